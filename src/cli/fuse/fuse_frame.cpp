#include <fmt/ranges.h>

#include <atomic>
#include <thread>

#include "cli/fuse/fuse.h"
#include "fusion/fuser_options.h"
#include "io/exr_window.h"
#include "networks/network.h"
#include "platform/folders.h"
#include "platform/interrupt.h"

namespace raymeld::cli {
namespace {

namespace fs = std::filesystem;

void dump_layers(const fs::path& folder, Fuser& fuser, const Image& fused, StagedFiles& staged) {
  const auto write = [&](const std::string& name, std::span<const float> values, const Shape& shape) {
    staged.add(folder / (name + ".npy"),
               [&](AtomicFile& file) { write_npy(file, values, shape.channels, shape.height, shape.width); });
  };
  staged.add_folder(folder);
  for (const Pass* layer : fuser.graph().layers()) {
    check_interrupted();
    if (const Tensor* output = layer->output()) {
      write(layer->name, fuser.program().read(*output), output->shape);
    } else {
      write(layer->name, fused.data,
            {uint32_t(fused.height), uint32_t(fused.width), uint32_t(fused.channels)});
    }
  }
}

// Warns of values that 16 bits could not hold, or throws Error for them if --overflow asks for that.
void report_overflow(const FuseArguments& arguments, const FuseReport& report, uint32_t tiles,
                     Console& console) {
  if (report.redone_tiles > 0) {
    console.warn(fmt::format("{} of {} tiles have values that 16 bits cannot hold, and were computed in fp32",
                             report.redone_tiles, tiles),
                 report.redone_tiles);
  }
  if (report.status.saturated == 0) return;
  const std::string what = fmt::format(
      "{} values within the network passed the largest 16-bit float, 65504; --precision fp32 can hold them",
      report.status.saturated);
  if (arguments.overflow == Overflow::kError)
    throw Error("{}, {}--overflow warn keeps the image", what,
                arguments.temporal ? "" : "--overflow redo uses it where needed, ");
  console.warn(what, report.status.saturated);
}

}  // namespace

const char* precision_name(Storage storage) { return storage == Storage::kFloat16 ? "fp16" : "fp32"; }

void check_keeps_history(const Model& model) {
  const float phase = lrhs_phase(true, model.architecture().scale);
  history_channels(model, model.architecture().reads_lrhs() ? phase : 0, true);
}

bool is_cut(const FuseFrame& frame, CutFinder& cuts) {
  const FuseImages& images = frame.images;
  return cuts.is_cut(images.lrhs, images.hrls, frame.files.layers_without(images.constants), images.motion);
}

FuserOptions options_of(const FuseArguments& arguments, const FuseFiles& files, const Device& device,
                        const ConstantLayers& constants) {
  FuserOptions options = fuser_options(device, *files.model, arguments.precision, arguments.kernels,
                                       arguments.overflow == Overflow::kRedo);
  options.max_memory_bytes = arguments.max_memory_mib << 20;
  options.skip_unchanged = arguments.skip_unchanged;
  options.temporal = options.motion_depth = arguments.temporal;
  options.compute_variance = files.computes_variance;
  if (options.temporal) options.fp32_kernels.reset();  // a history allows no tile to be computed again
  options.constants = constants;
  options.phase = files.model_phase();
  options.samples = files.model_samples();
  options.keep_activations = !arguments.dump.empty();
  options.profile = arguments.profile;
  return options;
}

struct FrameFuser::Cached {
  std::shared_ptr<const Model> model;
  float phase;
  SampleCounts samples;
  ConstantLayers constants;
  uint32_t height, width;  // LRHS's size
  Storage storage;
  Fuser fuser;

  Cached(const Device& device, const FuseFrame& frame, const FuserOptions& options)
      : model(frame.files.model),
        phase(options.phase),
        samples(options.samples),
        constants(options.constants),
        height(uint32_t(frame.images.lrhs.height)),
        width(uint32_t(frame.images.lrhs.width)),
        storage(options.storage),
        fuser(device, *model, height, width, options) {}

