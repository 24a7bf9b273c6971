// Wraps raymeld.h for C++: handles destroy themselves, and failures are thrown. raymeld.h says what the
// functions do and expect.
#pragma once

#include <raymeld/raymeld.h>

#include <algorithm>
#include <cstddef>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

namespace raymeld {

// Is thrown by all functions that fail; destructors do not throw.
class Failure : public std::runtime_error {
 public:
  Failure(raymeld_result result, const char* message) : std::runtime_error(message), result_(result) {}
  raymeld_result result() const { return result_; }

 private:
  raymeld_result result_;
};

namespace detail {

inline void check(raymeld_result result) {
  if (result != RAYMELD_SUCCESS) throw Failure(result, raymeld_error());
}

struct Destroy {
  void operator()(raymeld_context context) const { raymeld_context_destroy(context); }
  void operator()(raymeld_buffer buffer) const { raymeld_buffer_destroy(buffer); }
  void operator()(raymeld_model model) const { raymeld_model_destroy(model); }
  void operator()(raymeld_fusion fusion) const { raymeld_fusion_destroy(fusion); }
};

template <typename Handle>
using Owned = std::unique_ptr<std::remove_pointer_t<Handle>, Destroy>;

inline std::vector<std::string> strings(uint32_t count, const char* const* texts) {
  return {texts, texts + count};
}

inline std::vector<std::string> list(raymeld_result (*list_names)(uint32_t*, const char**)) {
  uint32_t count = 0;
  check(list_names(&count, nullptr));
  std::vector<const char*> names(count);
  check(list_names(&count, names.data()));
  names.resize(std::min<size_t>(count, names.size()));  // the number of names may have changed
  return {names.begin(), names.end()};
}

}  // namespace detail

inline std::vector<raymeld_feature> list_features(PFN_vkGetInstanceProcAddr get_instance_proc_addr,
                                                  VkInstance instance, VkPhysicalDevice physical_device) {
  uint32_t count = 0;
  detail::check(raymeld_list_features(get_instance_proc_addr, instance, physical_device, &count, nullptr));
  std::vector<raymeld_feature> features(count);
  detail::check(
      raymeld_list_features(get_instance_proc_addr, instance, physical_device, &count, features.data()));
  return features;
}

// Sets members of the caller's chain, with which the caller then creates the device.
inline raymeld_enabled_features enable_features(PFN_vkGetInstanceProcAddr get_instance_proc_addr,
                                                VkInstance instance, VkPhysicalDevice physical_device,
                                                VkPhysicalDeviceFeatures2& features) {
  raymeld_enabled_features enabled;
  detail::check(
      raymeld_enable_features(get_instance_proc_addr, instance, physical_device, &features, &enabled));
  return enabled;
}

// Lists the names of the stock models.
inline std::vector<std::string> list_models() { return detail::list(raymeld_list_models); }

// Lists the names of the system's devices, by index.
inline std::vector<std::string> device_names() { return detail::list(raymeld_list_devices); }

class Context {
 public:
  explicit Context(const raymeld_context_desc& desc = {}) {
    raymeld_context context = nullptr;
    detail::check(raymeld_context_create(&desc, &context));
    context_.reset(context);
  }
  raymeld_context get() const { return context_.get(); }

 private:
  detail::Owned<raymeld_context> context_;
};

// Takes over the file descriptor, unless the constructor throws.
class ImportedBuffer {
 public:
  ImportedBuffer(const Context& context, const raymeld_import_desc& desc) {
    raymeld_buffer buffer = nullptr;
    detail::check(raymeld_import_buffer(context.get(), &desc, &buffer));
    buffer_.reset(buffer);
  }
  raymeld_buffer get() const { return buffer_.get(); }

  raymeld_buffer_info info() const {
    raymeld_buffer_info info;
    detail::check(raymeld_buffer_get_info(get(), &info));
    return info;
  }

