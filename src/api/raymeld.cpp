// Implements the C interface: checks arguments and turns exceptions into results.
#include "raymeld/raymeld.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <mutex>
#include <set>

#include "api/features.h"
#include "choice/frame_times.h"
#include "engine/external_buffer.h"
#include "engine/frame_ring.h"
#include "engine/instance.h"
#include "fusion/exposure.h"
#include "fusion/fuser.h"
#include "fusion/fuser_options.h"
#include "fusion/tuner.h"
#include "io/safetensors.h"
#include "networks/stock_models.h"
#include "platform/files.h"
#include "platform/folders.h"

namespace {

using namespace raymeld;

class InvalidArgument : public Error {
  using Error::Error;
};

thread_local std::string last_error;

raymeld_result failed(raymeld_result result, const char* message) noexcept {
  try {
    last_error = message;
  } catch (const std::bad_alloc&) {
    last_error.clear();
  }
  return result;
}

// Runs `work` and turns what it throws into a result. An Error of no more specific class becomes `of_error`.
template <typename Work>
raymeld_result guarded(raymeld_result of_error, const Work& work) noexcept {
  try {
    work();
    return RAYMELD_SUCCESS;
  } catch (const InvalidArgument& error) {
    return failed(RAYMELD_ERROR_INVALID_ARGUMENT, error.what());
  } catch (const SizeError& error) {
    return failed(RAYMELD_ERROR_INVALID_ARGUMENT, error.what());
  } catch (const HistoryError& error) {
    return failed(RAYMELD_ERROR_INVALID_ARGUMENT, error.what());
  } catch (const OutOfMemory& error) {
    return failed(RAYMELD_ERROR_OUT_OF_MEMORY, error.what());
  } catch (const OutOfHostMemory& error) {
    return failed(RAYMELD_ERROR_OUT_OF_MEMORY, error.what());
  } catch (const DeviceLost& error) {
    return failed(RAYMELD_ERROR_DEVICE_LOST, error.what());
  } catch (const Cancelled& error) {
    return failed(RAYMELD_ERROR_CANCELLED, error.what());
  } catch (const NotFinite& error) {
    return failed(RAYMELD_ERROR_NOT_FINITE, error.what());
  } catch (const Error& error) {
    return failed(of_error, error.what());
  } catch (const std::bad_alloc&) {
    return failed(RAYMELD_ERROR_OUT_OF_MEMORY, "the host has no memory left");
  } catch (const std::exception& error) {
    return failed(RAYMELD_ERROR_INTERNAL, error.what());
  } catch (...) {
    return failed(RAYMELD_ERROR_INTERNAL, "an unknown exception");
  }
}

template <typename T>
T& given(T* argument, const char* name) {
  if (!argument) throw InvalidArgument("{} is NULL", name);
  return *argument;
}

// No version has a structure larger than this, so that a larger struct_size was never written.
constexpr size_t kLargestStruct = 4096;

template <typename Struct>
size_t size_of(const Struct& value, const char* name) {
  if (value.struct_size < sizeof(size_t) || value.struct_size > kLargestStruct)
    throw InvalidArgument("{}: struct_size is {}, expected sizeof({})", name, value.struct_size, name);
  return value.struct_size;
}

// Reads a structure of a program that may be compiled with another version. Members that the program did not
// know become zero; members that are not known here must be zero.
template <typename Struct>
Struct read(const Struct& from, const char* name) {
  const size_t size = size_of(from, name);
  const auto* bytes = reinterpret_cast<const char*>(&from);
  if (std::any_of(bytes + std::min(size, sizeof(Struct)), bytes + size, [](char byte) { return byte != 0; }))
    throw InvalidArgument("{} has members that this version ({}) of raymeld does not know", name,
                          RAYMELD_VERSION);
  Struct value;
  std::memset(static_cast<void*>(&value), 0, sizeof(value));
  std::memcpy(static_cast<void*>(&value), &from, std::min(size, sizeof(Struct)));
  if constexpr (requires { value.reserved; }) {
    if (value.reserved != 0) throw InvalidArgument("{}: reserved is {}, expected 0", name, value.reserved);
  }
  return value;
}

// Writes as much of the structure as the program knows.
template <typename Struct>
void write(Struct from, Struct& to, const char* name) {
  from.struct_size = size_of(to, name);
  std::memcpy(static_cast<void*>(&to), &from, std::min(from.struct_size, sizeof(Struct)));
}

std::vector<const char*> texts_of(const std::vector<std::string>& strings) {
  std::vector<const char*> texts;
  for (const std::string& string : strings) texts.push_back(string.c_str());
  return texts;
}

// Writes names and their count as raymeld_list_models() describes it.
void write_names(const std::vector<std::string>& all, uint32_t& count, const char** names) {
  static std::mutex mutex;
  static std::set<std::string> texts;  // all names ever written
  const std::lock_guard lock(mutex);
  for (size_t i = 0; names && i < std::min<size_t>(count, all.size()); ++i)
    names[i] = texts.insert(all[i]).first->c_str();
  count = static_cast<uint32_t>(all.size());
}

uint32_t count_of(std::span<const char* const> texts) { return static_cast<uint32_t>(texts.size()); }

// Checks a value of a C enumeration, whose values run from 0 to `last`.
void check_choice(int value, int last, const char* name) {
  if (value < 0 || value > last)
    throw InvalidArgument("{} is {}, expected a value from 0 to {}", name, value, last);
}

void check_given_exposure(float exposure) {
  try {
    if (exposure != 0) check_exposure(exposure);
  } catch (const Error& error) {
    throw InvalidArgument("{}", error.what());
  }
}

void check_samples(float spp, const char* name) {
  if (!(std::isfinite(spp) && spp >= 0))
    throw InvalidArgument("{} is {}, expected a number of samples a pixel or 0", name, spp);
}

// Holds the buffers that this device shares with others.
class SharedBuffers {
 public:
  void insert(VkBuffer buffer) {
    const std::lock_guard lock(mutex_);
    buffers_.insert(buffer);
  }
  void erase(VkBuffer buffer) {
    const std::lock_guard lock(mutex_);
    buffers_.erase(buffer);
  }
  // Returns the shared buffers of a frame.
  std::set<VkBuffer> of(const raymeld_frame& frame) {
    std::set<VkBuffer> found;
    const std::lock_guard lock(mutex_);
    for (const raymeld_image* image : {frame.lrhs, frame.hrls, frame.fused, frame.motion}) {
      if (!image) continue;
      const VkBuffer buffer = read(*image, "raymeld_image").buffer;
      if (buffers_.contains(buffer)) found.insert(buffer);
    }
    return found;
  }