  bool suits(const FuseFrame& frame) const {
    const Image& lrhs = frame.images.lrhs;
    return model == frame.files.model && phase == frame.files.model_phase() &&
           samples == frame.files.model_samples() && constants == frame.images.constants &&
           height == uint32_t(lrhs.height) && width == uint32_t(lrhs.width);
  }
};

// Compiles the kernels of a graph that is planned without the pixels. Constant layers may lead to another
// graph, most of whose kernels are the same.
struct FrameFuser::Preparation {
  std::vector<std::shared_ptr<const Kernel>> kernels = {};
  std::atomic<bool> compiles = false;  // kernels are not on disk, and a note has said so
  std::exception_ptr failure = {};
  std::jthread thread = {};

  // Throws Error.
  void compile(const Device& device, const Model& model, const TileSize& frame, const FuserOptions& options,
               const Console& console) {
    const FusePlan plan = plan_fusion(model, frame.height, frame.width, device.info(), options);
    const PipelineCache cache(device, default_cache_folder());
    if (!cache.loaded() && !cache.file().empty()) say_it_compiles(device, console);
    ProgressBar bar(console);
    const auto progress = [&](size_t done, size_t count) {
      if (takes_long(device, console)) bar.update(double(done) / double(count));
    };
    kernels =
        device.kernels().get(device, cache.handle(), kernel_recipes(plan.graph, device.info()), progress);
    cache.save();
  }

  // Returns whether to show progress. Drivers do not say whether they have a kernel on disk, so time decides.
  bool takes_long(const Device& device, const Console& console) {
    constexpr std::chrono::seconds kLong{1};
    if (!compiles && std::chrono::steady_clock::now() - start > kLong) say_it_compiles(device, console);
    return compiles;
  }

  void say_it_compiles(const Device& device, const Console& console) {
    compiles = true;
    console.note(fmt::format("compiling kernels for {}, which is done once", device.info().name));
  }

