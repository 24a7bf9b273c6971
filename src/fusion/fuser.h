// Fuses frames: records a graph for a model and a size, then takes one call for each frame.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <vector>

#include "engine/commands.h"
#include "engine/program.h"
#include "engine/staging_ring.h"
#include "engine/timestamps.h"
#include "fusion/last_frame.h"
#include "fusion/plan.h"
#include "io/image.h"
#include "platform/folders.h"

namespace raymeld {

// Sums up all passes of a layer, or of a kernel.
struct PassTime {
  std::string name;
  double time_ms = 0;
  double flop = 0;
  double bytes = 0;
};

struct FuseReport {
  float exposure = 1;         // the factor of radiance for the network
  double device_ms = 0;       // time from a tile's first submit to its end, summed over the tiles
  Status status;              // counts of the values that made the image
  uint32_t redone_tiles = 0;  // computed again in 32 bits; see FuserOptions::fp32_kernels
  // Holds the share of the frame's work that was skipped, because nothing changed there since the last frame;
  // see FuserOptions::skip_unchanged.
  double skipped_share = 0;
  // FuserOptions::profile fills these, each in the order of the first pass.
  std::vector<PassTime> layers;
  std::vector<PassTime> kernels;

  // Adds the times of another run.
  void add_times(const FuseReport& run);
};

// Is called with the share of a frame that is done, in [0, 1]. Returning false stops it with Cancelled.
using Progress = std::function<bool(double)>;

// Is thrown where a network's output is not finite; the image is of no use.
class NotFinite : public Error {
 public:
  using Error::Error;
};

// Is thrown where bytes are no saved history, or one of other frames.
class HistoryError : public Error {
 public:
  using Error::Error;
};

// Returns what memory the history of a sequence of (frame.height, frame.width) LRHS pixels needs, of no bytes
// without FuserOptions::temporal. Throws Error where none is kept.
VkMemoryRequirements history_requirements(const Device& device, const Model& model, TileSize frame,
                                          const FuserOptions& options);

class Fuser {
 public:
  // Allocates all that frames of (height, width) LRHS pixels need, and compiles the pipelines through the
  // cache on disk. If the device has less memory than it says, tiles become smaller until they fit. `device`
  // and `model` must outlive the Fuser. Throws Error.
  Fuser(const Device& device, const Model& model, uint32_t height, uint32_t width,
        const FuserOptions& options, const std::filesystem::path& cache_folder = default_cache_folder());

  const FusePlan& plan() const { return plan_; }
  const Graph& graph() const { return plan_.graph; }
  Program& program() { return made_program(); }
  // Returns the Fuser that computed the last tile: this one, or the one that computed it again in 32 bits.
  Fuser& last() { return last_redone_ ? *wide_ : *this; }
  // Returns the message of the first allocation that failed, so that tiles, or those computed again in 32
  // bits, are smaller than planned; empty if none failed.
  const std::string& shortage() const { return shortage_; }
  // Returns the bytes that the Fuser has allocated on the device, also for tiles computed again in 32 bits.
  uint64_t allocated_bytes() const;

  // Records one frame into the caller's command buffer, outside of any render pass. Never submits, allocates
  // or waits, unless a fuse() before threw OutOfMemory, after which everything is made anew. The images are
  // scene linear floats in storage buffers of this device: lrhs (h, w, 3), hrls (s h, s w, K) of
  // image_layers(), and fused (s h, s w, 3). h and w are plan().tiling.tile; a frame of several tiles is
  // recorded tile by tile, with views that start at each tile. The inputs must be visible to
  // VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT / VK_ACCESS_SHADER_READ_BIT. That stage writes the output with
  // VK_ACCESS_SHADER_WRITE_BIT, and the recording makes it visible to the host, with the counts that
  // take_status() reads. At most kFramesInFlight recordings may be pending, each submitted at most once, to
  // one queue. `exposure` is the factor of radiance for the network; FuserOptions::exposure does not count
  // here. With FuserOptions::compute_exposure, 0 makes the device compute exposure() of this LRHS; frames in
  // several tiles then throw SizeError. Throws Error when a view exceeds the device's limits, and with
  // FuserOptions::skip_unchanged, since record() does not look for changes. With FuserOptions::temporal each
  // recording goes on with the frame of the one before, so that all must be submitted, in this order; frames
  // in several tiles throw SizeError, and a frame of another size than the last one is the first of a
  // sequence.
  void record(VkCommandBuffer commands, const FrameBuffer& lrhs, const FrameBuffer& hrls,
              const FrameBuffer& fused, float exposure = 1);
  // Does the same with images by slot, for FuserOptions::frame_images. They are read in
  // VK_IMAGE_LAYOUT_GENERAL or SHADER_READ_ONLY_OPTIMAL, written in GENERAL, and left so. `size` is that of
  // LRHS, by default the tile's; others need a prepare() before.
  void record(VkCommandBuffer commands, const FrameBindings& frame, float exposure = 1,
              std::optional<TileSize> size = {});