 private:
  std::mutex mutex_;
  std::set<VkBuffer> buffers_;
};

struct ContextState {
  std::optional<VkAllocationCallbacks> allocation_callbacks;
  std::filesystem::path cache_folder = default_cache_folder(), tuning_folder;
  std::unique_ptr<const Device> device;
  mutable SharedBuffers shared;
};

struct ModelState {
  Model model;
  std::vector<const char*> layers = texts_of(model.architecture().hrls_layers),
                           optional_layers = texts_of(model.architecture().optional_layers);
};

std::unique_ptr<const Device> device_for(const raymeld_context_desc& desc,
                                         const VkAllocationCallbacks* allocation_callbacks) {
  const bool own =
      !desc.get_instance_proc_addr && !desc.instance && !desc.physical_device && !desc.device && !desc.queue;
  if (own) return Device::create({.selector = desc.selector ? desc.selector : ""});
  if (!desc.get_instance_proc_addr || !desc.instance || !desc.physical_device || !desc.device || !desc.queue)
    throw InvalidArgument(
        "raymeld_context_desc: get_instance_proc_addr, instance, physical_device, device and queue must be "
        "given together, but some are NULL");
  constexpr uint32_t kFeatures = RAYMELD_FEATURE_STORAGE_16BIT | RAYMELD_FEATURE_BUFFER_DEVICE_ADDRESS |
                                 RAYMELD_FEATURE_COOPERATIVE_MATRIX | RAYMELD_FEATURE_IMAGE_WRITES |
                                 RAYMELD_FEATURE_TIMELINE_SEMAPHORE | RAYMELD_FEATURE_EXTERNAL_MEMORY_FD |
                                 RAYMELD_FEATURE_FLOAT_CONTROLS | RAYMELD_FEATURE_HALF_DOTS;
  if (desc.enabled_features & ~kFeatures)
    throw InvalidArgument("raymeld_context_desc: enabled_features has unknown bits: {:#x}",
                          desc.enabled_features & ~kFeatures);
  return Device::wrap({
      .get_instance_proc_addr = desc.get_instance_proc_addr,
      .instance = desc.instance,
      .physical_device = desc.physical_device,
      .device = desc.device,
      .queue = desc.queue,
      .queue_family = desc.queue_family,
      .storage_16bit = (desc.enabled_features & RAYMELD_FEATURE_STORAGE_16BIT) != 0,
      .buffer_device_address = (desc.enabled_features & RAYMELD_FEATURE_BUFFER_DEVICE_ADDRESS) != 0,
      .cooperative_matrix = (desc.enabled_features & RAYMELD_FEATURE_COOPERATIVE_MATRIX) != 0,
      .half_dots = (desc.enabled_features & RAYMELD_FEATURE_HALF_DOTS) != 0,
      .image_writes = (desc.enabled_features & RAYMELD_FEATURE_IMAGE_WRITES) != 0,
      .float_controls = (desc.enabled_features & RAYMELD_FEATURE_FLOAT_CONTROLS) != 0,
      .timeline_semaphore = (desc.enabled_features & RAYMELD_FEATURE_TIMELINE_SEMAPHORE) != 0,
      .external_memory_fd = (desc.enabled_features & RAYMELD_FEATURE_EXTERNAL_MEMORY_FD) != 0,
      .allocator = allocation_callbacks,
      .pipeline_cache = desc.pipeline_cache,
  });
}

// Returns the description's absent layers. Throws InvalidArgument, naming a layer that the model needs or
// does not know.
ConstantLayers absent_layers(const raymeld_fusion_desc& desc, const Model& model) {
  const std::vector<std::string>& optional = model.architecture().optional_layers;
  ConstantLayers absent;
  if (desc.absent_layer_count > 0) given(desc.absent_layers, "absent_layers");
  for (uint32_t i = 0; i < desc.absent_layer_count; ++i) {
    const std::string layer = &given(desc.absent_layers[i], "a name of absent_layers");
    if (std::ranges::find(optional, layer) == optional.end()) {
      throw InvalidArgument("model {} cannot do without layer '{}'; the layers that may be absent are {}",
                            model.name(), layer,
                            optional.empty() ? "none" : fmt::format("{}", fmt::join(optional, ", ")));
    }
    absent[layer] = {};
  }
  return absent;
}

FuserOptions options_of(const raymeld_fusion_desc& desc, const ContextState& context, const Model& model) {
  const Device& device = *context.device;
  FuserOptions options = fuser_options(device, model, static_cast<Precision>(desc.precision),
                                       static_cast<KernelChoice>(desc.kernels), false, context.cache_folder,
                                       context.tuning_folder);
  check_storage(device.info(), options.storage);
  options.max_memory_bytes = desc.max_memory_bytes;
  const bool centered = desc.lrhs_sampling == RAYMELD_SAMPLING_MODEL
                            ? model.architecture().lrhs_centered
                            : desc.lrhs_sampling == RAYMELD_SAMPLING_CENTERED;
  options.exposure = desc.exposure;
  options.skip_unchanged = desc.skip_unchanged;
  options.frame_images = {.inputs = desc.input_images != 0, .output = desc.output_image != 0};
  options.constants = absent_layers(desc, model);
  options.compute_variance = desc.compute_variance;
  options.temporal = desc.temporal;
  options.motion_depth = desc.motion_depth;
  options.compute_exposure = desc.exposure == 0 && !desc.skip_unchanged;
  // Only raymeld_fuse() computes tiles again in fp32. It takes no images of Vulkan, and keeps one history.
  if (options.frame_images.any() || desc.temporal) options.fp32_kernels.reset();
  if (desc.memory) options.scratch = {desc.memory, desc.memory_offset_bytes, desc.memory_size_bytes};
  if (desc.history_memory)
    options.history_memory = {desc.history_memory, desc.history_memory_offset_bytes,
                              desc.history_memory_size_bytes};
  options.phase = lrhs_phase(centered, model.architecture().scale);
  options.samples = {desc.lrhs_spp, desc.hrls_spp};
  return options;
}

void check_desc(const raymeld_fusion_desc& desc) {
  check_lrhs_size({desc.height, desc.width});
  check_choice(desc.precision, RAYMELD_PRECISION_FP16, "precision");
  check_choice(desc.kernels, RAYMELD_KERNELS_DIRECT, "kernels");
  check_choice(desc.lrhs_sampling, RAYMELD_SAMPLING_CENTERED, "lrhs_sampling");
  check_given_exposure(desc.exposure);
  check_samples(desc.lrhs_spp, "lrhs_spp");
  check_samples(desc.hrls_spp, "hrls_spp");
  for (const auto& [is_given, name] : {std::pair(desc.motion_depth != 0, "motion_depth"),
                                       {desc.history_memory != VK_NULL_HANDLE, "history_memory"}})
    if (is_given && !desc.temporal)
      throw InvalidArgument("{} is given without temporal, expected both", name);
  if (desc.skip_unchanged && desc.temporal)
    throw InvalidArgument("skip_unchanged and temporal are both set, expected one of them");
  if (desc.skip_unchanged && (desc.input_images || desc.output_image))
    throw InvalidArgument(
        "skip_unchanged is for raymeld_fuse(), which takes no Vulkan images: input_images and output_image "
        "must be 0");
}

// Names an image of a frame. Its text is made only for an error message.
struct ImageRole {
  const char* name;
  std::optional<uint32_t> layer = {};
  const char* layer_name = nullptr;

