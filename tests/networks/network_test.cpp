#include "networks/network.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "fusion/fuser.h"
#include "golden.h"
#include "gpu.h"
#include "subject.h"
#include "within_bounds.h"

namespace raymeld::test {
namespace {

using reference::Bounded;
using reference::Outputs;
using reference::Planes;
using reference::Precision;

class NetworkTest : public GpuTest {};

Subject subject_of(const Golden& golden) {
  return {golden.architecture, golden.weights, golden.lrhs, golden.hrls};
}

// Compares each layer and the whole network with the reference.
TEST_F(NetworkTest, GoldenNetworksByAllKernels) {
  conform::Options options{.on_finding = expect_passed};
  const conform::Collector collector(target(), options);
  size_t index = 0, combinations = 0;
  for (const std::string& name : golden_names()) {
    const Golden golden = load_golden(name);
    conform::Collector::for_each(
        conform::network_methods(gpu().info(), index++),
        [&](const conform::Method& method, Precision precision) {
          for (const float phase : {0.0f, (float(golden.architecture.scale) - 1) / 2}) {
            if (phase > 0 && method.name != "direct") continue;
            if (!is_tried(combinations++, 3)) continue;
            conform::conform_one(collector, fmt::format("{}, phase {}", name, phase), subject_of(golden),
                                 {method, precision, phase, float(golden.exposure)});
          }
        });
  }
}

// Compares with PyTorch's float64, which the file stores as floats: the bound is the carried one and that
// rounding. The golden models' weights are halves, so that both precisions compute the same network.
TEST_F(NetworkTest, GoldenOutputs) {
  for (const std::string& name : golden_names()) {
    const Golden golden = load_golden(name);
    for (const Precision precision : kPrecisions) {
      SCOPED_TRACE(fmt::format("{} {}", name, name_of(precision)));
      const Model model(golden_model_path(name));
      const conform::NetworkRun run = conform::run_network(
          target(), model, subject_of(golden),
          {.storage = storage_of(precision), .phase = float(golden.phase), .samples = golden.samples});
      EXPECT_NEAR(run.report.exposure, golden.exposure, 1e-6 * golden.exposure);
      const conform::Method direct = conform::direct_method(gpu().info());
      const Outputs carried =
          reference::network(golden.architecture, golden.weights, golden.lrhs, golden.hrls, golden.phase,
                             precision, {}, run.report.exposure, {}, direct.units(precision));
      const auto check = [&](const std::string& layer, const Planes& device) {
        const auto known = golden.outputs.find(layer);
        if (known == golden.outputs.end()) return;  // sums over groups have no weights, so no golden
        Bounded expected{known->second, carried.at(layer).bound};
        for (size_t i = 0; i < expected.bound.data.size(); ++i) {
          expected.bound.data[i] += reference::kUnit * std::abs(expected.value.data[i]);
        }
        EXPECT_TRUE(within_bounds("golden " + layer, device, expected));
      };
      for (const auto& [layer, device] : run.layers) check(layer, device);
      check("output", run.output);
    }
  }
}

TEST(Network, HasTheLayersOfThePaper) {
  const Model model(golden_model_path(4));
  Graph graph(Storage::kFloat32);
  network(graph, model, 6, 10, 0);
  std::vector<std::string> names;
  for (const Pass& pass : graph.passes()) names.push_back(pass.name);
  EXPECT_EQ(names, (std::vector<std::string>{"encode.lrhs",
                                             "encode.hrls",
                                             "above_clip",
                                             "hrls",
                                             "down.0",
                                             "down.1",
                                             "lrhs",
                                             "fuse",
                                             "groups.0.blocks.0.dense.0",
                                             "groups.0.blocks.0.dense.1",
                                             "groups.0.blocks.0.dense.2",
                                             "groups.0.blocks.0.merge",
                                             "groups.1.blocks.0.dense.0",
                                             "groups.1.blocks.0.dense.1",
                                             "groups.1.blocks.0.dense.2",
                                             "groups.1.blocks.0.merge",
                                             "up.0",
                                             "up.1",
                                             "rec",
                                             "decode"}));
  double flop = 0;
  for (const Pass& pass : graph.passes()) flop += pass.flop;
  // C is 5, R 3, D 3 and K 9, and each weight is a multiply and an add. Full-size layers count 16 times, and
  // x2 ones 4 times.
  const double hrls = 16 * 9 * 5 * 9, down = (4 + 1) * 9 * 20 * 5, low = 9 * 3 * 5 + 10 * 5;
  const double trunk = 2 * (9 * 3 * (5 + 8 + 11) + 14 * 5), up = (1 + 4) * 9 * 5 * 20, rec = 16 * 9 * 5 * 3;
  EXPECT_EQ(flop, 2 * 60 * (hrls + down + low + trunk + up + rec));
}

}  // namespace
}  // namespace raymeld::test
