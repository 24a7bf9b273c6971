// Records frames: both renders, the fusion and the image that is shown.
#pragma once

#include <array>
#include <raymeld/raymeld.hpp>

#include "params.h"
#include "passes.h"
#include "resources.h"

namespace postpass {

struct RendererOptions {
  uint32_t lrhs_samples = 0;  // samples a pixel; 0: the square of the scale
  uint32_t hrls_samples = 1;
  bool history = false;  // joins each frame with the ones before it
  raymeld_precision precision = RAYMELD_PRECISION_AUTO;
};

// Lists the parts of a frame that are timed, in order.
enum class Part { kLrhs, kHrls, kFusion, kShow };
constexpr uint32_t kParts = 4;
constexpr std::array<const char*, kParts> kPartNames = {"LRHS", "HRLS", "fusion", "show"};
constexpr uint32_t kStamps = kParts + 1;

struct Frame {
  Camera camera = {};
  float scene_s = 0;           // the time of what moves in the room
  uint32_t view = kViewFused;  // one of params.h; kViewConverged discards the history
  bool restarts = false;       // discards what kViewConverged has accumulated
  uint32_t text_rows = 0;
  const char (*text)[kTextColumns] = nullptr;
};

class Renderer {
 public:
  // Shows images of `size`; the rendered size is rounded up to a multiple of the model's scale.
  Renderer(const Device& device, const raymeld::SharedModel& model, vk::Extent2D size,
           const RendererOptions& options);

  // Records a frame into shown(), which is then in the layout for copies from it. Resets `queries` and fills
  // kStamps timestamps of it.
  void record(vk::CommandBuffer commands, const Frame& frame, vk::QueryPool queries);
  // Does the same for another view of the last frame, without times.
  void record_again(vk::CommandBuffer commands, uint32_t view, vk::QueryPool queries) const;

  const Image& shown() const { return shown_; }
  vk::Extent2D full_size() const { return full_; }
  vk::Extent2D small_size() const { return small_; }
  uint32_t lrhs_samples() const { return constants_.lrhs_samples; }
  uint32_t accumulated_frames() const { return accumulated_; }

 private:
  void update_constants(vk::CommandBuffer commands, const Frame& frame);
  void record_view(vk::CommandBuffer commands, uint32_t view) const;
  void record_end(vk::CommandBuffer commands) const;

  vk::Extent2D small_, full_;
  raymeld::Fusion fusion_;
  std::array<Buffer, kShown> buffers_;
  Image shown_;
  Passes passes_;
  Constants constants_{};
  bool first_ = true;
  bool is_joined_ = false;    // the fusion has the frame before
  uint32_t accumulated_ = 0;  // frames in the converged image
};

}  // namespace postpass