  std::string text() const { return layer ? fmt::format("{}[{}], {}", name, *layer, layer_name) : name; }
};

// Returns the image's buffer and strides. A stride of 0 is that of a dense (shape.channels, height, width).
FrameBuffer buffer_of(const raymeld_image& image, const Shape& shape, const ImageRole& role) {
  if (!image.buffer) throw InvalidArgument("{}: buffer is VK_NULL_HANDLE", role.text());
  if (image.offset_bytes % 4 != 0)
    throw InvalidArgument("{}: offset_bytes is {}, expected a multiple of 4", role.text(),
                          image.offset_bytes);
  const uint64_t pixel = image.pixel_stride ? image.pixel_stride : 1;
  const uint64_t row = image.row_stride ? image.row_stride : shape.width * pixel;
  const uint64_t channel = image.channel_stride ? image.channel_stride : shape.height * row;
  if (channel > UINT32_MAX || row > UINT32_MAX)
    throw InvalidArgument("{}: row_stride and channel_stride are {} and {} floats, expected at most 2^32 - 1",
                          role.text(), row, channel);
  return {image.buffer, image.offset_bytes, uint32_t(pixel), uint32_t(row), uint32_t(channel)};
}

FrameTexture texture_of(const raymeld_image& image, bool written, const ImageRole& role) {
  if (!image.view) throw InvalidArgument("{}: view is VK_NULL_HANDLE", role.text());
  const VkImageLayout layout =
      image.layout == VK_IMAGE_LAYOUT_UNDEFINED ? VK_IMAGE_LAYOUT_GENERAL : image.layout;
  const bool read_only = layout == VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL && !written;
  if (layout != VK_IMAGE_LAYOUT_GENERAL && !read_only)
    throw InvalidArgument("{}: layout is {}, expected GENERAL{}", role.text(), int(layout),
                          written ? "" : " or SHADER_READ_ONLY_OPTIMAL");
  check_choice(image.texels, RAYMELD_TEXELS_OCTAHEDRAL, "texels");
  if (!std::isfinite(image.value_scale) || !std::isfinite(image.value_bias))
    throw InvalidArgument("{}: value_scale is {} and value_bias {}, expected finite numbers", role.text(),
                          image.value_scale, image.value_bias);
  return {image.view,
          layout,
          image.x,
          image.y,
          image.value_scale != 0 ? image.value_scale : 1,
          image.value_bias,
          image.texels == RAYMELD_TEXELS_OCTAHEDRAL};
}

FrameBinding binding_of(const raymeld_image* from, const Shape& shape, bool is_image, bool written,
                        const ImageRole& role) {
  const raymeld_image image = read(given(from, role.name), "raymeld_image");
  if (is_image) return {.texture = texture_of(image, written, role)};
  return {.view = buffer_of(image, shape, role), .shape = shape};
}

// Returns element i of an array whose elements all have the first one's struct_size.
const raymeld_image* element(const raymeld_image* first, uint32_t i) {
  const auto* at =
      reinterpret_cast<const raymeld_image*>(reinterpret_cast<const char*>(first) + i * first->struct_size);
  if (at->struct_size != first->struct_size)
    throw InvalidArgument("hrls[{}]: struct_size is {}, expected {} as in hrls[0]", i, at->struct_size,
                          first->struct_size);
  return at;
}

// Throws InvalidArgument unless there is motion where a history is kept, and only there.
void check_motion(const FuserOptions& options, const void* motion) {
  if (options.temporal && !motion) throw InvalidArgument("motion is NULL, and the fusion is temporal");
  if (!options.temporal && motion) throw InvalidArgument("motion is given, and the fusion is not temporal");
}

// Throws InvalidArgument unless exactly those renders are given that a model reads.
void check_renders(const Model& model, const void* lrhs, const void* hrls) {
  const Architecture& a = model.architecture();
  for (const auto& [render, reads, name] :
       {std::tuple(lrhs, a.reads_lrhs(), "lrhs"), {hrls, a.reads_hrls(), "hrls"}}) {
    if (reads && !render) throw InvalidArgument("{} is NULL", name);
    if (!reads && render)
      throw InvalidArgument("model {} does not read {}, which must be NULL", model.name(), name);
  }
}

// Returns the images of a frame by slot; `shapes` are those of a tile.
FrameBindings bindings_of(const raymeld_frame& frame, const std::array<Shape, 3>& shapes,
                          const FuserOptions& options, std::span<const char* const> layers) {
  const FrameImages images = options.frame_images;
  FrameBindings bindings;
  if (shapes[0].channels > 0)
    bindings[kLrhsSlot] = binding_of(frame.lrhs, shapes[0], images.inputs, false, {"lrhs"});
  if (shapes[1].channels > 0)
    bindings[kHrlsSlot] = binding_of(frame.hrls, shapes[1], images.inputs, false, {"hrls"});
  for (uint32_t i = 1; images.inputs && i < layers.size(); ++i) {
    bindings[layer_slot(i)] =
        binding_of(element(frame.hrls, i), shapes[1], true, false, {"hrls", i, layers[i]});
  }
  bindings[kFusedSlot] = binding_of(frame.fused, shapes[2], images.output, true, {"fused"});
  if (frame.motion) {
    bindings[kMotionSlot] =
        binding_of(frame.motion, motion_shape(shapes[2], options), images.inputs, false, {"motion"});
    const FrameTexture& texture = bindings[kMotionSlot].texture;
    if (texture.view && options.motion_depth && (texture.scale < 0 || texture.bias != 0))
      throw InvalidArgument(
          "motion: value_scale is {} and value_bias {}, expected a positive one and 0 with "
          "motion_depth",
          texture.scale, texture.bias);
  }
  return bindings;
}

// Reads one of the two lists of raymeld_semaphores; `role` is "wait" or "signal".
std::vector<SemaphoreValue> semaphores_of(uint32_t count, const VkSemaphore* semaphores,
                                          const uint64_t* values, const char* role, const Device& device) {
  std::vector<SemaphoreValue> all;
  if (count > 0) given(semaphores, role);
  if (count > 0 && device.is_own())
    throw InvalidArgument(
        "raymeld_semaphores: {} semaphores to {}, expected none, as the device is raymeld's own and not the "
        "caller's",
        count, role);
  for (uint32_t i = 0; i < count; ++i) {
    const SemaphoreValue one{semaphores[i], values ? values[i] : 0};
    if (!one.semaphore) throw InvalidArgument("raymeld_semaphores: {}[{}] is VK_NULL_HANDLE", role, i);
    if (one.value != 0 && !device.info().timeline_semaphore)
      throw InvalidArgument(
          "raymeld_semaphores: {}_values[{}] is {}, but RAYMELD_FEATURE_TIMELINE_SEMAPHORE is not enabled",
          role, i, one.value);
    all.push_back(one);
  }
  return all;
}

void hand_over(const Device& device, VkCommandBuffer commands, const std::set<VkBuffer>& buffers,
               uint32_t from_family, uint32_t to_family) {
  const bool acquires = to_family == device.queue_family();
  constexpr VkAccessFlags kBoth = VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_SHADER_WRITE_BIT;
  constexpr VkPipelineStageFlags kOutside = VK_PIPELINE_STAGE_ALL_COMMANDS_BIT,
                                 kInside = VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT;
  std::vector<VkBufferMemoryBarrier> barriers;
  for (VkBuffer buffer : buffers) {
    auto barrier = vk_struct<VkBufferMemoryBarrier>(VK_STRUCTURE_TYPE_BUFFER_MEMORY_BARRIER);
    (acquires ? barrier.dstAccessMask : barrier.srcAccessMask) = kBoth;
    barrier.srcQueueFamilyIndex = from_family;
    barrier.dstQueueFamilyIndex = to_family;
    barrier.buffer = buffer;
    barrier.size = VK_WHOLE_SIZE;
    barriers.push_back(barrier);
  }
  if (barriers.empty()) return;
  device.vk().CmdPipelineBarrier(commands, acquires ? kOutside : kInside, acquires ? kInside : kOutside, 0, 0,
                                 nullptr, uint32_t(barriers.size()), barriers.data(), 0, nullptr);
}

// Describes a caller's physical device.
DeviceInfo info_of(PFN_vkGetInstanceProcAddr get_instance_proc_addr, VkInstance instance,
                   VkPhysicalDevice physical_device) {
  if (!get_instance_proc_addr || !instance || !physical_device)
    throw InvalidArgument(
        "get_instance_proc_addr, instance and physical_device must be given, but some are NULL");
  VulkanFunctions vk;
  vk.GetInstanceProcAddr = get_instance_proc_addr;
  vk.load_instance(instance);
  return device_info(vk, physical_device, 0);
}

}  // namespace