  // Makes ready for recordings of frames of another size, at most as large as the tile in both directions;
  // recordings may be pending. The frames have the bits of a Fuser of that size with the same kernels. Throws
  // Error, also for frames in several tiles.
  void prepare(TileSize size);
  // Returns whether record() can take this size: the tile's, or one that was prepared.
  bool is_prepared(TileSize size) const {
    return size == plan_.tiling.tile || prepared_.contains({size.height, size.width});
  }

  // Returns the counts of recordings since the last call or the last fuse(), when they are done.
  Status take_status();

  // Returns which of the kFramesInFlight recordings the next one takes the place of.
  uint32_t next_frame() const { return next_set_; }

  // Returns the exposure that fuse() uses for this LRHS (3, h, w), planar and dense, or for the color of HRLS
  // where the model reads it alone.
  float exposure(const float* lrhs) const;

  // Does all work of the first fuse() but the fusing: allocates, records, and runs passes without workgroups,
  // since some drivers compile a kernel when it first runs. Throws as fuse() does.
  void prepare_fuse(const Progress& progress = {});

  // Fuses one frame: lrhs (3, h, w) and hrls (K, s h, s w) to fused (3, s h, s w), scene linear. A render
  // that the model does not read may be null. Runs tile by tile and waits. The first call
  // allocates and records, and so does the first that computes a tile again; other calls only submit. No
  // frame of record() may be pending. When the device runs out of memory, the frame starts again with smaller
  // tiles, unless record(), or prepare() of another size, was called before: recordings may still be
  // submitted. Throws NotFinite, Cancelled and Error, also with FuserOptions::frame_images; `fused` may then
  // hold some tiles, and the next call works if the device does. FuserOptions::skip_unchanged keeps the
  // inputs and the output for the next call of the same `sequence`, and the bits are those of a first call.
  // `exposure` is the factor of radiance for the network, to be given for parts of a larger frame; 0 means
  // exposure().
  FuseReport fuse(const Image& lrhs, const Image& hrls, Image& fused, const Progress& progress = {},
                  float exposure = 0, size_t sequence = 0, const Image& motion = {});
  // Does the same on planar, dense memory of the caller's, whose sizes are not checked.
  // `motion` (2, s h, s w), which FuserOptions::temporal needs, leads from each pixel to the same point in
  // the last frame of the sequence, in pixels along x and y; where it is not finite there is no such point.
  // It is (4, s h, s w) with FuserOptions::motion_depth: the depths of the point in this frame and in the
  // last one follow; what is not positive and finite says nothing. A frame that throws leaves the history as
  // it was.
  FuseReport fuse(const float* lrhs, const float* hrls, float* fused, const Progress& progress = {},
                  float exposure = 0, size_t sequence = 0, const float* motion = nullptr);

  // Takes a frame into the history of its sequence as fuse() does, without an output. Runs only the layers
  // that the history depends on. Those of the network do not belong to them unless `next_is_fused`, as only
  // the next frame reads what they leave.
  void remember(const Image& lrhs, const Image& hrls, const Image& motion, bool next_is_fused,
                const Progress& progress = {}, float exposure = 0, size_t sequence = 0);

  // Makes the next frame of a sequence its first one. record() goes on with sequence 0.
  void reset_history(size_t sequence = 0);

  // Returns the bytes of a saved history; 0 without FuserOptions::temporal.
  uint64_t saved_history_bytes() const;
  // Copies what the last frame left for the next one. No frame of record() may be pending. Throws Error.
  void save_history(std::span<std::byte> to, size_t sequence = 0);
  // Makes the next frame go on with a history that was saved on a computer of the same byte order, by a Fuser
  // for frames of the same size, scale and layers. No frame of record() may be pending. Throws HistoryError
  // if it is none, and Error; the history is then as it was.
  void load_history(std::span<const std::byte> from, size_t sequence = 0);

 private:
  static constexpr uint32_t kHostSet = kFramesInFlight;  // the descriptor set of fuse()'s own recordings

  // Holds a part of a planar image of floats.
  struct ImageWindow {
    const float* values = nullptr;  // the first channel's first row
    size_t row_stride = 0, plane = 0;
    uint32_t channels = 0, height = 0, width = 0;

    // Returns the number of rows of all channels.
    size_t rows() const { return size_t{channels} * height; }
    // Copies rows [first, last) to dense memory.
    void copy(size_t first, size_t last, float* to) const;
  };

