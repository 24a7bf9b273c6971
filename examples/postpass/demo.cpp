#include "demo.h"

#include <cctype>
#include <chrono>
#include <cstring>

#include "camera.h"

namespace postpass {
namespace {

constexpr double kFrameSeconds = 1.0 / 30;  // the time between two headless frames

constexpr const char* kViewNames[] = {"LRHS", "HRLS", "fused", "converged"};

double now_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

std::string text_of(vk::Extent2D size) {
  return std::to_string(size.width) + "x" + std::to_string(size.height);
}

vk::Extent2D divided(vk::Extent2D size, uint32_t zoom) {
  return {std::max(1u, size.width / zoom), std::max(1u, size.height / zoom)};
}

}  // namespace

Demo::Demo(const DemoOptions& options)
    : options_(options), models_(options.models), model_(models_.find(options.model)) {
  instance_ = std::make_unique<Instance>(
      options_.headless ? std::span<const char* const>{} : window_extensions(), options_.validate);
  const vk::Extent2D window{options_.zoom * options_.size.width, options_.zoom * options_.size.height};
  if (!options_.headless) window_ = std::make_unique<Window>(*instance_, window);
  make_device();
  make_renderer();
  if (!options_.y4m.empty()) y4m_.emplace(options_.y4m, options_.size, 1 / kFrameSeconds);
}

Demo::~Demo() {
  if (device_) vkDeviceWaitIdle(device_->get());
}

void Demo::make_device() {
  drop_renderer();
  swapchain_.reset();
  device_.reset();
  device_ = std::make_unique<Device>(*instance_, options_.device, window_ ? window_->surface() : nullptr);
  if (window_) swapchain_ = Swapchain::make(*device_, *window_);
  say("device", device_->name());
}

// Finishes the frames in flight first.
void Demo::drop_renderer() {
  if (frames_) {
    for (size_t i = 0; i < frames_->size(); ++i)
      if (const auto result = frames_->next().finish()) finish(*result);
    if (last_ && !options_.png.empty()) keep_last();
    device_->get().waitIdle();
  }
  frames_.reset();
  renderer_.reset();
  last_.reset();
  settle();
}

void Demo::make_renderer() {
  drop_renderer();
  if (swapchain_) options_.size = divided(swapchain_->size(), options_.zoom);
  renderer_ = std::make_unique<Renderer>(*device_, models_[model_], options_.size, options_.renderer);
  frames_ = std::make_unique<Frames>(*device_, *renderer_, options_.in_flight);
  say("renders", models_.name(model_) + ", " + text_of(options_.size));
}

// Keeps the image's size where the window's new size rounds to it, or where the window has no area.
void Demo::fit_window() {
  resized_ = false;
  device_->get().waitIdle();
  swapchain_.reset();
  swapchain_ = Swapchain::make(*device_, *window_);
  settle();
  if (swapchain_ && divided(swapchain_->size(), options_.zoom) != options_.size) make_renderer();
}

// The next frames may allocate, as something was made anew, and the time that this took is not counted.
void Demo::settle() {
  settling_ = 2 * options_.in_flight;
  last_s_.reset();
}

void Demo::say(const char* what, const std::string& value) const {
  std::printf("frame %llu: %s %s\n", static_cast<unsigned long long>(frame_), what, value.c_str());
  std::fflush(stdout);
}

void Demo::handle(const Event& event) {
  switch (event.kind) {
    case Event::kKey:
      return handle_key(event.key);
    case Event::kResize:
      if (window_) {
        resized_ = true;  // run() calls fit_window() once, however many events there are
        return;
      }
      options_.size = event.size;
      return make_renderer();
    case Event::kMinimise:
    case Event::kRestore:
      minimised_ = event.kind == Event::kMinimise;
      settle();
      return say("window", minimised_ ? "minimised" : "restored");
    case Event::kQuit:
      quit_ = true;
  }
}

void Demo::handle_key(char key) {
  const auto use = [&](size_t model) {
    model_ = model;
    make_renderer();
  };
  switch (key) {
    case '1':
    case '2':
    case '3':
    case '4':
      view_ = uint32_t(key - '1');
      settle();
      return say("shows", kViewNames[view_]);
    case 's':
      return use(models_.next_scale(model_));
    case 'm':
      return use(models_.next(model_));
    case 'q':
      return use(models_.next_quality(model_));
    case 'h':
      options_.renderer.history = !options_.renderer.history;
      make_renderer();
      return say("history", options_.renderer.history ? "on" : "off");
    case ' ':
      options_.still = !options_.still;
      return say("camera", options_.still ? "still" : "moves");
    case 'o':
      options_.moving = !options_.moving;
      return say("objects", options_.moving ? "move" : "still");
    case 'd':
      ++options_.device;
      make_device();
      return make_renderer();
    case 'f':
      options_.in_flight = options_.in_flight == 2 ? 3 : 2;
      make_renderer();
      return say("frames in flight", std::to_string(options_.in_flight));
    default:
      return;
  }
}

void Demo::run() {
  size_t scripted = 0;
  while (!quit_ && (options_.frames == 0 || frame_ < options_.frames)) {
    const bool hidden = minimised_ || (window_ && !swapchain_);
    if (window_)
      for (const Event& event : window_->poll(hidden)) handle(event);
    for (; scripted < options_.script.size() && options_.script[scripted].frame <= frame_; ++scripted) {
      const Event& event = options_.script[scripted].event;
      if (window_ && event.kind == Event::kResize)
        window_->resize(event.size);  // the window then reports an event
      else
        handle(event);
    }
    if (quit_) break;
    if (minimised_) {
      ++frame_;
      continue;
    }
    if (window_ && (resized_ || !swapchain_)) fit_window();
    const Allocations before = allocations_so_far();
    if (!frame()) continue;
    ++frame_;
    FrameAllocations& counted = settling_ > 0 ? first_ : settled_;
    settling_ -= settling_ > 0;
    ++counted.frames;
    counted.made += allocations_so_far() - before;
  }
  drop_renderer();
  if (y4m_) y4m_->close();
  if (options_.png.empty()) return;
  if (kept_.empty())
    throw std::runtime_error("no frame was rendered that " + options_.png.string() + " could hold");
  write_png(options_.png, kept_.data(), kept_size_);
}

Frame Demo::describe_frame() {
  const vk::Extent2D full = renderer_->full_size();
  Frame frame;
  frame.camera = camera_at(camera_s_, double(full.width) / full.height);
  frame.scene_s = float(scene_s_);
  frame.view = view_;
  if (options_.overlay) {
    write_text();
    frame.text_rows = text_rows_;
    frame.text = text_;
  }
  return frame;
}

// Returns whether it rendered a frame, which it does not while the window takes none.
bool Demo::frame() {
  if (window_ && !swapchain_) return false;
  Slot& slot = frames_->next();
  const auto result = slot.finish();
  if (result) finish(*result);
  if (swapchain_) {
    const Outcome outcome = swapchain_->acquire(slot.acquired());
    resized_ |= outcome == Outcome::kStale;
    if (outcome != Outcome::kDone) return false;
  }

  const double now = now_s();
  const double since_s = last_s_ ? now - *last_s_ : 0;
  // The first frames in flight wait for no earlier ones, so their times are not counted.
  if (last_s_ && result) times_.add_frame(1e3 * since_s);
  last_s_ = now;
  const double step_s = window_ ? since_s : kFrameSeconds;
  if (!options_.still) camera_s_ += step_s;
  if (options_.moving) scene_s_ += step_s;

  const Frame frame = describe_frame();
  last_ = frame;
  const vk::CommandBuffer commands = slot.begin();
  renderer_->record(commands, frame, slot.queries());
  if (y4m_) slot.record_copy();
  if (swapchain_) swapchain_->record_blit(commands, renderer_->shown());
  slot.submit(swapchain_ ? slot.acquired() : nullptr, swapchain_ ? swapchain_->written() : nullptr);
  if (swapchain_) resized_ |= swapchain_->present() == Outcome::kStale;
  return true;
}

void Demo::finish(const FrameResult& result) {
  times_.add_parts(result.part_ms);
  if (y4m_ && result.image) y4m_->write(result.image, renderer_->shown().size);
}

// Copies the last frame to the host. All slots must be idle.
void Demo::keep_last() {
  Slot& slot = frames_->next();
  renderer_->record_again(slot.begin(), last_->view, slot.queries());
  slot.record_copy();
  slot.submit(nullptr, nullptr);
  const float* image = slot.finish()->image;
  kept_size_ = renderer_->shown().size;
  kept_.assign(image, image + size_t{4} * kept_size_.width * kept_size_.height);
}

void Demo::write_text() {
  text_rows_ = 0;
  const auto line = [&](const char* format, auto... values) {
    char(&row)[kTextColumns] = text_[text_rows_++];
    char buffer[kTextColumns + 1];
    const int length = std::snprintf(buffer, sizeof(buffer), format, values...);
    for (int i = 0; i < int(kTextColumns); ++i)
      row[i] = i < length ? char(std::toupper(static_cast<unsigned char>(buffer[i]))) : ' ';
  };
  const vk::Extent2D small = renderer_->small_size(), full = renderer_->full_size();
  line("%s, %ux%u", models_.name(model_).c_str(), options_.size.width, options_.size.height);
  line("%s%s, %u in flight", kViewNames[view_],
       options_.renderer.history && view_ == kViewFused ? " + history" : "", options_.in_flight);
  if (view_ == kViewConverged)
    line("%u samples", renderer_->accumulated_frames() * options_.renderer.hrls_samples);
  line("lrhs %5.1f ms  %ux%u, %u spp", times_.part_ms(0), small.width, small.height,
       renderer_->lrhs_samples());
  line("hrls %5.1f ms  %ux%u, %u spp", times_.part_ms(1), full.width, full.height,
       options_.renderer.hrls_samples);
  line("fuse %5.1f ms", times_.part_ms(2));
  line("show %5.1f ms", times_.part_ms(3));
  if (times_.frame_ms() > 0) line("all  %5.1f ms  %.1f fps", times_.frame_ms(), 1e3 / times_.frame_ms());
}

}  // namespace postpass
