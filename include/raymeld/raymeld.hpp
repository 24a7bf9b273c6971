// raymeld as a library: fuses a small render with many samples a pixel (LRHS) and a full-size one with few
// (HRLS) on a Vulkan device, raymeld's own or the caller's. Every function may throw std::runtime_error whose
// message says what was being done and what was expected; nothing else is thrown but std::bad_alloc.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "raymeld/vulkan.hpp"

namespace raymeld {

enum class Precision {
  kAuto,  // fp16 on GPUs with 16-bit storage for models that fit it, else fp32; what fp16 cannot hold, fuse()
          // computes again in fp32
  kFp32,
  kFp16,  // 16-bit storage, 32-bit sums; an error on a device without 16-bit storage
};

// Where LRHS samples lie in the s x s full-size pixels they stand for.
enum class LrhsSampling {
  kModel,     // as in the images that the model was trained on
  kNearest,   // the top-left pixel: LRHS is every s-th pixel of a full-size render
  kCentered,  // the centre: LRHS is a render at low resolution
};

// What the device counted; saturated and not_finite are zero for a frame that can be trusted.
struct FusionStatus {
  uint32_t saturated =
      0;  // with fp16: values within the network beyond 16 bits, stored as the largest; use fp32
  uint32_t not_finite = 0;    // output values that were NaN or infinite, written as 0
  float settled_share = 0;    // of the last frame: FusionOptions::adaptive_threshold
  uint32_t redone_tiles = 0;  // of fuse() with kAuto: which fp16 could not hold, computed again in fp32
  float kept_share = 0;       // of fuse(): FusionOptions::changed_only
};

// How convolutions are computed.
enum class KernelChoice {
  kAuto,    // what is fastest on the device: as `raymeld tune` measured, else a default for its kind
  kDirect,  // by the plain sums of their definition, several times slower: the same bits whatever the tiles
};

struct FusionOptions {
  Precision precision = Precision::kAuto;
  KernelChoice kernels = KernelChoice::kAuto;
  // Of all buffers raymeld makes on the device; 0: what the device has to give.
  uint64_t max_memory_bytes = 0;
  LrhsSampling lrhs_sampling = LrhsSampling::kModel;
  // What fuse() multiplies radiance by for the network, from 2^-24 to 2^24, and divides its output by; 0:
  // what suits the model, see Fusion::exposure().
  float exposure = 0;
  // Blocks of 8 x 8 LRHS pixels in which HRLS and upsampled LRHS agree to within this, on the network's
  // scale, where 0.01 is about a step of an 8-bit display, are not computed by the network but get the mean
  // of both; what is computed has the same bits. Found on the device, by record() as well. 0: everything is
  // computed, which takes less memory.
  float adaptive_threshold = 0;
  // For the frames of an interactive viewport or of a sequence: fuse() keeps its inputs, in host memory, and
  // its output, and computes only what depends on pixels of which a bit has changed since; the rest is the
  // last output. The bits are those of a first fuse(). Everything is computed after a throw, and where the
  // exposure differs: give one. record() throws. Takes more memory of the device.
  bool changed_only = false;
  // Those of the model's optional layers that HRLS does not have: nothing is read or computed for them.
  std::vector<std::string> absent_layers = {};
  std::string device = {};  // index, UUID or part of the name; empty: the first GPU, else a CPU driver
};

// A model made ready for frames of one size on one device. One thread at a time may use a Fusion; several may
// be used in as many threads, each with a device of its own or all on one ExternalDevice, to whose queue they
// submit in turn. Of that queue only the caller's own use must not coincide with constructors and fuse().
class Fusion {
 public:
  // Frames that may be recorded and not yet done on the device.
  static constexpr uint32_t kFramesInFlight = 3;

  // `height`, `width`: the size of LRHS in pixels. Allocates all that frames need.
  Fusion(const std::string& model_file, uint32_t height, uint32_t width, const FusionOptions& options = {});
  // On the caller's device; FusionOptions::device is ignored.
  Fusion(const std::string& model_file, uint32_t height, uint32_t width, const FusionOptions& options,
         const ExternalDevice& device);
  ~Fusion();
  Fusion(Fusion&&) noexcept;
  Fusion& operator=(Fusion&&) noexcept;

  uint32_t scale() const;
  // The layers of HRLS that fuse() and record() read, three channels each, in order: color, albedo, normal,
  // diffuse, specular, variance or some of them; without FusionOptions::absent_layers.
  const std::vector<std::string>& hrls_layers() const;
  // The model's layers that it was trained to do without, see FusionOptions::absent_layers.
  const std::vector<std::string>& optional_layers() const;
  // The LRHS size that one recording computes: (height, width) unless memory or limits force tiles. A fuse()
  // that finds the device out of memory makes it smaller, unless record() was called before.
  uint32_t tile_height() const;
  uint32_t tile_width() const;

  // Records one frame into the caller's command buffer, outside of a render pass; never submits, allocates or
  // waits, unless a fuse() before threw for want of memory, after which everything is made anew. lrhs:
  // (tile_height, tile_width, 3), hrls: (s tile_height, s tile_width, 3 for each of hrls_layers()), fused: (s
  // tile_height, s tile_width, 3), scene linear. The inputs must be visible to
  // VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT with VK_ACCESS_SHADER_READ_BIT; the output is written in that stage
  // with VK_ACCESS_SHADER_WRITE_BIT. At most kFramesInFlight recordings may be pending, on one queue, each
  // submitted once. `exposure`: what radiance is multiplied by for the network, from 2^-24 to 2^24, and the
  // output divided by; a renderer knows it of its last frames, as LRHS itself is not looked at here.
  void record(VkCommandBuffer commands, const FrameBuffer& lrhs, const FrameBuffer& hrls,
              const FrameBuffer& fused, float exposure = 1);

  // What fuse() multiplies radiance by for an LRHS, in host memory, planar and dense (3, h, w): the option
  // exposure, else what brings LRHS to the brightness that the model was trained at; 1 for models that ask
  // for none.
  float exposure(const float* lrhs) const;

  // Fuses one frame of host memory, planar and dense: lrhs (3, h, w), hrls (3 for each of hrls_layers(), s h,
  // s w), fused (3, s h, s w). Tiles as needed, submits to the device's queue and waits. No recorded frame
  // may be pending. Throws when the output is not finite. After a throw `fused` may hold some of the tiles.
  FusionStatus fuse(const float* lrhs, const float* hrls, float* fused);

  // Counts since the last call or the last fuse(); call it when the recorded frames are done.
  FusionStatus take_status();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace raymeld
