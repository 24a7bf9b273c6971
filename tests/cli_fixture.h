// The program as a process: what its tests share.
#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "io/exr.h"
#include "io/exr_window.h"
#include "support.h"

namespace raymeld::test {

// What oiiotool would call "64x48+5+3": where a window starts, and its size.
inline Imath::Box2i window(int x, int y, int width, int height) {
  return {{x, y}, {x + width - 1, y + height - 1}};
}

// The three names of each layer that the tiny models take, and alpha.
inline const std::vector<std::string> kColorNames = {"R", "G", "B"};
inline const std::vector<std::string> kLayeredNames = {
    "R", "G", "B", "normal.X", "normal.Y", "normal.Z", "albedo.R", "albedo.G", "albedo.B", "A"};

// (names.size(), H, W) between 0 and 1, the same on every machine.
inline Image random_image(const std::vector<std::string>& names, int width, int height, uint64_t seed) {
  Image image(width, height, int(names.size()));
  image.data = floats(random_planes(image.channels, height, width, Fill::kUniform, seed));
  for (float& value : image.data) value = 0.5f * value + 0.5f;
  return image;
}

// The (C, height, width) part of `image` whose top-left pixel is (x, y).
inline Image crop(const Image& image, int x, int y, int width, int height) {
  Image part(width, height, image.channels);
  for (int c = 0; c < image.channels; ++c)
    for (int row = 0; row < height; ++row)
      std::copy_n(&image.plane(c)[(y + row) * image.width + x], width, &part.at(c, row, 0));
  return part;
}

// (C, s*h, s*w) -> (C, h, w): the top-left pixel of each s x s cell (Hou et al. 2021, section 3.3).
inline Image degrade_nearest(const Image& image, int scale) {
  Image low(image.width / scale, image.height / scale, image.channels);
  for (int c = 0; c < low.channels; ++c)
    for (int y = 0; y < low.height; ++y)
      for (int x = 0; x < low.width; ++x) low.at(c, y, x) = image.at(c, y * scale, x * scale);
  return low;
}

inline void write_image(const std::filesystem::path& path, const std::vector<std::string>& names,
                        const Image& image, const Imath::Box2i& data, const Imath::Box2i& display,
                        Imf::PixelType type = Imf::HALF) {
  ExrOutput output;
  output.source = Imf::Header(display, data);
  for (size_t c = 0; c < names.size(); ++c) output.planes.push_back({names[c], type, image.plane(int(c))});
  write_exr(path, output);
}

inline void write_image(const std::filesystem::path& path, const std::vector<std::string>& names,
                        const Image& image, Imf::PixelType type = Imf::HALF) {
  const Imath::Box2i whole = window(0, 0, image.width, image.height);
  write_image(path, names, image, whole, whole, type);
}

class Cli : public testing::Test {
 protected:
  // An x4 pair: low.exr 8 x 6 and high.exr 32 x 24 with layers and alpha.
  void SetUp() override {
    write_image(folder_ / "low.exr", kColorNames, random_image(kColorNames, 8, 6, 1));
    write_image(folder_ / "high.exr", kLayeredNames, random_image(kLayeredNames, 32, 24, 2));
    environment_ = {{"XDG_CACHE_HOME", (folder_ / "cache").string()}, {"RAYMELD_MODELS", std::nullopt}};
  }

  ProcessResult run(std::vector<std::string> arguments) const {
    arguments.insert(arguments.begin(), RAYMELD_PROGRAM);
    return run_process(arguments, {.directory = folder_.path(), .environment = environment_});
  }
  // `fuse` of the pair to out.exr with the tiny model of scale 4.
  static std::vector<std::string> fuse(const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = {"fuse", "--lrhs",  "low.exr", "--hrls",    "high.exr",
                                          "-o",   "out.exr", "--model", tiny_model()};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }
  static std::string tiny_model() { return source_path("tests/golden/tiny-x4.safetensors").string(); }

