#include "fusion/tuner.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "io/json_file.h"
#include "networks/network.h"
#include "numbers.h"

namespace raymeld {
namespace {

constexpr int kTuningVersion = 5;
constexpr uint32_t kMostOrder = 256;

// Returns whether the driver loads a value for each lane with one instruction, as Mesa's for CPUs does since
// version 24; earlier ones load lane by lane.
bool gathers(const DeviceInfo& device) {
  const size_t at = device.driver.find("Mesa ");
  return at != std::string::npos && std::atoi(device.driver.c_str() + at + 5) >= 24;
}

Conv2dKernel default_conv2d(const DeviceInfo& device, const Conv2dShape& shape) {
  Conv2dKernel kernel{
      .algorithm = Algorithm::kWinograd, .tile = shape.most_tile, .vector = device.vector_lanes};
  if (shape.kernel == 1) {
    kernel.algorithm = Algorithm::kPointwise, kernel.band = 2048;
  } else if (gathers(device) && device.vector_lanes == kPairedVector) {
    kernel.outputs = 6, kernel.order = 4;  // products of two tiles each
  }
  return kernel;
}

// Returns the kernel that the search starts from. GPUs have no use for an order, and want many workgroups.
Conv2dKernel first_guess(const DeviceInfo& device, const Conv2dShape& shape) {
  Conv2dKernel kernel = default_conv2d(device, shape);
  if (!device.is_cpu) kernel.order = 0, kernel.band = 1u << 16;
  return kernel;
}

// Returns whether a device can run a kernel that may have been measured on another device, or with more
// features enabled.
bool is_for(const DeviceInfo& device, const Conv2dKernel& kernel) {
  if (kernel.algorithm == Algorithm::kMatrix) return kernel.matrix.matrix == device.cooperative_matrix;
  return !kernel.needs_addresses() ||
         (device.buffer_device_address && (kernel.vector == 0 || kernel.vector == device.vector_lanes));
}

// Returns how unlike two shapes are; the channels count more than the size.
double distance(const Conv2dShape& a, const Conv2dShape& b) {
  const auto ratio = [](double x, double y) { return std::abs(std::log(x / y)); };
  return 4 * ratio(a.channels_out, b.channels_out) + 4 * ratio(a.channels_in, b.channels_in) +
         ratio(double(a.height) * a.width, double(b.height) * b.width) + (a.most_tile != b.most_tile) +
         (a.unshuffle != b.unshuffle) + (a.shuffle != b.shuffle);
}

using Json = nlohmann::ordered_json;

Json to_json(const Conv2dShape& s) {
  return {{"height", s.height},           {"width", s.width},
          {"channels_in", s.channels_in}, {"channels_out", s.channels_out},
          {"kernel", s.kernel},           {"most_tile", s.most_tile},
          {"unshuffle", s.unshuffle},     {"shuffle", s.shuffle}};
}

// Throws Error unless the value is an unsigned number of 32 bits; a conversion would accept -1 and 1e300 too.
uint32_t number_at(const Json& json, const char* key) {
  const Json& value = json.at(key);
  if (!value.is_number_unsigned() || value.get<uint64_t>() > UINT32_MAX)
    throw Error("reading {}: {} is not an unsigned number of 32 bits", key, value.dump());
  return value.get<uint32_t>();
}

Conv2dShape shape_from(const Json& j) {
  return {number_at(j, "height"),       number_at(j, "width"),  number_at(j, "channels_in"),
          number_at(j, "channels_out"), number_at(j, "kernel"), number_at(j, "most_tile"),
          number_at(j, "unshuffle"),    number_at(j, "shuffle")};
}

Json to_json(const MatrixTiles& t) {
  const CooperativeMatrix& matrix = t.matrix;
  return {{"m", matrix.m},
          {"n", matrix.n},
          {"k", matrix.k},
          {"subgroup_size", matrix.subgroup_size},
          {"requires_size", matrix.requires_size},
          {"max_invocations", matrix.max_invocations},
          {"max_shared_bytes", matrix.max_shared_bytes},
          {"outputs", t.outputs},
          {"rows", t.rows},
          {"subgroups", t.subgroups},
          {"channels", t.channels}};
}

MatrixTiles tiles_from(const Json& j) {
  return {.matrix = {.m = number_at(j, "m"),
                     .n = number_at(j, "n"),
                     .k = number_at(j, "k"),
                     .subgroup_size = number_at(j, "subgroup_size"),
                     .requires_size = j.at("requires_size").get<bool>(),
                     .max_invocations = number_at(j, "max_invocations"),
                     .max_shared_bytes = number_at(j, "max_shared_bytes")},
          .outputs = number_at(j, "outputs"),
          .rows = number_at(j, "rows"),
          .subgroups = number_at(j, "subgroups"),
          .channels = number_at(j, "channels")};
}

constexpr std::array kAlgorithmNames{"direct", "pointwise", "columns", "winograd", "matrix"};

Algorithm algorithm_from(const Json& json) {
  const auto found = std::ranges::find(kAlgorithmNames, json.get<std::string>());
  if (found == kAlgorithmNames.end()) throw Error("reading algorithm: {} is unknown", json.dump());
  return Algorithm(found - kAlgorithmNames.begin());
}

// Writes only the parameters of the algorithm.
Json to_json(const Conv2dKernel& k) {
  Json json{{"algorithm", kAlgorithmNames.at(size_t(k.algorithm))}};
  if (k.algorithm == Algorithm::kMatrix) json["matrix"] = to_json(k.matrix);
  if (k.has_tile()) json["tile"] = k.tile;
  if (k.needs_addresses()) {
    json["outputs"] = k.outputs;
    json["channels"] = k.channels;
    json["band"] = k.band;
    json["vector"] = k.vector;
    json["order"] = k.order;
  }
  return json;
}

Conv2dKernel kernel_from(const Json& j) {
  Conv2dKernel kernel{.algorithm = algorithm_from(j.at("algorithm"))};
  if (kernel.algorithm == Algorithm::kMatrix) kernel.matrix = tiles_from(j.at("matrix"));
  if (kernel.has_tile()) kernel.tile = number_at(j, "tile");
  if (kernel.needs_addresses()) {
    kernel.outputs = number_at(j, "outputs");
    kernel.channels = number_at(j, "channels");
    kernel.band = number_at(j, "band");
    kernel.vector = number_at(j, "vector");
    kernel.order = number_at(j, "order");
  }
  return kernel;
}

// Returns whether an entry is sound, which comes from a file that anyone may have edited. Small bands and few
// channels at a time would make millions of passes.
bool is_valid(const Conv2dShape& shape, const Conv2dKernel& kernel) {
  const auto within = [](uint32_t value, uint32_t least, uint32_t most) {
    return value >= least && value <= most;
  };
  const auto suits = [&] {
    if (kernel.has_tile() && ((kernel.tile != 2 && kernel.tile != 4) || kernel.tile > shape.most_tile))
      return false;
    return kernel.algorithm != Algorithm::kMatrix || is_possible(kernel.matrix, shape.kernel);
  };
  const uint32_t least_band = kernel.algorithm == Algorithm::kPointwise ? 512 : 128;
  return (shape.kernel == 1 || shape.kernel == 3 || shape.kernel == 5) && shape.most_tile <= 4 &&
         kernel.computes(shape.kernel) && suits() && within(kernel.outputs, 4, 64) &&
         within(kernel.channels, 32, 256) && within(kernel.order, 0, kMostOrder) &&
         within(kernel.vector, 0, 64) && within(kernel.band, least_band, 1u << 20);
}

struct Tuner {
  const DeviceInfo& device;
  Storage storage;
  const Conv2dTimer& time;