// Handles share their states, so that they may be destroyed in any order.
struct raymeld_context_t {
  std::shared_ptr<const ContextState> state;
};

struct raymeld_buffer_t {
  std::shared_ptr<const ContextState> context;
  VkDeviceSize size_bytes;
  ExternalBuffer buffer;

  raymeld_buffer_t(std::shared_ptr<const ContextState> on, const MemoryFd& from)
      : context(std::move(on)), size_bytes(from.size_bytes), buffer(*context->device, from) {
    context->shared.insert(buffer.handle());
  }
  ~raymeld_buffer_t() { context->shared.erase(buffer.handle()); }
};

struct raymeld_model_t {
  std::shared_ptr<const ModelState> state;
};

struct raymeld_fusion_t {
  std::shared_ptr<const ContextState> context;
  std::shared_ptr<const ModelState> model;
  FuserOptions options;
  Fuser fuser;
  std::vector<std::string> layer_names;
  std::vector<const char*> layers;
  std::optional<FrameRing> ring;  // used by raymeld_submit()

  raymeld_fusion_t(std::shared_ptr<const ContextState> on, std::shared_ptr<const ModelState> of,
                   const raymeld_fusion_desc& desc)
      : context(std::move(on)),
        model(std::move(of)),
        options(options_of(desc, *context, model->model)),
        fuser(*context->device, model->model, desc.height, desc.width, options, context->cache_folder),
        layer_names(image_layers(model->model.architecture(), options.constants, options.compute_variance)),
        layers(texts_of(layer_names)) {}

