#include "fusion/plan.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>

#include "networks/network.h"
#include "numbers.h"

namespace raymeld {
namespace {

StorageExponents exponents_for(const Model& model, const FuserOptions& options) {
  return options.storage == Storage::kFloat16 ? storage_exponents(model) : StorageExponents{};
}

// Makes the graph of a tile, which is not planned yet.
Graph make_graph(const Model& model, TileSize tile, const FuserOptions& options,
                 const StorageExponents& exponents, const Conv2dChoice& choose) {
  Graph graph(options.storage, options.kernels.addressed, options.keep_activations, options.frame_images);
  graph.read_vectors(options.kernels.vector);
  std::optional<Joining> joining;
  if (options.temporal) joining = {options.settles, options.motion_depth};
  network(graph, model, tile.height, tile.width, options.phase, choose, exponents, options.constants,
          options.compute_variance, options.samples, joining);
  return graph;
}

// Returns the shapes of those of the frame's images that are buffers.
std::vector<Shape> buffer_shapes(const Model& model, TileSize tile, const FuserOptions& options) {
  const auto [lrhs, hrls, fused] = frame_shapes(model, tile, options.constants, options.compute_variance);
  std::vector<Shape> shapes;
  if (!options.frame_images.inputs) shapes = {lrhs, hrls};
  if (!options.frame_images.output) shapes.push_back(fused);
  if (options.temporal && !options.frame_images.inputs) shapes.push_back(motion_shape(fused, options));
  return shapes;
}

FusePlan plan_tile(const Model& model, TileSize tile, const FuserOptions& options,
                   const StorageExponents& exponents) {
  std::vector<std::pair<Conv2dShape, Conv2dKernel>> kernels;
  const Conv2dChoice choose = [&](const Conv2dShape& shape) {
    return kernels.emplace_back(shape, options.kernels.conv2d(shape)).second;
  };
  Graph graph = make_graph(model, tile, options, exponents, choose);
  graph.plan();
  FusePlan plan{
      .tiling = make_tiling(tile, 1, 1, 0), .graph = std::move(graph), .kernels = std::move(kernels)};
  plan.frame_bytes = Program::host_bytes(kFramesInFlight + 1);
  for (const Shape& shape : buffer_shapes(model, tile, options)) plan.frame_bytes += frame_bytes(shape);
  for (const Pass& pass : plan.graph.passes()) plan.flop += pass.flop;
  return plan;
}

// Returns why a tile cannot run; nothing when it can.
std::optional<std::string> obstacle(const FusePlan& plan, std::span<const Shape> images,
                                    const DeviceInfo& device, uint64_t most_bytes) {
  uint64_t binding_bytes = plan.graph.largest_binding_bytes(), image_bytes = 0;
  for (const Shape& shape : images) image_bytes = std::max(image_bytes, frame_bytes(shape));
  binding_bytes = std::max(binding_bytes, image_bytes);
  const auto beyond = [](const char* what, uint64_t needed, uint64_t allowed, const char* whose) {
    return fmt::format("{} {:.1f} MiB, more than the {:.1f} MiB {}", what, double(needed) / kMebibyte,
                       double(allowed) / kMebibyte, whose);
  };
  if (plan.peak_bytes() > most_bytes) return beyond("it needs", plan.peak_bytes(), most_bytes, "allowed");
  if (plan.graph.activation_bytes() > device.max_allocation_bytes) {
    return beyond("its activations need", plan.graph.activation_bytes(), device.max_allocation_bytes,
                  "that the device allocates at once");
  }
  if (image_bytes > device.max_allocation_bytes) {
    return beyond("an image needs", image_bytes, device.max_allocation_bytes,
                  "that the device allocates at once");
  }
  if (binding_bytes > device.max_storage_range_bytes) {
    return beyond("a layer needs", binding_bytes, device.max_storage_range_bytes,
                  "that the device binds at once");
  }
  const auto groups = plan.graph.most_groups();
  for (size_t axis = 0; axis < 3; ++axis) {
    if (groups[axis] > device.max_groups[axis]) {
      return fmt::format("a layer needs {} workgroups along {}, more than the device's {}", groups[axis],
                         "xyz"[axis], device.max_groups[axis]);
    }
  }
  return std::nullopt;
}

// Does the same before the graph is made, which takes the host's memory in proportion to the tile. HRLS, or
// what takes its place, is a tensor of the graph, and no tensor has more bytes than 32 bits count.
std::optional<std::string> early_obstacle(const Model& model, TileSize tile, uint64_t most_bytes,
                                          const FuserOptions& options) {
  const Shape hrls = frame_shapes(model, tile, options.constants, options.compute_variance)[1];
  const uint64_t bytes = hrls.pixels() * std::max(hrls.channels, 3u) * element_bytes(options.storage);
  const uint64_t allowed = std::min<uint64_t>(most_bytes, UINT32_MAX);
  if (bytes <= allowed) return std::nullopt;
  return fmt::format("its full size alone needs {:.1f} MiB, more than the {:.1f} MiB allowed",
                     double(bytes) / kMebibyte, double(allowed) / kMebibyte);
}

// Returns whether a model's weights fit 16 bits. Tensors are stored divided by powers of two, and weights
// times the ratio of two of these: they must then be within 65504, and few of them so small that 16 bits have
// fewer digits for them.
bool fits_half(const Model& model) {
  constexpr int kMostExponent = 10;
  int most = 0;
  for (const auto& [tensor, exponent] : storage_exponents(model)) most = std::max(most, exponent);
  return most <= kMostExponent && std::ldexp(model.largest_weight(), most) <= 65504;
}

// Returns why tiles cannot be computed again in 32 bits beside this plan; nothing when they can.
std::optional<std::string> wide_obstacle(const FusePlan& plan, const Model& model, const DeviceInfo& device,
                                         const FuserOptions& options) {
  const uint64_t limit = memory_limit(device, options);
  if (3 * plan.peak_bytes() <= limit)
    return std::nullopt;  // numbers twice as wide take at most twice as much
  try {
    const auto [height, width] = plan.tiling.tile;
    plan_fusion(model, height, width, device, wide_options(device, options, plan.peak_bytes()));
    return std::nullopt;
  } catch (const Error& error) {
    return fmt::format("in fp32, for tiles that fp16 cannot hold: {}", error.what());
  }
}

}  // namespace

void check_lrhs_size(TileSize size) {
  const auto [height, width] = size;
  if (height >= 1 && width >= 1 && height <= kMostSide && width <= kMostSide) return;
  throw SizeError("LRHS of {} x {} pixels, expected sides from 1 to {}", width, height, kMostSide);
}

Storage storage_for(Precision precision, const DeviceInfo& device) {
  const bool half = precision == Precision::kFp16 ||
                    (precision == Precision::kAuto && !device.is_cpu && device.storage_16bit);
  return half ? Storage::kFloat16 : Storage::kFloat32;
}

Storage storage_for(Precision precision, const DeviceInfo& device, const Model& model) {
  const Storage storage = storage_for(precision, device);
  const bool half = storage == Storage::kFloat16 && (precision != Precision::kAuto || fits_half(model));
  return half ? Storage::kFloat16 : Storage::kFloat32;
}

float lrhs_phase(bool centered, uint32_t scale) noexcept {
  return centered ? (static_cast<float>(scale) - 1.0f) / 2.0f : 0.0f;
}

std::array<Shape, 3> frame_shapes(const Model& model, TileSize tile, const ConstantLayers& constants,
                                  bool compute_variance) {
  const Architecture& a = model.architecture();
  const uint32_t height = a.scale * tile.height, width = a.scale * tile.width;
  // Counts image_layers() without making its strings, since each frame that is recorded asks for this.
  const auto layers =
      static_cast<uint32_t>(std::ranges::count_if(a.hrls_layers, [&](const std::string& layer) {
        return !constants.contains(layer) && !(compute_variance && layer == "variance");
      }));
  return {Shape{tile.height, tile.width, a.reads_lrhs() ? 3u : 0u}, Shape{height, width, 3 * layers},
          Shape{height, width, 3}};
}

uint64_t history_bytes(const Model& model, TileSize frame, const DeviceInfo& device,
                       const FuserOptions& options) {
  if (!options.temporal) return 0;
  if (options.skip_unchanged)
    throw Error("a history is not kept where what did not change is skipped, expected one of the two");
  if (options.fp32_kernels)
    throw Error("a history is not kept where tiles are computed again in fp32, expected one precision");
  const uint32_t scale = model.architecture().scale;
  const uint32_t channels = history_channels(model, options.phase, options.compute_variance);
  const uint64_t bytes =
      sizeof(float) * history_floats(scale * frame.height, scale * frame.width, channels, scale);
  const auto check = [&](uint64_t most, const char* does) {
    if (bytes > most)
      throw Error(
          "a history of the frame needs {:.1f} MiB, more than the {:.1f} MiB that the device {} at once",
          double(bytes) / kMebibyte, double(most) / kMebibyte, does);
  };
  check(device.max_allocation_bytes, "allocates");
  // Shaders that find buffers by their addresses bind none; they count floats in 32 bits.
  check(options.kernels.addressed ? sizeof(float) << 32 : device.max_storage_range_bytes, "binds");
  return bytes;
}

uint64_t frame_bytes(const Shape& shape) { return shape.pixels() * shape.channels * sizeof(float); }

// Leaves a fifth of the memory: a driver that tells no budget still shares its heap with others.
uint64_t memory_limit(const DeviceInfo& device, const FuserOptions& options) {
  return options.max_memory_bytes ? options.max_memory_bytes : device.memory_bytes / 5 * 4;
}

FuserOptions wide_options(const DeviceInfo& device, FuserOptions options, uint64_t taken_bytes) {
  options.max_memory_bytes = memory_limit(device, options) - taken_bytes;
  options.storage = Storage::kFloat32;
  options.kernels = *options.fp32_kernels;
  options.fp32_kernels.reset();
  options.skip_unchanged = false;  // tiles are computed again as a whole
  options.compute_exposure = false;
  options.scratch.reset();
  return options;
}

FusePlan plan_fusion(const Model& model, uint32_t height, uint32_t width, const DeviceInfo& device,
                     const FuserOptions& options) {
  check_lrhs_size({height, width});
  const uint64_t histories_bytes = 2 * history_bytes(model, {height, width}, device, options);
  const uint64_t most_bytes = memory_limit(device, options) / (options.fp32_kernels ? 2 : 1);
  const StorageExponents exponents = exponents_for(model, options);
  std::optional<FusePlan> plan;  // the plan of the tile tried last
  std::optional<std::string> reason;
  const auto fits = [&](TileSize tile) {
    reason = early_obstacle(model, tile, most_bytes, options);
    if (!reason) {
      plan = plan_tile(model, tile, options, exponents);
      plan->frame_bytes += histories_bytes;
      reason = obstacle(*plan, buffer_shapes(model, tile, options), device, most_bytes);
    }
    if (!reason && options.fp32_kernels) reason = wide_obstacle(*plan, model, device, options);
    // Only a frame of one tile keeps every layer's output readable.
    if (reason && options.keep_activations)
      throw Error("keeping every layer's output needs a frame of one tile, which does not fit: {}", *reason);
    return !reason;
  };
  const uint32_t reach = receptive_halo(model.architecture(), options.compute_variance, options.temporal);
  const uint32_t halo = reach == kWholeFrame ? std::max(height, width) : reach;
  const Tiling tiling = choose_tiling({height, width}, halo, fits, model.architecture().grid());
  if (tiling.count() == 0) {
    throw Error(
        "model {}: {} does not fit: {}", model.name(),
        reach == kWholeFrame ? "the frame, all of which its network needs at once," : "the smallest tile",
        *reason);
  }
  plan->tiling = tiling;
  plan->flop *= tiling.count();
  return std::move(*plan);
}

Graph graph_within(const FusePlan& plan, const Model& model, TileSize size, const FuserOptions& options) {
  const TileSize most = plan.tiling.frame;
  if (plan.tiling.count() > 1)
    throw SizeError("frames of {} x {} LRHS pixels take {} tiles, so that no other size can be prepared",
                    most.width, most.height, plan.tiling.count());
  if (size.height == 0 || size.width == 0 || size.height > most.height || size.width > most.width)
    throw SizeError("frames of {} x {} LRHS pixels, expected at most {} x {}", size.width, size.height,
                    most.width, most.height);
  size_t next = 0;
  const Conv2dChoice choose = [&](const Conv2dShape&) {
    auto [shape, kernel] = plan.kernels.at(next++);
    if (kernel.algorithm == Algorithm::kWinograd) kernel.band_rows = winograd_band_rows(shape, kernel);
    return kernel;
  };
  Graph graph = make_graph(model, size, options, exponents_for(model, options), choose);
  graph.plan_within(plan.graph);
  return graph;
}

}  // namespace raymeld
