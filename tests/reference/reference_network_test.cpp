#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "golden.h"
#include "reference/reference.h"
#include "support.h"
#include "within_bounds.h"

namespace raymeld::reference {
namespace {

using test::within_bounds;

Architecture small(int scale) {
  Architecture a{.scale = scale, .features = 4, .growth = 3, .dense_layers = 2, .blocks = 2, .groups = 2};
  a.hrls_layers = {LayerKind::kRadiance, LayerKind::kAlbedo, LayerKind::kNormal};
  a.transfer = Transfer::kLog;
  a.clip = 100;
  a.has_base = true;
  return a;
}

struct Case {
  Architecture architecture;
  Weights weights;
  Planes lrhs, hrls;

  Case(const Architecture& a, Precision precision, int h, int w)
      : architecture(a),
        weights(test::random_weights(a, precision, 100)),
        lrhs(round_to(random_planes(3, h, w, Fill::kUniform, 1), precision)),
        hrls(round_to(random_planes(9, h * a.scale, w * a.scale, Fill::kUniform, 2), precision)) {}

  Outputs run(Precision precision, const std::map<std::string, Planes>& given = {}) const {
    return network(architecture, weights, lrhs, hrls, 0, precision, given);
  }
};

void zero_trunk(Weights& weights, double merge_bias) {
  for (auto& [name, conv] : weights) {
    if (!name.starts_with("groups.")) continue;
    std::fill(conv.weight.begin(), conv.weight.end(), 0);
    std::fill(conv.bias.begin(), conv.bias.end(), name.ends_with(".merge") ? merge_bias : 0);
  }
}

void expect_planes(const Planes& actual, int c, int h, int w) {
  EXPECT_EQ(actual.c, c);
  EXPECT_EQ(actual.h, h);
  EXPECT_EQ(actual.w, w);
}

TEST(Network, LayersAndShapes) {
  Architecture a = small(4);
  a.blocks = 1;
  const Outputs y = Case(a, Precision::kFp32, 3, 5).run(Precision::kFp32);
  std::string names;
  for (const auto& [name, output] : y) names += name + ' ';
  EXPECT_EQ(names,
            "above_clip down.0 down.1 encode.hrls encode.lrhs fuse "
            "groups.0 groups.0.blocks.0.dense.0 groups.0.blocks.0.dense.1 groups.0.blocks.0.merge "
            "groups.1 groups.1.blocks.0.dense.0 groups.1.blocks.0.dense.1 groups.1.blocks.0.merge "
            "hrls lrhs output rec trunk up.0 up.1 ");
  expect_planes(y.at("lrhs").value, 4, 3, 5);
  expect_planes(y.at("hrls").value, 4, 12, 20);
  expect_planes(y.at("down.0").value, 4, 6, 10);
  expect_planes(y.at("down.1").value, 4, 3, 5);
  expect_planes(y.at("groups.1.blocks.0.dense.1").value, 3, 3, 5);
  expect_planes(y.at("up.0").value, 4, 6, 10);
  expect_planes(y.at("output").value, 3, 12, 20);
}

// If the trunk's weights are zero, a block returns its input, and a group twice its input.
TEST(Network, SkipsAddUp) {
  for (const bool long_skip_fused : {false, true}) {
    Architecture a = small(2);
    a.long_skip_fused = long_skip_fused;
    Case c(a, Precision::kFp32, 2, 3);
    zero_trunk(c.weights, 0);
    const Outputs y = c.run(Precision::kFp32);
    const Planes &fused = y.at("fuse").value, &skip = y.at(long_skip_fused ? "fuse" : "lrhs").value;
    for (size_t i = 0; i < fused.data.size(); ++i) {
      EXPECT_EQ(y.at("groups.0.blocks.1.merge").value.data[i], fused.data[i]);
      EXPECT_EQ(y.at("groups.0").value.data[i], 2 * fused.data[i]);
      EXPECT_EQ(y.at("groups.1").value.data[i], 4 * fused.data[i]);
      EXPECT_EQ(y.at("trunk").value.data[i], 4 * fused.data[i] + skip.data[i]);
    }
  }
}

TEST(Network, MergeReluActsBeforeTheAdd) {
  for (const bool merge_relu : {false, true}) {
    Architecture a = small(2);
    a.merge_relu = merge_relu;
    Case c(a, Precision::kFp32, 2, 3);
    zero_trunk(c.weights, -1);
    const Outputs y = c.run(Precision::kFp32);
    for (size_t i = 0; i < y.at("fuse").value.data.size(); ++i) {
      EXPECT_EQ(y.at("groups.0.blocks.0.merge").value.data[i],
                y.at("fuse").value.data[i] - (merge_relu ? 0 : 1));
    }
  }
}

// Returns the outputs of a device that rounds every layer's output to half. Each pass gives one more layer
// the values that the device would have.
std::map<std::string, Planes> half_device(const Case& c) {
  std::map<std::string, Planes> stored;
  for (bool changed = true; changed;) {
    changed = false;
    for (const auto& [name, output] : c.run(Precision::kFp16, stored)) {
      if (name == "output") continue;
      Planes rounded = round_to(output.value, Precision::kFp16);
      changed |= stored[name].data != rounded.data;
      stored[name] = std::move(rounded);
    }
  }
  return stored;
}

TEST(Network, HalfStorageStaysWithinTheCarriedBounds) {
  const Case c(small(2), Precision::kFp16, 3, 4);
  const Outputs expected = c.run(Precision::kFp16);
  const std::map<std::string, Planes> stored = half_device(c);
  for (const auto& [name, planes] : stored) EXPECT_TRUE(within_bounds(name, planes, expected.at(name)));
  const Planes output = c.run(Precision::kFp16, stored).at("output").value;
  EXPECT_TRUE(within_bounds("output", output, expected.at("output")));
  EXPECT_GT(worst(output, expected.at("output")).ratio, 1e-4);  // the bound is still of use at the end
}

TEST(Network, GivenOutputsBlameOnlyTheLayerThatIsWrong) {
  const Case c(small(2), Precision::kFp16, 3, 4);
  std::map<std::string, Planes> stored = half_device(c);
  stored.at("groups.0.blocks.0.merge").at(1, 2, 3) += 0.25;
  const Outputs expected = c.run(Precision::kFp16, stored);
  const auto fits = [&](const std::string& name) {
    return within_bounds(name, stored.at(name), expected.at(name));
  };
  EXPECT_TRUE(fits("groups.0.blocks.0.dense.1"));
  EXPECT_FALSE(fits("groups.0.blocks.0.merge"));
  EXPECT_FALSE(fits("groups.0.blocks.1.dense.0"));  // its output was computed from the right input
  EXPECT_TRUE(fits("trunk"));
}

class NetworkGolden : public testing::TestWithParam<std::string> {};

// Both sides compute in float64, and the golden outputs are then rounded to fp32.
TEST_P(NetworkGolden, EveryLayerIsPyTorchs) {
  const test::Golden golden = test::load_golden(GetParam());
  const Outputs y = network(golden.architecture, golden.weights, golden.lrhs, golden.hrls, golden.phase,
                            Precision::kFp32, {}, golden.exposure);
  for (const auto& [name, expected] : golden.outputs) {
    double largest = 0;
    for (const double v : expected.data) largest = std::max(largest, std::abs(v));
    EXPECT_GT(largest, 0) << name;
    Bounded near = exact(expected);
    for (double& bound : near.bound.data) bound = 1e-12 * largest;
    for (size_t i = 0; i < expected.data.size(); ++i)
      near.bound.data[i] += kUnit * std::abs(expected.data[i]);
    EXPECT_TRUE(within_bounds(name, y.at(name).value, near));
  }
}

INSTANTIATE_TEST_SUITE_P(Models, NetworkGolden, testing::ValuesIn(test::golden_names()),
                         [](const auto& info) { return "n" + std::to_string(info.index); });

TEST(Network, AMissingGoldenIsAFailure) { EXPECT_ANY_THROW(test::load_golden("tiny-x3")); }

TEST(Network, RefusesWhatDoesNotFit) {
  Case c(small(2), Precision::kFp32, 1, 1);
  c.weights.erase("fuse");
  EXPECT_THROW(c.run(Precision::kFp32), std::invalid_argument);
  Case d(small(2), Precision::kFp32, 1, 1);
  d.hrls = Planes(6, 2, 2);
  EXPECT_THROW(d.run(Precision::kFp32), std::invalid_argument);
}

}  // namespace
}  // namespace raymeld::reference
