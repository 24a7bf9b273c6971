// Plans how a frame is run: the graph of a tile, and as few tiles as memory and the device's limits allow.
#pragma once

#include <optional>

#include "engine/device.h"
#include "engine/graph.h"
#include "engine/program.h"
#include "fusion/tiling.h"
#include "networks/constant_layers.h"
#include "networks/model.h"

namespace raymeld {

enum class Precision {
  kAuto,  // fp16 on GPUs with 16-bit storage for models that fit it, else fp32; fuse() computes tiles that
          // fp16 cannot hold again in fp32
  kFp32,
  kFp16,  // 16-bit storage, 32-bit sums; an error on a device without 16-bit storage
};

// Says how convolutions are computed.
enum class KernelChoice {
  kAuto,    // the fastest on the device: as a tuning says, else a default for its kind
  kDirect,  // the plain sums of their definition, slower: the same bits whatever the tiles
};

// Limits the frames that are recorded and not yet done on the device.
inline constexpr uint32_t kFramesInFlight = 3;

// Returns the storage of a precision on a device: kAuto takes 16 bits on GPUs that have such storage, 32 bits
// on CPUs, where converting costs more than it saves.
Storage storage_for(Precision precision, const DeviceInfo& device);
// Does the same for a model: kAuto takes 32 bits where its weights, or the values that they are expected to
// make, do not fit 16.
Storage storage_for(Precision precision, const DeviceInfo& device, const Model& model);

// Returns where an LRHS sample lies in its s x s full-size pixels, in such pixels: 0, the top-left one, for
// nearest-neighbour degradation, and (s - 1) / 2 for a real low-resolution render.
float lrhs_phase(bool centered, uint32_t scale) noexcept;

struct FuserOptions {
  Storage storage = Storage::kFloat32;
  // Limits all of raymeld's buffers on the device together; 0 allows what the device has to give.
  uint64_t max_memory_bytes = 0;
  Kernels kernels = {};
  // Makes fuse() compute tiles with values that 16-bit storage cannot hold again in 32 bits, by these
  // kernels. Half of the memory is kept for that.
  std::optional<Kernels> fp32_kernels = {};
  // Makes fuse() compute only the tiles in which a pixel changed since the last frame, and take the others
  // from the last output: see LastFrame.
  bool skip_unchanged = false;
  // Joins each frame with the ones before it: see accumulate(). Frames then have motion. The memory of one
  // sequence counts for max_memory_bytes. Not with skip_unchanged or fp32_kernels.
  bool temporal = false;
  // Also mixes the fused image with that of the last frame: see settle(). It matters only with `temporal`.
  bool settles = true;
  // Frames have the depth of each pixel's point beside its motion. It matters only with `temporal`.
  bool motion_depth = false;
  ConstantLayers constants = {};  // HRLS layers with one value, which no image holds
  // Makes the device compute the color's variance where the model reads it; no image holds it.
  bool compute_variance = false;
  float phase = 0;  // see lrhs_phase()
  SampleCounts samples = {};
  float exposure = 0;             // used by fuse(), see exposure.h; 0: what the model's exposure_key asks for
  bool compute_exposure = false;  // record() can find what the model's exposure_key asks for, on the device
  // Is the caller's memory for activations, except those of tiles that are computed again in 32 bits. Nothing
  // in it is kept from one frame to the next.
  std::optional<MemoryRange> scratch = {};
  // Is the caller's memory for the history of sequence 0, the only one there then is.
  std::optional<MemoryRange> history_memory = {};
  FrameImages frame_images = {};  // record() alone takes such images
  // Keeps every layer's output readable after a frame; needs memory for all of them and a frame of one tile.
  bool keep_activations = false;
  // Measures every pass; the frame is slower, as passes no longer overlap.
  bool profile = false;
  // Limits the pieces in which the driver gets a frame; by default they suit the device's kind.
  std::optional<WorkLimits> work_limits = {};
};

// Says how a frame is run, before anything is allocated.
struct FusePlan {
  Tiling tiling;
  Graph graph;  // the planned graph of one tile
  // Holds the kernels that network() was given for the convolutions, in order.
  std::vector<std::pair<Conv2dShape, Conv2dKernel>> kernels = {};
  uint64_t frame_bytes = 0;  // status, exposures, histories, and the images on their way in and out of fuse()
  double flop = 0;           // work of the whole frame, halos included

  uint64_t peak_bytes() const { return graph.constant_bytes() + graph.activation_bytes() + frame_bytes; }
};

// Returns what all of raymeld's buffers may take together.
uint64_t memory_limit(const DeviceInfo& device, const FuserOptions& options);

// Returns the options of tiles computed again in 32 bits, in the memory that is left beside `taken_bytes`.
// options.fp32_kernels must be there.
FuserOptions wide_options(const DeviceInfo& device, FuserOptions options, uint64_t taken_bytes);

// Plans frames of (height, width) LRHS pixels for a device. Throws SizeError, and Error when not even the
// smallest tile fits.
FusePlan plan_fusion(const Model& model, uint32_t height, uint32_t width, const DeviceInfo& device,
                     const FuserOptions& options);

// Is thrown when frames cannot have the size that was asked for.
class SizeError : public Error {
 public:
  using Error::Error;
};

// Limits the sides of LRHS, in pixels: what plans take of the host's memory grows with them.
inline constexpr uint32_t kMostSide = 65536;

// Throws SizeError unless both sides are from 1 to kMostSide.
void check_lrhs_size(TileSize size);

// Returns the graph of frames of (size.height, size.width) LRHS pixels for a device that runs `plan`, whose
// one tile is no smaller. It has the kernels of `plan` and fits its memory. Throws SizeError and Error.
Graph graph_within(const FusePlan& plan, const Model& model, TileSize size, const FuserOptions& options);

// Returns the bytes of the history of a frame, a buffer of which each sequence has two; 0 unless
// options.temporal. Throws Error where none is kept, or where the device cannot bind it.
uint64_t history_bytes(const Model& model, TileSize frame, const DeviceInfo& device,
                       const FuserOptions& options);

// Returns the shape of a tile's motion, whose fused image has this shape.
inline Shape motion_shape(const Shape& fused, const FuserOptions& options) {
  return {fused.height, fused.width, options.motion_depth ? 4u : 2u};
}

// Returns the shapes of a tile's images as frames bring and take them: LRHS, HRLS by image_layers(), fused.
// A render that the model does not read has no channels.
std::array<Shape, 3> frame_shapes(const Model& model, TileSize tile, const ConstantLayers& constants = {},
                                  bool compute_variance = false);

uint64_t frame_bytes(const Shape& shape);

}  // namespace raymeld