  // Tries the kinds of kernels, then the parameters of the fastest one after another, each at its best before
  // the next is tried. Kernels that are compared run in turns.
  Tuning::Entry best(const Tuning& tuning, const Conv2dShape& shape) const {
    Tuning::Entry best;
    const auto choose = [&](const std::vector<Conv2dKernel>& kernels) {
      const std::vector<double> times = time(tuning.addressed, shape, kernels);
      const auto least = std::ranges::min_element(times);
      if (std::isfinite(*least))
        std::tie(best.kernel, best.time_ms) = std::pair(kernels[size_t(least - times.begin())], *least);
      return times;
    };
    std::vector<Conv2dKernel> kinds(1);
    if (!device.is_cpu && shape.kernel == 3) {
      for (uint32_t tile = 2; tile <= shape.most_tile; tile += 2)
        kinds.push_back({.algorithm = Algorithm::kColumns, .tile = tile});
    }
    if (device.buffer_device_address) {
      Conv2dKernel kernel = first_guess(device, shape);
      kernel.order = tuning.order;
      if (kernel.algorithm == Algorithm::kPointwise) {
        kinds.push_back(kernel);
      } else {
        for (kernel.tile = 2; kernel.tile <= shape.most_tile; kernel.tile += 2) kinds.push_back(kernel);
      }
    }
    if (device.cooperative_matrix && storage == Storage::kFloat16 && shape.kernel < 5)
      kinds.push_back(first_matrix_guess(*device.cooperative_matrix, shape));
    best.direct_ms = choose(kinds).front();
    const auto vary = [&](const auto& parameter, std::initializer_list<uint32_t> values) {
      std::vector<Conv2dKernel> kernels{best.kernel};
      for (const uint32_t value : values) {
        Conv2dKernel kernel = best.kernel;
        std::invoke(parameter, kernel) = value;
        if (kernel != best.kernel) kernels.push_back(kernel);
      }
      if (kernels.size() > 1) choose(kernels);
    };
    if (best.kernel.algorithm == Algorithm::kMatrix && !device.is_cpu) {
      const auto of_tiles = [](uint32_t MatrixTiles::*member) {
        return [member](Conv2dKernel& kernel) -> uint32_t& { return kernel.matrix.*member; };
      };
      vary(of_tiles(&MatrixTiles::rows), {1, 4});
      vary(of_tiles(&MatrixTiles::outputs), {16, 64});
      vary(of_tiles(&MatrixTiles::subgroups), {2, 8});
      vary(of_tiles(&MatrixTiles::channels), {16, 32, 64});
    }
    if (!best.kernel.needs_addresses()) return best;
    if (shape.channels_out > 8) vary(&Conv2dKernel::outputs, {8, 24});
    if (device.is_cpu) {
      // A band of a 3x3 takes 36 floats a channel for each tile, that of a 5x5 four times as many, and that
      // of a 1x1 one for each pixel.
      shape.kernel == 1 ? vary(&Conv2dKernel::band, {512, 1024, 4096})
                        : vary(&Conv2dKernel::band, {128, 512});
      if (best.kernel.vector > 0) vary(&Conv2dKernel::vector, {0});
    } else {
      vary(&Conv2dKernel::band, {1u << 14, 1u << 18});
    }
    return best;
  }
};

// Returns whether matrices compute a shape faster than the direct kernel, by the estimates of docs/gpu.md. An
// image of fewer pixels than a row of a workgroup's leaves nearly all of it idle.
// Among Radeons, whose driver in Mesa is RADV, RDNA 3 multiplies no faster by matrices than by dot products
// of halves, and stores the results more slowly. RDNA 4, which Mesa names GFX12, multiplies twice as fast by
// matrices, but channels that do not fill one are lost.
bool suits_matrices(const DeviceInfo& device, const Conv2dShape& shape) {
  if (shape.height * shape.width < kMatrixColumns) return false;
  if (!device.half_dots || device.name.find("RADV") == std::string::npos) return true;
  if (device.name.find("GFX12") == std::string::npos) return false;
  return shape.channels_in > 16 && shape.channels_out > (shape.kernel == 1 ? 32u : 8u);
}

// Returns the largest m of F(m, 3) in columns whose sums a GPU can keep in registers, by the compilers of
// docs/gpu.md, or 0 for GPUs of other kinds. The first part of a name that fits counts.
uint32_t columns_tile(const DeviceInfo& device) {
  constexpr std::pair<const char*, uint32_t> kTiles[] = {{"RADV NAVI", 4}, {"RADV GFX1", 4}, {"RADV", 2},
                                                         {"NVK GK", 0},    {"NVK", 4},       {"RTX", 4},
                                                         {"Apple", 2},     {"Adreno", 2}};
  const auto found = std::ranges::find_if(
      kTiles, [&](const auto& named) { return device.name.find(named.first) != std::string::npos; });
  return found == std::end(kTiles) ? 0 : found->second;
}

}  // namespace

Conv2dKernel first_matrix_guess(const CooperativeMatrix& matrix, const Conv2dShape& shape) {
  constexpr uint32_t kMostSums = 128;    // sums of a lane, about half of its registers
  constexpr uint32_t kMostOutputs = 32;  // with 48 NVK spills sums, and RADV takes 240 registers
  MatrixTiles tiles{.matrix = matrix, .outputs = kMostOutputs, .channels = shape.kernel == 1 ? 32u : 16u};
  tiles.outputs = std::min(tiles.outputs, divide_up(shape.channels_out, matrix.m) * matrix.m);
  const auto sums = [&] { return tiles.outputs * tiles.rows * kMatrixColumns / matrix.subgroup_size; };
  if (sums() > kMostSums) tiles.rows = 1;
  while ((sums() > kMostSums || !is_possible(tiles, shape.kernel)) && tiles.outputs > matrix.m)
    tiles.outputs = divide_up(tiles.outputs / 2, matrix.m) * matrix.m;
  return {.algorithm = Algorithm::kMatrix, .matrix = tiles};
}

Kernels default_kernels(const DeviceInfo& device, Storage storage) {
  if (device.is_cpu) {
    if (!device.buffer_device_address) return {};
    const auto choose = [device](const Conv2dShape& shape) { return default_conv2d(device, shape); };
    return {.addressed = gathers(device), .vector = device.vector_lanes, .conv2d = choose};
  }
  const bool half = storage == Storage::kFloat16;
  const uint32_t most = half && device.half_dots ? 0 : columns_tile(device);
  const auto choose = [device, half, most](const Conv2dShape& shape) -> Conv2dKernel {
    if (shape.kernel == 5) return {};
    if (half && device.cooperative_matrix && suits_matrices(device, shape))
      return first_matrix_guess(*device.cooperative_matrix, shape);
    if (most == 0 || shape.kernel != 3) return {};
    return {.algorithm = Algorithm::kColumns, .tile = std::min(most, shape.most_tile)};
  };
  return {.conv2d = choose};
}

Kernels Tuning::kernels(const DeviceInfo& device, Storage storage) const {
  auto usable = entries;
  std::erase_if(usable, [&](const auto& entry) { return !is_for(device, entry.second.kernel); });
  const Kernels defaults = default_kernels(device, storage);
  if (usable.empty()) return defaults;
  const auto choose = [entries = usable, fallback = defaults.conv2d](const Conv2dShape& shape) {
    // network() refuses F(4, 3) only after it was chosen, so the entry of a shape that refuses it has a
    // most_tile of 2.
    for (const uint32_t most_tile : {shape.most_tile, 2u}) {
      Conv2dShape measured = shape;
      measured.most_tile = most_tile;
      const auto exact = entries.find(measured);
      if (exact != entries.end()) return exact->second.kernel;
    }
    const Conv2dKernel* nearest = nullptr;
    double least = 0;
    for (const auto& [other, entry] : entries) {
      if (other.kernel != shape.kernel || entry.kernel.winograd_tile() > shape.most_tile) continue;
      const double d = distance(shape, other);
      if (!nearest || d < least) std::tie(nearest, least) = std::pair(&entry.kernel, d);
    }
    return nearest ? *nearest : fallback(shape);
  };
  return {
      .addressed = addressed && device.buffer_device_address, .vector = defaults.vector, .conv2d = choose};
}

std::filesystem::path tuning_file(const std::filesystem::path& folder, const Device& device,
                                  Storage storage) {
  if (folder.empty()) return {};
  return folder / fmt::format("tuning-{}-{}lanes-{}.json", device_key(device.properties()),
                              device.info().subgroup_size, storage == Storage::kFloat16 ? "fp16" : "fp32");
}

Tuning load_tuning(const std::filesystem::path& file) try {
  const Json json = load_json_file(file, kTuningVersion);
  if (json.is_null()) return {};
  Tuning tuning;
  tuning.device = json.at("device");
  tuning.driver = json.at("driver");
  tuning.addressed = json.at("addressed");
  tuning.order = number_at(json, "order");
  if (tuning.order > kMostOrder) return {};
  for (const Json& entry : json.at("conv2d")) {
    const Conv2dShape shape = shape_from(entry.at("shape"));
    const Conv2dKernel kernel = kernel_from(entry.at("kernel"));
    if (!is_valid(shape, kernel)) return {};
    tuning.entries[shape] = {kernel, entry.at("time_ms"), entry.at("direct_ms")};
  }
  return tuning;
} catch (const std::exception&) {
  return {};
}

void save_tuning(const std::filesystem::path& file, const Tuning& tuning) {
  Json json{{"device", tuning.device},
            {"driver", tuning.driver},
            {"addressed", tuning.addressed},
            {"order", tuning.order},
            {"conv2d", Json::array()}};
  for (const auto& [shape, entry] : tuning.entries) {
    json["conv2d"].push_back({{"shape", to_json(shape)},
                              {"kernel", to_json(entry.kernel)},
                              {"time_ms", entry.time_ms},
                              {"direct_ms", entry.direct_ms}});
  }
  save_json_file(file, kTuningVersion, json);
}

void tune(const DeviceInfo& device, Storage storage, const Conv2dTimer& time, std::vector<Conv2dShape> shapes,
          Tuning& tuning, const TuneProgress& progress) {
  if (shapes.empty()) return;
  std::ranges::stable_sort(shapes, std::greater{}, &Conv2dShape::flop);
  tuning.device = device.name;
  tuning.driver = device.driver;
  const Tuner tuner{device, storage, time};
  if (tuning.entries.empty() && device.buffer_device_address) {
    const Conv2dShape& most = shapes.front();  // decides, as the defaults would compute it
    Conv2dKernel kernel = first_guess(device, most);
    const auto measure = [&](bool addressed) { return time(addressed, most, {&kernel, 1}).front(); };
    tuning.addressed = measure(true) < measure(false);
    tuning.order = kernel.order;
    if (kernel.vector > 0) {
      std::vector<Conv2dKernel> kernels{kernel};
      for (const uint32_t order : {0u, 8u, 16u}) {
        if (order == kernel.order) continue;
        kernels.push_back(kernel);
        kernels.back().order = order;
      }
      const std::vector<double> times = time(tuning.addressed, most, kernels);
      tuning.order = kernels[size_t(std::ranges::min_element(times) - times.begin())].order;
    }
  }
  for (const Conv2dShape& shape : shapes) {
    if (tuning.entries.contains(shape)) continue;
    if (!progress(shape, tuning.entries[shape] = tuner.best(tuning, shape))) return;
  }
}

void tune(const Device& device, PipelineCache& cache, Storage storage, const std::vector<Conv2dShape>& shapes,
          Tuning& tuning, const TuneProgress& progress) {
  const auto time = [&](bool addressed, const Conv2dShape& shape, std::span<const Conv2dKernel> kernels) {
    return time_conv2d(device, cache, storage, addressed, shape, kernels);
  };
  tune(device.info(), storage, time, shapes, tuning, progress);
}

std::vector<Conv2dShape> shapes_to_tune(const Device& device, Storage storage, const Model& model,
                                        TileSize lrhs) {
  const FuserOptions options{.storage = storage, .kernels = default_kernels(device.info(), storage)};
  const TileSize tile = plan_fusion(model, lrhs.height, lrhs.width, device.info(), options).tiling.tile;
  return conv2d_shapes(model, tile.height, tile.width);
}

void tune_file(const Device& device, Storage storage, const TuneFile& file, const TuneProgress& progress) {
  const std::filesystem::path path = tuning_file(file.folder, device, storage);
  Tuning tuning = load_tuning(path);
  const Tuning before = tuning;
  if (file.again)
    for (const Conv2dShape& shape : file.shapes) tuning.entries.erase(shape);
  PipelineCache cache(device, file.cache_folder);
  struct Save {
    PipelineCache& cache;
    ~Save() { cache.save(); }  // however this ends, so that the next try need not compile
  } const save{cache};
  tune(device, cache, storage, file.shapes, tuning,
       [&](const Conv2dShape& shape, const Tuning::Entry& entry) {
         Tuning all = tuning;
         all.entries.insert(before.entries.begin(), before.entries.end());  // those not yet measured again
         save_tuning(path, all);
         return progress(shape, entry);
       });
}

Kernels kernels_for(const Device& device, Storage storage, const std::filesystem::path& folder,
                    const std::filesystem::path& shipped) {
  Tuning tuning = load_tuning(tuning_file(folder, device, storage));
  Tuning other = load_tuning(tuning_file(shipped, device, storage));
  if (tuning.entries.empty()) {
    tuning = std::move(other);
  } else {
    tuning.entries.merge(other.entries);
  }
  return tuning.kernels(device.info(), storage);
}

}  // namespace raymeld