  void wait_for_submitted() {
    if (ring) ring->wait();
  }
};

// Returns a fusion that keeps a history. Throws InvalidArgument.
static raymeld_fusion_t& temporal(raymeld_fusion fusion) {
  raymeld_fusion_t& made = given(fusion, "fusion");
  if (!made.options.temporal) throw InvalidArgument("the fusion keeps no history, as it is not temporal");
  return made;
}

const char* raymeld_error() { return last_error.c_str(); }

uint32_t raymeld_version() {
  return RAYMELD_VERSION_MAJOR << 16 | RAYMELD_VERSION_MINOR << 8 | RAYMELD_VERSION_PATCH;
}

raymeld_result raymeld_list_features(PFN_vkGetInstanceProcAddr get_instance_proc_addr, VkInstance instance,
                                     VkPhysicalDevice physical_device, uint32_t* count,
                                     raymeld_feature* features) {
  return guarded(RAYMELD_ERROR_DEVICE, [&] {
    given(count, "count");
    const std::vector<raymeld_feature> all =
        features_of(info_of(get_instance_proc_addr, instance, physical_device));
    const size_t size = features && *count > 0 ? size_of(*features, "raymeld_feature") : 0;
    for (size_t i = 0; size > 0 && i < std::min<size_t>(*count, all.size()); ++i) {
      auto& at = *reinterpret_cast<raymeld_feature*>(reinterpret_cast<char*>(features) + i * size);
      at.struct_size = size;
      write(all[i], at, "raymeld_feature");
    }
    *count = static_cast<uint32_t>(all.size());
  });
}

raymeld_result raymeld_enable_features(PFN_vkGetInstanceProcAddr get_instance_proc_addr, VkInstance instance,
                                       VkPhysicalDevice physical_device, VkPhysicalDeviceFeatures2* features,
                                       raymeld_enabled_features* enabled) {
  return guarded(RAYMELD_ERROR_DEVICE, [&] {
    size_of(given(enabled, "enabled"), "raymeld_enabled_features");
    if (given(features, "features").sType != VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2)
      throw InvalidArgument(
          "features: sType is {}, expected VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2 ({})",
          int(features->sType), int(VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2));
    raymeld_enabled_features known;
    known.bits = enable_features(info_of(get_instance_proc_addr, instance, physical_device), *features);
    known.extension_count = count_of(extensions_of(known.bits));
    known.extensions = extensions_of(known.bits).data();
    write(known, *enabled, "raymeld_enabled_features");
  });
}

raymeld_result raymeld_context_create(const raymeld_context_desc* desc, raymeld_context* context) {
  return guarded(RAYMELD_ERROR_DEVICE, [&] {
    given(context, "context");
    const raymeld_context_desc defaults;
    const raymeld_context_desc asked = read(desc ? *desc : defaults, "raymeld_context_desc");
    auto state = std::make_shared<ContextState>();
    if (asked.allocation_callbacks) state->allocation_callbacks = *asked.allocation_callbacks;
    if (asked.cache_folder) state->cache_folder = asked.cache_folder;
    if (asked.tuning_folder) state->tuning_folder = asked.tuning_folder;
    state->device = device_for(asked, state->allocation_callbacks ? &*state->allocation_callbacks : nullptr);
    *context = new raymeld_context_t{std::move(state)};
  });
}