 private:
  detail::Owned<raymeld_buffer> buffer_;
};

// Holds a model, which any number of fusions may share.
class SharedModel {
 public:
  // Loads a file, or a stock model by its name.
  explicit SharedModel(const std::string& file) {
    raymeld_model model = nullptr;
    detail::check(raymeld_model_load(file.c_str(), &model));
    model_.reset(model);
  }
  SharedModel(const void* bytes, size_t size_bytes, const std::string& name) {
    raymeld_model model = nullptr;
    detail::check(raymeld_model_read(bytes, size_bytes, name.c_str(), &model));
    model_.reset(model);
  }
  raymeld_model get() const { return model_.get(); }

  raymeld_model_info info() const {
    raymeld_model_info info;
    detail::check(raymeld_model_get_info(get(), &info));
    return info;
  }
  std::vector<std::string> layers() const { return detail::strings(info().layer_count, info().layers); }
  std::vector<std::string> optional_layers() const {
    return detail::strings(info().optional_layer_count, info().optional_layers);
  }

 private:
  detail::Owned<raymeld_model> model_;
};

inline void tune(const Context& context, const SharedModel& model, const raymeld_tune_desc& desc) {
  detail::check(raymeld_tune(context.get(), model.get(), &desc));
}

inline raymeld_memory_needs memory_needs(const Context& context, const SharedModel& model,
                                         const raymeld_fusion_desc& desc) {
  raymeld_memory_needs needs;
  detail::check(raymeld_get_memory_needs(context.get(), model.get(), &desc, &needs));
  return needs;
}

class Fusion {
 public:
  Fusion(const Context& context, const SharedModel& model, const raymeld_fusion_desc& desc) {
    raymeld_fusion fusion = nullptr;
    detail::check(raymeld_fusion_create(context.get(), model.get(), &desc, &fusion));
    fusion_.reset(fusion);
  }
  raymeld_fusion get() const { return fusion_.get(); }

  raymeld_fusion_info info() const {
    raymeld_fusion_info info;
    detail::check(raymeld_fusion_get_info(get(), &info));
    return info;
  }
  std::vector<std::string> layers() const { return detail::strings(info().layer_count, info().layers); }

  void prepare_size(uint32_t height, uint32_t width) {
    detail::check(raymeld_prepare_size(get(), height, width));
  }
  void record(VkCommandBuffer commands, const raymeld_frame& frame) {
    detail::check(raymeld_record(get(), commands, &frame));
  }
  void submit(const raymeld_frame& frame, const raymeld_semaphores& semaphores = {}) {
    detail::check(raymeld_submit(get(), &frame, &semaphores));
  }
  raymeld_status take_status() {
    raymeld_status status;
    detail::check(raymeld_take_status(get(), &status));
    return status;
  }
  raymeld_status fuse(const float* lrhs, const float* hrls, float* fused) {
    raymeld_status status;
    detail::check(raymeld_fuse(get(), lrhs, hrls, fused, &status));
    return status;
  }
  raymeld_status fuse_next(const float* lrhs, const float* hrls, const float* motion, float* fused) {
    raymeld_status status;
    detail::check(raymeld_fuse_next(get(), lrhs, hrls, motion, fused, &status));
    return status;
  }
  void reset_history() { detail::check(raymeld_reset_history(get())); }
  std::vector<std::byte> save_history() {
    std::vector<std::byte> data(info().history_bytes);
    detail::check(raymeld_save_history(get(), data.data(), data.size()));
    return data;
  }
  void load_history(std::span<const std::byte> data) {
    detail::check(raymeld_load_history(get(), data.data(), data.size()));
  }
  float exposure(const float* lrhs) const {
    float exposure = 1;
    detail::check(raymeld_exposure(get(), lrhs, &exposure));
    return exposure;
  }

 private:
  detail::Owned<raymeld_fusion> fusion_;
};

}  // namespace raymeld
