// Tests which model a curve chooses.
#include "choice/curve.h"

#include <gtest/gtest.h>

#include <cmath>

#include "error_of.h"
#include "support.h"

namespace raymeld::test {
namespace {

Candidate candidate(const std::string& name, double time_ms, double psnr_db) {
  return {.point = {.model = name, .scale = 4, .time_ms = 1, .psnr_db = psnr_db}, .time_ms = time_ms};
}

std::vector<std::string> names_of(const std::vector<Candidate>& candidates) {
  std::vector<std::string> names;
  for (const Candidate& candidate : candidates) names.push_back(candidate.point.model);
  return names;
}

const std::vector<Candidate> kFront{candidate("a", 10, 30), candidate("b", 20, 30.2),
                                    candidate("c", 80, 30.21)};

TEST(Curve, FrontHasWhatNoOtherBeats) {
  const std::vector<Candidate> front =
      front_of({candidate("slow", 9, 30), candidate("best", 20, 33), candidate("fast", 5, 31),
                candidate("twin", 5, 30.5), candidate("equal", 30, 33)});
  EXPECT_EQ(names_of(front), (std::vector<std::string>{"fast", "best"}));
}

TEST(Curve, LevelsAreRatesOfExchange) {
  EXPECT_EQ(at_level(kFront, 0).point.model, "a");
  EXPECT_EQ(at_level(kFront, 100).point.model, "c");
  // A doubling of the time must bring 0.1 dB. The first brings 0.2, the quadrupling after it only 0.01.
  EXPECT_EQ(at_level(kFront, kBalanced).point.model, "b");
  EXPECT_EQ(at_level(kFront, 34).point.model, "b");  // a doubling must bring 0.194
  EXPECT_EQ(at_level(kFront, 33).point.model, "a");  // a doubling must bring 0.203
  EXPECT_EQ(at_level(kFront, 96).point.model, "c");  // a doubling must bring 0.0042, and brings 0.005
  EXPECT_EQ(at_level(kFront, 95).point.model, "b");  // a doubling must bring 0.0053
}

TEST(Curve, BudgetIsKept) {
  EXPECT_EQ(within_budget(kFront, 80).point.model, "c");
  EXPECT_EQ(within_budget(kFront, 79.9).point.model, "b");
  EXPECT_EQ(within_budget(kFront, 15).point.model, "a");
  EXPECT_EQ(within_budget(kFront, 1).point.model, "a");
}

TEST(Curve, IsKeptInAFile) {
  const TemporaryDirectory folder;
  const Curve curve{
      .device = "device",
      .data = "set",
      .points = {{.model = "x2-a", .scale = 2, .time_ms = 12.5, .psnr_db = 33.25},
                 {.model = "x4-b", .scale = 4, .time_ms = 1, .psnr_db = 30, .task = Task::kUpscale}}};
  save_curve(folder / "curve.json", curve);
  const Curve loaded = load_curve(folder / "curve.json");
  EXPECT_EQ(loaded.device, "device");
  EXPECT_EQ(loaded.data, "set");
  ASSERT_EQ(loaded.points.size(), 2u);
  EXPECT_EQ(loaded.points[0].model, "x2-a");
  EXPECT_EQ(loaded.points[0].scale, 2u);
  EXPECT_EQ(loaded.points[0].time_ms, 12.5);
  EXPECT_EQ(loaded.points[0].psnr_db, 33.25);
  EXPECT_EQ(loaded.points[0].task, Task::kFuse);
  EXPECT_EQ(loaded.points[1].task, Task::kUpscale);
}

TEST(Curve, BadFilesAreErrorsThatNameThem) {
  const TemporaryDirectory folder;
  const std::filesystem::path file = folder / "curve.json";
  const auto error = [&](std::string_view content) {
    write_file(file, content);
    return error_of([&] { load_curve(file); });
  };
  EXPECT_NE(error("{").find("curve '" + file.string() + "'"), std::string::npos);
  EXPECT_NE(error(R"({"format_version": 9})").find("its format_version is 9, expected 3"), std::string::npos);
  EXPECT_NE(error(R"({"format_version": 3, "device": "", "data": "", "points": [{"model": "x2-a"}]})")
                .find("scale"),
            std::string::npos);
  EXPECT_NE(error(R"({"format_version": 3, "device": "", "data": "", "points": [{"model": "x2-a", "scale": 2,
                      "time_ms": 1, "psnr_db": 30, "task": "guess"}]})")
                .find("task 'guess' is unknown"),
            std::string::npos);
  std::filesystem::remove(file);
  EXPECT_NE(error_of([&] { load_curve(file); }).find("cannot be read"), std::string::npos);
}

}  // namespace
}  // namespace raymeld::test