raymeld_result raymeld_list_devices(uint32_t* count, const char** names) {
  return guarded(RAYMELD_ERROR_DEVICE, [&] {
    given(count, "count");
    std::vector<std::string> all;
    for (const DeviceInfo& device : list_devices()) all.push_back(device.name);
    write_names(all, *count, names);
  });
}

void raymeld_context_destroy(raymeld_context context) { delete context; }

raymeld_result raymeld_import_buffer(raymeld_context context, const raymeld_import_desc* desc,
                                     raymeld_buffer* buffer) {
  return guarded(RAYMELD_ERROR_DEVICE, [&] {
    given(buffer, "buffer");
    const auto asked = read(given(desc, "desc"), "raymeld_import_desc");
    if (asked.fd < 0) throw InvalidArgument("raymeld_import_desc: fd is {}", asked.fd);
    if (asked.handle_type != VK_EXTERNAL_MEMORY_HANDLE_TYPE_OPAQUE_FD_BIT &&
        asked.handle_type != VK_EXTERNAL_MEMORY_HANDLE_TYPE_DMA_BUF_BIT_EXT)
      throw InvalidArgument(
          "raymeld_import_desc: handle_type is {:#x}, expected an opaque descriptor ({:#x}) "
          "or a dma_buf ({:#x})",
          asked.handle_type, uint32_t(VK_EXTERNAL_MEMORY_HANDLE_TYPE_OPAQUE_FD_BIT),
          uint32_t(VK_EXTERNAL_MEMORY_HANDLE_TYPE_DMA_BUF_BIT_EXT));
    if (asked.size_bytes == 0) throw InvalidArgument("raymeld_import_desc: size_bytes is 0");
    *buffer =
        new raymeld_buffer_t(given(context, "context").state,
                             {.fd = asked.fd,
                              .type = static_cast<VkExternalMemoryHandleTypeFlagBits>(asked.handle_type),
                              .memory_size_bytes = asked.memory_size_bytes,
                              .memory_type = asked.memory_type_index,
                              .dedicated = asked.dedicated != VK_FALSE,
                              .offset_bytes = asked.offset_bytes,
                              .size_bytes = asked.size_bytes});
    close_descriptor(asked.fd);
  });
}

void raymeld_buffer_destroy(raymeld_buffer buffer) { delete buffer; }

raymeld_result raymeld_buffer_get_info(raymeld_buffer buffer, raymeld_buffer_info* info) {
  return guarded(RAYMELD_ERROR_INTERNAL, [&] {
    raymeld_buffer_info known;
    known.buffer = given(buffer, "buffer").buffer.handle();
    known.size_bytes = buffer->size_bytes;
    write(known, given(info, "info"), "raymeld_buffer_info");
  });
}

raymeld_result raymeld_model_load(const char* file, raymeld_model* model) {
  return guarded(RAYMELD_ERROR_MODEL, [&] {
    given(model, "model");
    *model = new raymeld_model_t{
        std::make_shared<ModelState>(ModelState{Model(model_file(&given(file, "file")))})};
  });
}

raymeld_result raymeld_list_models(uint32_t* count, const char** names) {
  return guarded(RAYMELD_ERROR_MODEL, [&] { write_names(stock_models(), given(count, "count"), names); });
}

raymeld_result raymeld_model_read(const void* bytes, size_t size_bytes, const char* name,
                                  raymeld_model* model) {
  return guarded(RAYMELD_ERROR_MODEL, [&] {
    given(model, "model");
    const std::string_view content(&given(static_cast<const char*>(bytes), "bytes"), size_bytes);
    const std::string called = name ? name : "model in memory";
    *model = new raymeld_model_t{
        std::make_shared<ModelState>(ModelState{Model(parse_safetensors(content, called), called)})};
  });
}

void raymeld_model_destroy(raymeld_model model) { delete model; }

raymeld_result raymeld_model_get_info(raymeld_model model, raymeld_model_info* info) {
  return guarded(RAYMELD_ERROR_INTERNAL, [&] {
    const ModelState& state = *given(model, "model").state;
    raymeld_model_info known;
    known.name = state.model.name().c_str();
    known.scale = state.model.architecture().scale;
    known.layer_count = count_of(state.layers);
    known.layers = state.layers.data();
    known.optional_layer_count = count_of(state.optional_layers);
    known.optional_layers = state.optional_layers.data();
    known.knows_spp = state.model.architecture().knows_spp;
    known.parameters = state.model.parameters();
    known.reads_lrhs = state.model.architecture().reads_lrhs();
    known.reads_hrls = state.model.architecture().reads_hrls();
    write(known, given(info, "info"), "raymeld_model_info");
  });
}

