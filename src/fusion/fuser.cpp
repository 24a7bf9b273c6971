#include "fusion/fuser.h"

#include <algorithm>

#include "fusion/exposure.h"
#include "numbers.h"

namespace raymeld {
namespace {

FrameBuffer dense_view(const Buffer& buffer, const Shape& shape) {
  return {buffer.handle(), 0, 1, shape.width, static_cast<uint32_t>(shape.pixels())};
}

// Returns the offset of a second buffer behind one with these requirements.
uint64_t place_after(const VkMemoryRequirements& needs) {
  return (needs.size + needs.alignment - 1) / needs.alignment * needs.alignment;
}

}  // namespace

VkMemoryRequirements history_requirements(const Device& device, const Model& model, TileSize frame,
                                          const FuserOptions& options) {
  const uint64_t bytes = history_bytes(model, frame, device.info(), options);
  if (bytes == 0) return {};
  VkMemoryRequirements needs = Buffer::requirements(device, bytes);
  needs.size += place_after(needs);
  return needs;
}

// Does `work` with ever smaller tiles for as long as the device has no memory for it.
template <typename Work>
auto Fuser::within_memory(const Work& work) {
  while (true) {
    try {
      return work();
    } catch (const OutOfMemory& refused) {
      if (recorded_ || !prepared_.empty()) throw;
      take_smaller_tiles(refused);
    }
  }
}

Fuser::Fuser(const Device& device, const Model& model, uint32_t height, uint32_t width,
             const FuserOptions& options, const std::filesystem::path& cache_folder)
    : device_(device),
      model_(model),
      cache_folder_(cache_folder),
      options_(options),
      plan_(plan_fusion(model, height, width, device.info(), options)),
      cache_(device, cache_folder) {
  if (options.profile && device.info().timestamp_period_ns == 0) {
    throw Error("device {} has no timestamps to profile with", device.info().name);
  }
  if (options.exposure != 0) check_exposure(options.exposure);
  within_memory([&] { made_program(); });
  cache_.save();
}

void Fuser::take_smaller_tiles(const OutOfMemory& refused) try {
  FuserOptions smaller = options_;
  const auto [height, width] = plan_.tiling.frame;
  const uint64_t kept = 2 * history_bytes(model_, plan_.tiling.frame, device_.info(), options_);
  smaller.max_memory_bytes = kept + (plan_.peak_bytes() - kept) / 4 * 3 * (options_.fp32_kernels ? 2 : 1);
  FusePlan plan = plan_fusion(model_, height, width, device_.info(), smaller);
  if (shortage_.empty()) shortage_ = refused.what();
  wide_.reset();
  last_redone_ = false;
  if (last_frame_) last_frame_->change_all();
  std::erase_if(last_frames_, [&](const auto& known) { return &known.second != last_frame_; });
  host_.reset();
  exposures_.clear();
  program_.reset();
  plan_ = std::move(plan);
} catch (const Error& error) {
  throw OutOfMemory(
      "{}; the frame needs {:.1f} MiB in all, and smaller tiles are not possible: {}; free some of the "
      "device's memory, or try fp16, a smaller model or another device",
      refused.what(), double(plan_.peak_bytes()) / kMebibyte, error.what());
}

Program& Fuser::made_program() {
  if (!program_) {
    program_.emplace(device_, plan_.graph, cache_, kFramesInFlight + 1, options_.work_limits,
                     options_.scratch);
    if (computes_exposure()) exposure_program(plan_.tiling.tile);
    if (options_.temporal) history(0);  // record() allocates nothing
  }
  return *program_;
}

// Returns the Program that finds the exposure of frames of this size. The network's Program must exist.
Program& Fuser::exposure_program(TileSize size) {
  const auto [height, width] = size;
  if (!exposures_.contains({height, width})) {
    Graph graph(options_.storage, false, false, options_.frame_images);
    const Architecture& a = model_.architecture();
    raymeld::exposure(graph, "exposure", a.bright_slot(), height, width, a.exposure_key);
    graph.plan();
    exposures_.try_emplace({height, width}, std::move(graph), *program_, cache_);
  }
  return exposures_.at({height, width}).program;
}

// Returns the exposure that record() was asked for, or 0 where exposure_program() finds it.
float Fuser::recorded_exposure(float asked) const {
  if (asked != 0 || !options_.compute_exposure) {
    check_exposure(asked);
    return asked;
  }
  if (model_.architecture().exposure_key == 0) return 1;
  if (plan_.tiling.count() > 1)
    throw SizeError(
        "the device cannot compute the exposure of a frame of {} tiles, expected an exposure for the "
        "recording",
        plan_.tiling.count());
  return 0;
}

uint64_t Fuser::allocated_bytes() const {
  const uint64_t frame_bytes = host_ ? host_->lrhs.size_bytes() + host_->hrls.size_bytes() +
                                           host_->motion.size_bytes() + host_->fused.size_bytes()
                                     : 0;
  uint64_t histories_bytes = 0;
  for (const auto& [sequence, history] : histories_)
    histories_bytes += history.last.allocated_bytes() + history.next.allocated_bytes();
  return (program_ ? program_->allocated_bytes() : 0) + frame_bytes + histories_bytes +
         (wide_ ? wide_->allocated_bytes() : 0);
}

std::array<Shape, 3> Fuser::image_shapes(TileSize tile) const {
  return frame_shapes(model_, tile, options_.constants, options_.compute_variance);
}

FrameBindings Fuser::bindings(const FrameBuffer& lrhs, const FrameBuffer& hrls,
                              const FrameBuffer& fused) const {
  const auto shapes = image_shapes(plan_.tiling.tile);
  FrameBindings frame;
  frame[kLrhsSlot] = {lrhs, shapes[0]};
  frame[kHrlsSlot] = {hrls, shapes[1]};
  frame[kFusedSlot] = {fused, shapes[2]};
  return frame;
}

void Fuser::record(VkCommandBuffer commands, const FrameBuffer& lrhs, const FrameBuffer& hrls,
                   const FrameBuffer& fused, float exposure) {
  record(commands, bindings(lrhs, hrls, fused), exposure);
}

void Fuser::record(VkCommandBuffer commands, const FrameBindings& frame, float exposure,
                   std::optional<TileSize> size) {
  exposure = recorded_exposure(exposure);
  if (options_.skip_unchanged) throw Error("record() cannot be used with skip_unchanged, expected fuse()");
  if (size && !is_prepared(*size))
    throw Error("recording a frame of {} x {} LRHS pixels: prepare() was not called for this size",
                size->width, size->height);
  const auto [height, width] = size.value_or(plan_.tiling.tile);
  Program& program =
      TileSize{height, width} == plan_.tiling.tile ? made_program() : prepared_.at({height, width}).program;
  const bool has_motion = frame[kMotionSlot].view.buffer || frame[kMotionSlot].texture.view;
  if (options_.temporal && !has_motion)
    throw Error("a recording without motion, expected it, as a history is kept");
  if (options_.temporal) {
    program.bind(next_set_, with_history(commands, frame, {height, width}));
    const Tile whole{.core = {height, width}};
    program.set_place(next_set_, place_of(whole, {height, width}));
  } else {
    program.bind(next_set_, frame);
  }
  recorded_ = true;
  if (exposure != 0) {
    program.set_exposure(next_set_, exposure);
  } else {
    Program& found = exposure_program({height, width});
    found.bind(next_set_, frame);
    found.record(commands, next_set_, 0, found.graph().passes().size());
  }
  program.record(commands, next_set_, 0, program.graph().passes().size());
  if (options_.temporal) history(0).go_on({height, width});
  show_host(device_, commands);
  next_set_ = (next_set_ + 1) % kFramesInFlight;
}

void Fuser::prepare(TileSize size) {
  if (is_prepared(size)) return;
  Graph graph = graph_within(plan_, model_, size, options_);
  const size_t compiled = made_program().pipelines();
  prepared_.try_emplace({size.height, size.width}, std::move(graph), made_program(), cache_);
  if (computes_exposure()) exposure_program(size);
  if (made_program().pipelines() > compiled) cache_.save();
}

Status Fuser::take_status() {
  if (!program_) return {};  // a fuse() has failed since
  const Status status = program_->status();
  reset_status();
  return status;
}

void Fuser::reset_status() {
  if (program_) program_->reset_status();
}

float Fuser::exposure(const float* lrhs) const {
  if (options_.exposure != 0) return options_.exposure;
  const auto [height, width] = plan_.tiling.frame;
  return exposure_of(lrhs, size_t{height} * width, model_.architecture().exposure_key);
}

void Fuser::prepare_host() {
  if (host_) return;
  auto host = std::make_unique<Host>(device_);
  const auto shapes = image_shapes(plan_.tiling.tile);
  const auto make = [&](Buffer& buffer, const Shape& shape, const char* name) {
    if (shape.channels == 0) return;
    buffer = Buffer(device_, frame_bytes(shape), Memory::kDevice, name);
    if (!buffer.mapped() && !host->staging) host->staging.emplace(device_, shapes[1].width * sizeof(float));
  };
  make(host->lrhs, shapes[0], "lrhs");
  make(host->hrls, shapes[1], "hrls");
  if (options_.temporal) make(host->motion, motion_shape(shapes[2], options_), "motion");
  host->fused = Buffer(device_, frame_bytes(shapes[2]), Memory::kReadback, "fused");
  bind_host(*host);
  if (options_.profile) host->timestamps.emplace(device_, uint32_t(plan_.graph.passes().size()));
  if (!options_.temporal)
    record_chunks(*host, plan_.graph.passes().size());  // run() records each frame with its own histories
  host_ = std::move(host);
}

// Points fuse()'s descriptor set at its buffers and at the histories of the frame at hand. Recordings with
// this set have to be made anew.
void Fuser::bind_host(Host& host) {
  const auto shapes = image_shapes(plan_.tiling.tile);
  FrameBindings frame = bindings(dense_view(host.lrhs, shapes[0]), dense_view(host.hrls, shapes[1]),
                                 dense_view(host.fused, shapes[2]));
  if (options_.temporal) {
    const Shape motion = motion_shape(shapes[2], options_);
    frame[kMotionSlot] = {dense_view(host.motion, motion), motion};
    bind_history(frame, history_ ? *history_ : history(0));
  }
  program_->bind(kHostSet, frame);
}

void Fuser::bind_history(FrameBindings& frame, const History& history) {
  for (const auto& [slot, buffer] :
       {std::pair(kLastSlot, &history.last), std::pair(kNextSlot, &history.next)}) {
    const Shape shape{1, static_cast<uint32_t>(buffer->size_bytes() / sizeof(float)), 1};
    frame[slot] = {.view = dense_view(*buffer, shape), .shape = shape, .address = buffer->address()};
  }
}

FrameBindings Fuser::with_history(VkCommandBuffer commands, FrameBindings frame, TileSize size) {
  if (plan_.tiling.count() > 1)
    throw SizeError("record() keeps no history of a frame of {} tiles, expected fuse()",
                    plan_.tiling.count());
  const History& known = history(0);
  if (known.is_empty || known.size != size) record_fill(device_, commands, known.last.handle(), known.all());
  bind_history(frame, known);
  return frame;
}

Fuser::History& Fuser::history(size_t sequence) {
  const auto found = histories_.find(sequence);
  if (found != histories_.end()) return found->second;
  const uint64_t bytes = history_bytes(model_, plan_.tiling.frame, device_.info(), options_);
  const auto made = [&]() -> History {
    if (!options_.history_memory)
      return {Buffer(device_, bytes, Memory::kDevice, "history"),
              Buffer(device_, bytes, Memory::kDevice, "next history")};
    if (sequence != 0) throw Error("a history of sequence {} in the caller's memory, expected 0", sequence);
    const uint64_t taken = place_after(Buffer::requirements(device_, bytes));
    const MemoryRange first = *options_.history_memory;
    const MemoryRange second{first.memory, first.offset_bytes + taken,
                             first.size_bytes - std::min(taken, first.size_bytes)};
    return {Buffer(device_, bytes, first, "history"), Buffer(device_, bytes, second, "next history")};
  };
  return histories_.emplace(sequence, made()).first->second;
}

void Fuser::reset_history(size_t sequence) {
  const auto found = histories_.find(sequence);
  if (found != histories_.end()) found->second.is_empty = true;
}

// Returns the number of passes until the last one that writes to a history, but for settle() where no next
// frame is fused.
size_t Fuser::history_end(bool next_is_fused) const {
  const auto writes_history = [&](const Pass& pass) {
    return (next_is_fused || pass.name != "settle") &&
           std::ranges::any_of(pass.bindings, [](const Binding& binding) {
             return binding.kind == Binding::Kind::kFrame && binding.slot == kNextSlot;
           });
  };
  size_t end = plan_.graph.passes().size();
  while (end > 0 && !writes_history(plan_.graph.passes()[end - 1])) --end;
  return end;
}

// Records the passes before `end` for fuse().
void Fuser::record_chunks(Host& host, size_t end) const {
  const auto passes = plan_.graph.passes().first(end);
  size_t chunk = 0;
  for (size_t first = 0; first < passes.size(); ++chunk) {
    double work = passes[first].work();
    size_t last = first + 1;
    while (last < passes.size() && work + passes[last].work() <= program_->limits().submit_work) {
      work += passes[last++].work();
    }
    if (chunk == host.chunks.size()) {
      host.chunks.push_back(host.pool.begin(fmt::format("passes {} to {}", first, last - 1)));
    } else {
      host.pool.restart(host.chunks[chunk]);
    }
    const VkCommandBuffer commands = host.chunks[chunk];
    program_->record(commands, kHostSet, first, last, host.timestamps ? &*host.timestamps : nullptr);
    if (last == passes.size()) show_host(device_, commands);
    host.pool.end(commands);
    first = last;
  }
  host.chunk_count = chunk;
}

void Fuser::check_sizes(const Image& lrhs, const Image& hrls, const Image& motion) const {
  const auto shapes = image_shapes(plan_.tiling.frame);
  const auto check_size = [](const char* role, const Image& image, const Shape& shape) {
    if (shape.channels == 0) return;  // it is not read
    if (image.height == static_cast<int>(shape.height) && image.width == static_cast<int>(shape.width) &&
        image.channels == static_cast<int>(shape.channels)) {
      return;
    }
    throw Error("{} is {}x{} with {} channels, expected {}x{} with {}", role, image.width, image.height,
                image.channels, shape.width, shape.height, shape.channels);
  };
  check_size("LRHS", lrhs, shapes[0]);
  check_size("HRLS", hrls, shapes[1]);
  if (options_.temporal) check_size("motion", motion, motion_shape(shapes[2], options_));
}

FuseReport Fuser::fuse(const Image& lrhs, const Image& hrls, Image& fused, const Progress& progress,
                       float exposure, size_t sequence, const Image& motion) {
  check_sizes(lrhs, hrls, motion);
  const Shape shape = image_shapes(plan_.tiling.frame)[2];
  if (fused.width != int(shape.width) || fused.height != int(shape.height) || fused.channels != 3)
    fused = Image(int(shape.width), int(shape.height), 3);
  return fuse(lrhs.data.data(), hrls.data.data(), fused.data.data(), progress, exposure, sequence,
              motion.data.empty() ? nullptr : motion.data.data());
}

void Fuser::remember(const Image& lrhs, const Image& hrls, const Image& motion, bool next_is_fused,
                     const Progress& progress, float exposure, size_t sequence) {
  if (!options_.temporal || options_.profile)
    throw Error("a frame to remember, expected a fusion that keeps a history and measures no times");
  check_sizes(lrhs, hrls, motion);
  next_is_fused_ = next_is_fused;
  fuse(lrhs.data.data(), hrls.data.data(), nullptr, progress, exposure, sequence, motion.data.data());
}

FuseReport Fuser::fuse(const float* lrhs, const float* hrls, float* fused, const Progress& progress,
                       float exposure, size_t sequence, const float* motion) {
  if (exposure != 0) check_exposure(exposure);
  if (options_.frame_images.any()) throw Error("fuse() cannot be used with frame_images, expected record()");
  if (options_.temporal != (motion != nullptr))
    throw Error("a frame {} motion, expected {}", motion ? "with" : "without",
                motion ? "none, as no history is kept" : "it, as a history is kept");
  motion_ = motion;
  if (!model_.architecture().reads_lrhs()) lrhs = hrls;  // HRLS begins with its color
  // The default exposure is the whole frame's, so that all tiles have the same.
  const float factor = exposure != 0 ? exposure : this->exposure(lrhs);
  if (options_.skip_unchanged) {
    const TileSize frame = plan_.tiling.frame;
    const uint32_t channels = image_shapes(frame)[1].channels;
    const auto found = last_frames_.try_emplace(sequence, frame, model_.architecture().scale, channels).first;
    last_frame_ = &found->second;
    last_frame_->begin(lrhs, hrls, factor);
  }
  // The counts are reset however this ends, since take_status() counts recorded frames only.
  struct Reset {
    Fuser& fuser;
    ~Reset() { fuser.reset_status(); }
  } const reset{*this};
  const FuseReport report =
      run_within_memory(lrhs, hrls, last_frame_ ? last_frame_->fused() : fused, factor, progress, sequence);
  if (report.status.not_finite > 0) {
    throw NotFinite("model {} gave {} values that are not finite; the image is of no use", model_.name(),
                    report.status.not_finite);
  }
  if (history_) history_->go_on(plan_.tiling.frame);
  if (last_frame_) {
    std::copy_n(last_frame_->fused(), last_frame_->fused_size(), fused);
    last_frame_->end();
  }
  return report;
}

void Fuser::prepare_fuse(const Progress& progress) {
  within_memory([&] {
    made_program();
    prepare_host();
    run_empty(progress);
  });
}

// Submits all passes at once, or eight parts of them when the caller wants progress: a submit for each pass
// takes 80 ms more in all on a CPU.
void Fuser::run_empty(const Progress& progress) {
  const size_t count = plan_.graph.passes().size(), step = progress ? (count + 7) / 8 : count;
  Commands pool(device_);
  for (size_t first = 0; first < count; first += step) {
    const size_t end = std::min(first + step, count);
    const VkCommandBuffer commands = pool.begin("empty passes");
    for (size_t i = first; i < end; ++i) program_->record_empty(commands, kHostSet, i);
    pool.end(commands);
    device_.submit_and_wait(commands);
    if (progress && !progress(double(end) / double(count))) throw Cancelled();
  }
}

FuseReport Fuser::run_within_memory(const float* lrhs, const float* hrls, float* fused, float exposure,
                                    const Progress& progress, size_t sequence) {
  return within_memory([&] {
    made_program();
    if (motion_) history_ = &history(sequence);
    prepare_host();
    return run(lrhs, hrls, fused, exposure, progress);
  });
}

}  // namespace raymeld
