#include "network.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "fuser.h"
#include "golden.h"
#include "gpu.h"
#include "subject.h"
#include "within_bounds.h"

namespace raymeld::test {
namespace {

using reference::Bounded;
using reference::LayerKind;
using reference::Outputs;
using reference::Planes;
using reference::Precision;

class NetworkTest : public GpuTest {};

// The reference's name of what a pass wrote: residuals and shuffles are part of its layers. Empty: only an
// intermediate of one.
std::string reference_name(const std::string& pass, const Graph& graph, const reference::Architecture& a) {
  if (pass.ends_with(".space_to_depth") || pass == "decode") return {};
  if (pass.ends_with(".pixel_shuffle")) return pass.substr(0, pass.find('.', 3));
  for (const Pass* layer : graph.layers()) {
    if (layer->name == pass + ".pixel_shuffle") return {};
  }
  for (int g = 0; g < a.groups; ++g) {
    if (pass != fmt::format("groups.{}.blocks.{}.merge", g, a.blocks - 1)) continue;
    return g + 1 == a.groups ? "trunk" : fmt::format("groups.{}", g);
  }
  return pass;
}

struct DeviceRun {
  std::map<std::string, Planes> layers;  // by the reference's names
  Planes output;
  FuseReport report;
};

DeviceRun run_on_gpu(const std::filesystem::path& file, const reference::Architecture& architecture,
                     const Planes& lrhs, const Planes& hrls, float phase, Precision precision, float exposure,
                     const Kernels& kernels = {}) {
  const Model model(file);
  Fuser fuser(gpu(), model, uint32_t(lrhs.h), uint32_t(lrhs.w),
              {.storage = storage_of(precision),
               .kernels = kernels,
               .phase = phase,
               .exposure = exposure,
               .keep_activations = true},
              shared_cache_folder());
  Image fused;
  DeviceRun run;
  run.report = fuser.fuse(image_of(lrhs), image_of(hrls), fused);
  run.output = planes_of(fused);
  for (const Pass* layer : fuser.graph().layers()) {
    const std::string name = reference_name(layer->name, fuser.graph(), architecture);
    if (name.empty()) continue;
    const Shape& shape = layer->output()->shape;
    run.layers[name] = planes(int(shape.channels), int(shape.height), int(shape.width),
                              fuser.program().read(*layer->output()));
  }
  return run;
}

// Each layer against the reference fed with the device's own values, then the whole with bounds carried
// through all layers.
void check_against_reference(const std::filesystem::path& file, const Subject& subject, float phase,
                             Precision precision, float exposure, const Kernels& kernels = {}, int tile = 0,
                             int units = 1) {
  const DeviceRun run =
      run_on_gpu(file, subject.architecture, subject.lrhs, subject.hrls, phase, precision, exposure, kernels);
  reference::Weights weights;
  for (const auto& [name, conv] : subject.weights) weights[name] = round_to(conv, precision);
  const Outputs layers = reference::network(subject.architecture, weights, subject.lrhs, subject.hrls, phase,
                                            precision, run.layers, exposure, tile, units);
  for (const auto& [name, device] : run.layers) {
    EXPECT_TRUE(within_bounds(fmt::format("{} {}", name, name_of(precision)), device, layers.at(name)));
  }
  EXPECT_TRUE(within_bounds("output " + name_of(precision), run.output, layers.at("output")));
  const Outputs carried = reference::network(subject.architecture, weights, subject.lrhs, subject.hrls, phase,
                                             precision, {}, exposure, tile, units);
  EXPECT_TRUE(within_bounds("carried " + name_of(precision), run.output, carried.at("output")));
  EXPECT_EQ(run.report.status.saturated, 0u);
}

TEST_F(NetworkTest, GoldenNetworksLayerByLayer) {
  for (const std::string& name : golden_names()) {
    const Golden golden = load_golden(name);
    const Subject subject{golden.architecture, golden.weights, golden.lrhs, golden.hrls};
    for (const Precision precision : kPrecisions) {
      for (const float phase : {0.0f, (float(golden.architecture.scale) - 1) / 2}) {
        SCOPED_TRACE(fmt::format("{} {} phase {}", name, name_of(precision), phase));
        check_against_reference(golden_model_path(name), subject, phase, precision, float(golden.exposure));
      }
    }
  }
}

// By every tile, activations in buffers and by address. The golden networks have few channels, so that parts
// and bands are small, to have several.
TEST_F(NetworkTest, GoldenNetworksByMinimalFiltering) {
  if (!gpu().info().buffer_device_address) GTEST_SKIP() << "the device has no buffer addresses";
  for (const std::string& name : golden_names()) {
    const Golden golden = load_golden(name);
    const Subject subject{golden.architecture, golden.weights, golden.lrhs, golden.hrls};
    for (const auto& [tile, addressed, precision] : {std::tuple(2u, false, Precision::kFp32),
                                                     {4u, true, Precision::kFp32},
                                                     {4u, true, Precision::kFp16}}) {
      SCOPED_TRACE(
          fmt::format("{} F({}, 3) {}{}", name, tile, name_of(precision), addressed ? " by address" : ""));
      const Kernels kernels{
          .addressed = addressed, .conv2d = [tile = tile](const Conv2dShape& shape) {
            return Conv2dKernel{
                .tile = shape.kernel == 1 ? 1 : tile, .outputs = 8, .channels = 8, .band = 64};
          }};
      check_against_reference(golden_model_path(name), subject, 0, precision, float(golden.exposure), kernels,
                              int(tile));
    }
  }
}

TEST_F(NetworkTest, GoldenNetworksByCooperativeMatrices) {
  const auto& matrix = gpu().info().cooperative_matrix;
  if (!matrix) GTEST_SKIP() << "the device has no cooperative matrices";
  const Kernels kernels{.conv2d = [&](const Conv2dShape&) {
    return Conv2dKernel{.matrix = MatrixTiles{*matrix, matrix->m, 1, 2, matrix->k}};
  }};
  for (const std::string& name : golden_names()) {
    SCOPED_TRACE(name);
    const Golden golden = load_golden(name);
    const Subject subject{golden.architecture, golden.weights, golden.lrhs, golden.hrls};
    check_against_reference(golden_model_path(name), subject, 0, Precision::kFp16, float(golden.exposure),
                            kernels, 0, reference::kMatrixUnits);
  }
}

// Against PyTorch's float64, which the file stores as floats: the carried bound and that rounding. The
// weights of the golden models are halves, so that both precisions compute the same network.
TEST_F(NetworkTest, GoldenOutputs) {
  for (const std::string& name : golden_names()) {
    const Golden golden = load_golden(name);
    for (const Precision precision : kPrecisions) {
      SCOPED_TRACE(fmt::format("{} {}", name, name_of(precision)));
      const DeviceRun run = run_on_gpu(golden_model_path(name), golden.architecture, golden.lrhs, golden.hrls,
                                       float(golden.phase), precision, 0);
      EXPECT_NEAR(run.report.exposure, golden.exposure, 1e-6 * golden.exposure);
      const Outputs carried =
          reference::network(golden.architecture, golden.weights, golden.lrhs, golden.hrls, golden.phase,
                             precision, {}, run.report.exposure);
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

struct Variant {
  reference::Architecture architecture;
  int height, width;
};

std::vector<Variant> variants() {
  using enum LayerKind;
  using enum reference::Base;
  constexpr auto kLinear = reference::Transfer::kLinear, kLog = reference::Transfer::kLog;
  // scale, C, R, D, B, G, layers, long skip fused, merge ReLU, base, transfer, clip
  return {
      {{2, 1, 1, 1, 1, 1, {kRadiance}, false, false, kNone, kLinear, 100}, 1, 1},
      {{4, 9, 5, 2, 1, 1, {kRadiance, kAlbedo}, true, false, kBilinear, kLog, 1000}, 1, 7},
      {{8, 3, 4, 1, 1, 2, {kRadiance, kNormal, kRadiance}, false, true, kBilinear, kLinear, 10}, 1, 1},
      {{2,
        8,
        9,
        3,
        2,
        1,
        {kRadiance, kAlbedo, kNormal, kRadiance, kRadiance, kVariance},
        true,
        true,
        kBilinear,
        kLinear,
        100},
       9,
       5},
      {{4, 4, 3, 1, 1, 3, {kRadiance, kAlbedo, kNormal}, false, false, kNone, kLog, 50}, 9, 5},
      {{8, 5, 2, 2, 1, 1, {kRadiance}, true, true, kNone, kLog, 1000}, 1, 7},
      // further: unshuffled HRLS, direct upscaling, guide, both samplings, M, head
      {{2, 3, 2, 1, 1, 1, {kRadiance}, false, false, kBilinear, kLog, 100, true, true, true, true, 5, 0},
       1,
       1},
      {{4,
        5,
        3,
        1,
        1,
        1,
        {kRadiance, kNormal},
        true,
        false,
        kBilinear,
        kLog,
        100,
        true,
        true,
        false,
        true,
        2,
        3,
        2},
       1,
       7},
      {{8, 2, 3, 1, 2, 1, {kRadiance}, false, true, kNone, kLinear, 10, false, true, false, false, 1, 4, 1},
       3,
       1},
      {{4,
        4,
        2,
        1,
        1,
        2,
        {kRadiance, kAlbedo},
        false,
        false,
        kBilinear,
        kLinear,
        50,
        true,
        false,
        false,
        true,
        0,
        9,
        1},
       9,
       5},
      // joint base
      {{2, 3, 2, 1, 1, 1, {kRadiance, kNormal, kAlbedo}, false, false, kJoint, kLinear, 30}, 9, 5},
      {{4,    4,     2,      1,    1,    1,    {kRadiance, kAlbedo, kNormal, kVariance},
        true, false, kJoint, kLog, 1000, true, true,
        true, true,  3,      5,    3,    20},
       1,
       7},
      {{8, 3, 2, 1, 1, 1, {kRadiance, kRadiance, kAlbedo, kNormal}, false, false, kJoint, kLog, 100}, 1, 1},
  };
}

TEST_F(NetworkTest, OtherArchitecturesLayerByLayer) {
  const TemporaryDirectory folder;
  uint64_t seed = 100;
  for (const auto& [a, height, width] : variants()) {
    SCOPED_TRACE(fmt::format("x{}, C {}, R {}, {} x {}", a.scale, a.features, a.growth, height, width));
    const Subject subject = make_subject(a, height, width, ++seed);
    const std::filesystem::path file = folder / "model.safetensors";
    write_model(file, a, subject.weights);
    for (const Precision precision : kPrecisions) {
      const float exposure = std::array{1.0f, 0.037f, 2.3f}[seed % 3];
      check_against_reference(file, subject, (float(a.scale) - 1) / 2, precision, exposure);
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
                                             "highlights",
                                             "hrls",
                                             "down.0.space_to_depth",
                                             "down.0",
                                             "down.1.space_to_depth",
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
                                             "up.0.pixel_shuffle",
                                             "up.1",
                                             "up.1.pixel_shuffle",
                                             "rec",
                                             "decode"}));
  double flop = 0;
  for (const Pass& pass : graph.passes()) flop += pass.flop;
  // C 5, R 3, D 3, K 9, two multiplies and adds a weight; full-size layers count 16 times, x2 ones 4 times.
  const double hrls = 16 * 9 * 5 * 9, down = (4 + 1) * 9 * 20 * 5, low = 9 * 3 * 5 + 10 * 5;
  const double trunk = 2 * (9 * 3 * (5 + 8 + 11) + 14 * 5), up = (1 + 4) * 9 * 5 * 20, rec = 16 * 9 * 5 * 3;
  EXPECT_EQ(flop, 2 * 60 * (hrls + down + low + trunk + up + rec));
}

}  // namespace
}  // namespace raymeld::test
