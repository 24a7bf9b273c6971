// How a frame will be run: the graph of a tile, and as few tiles as memory and the device's limits allow.
#pragma once

#include <optional>

#include "model/constant_layers.h"
#include "engine/device.h"
#include "engine/graph.h"
#include "engine/program.h"
#include "model/model.h"
#include "fusion/tiling.h"

namespace raymeld {

enum class Precision {
  kAuto,  // fp16 on GPUs with 16-bit storage for models that fit it, else fp32; what fp16 cannot hold, fuse()
          // computes again in fp32
  kFp32,
  kFp16,  // 16-bit storage, 32-bit sums; an error on a device without 16-bit storage
};

// How convolutions are computed.
enum class KernelChoice {
  kAuto,    // what is fastest on the device: as `raymeld tune` measured, else a default for its kind
  kDirect,  // by the plain sums of their definition, several times slower: the same bits whatever the tiles
};

// Frames that may be recorded and not yet done on the device.
inline constexpr uint32_t kFramesInFlight = 3;

// What a wish for a precision means on a device: kAuto takes 16-bit storage on GPUs that have it, 32 bits on
// CPUs, where converting costs more than it saves.
Storage storage_for(Precision precision, const DeviceInfo& device);
// The same for a model: kAuto takes 32 bits where its weights, or what they are expected to make, do not
// fit 16.
Storage storage_for(Precision precision, const DeviceInfo& device, const Model& model);

// Where LRHS samples lie in their s x s cell, in full-size pixels: 0 for nearest-neighbour degradation (the
// top-left pixel), (s - 1) / 2 for a real low-resolution render.
float lrhs_phase(bool centered, uint32_t scale) noexcept;

struct FuserOptions {
  Storage storage = Storage::kFloat32;
  // What all of raymeld's buffers on the device may take together; 0: what the device has to give.
  uint64_t max_memory_bytes = 0;
  Kernels kernels = {};  // how it is computed
  // With 16-bit storage: tiles of fuse() with values that it cannot hold are computed again in 32 bits, by
  // these kernels. Half of the memory is kept for that.
  std::optional<Kernels> fp32_kernels = {};
  // fuse() computes only the tiles of which a pixel changed since the last frame, and takes the others from
  // that one's output: see LastFrame.
  bool changed_only = false;
  ConstantLayers constants = {};  // of HRLS; no image holds them
  bool compute_variance = false;  // of the color, by the device, where the model reads it; no image holds it
  float phase = 0;                // see lrhs_phase()
  float exposure = 0;             // of fuse(): see exposure.h; 0: what the model's exposure_key asks for
  bool compute_exposure = false;  // record() can find, on the device, what the model's exposure_key asks for
  // Of the caller, for the activations: of a tile that is not done again in 32 bits. Nothing in it is kept
  // from one frame to the next.
  std::optional<MemoryRange> scratch = {};
  FrameImages frame_images = {};  // for record() alone
  // Keeps every layer's output readable after a frame; needs the memory of all and a frame of one tile.
  bool keep_activations = false;
  // Measures every pass; the frame is slower, as passes no longer overlap.
  bool profile = false;
  // How a frame is cut up for the driver; unless given, as suits the device's kind.
  std::optional<WorkLimits> work_limits = {};
};

// How a frame will be run, before anything is allocated.
struct FusePlan {
  Tiling tiling;
  Graph graph;  // of one tile, planned
  // What network() was told of the convolutions, in order.
  std::vector<std::pair<Conv2dShape, Conv2dKernel>> kernels = {};
  uint64_t frame_bytes = 0;  // the images on their way in and out of fuse()
  double flop = 0;           // of the whole frame, halos included

  uint64_t peak_bytes() const { return graph.constant_bytes() + graph.activation_bytes() + frame_bytes; }
};

// What all of raymeld's buffers may take together.
uint64_t memory_limit(const DeviceInfo& device, const FuserOptions& options);

// How tiles are computed again in 32 bits, beside what is taken of the memory; options.fp32_kernels must be
// there.
FuserOptions wide_options(const DeviceInfo& device, FuserOptions options, uint64_t taken_bytes);

// Plans frames of (height, width) LRHS pixels for a device. Throws SizeError, and Error when not even the
// smallest tile fits.
FusePlan plan_fusion(const Model& model, uint32_t height, uint32_t width, const DeviceInfo& device,
                     const FuserOptions& options);

// Frames cannot have a size that was asked for.
class SizeError : public Error {
 public:
  using Error::Error;
};

// No LRHS is larger than this, in pixels: what plans take of the host's memory grows with its sides.
inline constexpr uint32_t kMostSide = 65536;

// Throws SizeError unless both sides are from 1 to kMostSide.
void check_lrhs_size(TileSize size);

// The graph of frames of (size.height, size.width) LRHS pixels for a device that runs `plan`, of one tile
// that is no smaller: by the same kernels, in the same memory. Throws Error, and SizeError.
Graph graph_within(const FusePlan& plan, const Model& model, TileSize size, const FuserOptions& options);

// The images of a tile, as frames bring and take them: LRHS, HRLS with image_layers(), fused.
std::array<Shape, 3> frame_shapes(const Model& model, TileSize tile, const ConstantLayers& constants = {},
                                  bool compute_variance = false);

uint64_t frame_bytes(const Shape& shape);

}  // namespace raymeld
