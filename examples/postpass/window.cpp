#include "window.h"

#include <GLFW/glfw3.h>

#include <algorithm>
#include <cctype>
#include <stdexcept>

#include "allocations.h"

namespace postpass {
namespace {

[[noreturn]] void fail(const char* what) {
  const char* why = nullptr;
  glfwGetError(&why);
  throw std::runtime_error(std::string(what) + ": " + (why ? why : "no reason given"));
}

std::vector<Event>& events_of(GLFWwindow* window) {
  return *static_cast<std::vector<Event>*>(glfwGetWindowUserPointer(window));
}

// Chooses a format without conversion, as values are sRGB already.
vk::SurfaceFormatKHR choose_format(const Device& device, vk::SurfaceKHR surface) {
  for (const vk::SurfaceFormatKHR& format : device.physical().getSurfaceFormatsKHR(surface))
    if (format.format == vk::Format::eB8G8R8A8Unorm || format.format == vk::Format::eR8G8B8A8Unorm)
      return format;
  throw std::runtime_error("the window takes no 8-bit images");
}

// A suboptimal swapchain still shows images; where its size is wrong, the window reports a resize.
Outcome outcome_of(vk::Result result, const char* what) {
  if (result == vk::Result::eErrorOutOfDateKHR) return Outcome::kStale;
  if (result == vk::Result::eTimeout) return Outcome::kNotNow;
  if (result != vk::Result::eSuboptimalKHR) vk::resultCheck(result, what);
  return Outcome::kDone;
}

vk::CompositeAlphaFlagBitsKHR choose_alpha(vk::CompositeAlphaFlagsKHR supported) {
  using Alpha = vk::CompositeAlphaFlagBitsKHR;
  for (const Alpha alpha : {Alpha::eOpaque, Alpha::eInherit, Alpha::ePreMultiplied, Alpha::ePostMultiplied})
    if (supported & alpha) return alpha;
  throw std::runtime_error("the window blends images in no way that is known");
}

}  // namespace

std::span<const char* const> window_extensions() {
  if (!glfwInit()) fail("opening a window (--headless needs none)");
  uint32_t count = 0;
  const char** const names = glfwGetRequiredInstanceExtensions(&count);
  if (!names) fail("a window with Vulkan");
  return {names, count};
}

Window::Window(const Instance& instance, vk::Extent2D size) {
  events_.reserve(64);
  polled_.reserve(64);
  glfwWindowHint(GLFW_CLIENT_API, GLFW_NO_API);
  window_ = glfwCreateWindow(int(size.width), int(size.height), "raymeld postpass", nullptr, nullptr);
  if (!window_) fail("opening a window");
  glfwSetWindowUserPointer(window_, &events_);
  glfwSetKeyCallback(window_, on_key);
  glfwSetFramebufferSizeCallback(window_, on_resize);
  glfwSetWindowIconifyCallback(window_, on_minimise);
  VkSurfaceKHR surface = VK_NULL_HANDLE;
  vk::resultCheck(vk::Result(glfwCreateWindowSurface(instance.get(), window_, nullptr, &surface)),
                  "making a surface");
  surface_ = vk::UniqueSurfaceKHR(surface, instance.get());
}

Window::~Window() {
  surface_.reset();
  if (window_) glfwDestroyWindow(window_);
  glfwTerminate();
}

vk::Extent2D Window::size() const {
  int width = 0, height = 0;
  glfwGetFramebufferSize(window_, &width, &height);
  return {uint32_t(width), uint32_t(height)};
}

void Window::resize(vk::Extent2D size) { glfwSetWindowSize(window_, int(size.width), int(size.height)); }

std::span<const Event> Window::poll(bool wait) {
  if (wait)
    glfwWaitEventsTimeout(0.05);
  else
    glfwPollEvents();
  if (glfwWindowShouldClose(window_)) events_.push_back({.kind = Event::kQuit});
  // Handling these events may cause new ones, which the next call returns.
  polled_.swap(events_);
  events_.clear();
  return polled_;
}

void Window::on_key(GLFWwindow* window, int key, int, int action, int) {
  if (action != GLFW_PRESS) return;
  if (key == GLFW_KEY_ESCAPE)
    events_of(window).push_back({.kind = Event::kQuit});
  else if (key < 128)  // these key codes are ASCII's
    events_of(window).push_back({.key = char(std::tolower(key))});
}

void Window::on_resize(GLFWwindow* window, int width, int height) {
  if (width > 0 && height > 0)
    events_of(window).push_back({.kind = Event::kResize, .size = {uint32_t(width), uint32_t(height)}});
}

void Window::on_minimise(GLFWwindow* window, int minimised) {
  events_of(window).push_back({.kind = minimised ? Event::kMinimise : Event::kRestore});
}

std::unique_ptr<Swapchain> Swapchain::make(const Device& device, const Window& window) {
  const vk::SurfaceCapabilitiesKHR can = device.physical().getSurfaceCapabilitiesKHR(window.surface());
  const vk::SurfaceFormatKHR format = choose_format(device, window.surface());
  if (!(can.supportedUsageFlags & vk::ImageUsageFlagBits::eTransferDst))
    throw std::runtime_error("the window takes no copies");
  const vk::Extent2D wanted = can.currentExtent.width == UINT32_MAX ? window.size() : can.currentExtent;
  const vk::Extent2D size{std::clamp(wanted.width, can.minImageExtent.width, can.maxImageExtent.width),
                          std::clamp(wanted.height, can.minImageExtent.height, can.maxImageExtent.height)};
  if (wanted.width == 0 || wanted.height == 0 || size.width == 0 || size.height == 0) return nullptr;
  std::unique_ptr<Swapchain> made(new Swapchain(device));
  made->size_ = size;
  const uint32_t most = can.maxImageCount ? can.maxImageCount : UINT32_MAX;
  made->swapchain_ =
      device.get().createSwapchainKHRUnique({.surface = window.surface(),
                                             .minImageCount = std::min(can.minImageCount + 1, most),
                                             .imageFormat = format.format,
                                             .imageColorSpace = format.colorSpace,
                                             .imageExtent = size,
                                             .imageArrayLayers = 1,
                                             .imageUsage = vk::ImageUsageFlagBits::eTransferDst,
                                             .preTransform = can.currentTransform,
                                             .compositeAlpha = choose_alpha(can.supportedCompositeAlpha),
                                             .presentMode = vk::PresentModeKHR::eFifo,
                                             .clipped = true},
                                            counting_callbacks());
  made->images_ = device.get().getSwapchainImagesKHR(*made->swapchain_);
  for (size_t i = 0; i < made->images_.size(); ++i)
    made->written_.push_back(device.get().createSemaphoreUnique({}, counting_callbacks()));
  return made;
}

Outcome Swapchain::acquire(vk::Semaphore acquired) {
  constexpr uint64_t kMost_ns = 1'000'000'000;
  return outcome_of(device_.get().acquireNextImageKHR(*swapchain_, kMost_ns, acquired, nullptr, &index_),
                    "acquiring an image");
}

void Swapchain::record_blit(vk::CommandBuffer commands, const Image& image) const {
  using Stage = vk::PipelineStageFlagBits;
  const auto change = [&](vk::ImageLayout from, vk::ImageLayout to, vk::AccessFlags before,
                          vk::AccessFlags after, vk::PipelineStageFlags next) {
    commands.pipelineBarrier(Stage::eTransfer, next, {}, {}, {},
                             image_barrier(images_[index_], before, after, from, to));
  };
  change(vk::ImageLayout::eUndefined, vk::ImageLayout::eTransferDstOptimal, {},
         vk::AccessFlagBits::eTransferWrite, Stage::eTransfer);
  const auto whole = [](vk::Extent2D size) {
    return std::array<vk::Offset3D, 2>{{{}, {int32_t(size.width), int32_t(size.height), 1}}};
  };
  const vk::ImageSubresourceLayers layers{vk::ImageAspectFlagBits::eColor, 0, 0, 1};
  const vk::ImageBlit blit{.srcSubresource = layers,
                           .srcOffsets = whole(image.size),
                           .dstSubresource = layers,
                           .dstOffsets = whole(size_)};
  commands.blitImage(*image.image, vk::ImageLayout::eTransferSrcOptimal, images_[index_],
                     vk::ImageLayout::eTransferDstOptimal, blit, vk::Filter::eNearest);
  change(vk::ImageLayout::eTransferDstOptimal, vk::ImageLayout::ePresentSrcKHR,
         vk::AccessFlagBits::eTransferWrite, {}, Stage::eBottomOfPipe);
}

Outcome Swapchain::present() {
  const vk::PresentInfoKHR info{.waitSemaphoreCount = 1,
                                .pWaitSemaphores = &*written_[index_],
                                .swapchainCount = 1,
                                .pSwapchains = &*swapchain_,
                                .pImageIndices = &index_};
  return outcome_of(device_.queue().presentKHR(&info), "presenting");
}

}  // namespace postpass