raymeld_result raymeld_get_memory_needs(raymeld_context context, raymeld_model model,
                                        const raymeld_fusion_desc* desc, raymeld_memory_needs* needs) {
  return guarded(RAYMELD_ERROR_DEVICE, [&] {
    const ContextState& on = *given(context, "context").state;
    const Model& of = given(model, "model").state->model;
    const raymeld_fusion_desc asked = read(given(desc, "desc"), "raymeld_fusion_desc");
    check_desc(asked);
    const FuserOptions options = options_of(asked, on, of);
    const FusePlan plan = plan_fusion(of, asked.height, asked.width, on.device->info(), options);
    const VkMemoryRequirements memory = Buffer::requirements(*on.device, plan.graph.activation_bytes());
    raymeld_memory_needs known;
    known.size_bytes = memory.size;
    known.alignment_bytes = memory.alignment;
    known.memory_type_bits = memory.memoryTypeBits;
    known.device_address = on.device->info().buffer_device_address;
    known.history_size_bytes =
        history_requirements(*on.device, of, {asked.height, asked.width}, options).size;
    write(known, given(needs, "needs"), "raymeld_memory_needs");
  });
}

raymeld_result raymeld_tune(raymeld_context context, raymeld_model model, const raymeld_tune_desc* desc) {
  return guarded(RAYMELD_ERROR_DEVICE, [&] {
    const ContextState& on = *given(context, "context").state;
    const Model& of = given(model, "model").state->model;
    const raymeld_tune_desc asked = read(given(desc, "desc"), "raymeld_tune_desc");
    check_lrhs_size({asked.height, asked.width});
    check_choice(asked.precision, RAYMELD_PRECISION_FP16, "precision");
    const Storage storage = storage_for(static_cast<Precision>(asked.precision), on.device->info(), of);
    check_storage(on.device->info(), storage);
    const std::filesystem::path folder = asked.folder ? asked.folder : on.cache_folder;
    if (folder.empty())
      throw Error("there is no folder for the measurements: neither `folder` nor a cache folder");
    const TuneFile file{.folder = folder,
                        .shapes = shapes_to_tune(*on.device, storage, of, {asked.height, asked.width}),
                        .again = asked.again != 0,
                        .cache_folder = on.cache_folder};
    std::set<Conv2dShape> left(file.shapes.begin(), file.shapes.end());
    if (!file.again) {
      const Tuning known = load_tuning(tuning_file(folder, *on.device, storage));
      std::erase_if(left, [&](const Conv2dShape& shape) { return known.entries.contains(shape); });
    }
    const size_t all = left.size();
    const auto go_on = [&] {
      const float done = all == 0 ? 1 : 1 - float(left.size()) / float(all);
      const bool stop = asked.progress && !asked.progress(asked.user, done);
      if (stop && !left.empty()) throw Cancelled();
    };
    go_on();
    FrameTimes::forget(*on.device, on.cache_folder);
    tune_file(*on.device, storage, file, [&](const Conv2dShape& shape, const Tuning::Entry&) {
      left.erase(shape);
      go_on();
      return true;
    });
  });
}

raymeld_result raymeld_fusion_create(raymeld_context context, raymeld_model model,
                                     const raymeld_fusion_desc* desc, raymeld_fusion* fusion) {
  return guarded(RAYMELD_ERROR_DEVICE, [&] {
    given(fusion, "fusion");
    const raymeld_fusion_desc asked = read(given(desc, "desc"), "raymeld_fusion_desc");
    check_desc(asked);
    *fusion = new raymeld_fusion_t(given(context, "context").state, given(model, "model").state, asked);
  });
}

void raymeld_fusion_destroy(raymeld_fusion fusion) { delete fusion; }

raymeld_result raymeld_fusion_get_info(raymeld_fusion fusion, raymeld_fusion_info* info) {
  return guarded(RAYMELD_ERROR_INTERNAL, [&] {
    const raymeld_fusion_t& made = given(fusion, "fusion");
    raymeld_fusion_info known;
    known.precision =
        made.fuser.graph().storage() == Storage::kFloat16 ? RAYMELD_PRECISION_FP16 : RAYMELD_PRECISION_FP32;
    known.scale = made.model->model.architecture().scale;
    known.layer_count = count_of(made.layers);
    known.layers = made.layers.data();
    known.tile_height = made.fuser.plan().tiling.tile.height;
    known.tile_width = made.fuser.plan().tiling.tile.width;
    known.frames_in_flight = kFramesInFlight;
    known.memory_bytes = made.fuser.allocated_bytes();
    known.history_bytes = made.fuser.saved_history_bytes();
    write(known, given(info, "info"), "raymeld_fusion_info");
  });
}

raymeld_result raymeld_prepare_size(raymeld_fusion fusion, uint32_t height, uint32_t width) {
  return guarded(RAYMELD_ERROR_DEVICE, [&] { given(fusion, "fusion").fuser.prepare({height, width}); });
}

raymeld_result raymeld_record(raymeld_fusion fusion, VkCommandBuffer commands, const raymeld_frame* frame) {
  return guarded(RAYMELD_ERROR_DEVICE, [&] {
    raymeld_fusion_t& made = given(fusion, "fusion");
    const raymeld_frame asked = read(given(frame, "frame"), "raymeld_frame");
    if (!commands) throw InvalidArgument("commands is VK_NULL_HANDLE");
    if (made.options.skip_unchanged)
      throw InvalidArgument(
          "raymeld_record() cannot find what changed in the inputs: skip_unchanged is for raymeld_fuse()");
    check_renders(made.model->model, asked.lrhs, asked.hrls);
    check_motion(made.options, asked.motion);
    check_given_exposure(asked.exposure);
    if (made.ring && made.ring->is_pending(made.fuser.next_frame()))
      throw InvalidArgument(
          "raymeld_record(): {} frames are pending, and the oldest, from raymeld_submit(), must be done "
          "first",
          kFramesInFlight);
    const TileSize tile = made.fuser.plan().tiling.tile;
    const TileSize size{asked.height ? asked.height : tile.height, asked.width ? asked.width : tile.width};
    if (!made.fuser.is_prepared(size))
      throw InvalidArgument(
          "raymeld_frame: {} x {} LRHS pixels, a size for which raymeld_prepare_size() was not called",
          size.width, size.height);
    const auto shapes =
        frame_shapes(made.model->model, size, made.options.constants, made.options.compute_variance);
    const FrameBindings images = bindings_of(asked, shapes, made.options, made.layers);
    made.fuser.record(commands, images, asked.exposure != 0 ? asked.exposure : made.options.exposure, size);
  });
}