  const std::chrono::steady_clock::time_point start = std::chrono::steady_clock::now();
};

FrameFuser::FrameFuser(const Device& device) : device_(device) {}

FrameFuser::~FrameFuser() = default;

void FrameFuser::prepare(const FuseFrame& frame) {
  preparation_ = std::make_unique<Preparation>();
  const FuseFiles& files = frame.files;
  const TileSize size{uint32_t(height_of(files.canvas.lrhs)), uint32_t(width_of(files.canvas.lrhs))};
  preparation_->thread = std::jthread(
      [&preparation = *preparation_, &device = device_, model = files.model, size,
       options = options_of(frame.arguments, files, device_, files.absent_layers), console = frame.console] {
        try {
          preparation.compile(device, *model, size, options, console);
        } catch (...) {
          preparation.failure = std::current_exception();
        }
      });
}

FrameFuser::Cached& FrameFuser::cached_for(FuseFrame& frame) {
  if (cached_ && cached_->suits(frame)) return *cached_;
  cached_.reset();  // frees its memory for the next one
  last_frames_.clear();
  const PhaseTimer timer(frame, "prepare");
  const auto preparation = std::exchange(preparation_, nullptr);
  if (preparation) preparation->thread.join();
  if (preparation && preparation->failure) std::rethrow_exception(preparation->failure);
  const FuserOptions options = options_of(frame.arguments, frame.files, device_, frame.images.constants);
  cached_ = std::make_unique<Cached>(device_, frame, options);
  ProgressBar bar(frame.console);
  const auto progress = [&](double share) {
    if (preparation && preparation->takes_long(device_, frame.console)) bar.update(share);
    return !interrupted();
  };
  cached_->fuser.prepare_fuse(progress);
  return *cached_;
}

// Resets the history of a sequence unless it is that of the frame before this one, in the same window.
void FrameFuser::go_on(FuseFrame& frame, size_t sequence, Fuser& fuser) {
  if (!frame.arguments.temporal) return;
  FrameInTime& time = frame.time;
  const Imath::Box2i& window = frame.files.canvas.hrls;
  const auto last = last_frames_.find(sequence);
  const bool follows =
      last != last_frames_.end() && last->second.number + 1 == time.number && last->second.window == window;
  if (sequence == 0 && !follows && !std::exchange(time.starts_anew, true))
    frame.console.note(fmt::format("starts anew, as there is no history of frame {}", time.number - 1));
  if (!follows || time.starts_anew) fuser.reset_history(sequence);
  last_frames_[sequence] = {time.number, window};
}

void FrameFuser::fuse_color(FuseFrame& frame, Cached& cached, const Progress& progress) {
  Fuser& fuser = cached.fuser;
  const FuseArguments& arguments = frame.arguments;
  FuseResult& result = frame.result;
  result.storage = cached.storage;
  const FuseImages& images = frame.images;
  go_on(frame, 0, fuser);
  if (frame.time.is_lead_in)
    return fuser.remember(images.lrhs, images.hrls, images.motion, frame.time.next_is_fused, progress,
                          images.exposure);
  Image fused;
  // Some drivers compile a kernel when it first runs, so a second run is timed.
  if (arguments.profile) fuser.fuse(images.lrhs, images.hrls, fused, progress, images.exposure);
  const PhaseTimer timer(frame, "fuse");
  const Stopwatch watch;
  result.report = fuser.fuse(images.lrhs, images.hrls, fused, progress, images.exposure, 0, images.motion);
  result.time_ms = watch.ms();
  result.tiling = fuser.plan().tiling;
  if (result.report.redone_tiles == result.tiling.count()) result.storage = Storage::kFloat32;
  report_overflow(arguments, result.report, result.tiling.count(), frame.console);
  if (!arguments.dump.empty()) dump_layers(arguments.dump_folder(), fuser.last(), fused, frame.staged);
  result.fused = seen_through(std::move(fused), frame.files.canvas.hrls, frame.files.window);
}

Image FrameFuser::fuse_companion(FuseFrame& frame, const Companion& companion, const Image& hrls,
                                 float exposure, Fuser& fuser, const Progress& progress) {
  FuseResult& result = frame.result;
  const Image& motion = frame.images.motion;
  Image fused;
  go_on(frame, companion.sequence, fuser);
  if (frame.time.is_lead_in) {
    fuser.remember(companion.lrhs, hrls, motion, frame.time.next_is_fused, progress, exposure,
                   companion.sequence);
    return fused;
  }
  const Stopwatch watch;
  const FuseReport report =
      fuser.fuse(companion.lrhs, hrls, fused, progress, exposure, companion.sequence, motion);
  result.time_ms += watch.ms();
  result.report.add_times(report);
  result.report.skipped_share += report.skipped_share;
  report_overflow(frame.arguments, report, fuser.plan().tiling.count(), frame.console);
  return fused;
}

void FrameFuser::fuse(FuseFrame& frame, const Progress& progress) try {
  Cached& cached = cached_for(frame);
  if (!progress(0)) throw Cancelled();
  Fuser& fuser = cached.fuser;
  const double count = double(1 + frame.images.companions.size());
  double done = 0;
  const auto of_all = [&](double share) { return progress((done + share) / count); };
  fuse_color(frame, cached, of_all);
  if (count > 1) {
    const PhaseTimer timer(frame, "companions");
    fuse_companions(frame, [&](const Companion& companion, const Image& hrls, float exposure) {
      ++done;
      return fuse_companion(frame, companion, hrls, exposure, fuser, of_all);
    });
  }
  frame.result.report.skipped_share /= count;
  const Tiling& tiling = fuser.plan().tiling;
  if (!fuser.shortage().empty()) {
    frame.console.warn(
        fmt::format("{}; computed in {} smaller tiles of {} x {} {} instead", fuser.shortage(),
                    tiling.count(), tiling.tile.width, tiling.tile.height, frame.files.pixels()),
        1);
  }
  frame.result.allocated_bytes = fuser.allocated_bytes();
} catch (...) {
  cached_.reset();  // its state is unknown; the next frame gets a new one, without a history
  last_frames_.clear();
  throw;
}

}  // namespace raymeld::cli