  // The program with fault_layer/ between it and the driver.
  void add_fault_layer() {
    environment_["VK_LAYER_PATH"] = RAYMELD_FAULT_LAYER;
    environment_["VK_INSTANCE_LAYERS"] = "VK_LAYER_RAYMELD_faults";
    environment_["NODEVICE_SELECT"] = "1";  // a layer of Mesa, whose calls are not the program's
    environment_["RAYMELD_CALLS"] = (folder_ / "cache" / "calls.txt").string();
  }

  struct CallCount {
    int calls = 0, alive = 0;
  };
  // Returns what the last run called, by function; empty when its instance was not destroyed.
  std::map<std::string, CallCount> calls() const {
    std::map<std::string, CallCount> result;
    std::ifstream stream(folder_ / "cache" / "calls.txt");
    std::string function;
    for (CallCount count; stream >> function >> count.calls >> count.alive;) result[function] = count;
    return result;
  }

  // The program with sync_log/ between it and the disk; its log is sync_log().
  void add_sync_log() {
    environment_["LD_PRELOAD"] = RAYMELD_SYNC_LOG_LIBRARY;
    environment_["RAYMELD_SYNC_LOG"] = (folder_ / "cache" / "sync.txt").string();
    environment_["ASAN_OPTIONS"] = "detect_leaks=0:verify_asan_link_order=0";  // it asks to be the first
  }
  std::string sync_log() const { return read_file(folder_ / "cache" / "sync.txt"); }

  // Runs the program and holds it back until its stderr holds `text` and, after options.signal, options.then
  // has returned. `hold` and `where` say at what: RAYMELD_HOLD_SUBMIT and a number, see fault_layer/, or
  // RAYMELD_HOLD_SYNC and a part of a path, see sync_log/.
  ProcessResult run_held(const std::string& hold, const std::string& where,
                         std::vector<std::string> arguments, const std::string& text,
                         ProcessOptions options = {}) {
    const std::filesystem::path gate = folder_ / "cache" / "gate", late = gate.string() + ".late";
    std::filesystem::remove(gate);
    options.directory = folder_.path();
    options.environment = environment_;
    options.environment[hold] = where + " " + gate.string();
    options.signal_after = text;
    options.then = [gate, then = options.then] {
      if (then) then();
      write_file(gate, "");
    };
    arguments.insert(arguments.begin(), RAYMELD_PROGRAM);
    const ProcessResult result = run_process(arguments, options);
    EXPECT_TRUE(std::filesystem::exists(gate)) << "never said '" << text << "': " << result.err;
    EXPECT_FALSE(std::filesystem::exists(late)) << "did not say '" << text << "' while it was held";
    return result;
  }
  // The number of submits of the last run, which had the fault layer.
  std::string submits() const { return std::to_string(calls().at("vkQueueSubmit").calls); }

  // The program fails, says all `texts` on stderr, prints nothing and leaves the files as they were.
  ProcessResult expect_error(const std::vector<std::string>& arguments,
                             const std::vector<std::string>& texts) const {
    const std::set<std::string> before = files();
    const ProcessResult result = run(arguments);
    EXPECT_EQ(result.exit_status, 2) << result.err;
    EXPECT_EQ(result.out, "");
    for (const std::string& text : texts)
      EXPECT_NE(result.err.find(text), std::string::npos) << "'" << text << "' in: " << result.err;
    EXPECT_EQ(files(), before);
    return result;
  }

  nlohmann::json run_json(const std::vector<std::string>& arguments) const {
    const ProcessResult result = run(arguments);
    EXPECT_EQ(result.exit_status, 0) << result.err;
    return nlohmann::json::parse(result.out);
  }

  // The names of the files and folders there are, without the cache.
  std::set<std::string> files() const {
    std::set<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(folder_.path()))
      names.insert(entry.path().filename().string());
    names.erase("cache");
    return names;
  }
  Image read(const std::string& name, const std::vector<std::string>& channels = kColorNames) const {
    return ExrFile(folder_ / name).read(channels);
  }

  TemporaryDirectory folder_;
  std::map<std::string, std::optional<std::string>> environment_;
};

}  // namespace raymeld::test