raymeld_result raymeld_submit(raymeld_fusion fusion, const raymeld_frame* frame,
                              const raymeld_semaphores* semaphores) {
  raymeld_result recorded = RAYMELD_SUCCESS;
  const raymeld_result submitted = guarded(RAYMELD_ERROR_DEVICE, [&] {
    raymeld_fusion_t& made = given(fusion, "fusion");
    const Device& device = *made.context->device;
    const raymeld_semaphores none, asked = read(semaphores ? *semaphores : none, "raymeld_semaphores");
    const auto waits = semaphores_of(asked.wait_count, asked.wait, asked.wait_values, "wait", device);
    const auto signals =
        semaphores_of(asked.signal_count, asked.signal, asked.signal_values, "signal", device);
    if (!made.ring) made.ring.emplace(device, kFramesInFlight);
    const std::set<VkBuffer> shared = made.context->shared.of(read(given(frame, "frame"), "raymeld_frame"));
    const uint32_t index = made.fuser.next_frame(), family = device.queue_family();
    const VkCommandBuffer commands = made.ring->begin(index);
    hand_over(device, commands, shared, VK_QUEUE_FAMILY_EXTERNAL, family);
    recorded = raymeld_record(fusion, commands, frame);
    if (recorded != RAYMELD_SUCCESS) return;
    hand_over(device, commands, shared, family, VK_QUEUE_FAMILY_EXTERNAL);
    try {
      made.ring->submit(index, waits, signals);
    } catch (...) {
      made.fuser.reset_history();  // nothing writes what the next frame would go on with
      throw;
    }
  });
  return submitted != RAYMELD_SUCCESS ? submitted : recorded;
}

raymeld_result raymeld_take_status(raymeld_fusion fusion, raymeld_status* status) {
  return guarded(RAYMELD_ERROR_DEVICE, [&] {
    raymeld_fusion_t& made = given(fusion, "fusion");
    made.wait_for_submitted();
    size_of(given(status, "status"), "raymeld_status");
    const Status counted = made.fuser.take_status();
    raymeld_status known;
    known.saturated = counted.saturated;
    known.not_finite = counted.not_finite;
    write(known, *status, "raymeld_status");
  });
}

raymeld_result raymeld_fuse(raymeld_fusion fusion, const float* lrhs, const float* hrls, float* fused,
                            raymeld_status* status) {
  return raymeld_fuse_next(fusion, lrhs, hrls, nullptr, fused, status);
}

raymeld_result raymeld_reset_history(raymeld_fusion fusion) {
  return guarded(RAYMELD_ERROR_INTERNAL, [&] { temporal(fusion).fuser.reset_history(); });
}

raymeld_result raymeld_save_history(raymeld_fusion fusion, void* data, uint64_t size_bytes) {
  return guarded(RAYMELD_ERROR_DEVICE, [&] {
    raymeld_fusion_t& made = temporal(fusion);
    made.wait_for_submitted();
    made.fuser.save_history({&given(static_cast<std::byte*>(data), "data"), size_bytes});
  });
}

raymeld_result raymeld_load_history(raymeld_fusion fusion, const void* data, uint64_t size_bytes) {
  return guarded(RAYMELD_ERROR_DEVICE, [&] {
    raymeld_fusion_t& made = temporal(fusion);
    made.wait_for_submitted();
    made.fuser.load_history({&given(static_cast<const std::byte*>(data), "data"), size_bytes});
  });
}

raymeld_result raymeld_fuse_next(raymeld_fusion fusion, const float* lrhs, const float* hrls,
                                 const float* motion, float* fused, raymeld_status* status) {
  return guarded(RAYMELD_ERROR_DEVICE, [&] {
    raymeld_fusion_t& made = given(fusion, "fusion");
    Fuser& fuser = made.fuser;
    if (made.options.frame_images.any())
      throw InvalidArgument(
          "raymeld_fuse() takes no Vulkan images: a fusion with images is for raymeld_record() and "
          "raymeld_submit()");
    if (status) size_of(*status, "raymeld_status");
    fusion->wait_for_submitted();
    check_renders(made.model->model, lrhs, hrls);
    check_motion(made.options, motion);
    const FuseReport report = fuser.fuse(lrhs, hrls, &given(fused, "fused"), {}, 0, 0, motion);
    raymeld_status known;
    known.saturated = report.status.saturated;
    known.not_finite = report.status.not_finite;
    known.redone_tiles = report.redone_tiles;
    known.skipped_share = float(report.skipped_share);
    if (status) write(known, *status, "raymeld_status");
  });
}

raymeld_result raymeld_exposure(raymeld_fusion fusion, const float* lrhs, float* exposure) {
  return guarded(RAYMELD_ERROR_INTERNAL, [&] {
    const Fuser& fuser = given(fusion, "fusion").fuser;
    given(exposure, "exposure") = fuser.exposure(&given(lrhs, "lrhs"));
  });
}