  // Holds the buffers and recordings of fuse(), made once.
  struct Host {
    Buffer lrhs, hrls, motion, fused;
    Commands pool;
    std::vector<VkCommandBuffer> chunks;   // parts of one tile, each short enough for a watchdog
    size_t chunk_count = 0;                // those of the frame at hand
    std::optional<Timestamps> timestamps;  // with FuserOptions::profile
    std::optional<StagingRing> staging;    // where the host does not see lrhs and hrls
    explicit Host(const Device& device) : pool(device, VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT) {}
  };

  // Holds what the last frame of a sequence left for the next one, and room for what that one leaves.
  struct History {
    Buffer last, next;
    TileSize size = {};    // of the last frame
    bool is_empty = true;  // whatever `last` holds
    FillRegion all() const { return {0, last.size_bytes(), 0}; }
    // Makes what a frame of this size left that of the last frame.
    void go_on(TileSize of) {
      std::swap(last, next);
      size = of;
      is_empty = false;
    }
  };

  // Holds a graph of record() beside the network for frames of the tile's size: the network for another size,
  // or the layer that finds an exposure.
  struct Prepared {
    Graph graph;
    Program program;
    Prepared(Graph of, const Program& larger, PipelineCache& cache)
        : graph(std::move(of)), program(larger, graph, cache) {}
  };

  template <typename Work>
  auto within_memory(const Work& work);
  void take_smaller_tiles(const OutOfMemory& refused);
  Program& made_program();
  // Returns whether record() may be asked for the exposure. Several tiles are never seen as a whole.
  bool computes_exposure() const {
    return options_.compute_exposure && model_.architecture().exposure_key > 0 && plan_.tiling.count() == 1;
  }
  float recorded_exposure(float asked) const;
  Program& exposure_program(TileSize size);
  void reset_status();
  void check_sizes(const Image& lrhs, const Image& hrls, const Image& motion) const;
  std::array<Shape, 3> image_shapes(TileSize tile) const;
  FrameBindings bindings(const FrameBuffer& lrhs, const FrameBuffer& hrls, const FrameBuffer& fused) const;
  FuseReport run_within_memory(const float* lrhs, const float* hrls, float* fused, float exposure,
                               const Progress& progress, size_t sequence = 0);
  FuseReport run(const float* lrhs, const float* hrls, float* fused, float exposure,
                 const Progress& progress);
  History& history(size_t sequence);
  static void bind_history(FrameBindings& frame, const History& history);
  void bind_host(Host& host);
  // Joins a frame of record() with the history of sequence 0.
  FrameBindings with_history(VkCommandBuffer commands, FrameBindings frame, TileSize size);
  // Returns where a tile lies in the frame.
  Place place_of(const Tile& at, TileSize frame) const;
  Status run_tile(const Progress& progress, FuseReport& report);
  Image redo_tile(const ImageWindow& lrhs, const ImageWindow& hrls, const Progress& progress,
                  FuseReport& report);
  void prepare_host();
  void run_empty(const Progress& progress);
  void record_chunks(Host& host, size_t end) const;
  size_t history_end(bool next_is_fused) const;
  // Returns the part of a frame's image that a tile reads, of which it has the shape.
  ImageWindow window(const float* image, const Shape& shape, uint32_t scale, const Tile& at) const;
  // Returns the parts of the frame's LRHS and HRLS that a tile reads.
  std::array<ImageWindow, 2> windows(const float* lrhs, const float* hrls, const Tile& at) const;
  void upload(const ImageWindow& window, const Buffer& to);
  // Copies the core from the planar, dense image of a tile.
  void copy_core(const float* tile_image, float* fused, const Tile& at) const;
  void add_pass_times(FuseReport& report) const;

  const Device& device_;
  const Model& model_;
  std::filesystem::path cache_folder_;
  FuserOptions options_;
  FusePlan plan_;
  PipelineCache cache_;
  std::optional<Program> program_;
  std::map<std::pair<uint32_t, uint32_t>, Prepared> prepared_, exposures_;  // keyed by height and width
  bool recorded_ = false;  // record() was called since the Fuser was made
  std::string shortage_;
  uint32_t next_set_ = 0;
  std::unique_ptr<Host> host_;
  std::unique_ptr<Fuser> wide_;  // fuses one tile in 32 bits; made when first needed
  bool last_redone_ = false;
  std::map<size_t, LastFrame> last_frames_;  // keyed by sequence; see FuserOptions::skip_unchanged
  LastFrame* last_frame_ = nullptr;          // the one of the frame at hand
  std::map<size_t, History> histories_;      // keyed by sequence; see FuserOptions::temporal
  History* history_ = nullptr;               // the one of the frame at hand
  const float* motion_ = nullptr;            // of the frame at hand
  bool next_is_fused_ = true;                // of a frame to remember
};

}  // namespace raymeld
