#include "fusion/tuner.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>

#include "gpu.h"
#include "matrix.h"
#include "networks/network.h"
#include "subject.h"

namespace raymeld::test {
namespace {

class TunerTest : public GpuTest {
 protected:
  TemporaryDirectory folder_;
};

constexpr CooperativeMatrix kSmallMatrix{
    .m = 8, .n = 8, .k = 8, .subgroup_size = 8, .max_invocations = 1024, .max_shared_bytes = 32768};
constexpr Conv2dShape kSmall{.height = 16, .width = 16, .channels_in = 5, .channels_out = 7, .kernel = 3};
constexpr Conv2dShape kSmall1x1{.height = 16, .width = 16, .channels_in = 5, .channels_out = 7, .kernel = 1};

// example() has these.
constexpr Conv2dShape kByWinograd{
    .height = 128, .width = 128, .channels_in = 64, .channels_out = 64, .kernel = 3};
constexpr Conv2dShape kByMatrices{
    .height = 64, .width = 64, .channels_in = 64, .channels_out = 64, .kernel = 3};
constexpr Conv2dShape kByVectors{
    .height = 128, .width = 128, .channels_in = 320, .channels_out = 64, .kernel = 1};

Conv2dKernel columns(uint32_t tile) { return {.algorithm = Algorithm::kColumns, .tile = tile}; }

Tuning example() {
  Tuning tuning;
  tuning.entries[kByWinograd] = {.kernel = {.algorithm = Algorithm::kWinograd, .outputs = 24, .band = 512},
                                 .time_ms = 1.5,
                                 .direct_ms = 30};
  tuning.entries[{
      .height = 128, .width = 128, .channels_in = 64, .channels_out = 64, .kernel = 3, .most_tile = 2}] = {
      .kernel = {.algorithm = Algorithm::kWinograd, .tile = 2, .order = 0}, .time_ms = 2.5, .direct_ms = 30};
  tuning.entries[{.height = 512, .width = 512, .channels_in = 16, .channels_out = 8, .kernel = 3}] = {
      .kernel = {}, .time_ms = 3, .direct_ms = 3};
  tuning.entries[{.height = 64, .width = 64, .channels_in = 8, .channels_out = 8, .kernel = 3}] = {
      .kernel = columns(4), .time_ms = 1, .direct_ms = 2};
  tuning.entries[kByMatrices] = {
      .kernel = {.algorithm = Algorithm::kMatrix, .matrix = {.matrix = kMatrix, .rows = 1}},
      .time_ms = 0.5,
      .direct_ms = 8};
  tuning.entries[kByVectors] = {.kernel = {.algorithm = Algorithm::kPointwise, .band = 4096, .vector = 8},
                                .time_ms = 4,
                                .direct_ms = 20};
  return tuning;
}

DeviceInfo device_with_addresses() {
  DeviceInfo info;
  info.buffer_device_address = true;
  info.vector_lanes = 8;
  return info;
}

TEST(DefaultKernels, TakeDotProductsWhereMatricesAreNoFaster) {
  DeviceInfo info;
  info.cooperative_matrix = kMatrix;
  const auto by_matrices = [&](uint32_t channels_in, uint32_t channels_out, uint32_t kernel,
                               Storage storage = Storage::kFloat16) {
    const Kernels kernels = default_kernels(info, storage);
    const Conv2dShape shape{64, 64, channels_in, channels_out, kernel};
    return kernels.conv2d && kernels.conv2d(shape).algorithm == Algorithm::kMatrix;
  };
  info.name = "NVIDIA GeForce RTX 4090";
  EXPECT_TRUE(by_matrices(64, 64, 3));
  EXPECT_TRUE(by_matrices(16, 3, 3));
  EXPECT_FALSE(by_matrices(64, 64, 3, Storage::kFloat32));
  info.half_dots = true;
  info.name = "AMD Radeon RX 7900 XTX (RADV NAVI31)";
  EXPECT_FALSE(by_matrices(64, 64, 3));
  info.name = "AMD Radeon RX 9070 XT (RADV GFX1201)";
  EXPECT_TRUE(by_matrices(24, 16, 3));
  EXPECT_FALSE(by_matrices(16, 16, 3));
  EXPECT_FALSE(by_matrices(64, 3, 3));
  EXPECT_FALSE(by_matrices(64, 16, 1));
  EXPECT_TRUE(by_matrices(64, 64, 1));
}

TEST(Tuning, IsKeptInAFile) {
  const TemporaryDirectory folder;
  const std::filesystem::path file = folder.path() / "new" / "tuning.json";
  Tuning tuning = example();
  tuning.addressed = true;
  save_tuning(file, tuning);
  const Tuning loaded = load_tuning(file);
  EXPECT_TRUE(loaded.addressed);
  ASSERT_EQ(loaded.entries.size(), tuning.entries.size());
  for (const auto& [shape, entry] : tuning.entries) {
    EXPECT_EQ(loaded.entries.at(shape).kernel, entry.kernel);
    EXPECT_EQ(loaded.entries.at(shape).time_ms, entry.time_ms);
    EXPECT_EQ(loaded.entries.at(shape).direct_ms, entry.direct_ms);
  }
}

TEST(Tuning, WhatIsNoFileIsNoTuning) {
  const TemporaryDirectory folder;
  EXPECT_TRUE(load_tuning(folder.path()).entries.empty());
  write_file(folder / "huge", "{");
  std::filesystem::resize_file(folder / "huge", 1 << 30);
  EXPECT_TRUE(load_tuning(folder / "huge").entries.empty());
}

TEST(Tuning, ADamagedFileIsNoTuning) {
  const TemporaryDirectory folder;
  const std::filesystem::path file = folder.path() / "tuning.json";
  EXPECT_TRUE(load_tuning(file).entries.empty());
  save_tuning(file, example());
  const std::string good = read_file(file);
  const auto entries_of = [&](const std::string& text) {
    std::ofstream(file) << text;
    return load_tuning(file).entries.size();
  };
  const auto changed = [&](const std::string& from, const std::string& to) {
    std::string text = good;
    EXPECT_NE(text.find(from), std::string::npos) << from;
    return entries_of(text.replace(text.find(from), from.size(), to));
  };
  EXPECT_EQ(entries_of(good), 6u);
  for (size_t length = 0; length + 2 < good.size(); length += 7)
    EXPECT_EQ(entries_of(good.substr(0, length)), 0u);
  EXPECT_EQ(changed("\"format_version\": 5", "\"format_version\": 4"), 0u);
  EXPECT_EQ(changed("\"winograd\"", "\"fourier\""), 0u);
  EXPECT_EQ(changed("\"pointwise\"", "\"winograd\""), 0u);
  EXPECT_EQ(changed("\"pointwise\"", "\"columns\", \"tile\": 2"), 0u);
  EXPECT_EQ(changed("\"columns\"", "\"pointwise\""), 0u);
  EXPECT_EQ(changed("\"tile\": 4", "\"tile\": 3"), 0u);
  EXPECT_EQ(changed("\"tile\": 4", "\"tile\": \"4\""), 0u);
  EXPECT_EQ(changed("\"tile\": 2", "\"tile\": 4"), 0u);  // F(4, 3) is refused for that shape
  EXPECT_EQ(changed("\"outputs\": 24", "\"outputs\": 0"), 0u);
  EXPECT_EQ(changed("\"band\": 512", "\"band\": 4000000000"), 0u);
  EXPECT_EQ(changed("\"band\": 4096", "\"band\": 511"), 0u);
  EXPECT_EQ(changed("\"channels\": 64", "\"channels\": 31"), 0u);
  EXPECT_EQ(changed("\"vector\": 8", "\"vector\": 65"), 0u);
  for (const char* height : {"-1", "1.5", "1e300", "4294967296", "null"})
    EXPECT_EQ(changed("\"height\": 128", fmt::format("\"height\": {}", height)), 0u) << height;
  EXPECT_EQ(changed("\n \"order\": 8", "\n \"order\": 257"), 0u);
  EXPECT_EQ(changed("\"rows\": 1", "\"rows\": 40"), 0u);
  EXPECT_EQ(changed("\"n\": 16", "\"n\": 12"), 0u);
  EXPECT_EQ(changed("\"subgroups\": 4", "\"subgroups\": 0"), 0u);
}

// A fuzzer that starts from files of an older format finds nothing but that.
TEST(Tuning, TheFuzzersCorpusHasTodaysFormat) {
  EXPECT_EQ(load_tuning(source_path("tests/fuzz/corpus/tuning/three-kernels.json")).entries.size(), 3u);
}

TEST(Tuning, ChoosesWhatWasMeasuredOrTheMostAlike) {
  const Conv2dChoice choose = example().kernels(device_with_addresses(), Storage::kFloat32).conv2d;
  const Conv2dShape by_winograd{
      .height = 120, .width = 160, .channels_in = 60, .channels_out = 64, .kernel = 3};
  const Conv2dShape by_small_tiles{
      .height = 128, .width = 128, .channels_in = 60, .channels_out = 64, .kernel = 3, .most_tile = 2};
  const Conv2dShape direct{.height = 500, .width = 500, .channels_in = 16, .channels_out = 6, .kernel = 3};
  const Conv2dShape pointwise{.height = 128, .width = 128, .channels_in = 3, .channels_out = 3, .kernel = 1};
  EXPECT_EQ(choose(kByWinograd).band, 512u);
  EXPECT_EQ(choose(by_winograd).outputs, 24u);
  EXPECT_EQ(choose(by_small_tiles), (Conv2dKernel{.algorithm = Algorithm::kWinograd, .tile = 2, .order = 0}));
  EXPECT_EQ(choose(direct).algorithm, Algorithm::kDirect);
  EXPECT_EQ(choose(pointwise).band, 4096u);
}

TEST(Tuning, NeverAsksADeviceForWhatItCannot) {
  const Kernels plain = default_kernels(DeviceInfo{}, Storage::kFloat32);
  EXPECT_FALSE(plain.addressed);
  EXPECT_EQ(plain.conv2d(kByWinograd), Conv2dKernel{});
  Tuning tuning = example();
  tuning.addressed = true;
  EXPECT_EQ(tuning.kernels(DeviceInfo{}, Storage::kFloat32).conv2d(kByWinograd), Conv2dKernel{});
  tuning.addressed = false;
  EXPECT_EQ(tuning.kernels(DeviceInfo{}, Storage::kFloat32).conv2d(kByWinograd), Conv2dKernel{});

  DeviceInfo device = device_with_addresses();
  EXPECT_EQ(tuning.kernels(device, Storage::kFloat32).conv2d(kByMatrices).winograd_tile(), 4u);
  device.cooperative_matrix = kSmallMatrix;
  EXPECT_EQ(tuning.kernels(device, Storage::kFloat32).conv2d(kByMatrices).winograd_tile(), 4u);
  device.cooperative_matrix = kMatrix;
  EXPECT_EQ(tuning.kernels(device, Storage::kFloat32).conv2d(kByMatrices).matrix.rows, 1u);
}

TEST(Tuning, GpusWithMatricesMultiplyThemByDefault) {
  DeviceInfo device = device_with_addresses();
  device.cooperative_matrix = kMatrix;
  const auto algorithm = [&](Storage storage) {
    return default_kernels(device, storage).conv2d(kByMatrices).algorithm;
  };
  EXPECT_EQ(algorithm(Storage::kFloat16), Algorithm::kMatrix);
  EXPECT_EQ(algorithm(Storage::kFloat32), Algorithm::kDirect);
  EXPECT_EQ(Tuning{}.kernels(device, Storage::kFloat16).conv2d(kByMatrices).algorithm, Algorithm::kMatrix);
  device.is_cpu = true;
  EXPECT_EQ(algorithm(Storage::kFloat16), Algorithm::kWinograd);
}

TEST(Tuning, AKernelOf5IsDirectOnGpusAndByWinogradOnCpus) {
  const Conv2dShape shape{.height = 64, .width = 64, .channels_in = 32, .channels_out = 32, .kernel = 5};
  DeviceInfo device = device_with_addresses();
  device.cooperative_matrix = kMatrix;
  device.name = "NVIDIA RTX";
  for (const bool is_cpu : {false, true}) {
    device.is_cpu = is_cpu;
    for (const Storage storage : {Storage::kFloat32, Storage::kFloat16})
      EXPECT_EQ(default_kernels(device, storage).conv2d(shape).algorithm,
                is_cpu ? Algorithm::kWinograd : Algorithm::kDirect);
  }
}

TEST(Tuning, AnImageOfOnePixelTakesNoMatrices) {
  DeviceInfo device = device_with_addresses();
  device.cooperative_matrix = kMatrix;
  Conv2dShape shape = kByMatrices;
  shape.height = shape.width = 1;
  EXPECT_EQ(default_kernels(device, Storage::kFloat16).conv2d(shape).algorithm, Algorithm::kDirect);
}

TEST(Tuning, GpusWithoutAnythingFasterGetColumnsThatFitTheirRegisters) {
  DeviceInfo device = device_with_addresses();
  const auto chosen = [&](const char* name, uint32_t most_tile, uint32_t kernel = 3) {
    device.name = name;
    return default_kernels(device, Storage::kFloat16).conv2d({64, 64, 24, 24, kernel, most_tile});
  };
  EXPECT_EQ(chosen("AMD Radeon RX 5700 XT (RADV NAVI10)", 4), columns(4));
  EXPECT_EQ(chosen("AMD Radeon RX 5700 XT (RADV NAVI10)", 2), columns(2));
  EXPECT_EQ(chosen("AMD Radeon RX 9070 XT (RADV GFX1201)", 4), columns(4));
  EXPECT_EQ(chosen("AMD Radeon RX Vega (RADV VEGA10)", 4), columns(2));
  EXPECT_EQ(chosen("AMD Radeon Graphics (RADV RENOIR)", 4), columns(2));
  EXPECT_EQ(chosen("NVIDIA GeForce RTX 4090 (NVK AD102)", 4), columns(4));
  EXPECT_EQ(chosen("NVIDIA GeForce GTX 680 (NVK GK104)", 4), Conv2dKernel{});
  EXPECT_EQ(chosen("Apple M1", 4), columns(2));
  EXPECT_EQ(chosen("Apple M1", 4, 1), Conv2dKernel{});
  EXPECT_EQ(chosen("a GPU of which nothing is known", 4), Conv2dKernel{});
  device.half_dots = true;
  EXPECT_EQ(chosen("AMD Radeon RX 6900 XT (RADV NAVI21)", 4), Conv2dKernel{});
  EXPECT_EQ(default_kernels(device, Storage::kFloat32).conv2d(kByMatrices), columns(4));
}

TEST(Tuning, ReadsByVectorsOfTheDevicesOwnOnly) {
  DeviceInfo device = device_with_addresses();
  EXPECT_EQ(example().kernels(device, Storage::kFloat32).conv2d(kByVectors).vector, 8u);
  device.vector_lanes = 16;
  EXPECT_EQ(example().kernels(device, Storage::kFloat32).conv2d(kByVectors).vector, 0u);
  EXPECT_EQ(default_kernels(device, Storage::kFloat32).conv2d(kByVectors).vector, 0u);
  device.is_cpu = true;
  EXPECT_EQ(default_kernels(device, Storage::kFloat32).conv2d(kByVectors).vector, 16u);
  EXPECT_EQ(default_kernels(device, Storage::kFloat32).vector, 16u);
  EXPECT_EQ(example().kernels(device, Storage::kFloat32).vector, 16u);
  device.buffer_device_address = false;
  EXPECT_EQ(default_kernels(device, Storage::kFloat32).vector, 0u);
  EXPECT_EQ(example().kernels(device, Storage::kFloat32).vector, 0u);
}

TEST(Tuning, StartsTheSearchWithWhatFitsSharedMemory) {
  Conv2dShape shape{.height = 128, .width = 128, .channels_in = 64, .channels_out = 64, .kernel = 3};
  EXPECT_EQ(first_matrix_guess(kMatrix, shape).matrix.outputs, 32u);
  shape.channels_out = 18;
  EXPECT_EQ(first_matrix_guess(kMatrix, shape).matrix.outputs, 32u);
  shape.channels_out = 12;
  EXPECT_EQ(first_matrix_guess(kMatrix, shape).matrix.outputs, 16u);
  shape.channels_out = 256;
  for (const uint32_t kernel : {1u, 3u}) {
    shape.kernel = kernel;
    EXPECT_TRUE(is_possible(first_matrix_guess(kSmallMatrix, shape).matrix, kernel));
  }
}

DeviceInfo device_with_everything() {
  DeviceInfo device = device_with_addresses();
  device.cooperative_matrix = kMatrix;
  return device;
}

constexpr Conv2dShape kShape3x3{
    .height = 64, .width = 64, .channels_in = 32, .channels_out = 32, .kernel = 3};

// Returns what tune() finds for one shape of 16-bit storage where `time` says how long a kernel takes.
Tuning::Entry tuned(const Conv2dShape& shape, const std::function<double(const Conv2dKernel&)>& time) {
  Tuning tuning;
  const Conv2dTimer timer = [&](bool, const Conv2dShape&, std::span<const Conv2dKernel> kernels) {
    std::vector<double> times;
    for (const Conv2dKernel& kernel : kernels) times.push_back(time(kernel));
    return times;
  };
  tune(device_with_everything(), Storage::kFloat16, timer, {shape}, tuning,
       [](const auto&, const auto&) { return true; });
  return tuning.entries.at(shape);
}

std::string kind_of(const Conv2dKernel& kernel) {
  switch (kernel.algorithm) {
    case Algorithm::kDirect:
      return "direct";
    case Algorithm::kPointwise:
      return "pointwise";
    case Algorithm::kColumns:
      return fmt::format("columns {}", kernel.tile);
    case Algorithm::kWinograd:
      return fmt::format("tile {}", kernel.tile);
    case Algorithm::kMatrix:
      return "matrices";
  }
  return "";
}

TEST(Tuner, TakesTheKindOfKernelThatIsFastest) {
  for (const std::string fastest : {"direct", "columns 2", "columns 4", "tile 2", "tile 4", "matrices"}) {
    const auto entry = tuned(kShape3x3, [&](const Conv2dKernel& k) { return kind_of(k) == fastest ? 2 : 5; });
    EXPECT_EQ(kind_of(entry.kernel), fastest);
    EXPECT_EQ(entry.time_ms, 2);
    EXPECT_EQ(entry.direct_ms, fastest == "direct" ? 2 : 5);
  }
  for (const std::string fastest : {"direct", "pointwise", "matrices"}) {
    const auto entry = tuned(kSmall1x1, [&](const Conv2dKernel& k) { return kind_of(k) == fastest ? 2 : 5; });
    EXPECT_EQ(kind_of(entry.kernel), fastest);
  }
}

TEST(Tuner, KeepsTheBestOfEachParameter) {
  const auto winograd = tuned(kShape3x3, [](const Conv2dKernel& k) {
    if (k.algorithm != Algorithm::kWinograd) return 9.0;
    return 9.0 - (k.tile == 4) - (k.outputs == 24) - (k.band == 1u << 18);
  });
  EXPECT_EQ(winograd.time_ms, 6);
  EXPECT_EQ(winograd.kernel.winograd_tile(), 4u);
  EXPECT_EQ(winograd.kernel.outputs, 24u);
  EXPECT_EQ(winograd.kernel.band, 1u << 18);
  const auto matrices = tuned(kShape3x3, [](const Conv2dKernel& k) {
    if (k.algorithm != Algorithm::kMatrix) return 9.0;
    return 8.0 - (k.matrix.rows == 1) - (k.matrix.outputs == 16) - (k.matrix.subgroups == 8);
  });
  EXPECT_EQ(matrices.time_ms, 5);
}

// What a limit of time leaves out has the least work.
TEST(Tuner, MeasuresFromTheMostWorkToTheLeastUntilItIsStopped) {
  Conv2dShape small = kShape3x3, large = kShape3x3;
  small.channels_out = 8, large.channels_out = 64;
  const Conv2dTimer timer = [](bool, const Conv2dShape&, std::span<const Conv2dKernel> kernels) {
    return std::vector<double>(kernels.size(), 1.0);
  };
  Tuning tuning;
  std::vector<Conv2dShape> measured;
  const auto until = [&](size_t count) {
    tune(device_with_everything(), Storage::kFloat16, timer, {small, large, kShape3x3}, tuning,
         [&](const Conv2dShape& shape, const auto&) {
           measured.push_back(shape);
           return measured.size() < count;
         });
  };
  until(2);
  EXPECT_EQ(measured, (std::vector{large, kShape3x3}));
  EXPECT_FALSE(tuning.entries.contains(small));
  until(4);
  EXPECT_EQ(measured, (std::vector{large, kShape3x3, small}));
}

TEST(Tuner, LeavesOutWhatTheDeviceCannotComputeButNotALostDevice) {
  const auto entry = tuned(kShape3x3, [](const Conv2dKernel& k) -> double {
    if (k.winograd_tile() == 4) return std::numeric_limits<double>::infinity();
    return k.winograd_tile() == 2 ? 1 : 2;
  });
  EXPECT_EQ(entry.kernel.winograd_tile(), 2u);
  EXPECT_THROW(tuned(kShape3x3,
                     [](const Conv2dKernel& k) -> double {
                       if (k.winograd_tile() == 4) throw DeviceLost("gone");
                       return 1;
                     }),
               DeviceLost);
}

// The device must compute every candidate: tune() silently passes over those that fail.
TEST_F(TunerTest, MeasuresEachShapeOnceByEveryKernel) {
  Tuning tuning;
  std::vector<Conv2dShape> measured;
  std::map<std::string, double> least_ms;  // keyed by shape and kind
  const Conv2dTimer time = [&](bool addressed, const Conv2dShape& shape,
                               std::span<const Conv2dKernel> kernels) {
    const auto times = time_conv2d(gpu(), shared_cache(), Storage::kFloat32, addressed, shape, kernels);
    EXPECT_EQ(times.size(), kernels.size());
    for (size_t i = 0; i < times.size(); ++i) {
      EXPECT_GT(times[i], 0);
      EXPECT_TRUE(std::isfinite(times[i]));
      const auto [at, is_new] = least_ms.emplace(
          fmt::format("{}x{}, {}", shape.kernel, shape.kernel, kind_of(kernels[i])), times[i]);
      at->second = std::min(at->second, times[i]);
    }
    return times;
  };
  const auto note = [&](const Conv2dShape& shape, const Tuning::Entry&) {
    measured.push_back(shape);
    return true;
  };
  tune(gpu().info(), Storage::kFloat32, time, {kSmall, kSmall1x1, kSmall}, tuning, note);
  EXPECT_EQ(measured, (std::vector{kSmall, kSmall1x1}));
  tune(gpu().info(), Storage::kFloat32, time, {kSmall}, tuning, note);
  EXPECT_EQ(measured.size(), 2u);
  const bool addresses = gpu().info().buffer_device_address;
  EXPECT_EQ(least_ms.size(), addresses ? 5u : 2u);
  for (const Conv2dShape& shape : measured) {
    const auto& [kernel, time_ms, direct_ms] = tuning.entries.at(shape);
    const std::string size = fmt::format("{}x{}, ", shape.kernel, shape.kernel);
    EXPECT_LE(least_ms.at(size + kind_of(kernel)), time_ms);
    EXPECT_EQ(least_ms.at(size + "direct"), direct_ms);
  }
}

TEST_F(TunerTest, WhatCannotBeComputedTakesForever) {
  const Conv2dKernel wrong{.algorithm = Algorithm::kWinograd, .tile = 3};
  const auto times =
      time_conv2d(gpu(), shared_cache(), Storage::kFloat32, false, kSmall, std::array{Conv2dKernel{}, wrong});
  EXPECT_TRUE(std::isfinite(times.at(0)));
  EXPECT_EQ(times.at(1), std::numeric_limits<double>::infinity());
}

TEST_F(TunerTest, LayersWithShufflesAreShapesOfTheirOwn) {
  const TemporaryDirectory folder;
  const Subject subject = make_subject(guided_architecture(4), 8, 8, 1);
  write_model(folder / "model", subject.architecture, subject.weights);
  const auto shapes = conv2d_shapes(Model(folder / "model"), 8, 8);
  const auto shuffled = std::ranges::find_if(shapes, [](const auto& s) { return s.shuffle == 4; });
  const auto unshuffled = std::ranges::find_if(shapes, [](const auto& s) { return s.unshuffle == 4; });
  ASSERT_TRUE(shuffled != shapes.end() && unshuffled != shapes.end());
  for (const Conv2dShape& shape : {*shuffled, *unshuffled}) {
    const auto times =
        time_conv2d(gpu(), shared_cache(), Storage::kFloat32, false, shape, std::array{Conv2dKernel{}});
    EXPECT_GT(times.at(0), 0);
  }
}

TEST_F(TunerTest, MeasuresBothStorages) {
  Tuning tuning;
  const auto ignore = [](const Conv2dShape&, const Tuning::Entry&) { return true; };
  for (const Storage storage : {Storage::kFloat32, Storage::kFloat16}) {
    tuning.entries.clear();
    tune(gpu(), shared_cache(), storage, {kSmall1x1}, tuning, ignore);
    EXPECT_GT(tuning.entries.at(kSmall1x1).direct_ms, 0);
  }
}

// The formula, evaluated by hand, gives 149.38 for 3x3 ones and 128.44 (18496 / 144) for a single one, and in
// one direction the roots of these. The center of a 5x5 is the corner of a piece of 3x3.
TEST(WinogradAmplification, IsWhatTheTransformsAbsoluteValuesLetThrough) {
  const float bias[] = {0};
  const std::vector<float> ones(9, 1.0f), one{0, 0, 0, 0, 1, 0, 0, 0, 0}, two(18, -2.0f);
  EXPECT_NEAR(winograd_amplification({ones, bias}, 1, 3, Algorithm::kWinograd), 149.38271605, 1e-6);
  EXPECT_NEAR(winograd_amplification({one, bias}, 1, 3, Algorithm::kWinograd), 128.44444444, 1e-6);
  EXPECT_NEAR(winograd_amplification({two, bias}, 2, 3, Algorithm::kWinograd), 149.38271605, 1e-6);
  std::vector<float> center(25);
  center[12] = 1;
  EXPECT_NEAR(winograd_amplification({center, bias}, 1, 5, Algorithm::kWinograd), 7744. / 9, 1e-6);
  EXPECT_NEAR(winograd_amplification({ones, bias}, 1, 3, Algorithm::kColumns), 110. / 9, 1e-6);
  EXPECT_NEAR(winograd_amplification({one, bias}, 1, 3, Algorithm::kColumns), 34. / 3, 1e-6);
  EXPECT_NEAR(winograd_amplification({two, bias}, 2, 3, Algorithm::kColumns), 110. / 9, 1e-6);
  for (const Algorithm algorithm : {Algorithm::kWinograd, Algorithm::kColumns})
    EXPECT_EQ(winograd_amplification({std::vector<float>(9, 0.0f), bias}, 1, 3, algorithm), 0);
}

// A log transfer leaves no radiance that drowns its neighbours. Linear radiance of up to 1000 drowns them.
TEST_F(TunerTest, F43IsRefusedWhereItIsNotAccurateEnough) {
  for (const auto transfer : {reference::Transfer::kLog, reference::Transfer::kLinear}) {
    Subject subject = make_subject(small_architecture(4), 5, 7, 1);
    subject.architecture.transfer = transfer;
    subject.architecture.clip = 1000;
    const std::filesystem::path path = folder_.path() / "model.safetensors";
    write_model(path, subject.architecture, subject.weights);
    size_t count = 0;
    for (const Conv2dShape& shape : conv2d_shapes(Model(path), 5, 7)) {
      if (shape.kernel == 1) continue;
      EXPECT_EQ(shape.most_tile, transfer == reference::Transfer::kLog ? 4u : 2u);
      ++count;
    }
    EXPECT_GT(count, 5u);
  }
}

}  // namespace
}  // namespace raymeld::test
