// Holds the program's state and its loop of frames.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>

#include "allocations.h"
#include "events.h"
#include "frames.h"
#include "instance.h"
#include "models.h"
#include "output.h"
#include "times.h"
#include "window.h"

namespace postpass {

struct DemoOptions {
  std::filesystem::path models;
  std::string model = "x4-fast";
  vk::Extent2D size{256, 256};
  bool headless = false;
  uint32_t zoom = 2;    // window pixels for one pixel of the image, in each direction
  uint64_t frames = 0;  // 0: until the window is closed
  uint32_t in_flight = 2;
  uint32_t device = 0;
  bool still = false;   // the camera does not move
  bool moving = false;  // the red ball and the lamp move
  bool validate = false;
  bool overlay = true;
  std::vector<ScriptedEvent> script;
  std::filesystem::path png, y4m;
  RendererOptions renderer;
};

struct FrameAllocations {
  uint64_t frames = 0;
  Allocations made;
};

class Demo {
 public:
  explicit Demo(const DemoOptions& options);
  ~Demo();

  // Renders all frames.
  void run();

  uint32_t validation_messages() const { return instance_->messages(); }
  // Return the allocations in the first frames after something was made anew, for which drivers compile, and
  // those in all other frames.
  const FrameAllocations& first_allocations() const { return first_; }
  const FrameAllocations& allocations() const { return settled_; }
  const Times& times() const { return times_; }

 private:
  void handle(const Event& event);
  void handle_key(char key);
  void make_device();
  void make_renderer();
  void drop_renderer();
  void fit_window();
  void settle();
  bool frame();
  void finish(const FrameResult& result);
  Frame describe_frame();
  void keep_last();
  void write_text();
  void say(const char* what, const std::string& value) const;

  DemoOptions options_;
  Models models_;
  size_t model_;
  std::unique_ptr<Instance> instance_;
  std::unique_ptr<Window> window_;
  std::unique_ptr<Device> device_;
  std::unique_ptr<Swapchain> swapchain_;
  std::unique_ptr<Renderer> renderer_;
  std::unique_ptr<Frames> frames_;
  std::optional<Y4mFile> y4m_;

  std::optional<Frame> last_;  // the last frame that this renderer rendered
  std::vector<float> kept_;    // the pixels of that frame, for a PNG
  vk::Extent2D kept_size_;
  uint32_t view_ = kViewFused;
  uint64_t frame_ = 0;
  bool minimised_ = false, quit_ = false, resized_ = false;
  uint32_t settling_ = 0;  // coming frames that may allocate, as something was made anew
  double camera_s_ = 0, scene_s_ = 0;
  Times times_;
  char text_[kTextRows][kTextColumns];
  uint32_t text_rows_ = 0;
  std::optional<double> last_s_;
  FrameAllocations first_, settled_;
};

}  // namespace postpass
