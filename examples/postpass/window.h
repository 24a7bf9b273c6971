// Opens a window through GLFW, and makes its swapchain.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "device.h"
#include "events.h"
#include "resources.h"

struct GLFWwindow;

namespace postpass {

// Returns the extensions that an instance needs for windows. Throws where there is no display.
std::span<const char* const> window_extensions();

class Window {
 public:
  Window(const Instance& instance, vk::Extent2D size);
  ~Window();
  Window(const Window&) = delete;
  Window& operator=(const Window&) = delete;

  vk::SurfaceKHR surface() const { return *surface_; }
  vk::Extent2D size() const;  // the size in pixels; zero while the window is minimised
  void resize(vk::Extent2D size);
  // Returns the events since the last call, valid until the next one. `wait` waits a while for an event.
  std::span<const Event> poll(bool wait);

 private:
  static void on_key(GLFWwindow* window, int key, int, int action, int);
  static void on_resize(GLFWwindow* window, int width, int height);
  static void on_minimise(GLFWwindow* window, int minimised);

  GLFWwindow* window_ = nullptr;
  vk::UniqueSurfaceKHR surface_;
  std::vector<Event> events_, polled_;
};

// Says how an attempt to acquire or present an image ended.
enum class Outcome {
  kDone,
  kNotNow,  // no image for some time, as when the window is hidden
  kStale,   // the window has changed: make another swapchain
};

class Swapchain {
 public:
  // Returns null while the window has no area.
  static std::unique_ptr<Swapchain> make(const Device& device, const Window& window);

  vk::Extent2D size() const { return size_; }
  // `acquired` is signalled when the image may be written to.
  Outcome acquire(vk::Semaphore acquired);
  // Scales the image to the window. The image must be in the layout for copies from it.
  void record_blit(vk::CommandBuffer commands, const Image& image) const;
  vk::Semaphore written() const { return *written_[index_]; }  // the submission signals it
  Outcome present();

 private:
  explicit Swapchain(const Device& device) : device_(device) {}

  const Device& device_;
  vk::Extent2D size_;
  vk::UniqueSwapchainKHR swapchain_;
  std::vector<vk::Image> images_;
  std::vector<vk::UniqueSemaphore> written_;  // one for each image
  uint32_t index_ = 0;
};

}  // namespace postpass
