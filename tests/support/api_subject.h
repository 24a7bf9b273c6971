// Holds the models and images of the library's tests.
#pragma once

#include <gtest/gtest.h>

#include "caller_device.h"
#include "raymeld/raymeld.hpp"
#include "subject.h"

namespace raymeld::test {

// Describes `device` as the program that made it would.
inline raymeld_context_desc context_desc(const ExternalDevice& device) {
  raymeld_context_desc desc;
  desc.get_instance_proc_addr = device.get_instance_proc_addr;
  desc.instance = device.instance;
  desc.physical_device = device.physical_device;
  desc.device = device.device;
  desc.queue = device.queue;
  desc.queue_family = device.queue_family;
  if (device.storage_16bit) desc.enabled_features |= RAYMELD_FEATURE_STORAGE_16BIT;
  if (device.buffer_device_address) desc.enabled_features |= RAYMELD_FEATURE_BUFFER_DEVICE_ADDRESS;
  if (device.cooperative_matrix) desc.enabled_features |= RAYMELD_FEATURE_COOPERATIVE_MATRIX;
  if (device.half_dots) desc.enabled_features |= RAYMELD_FEATURE_HALF_DOTS;
  if (device.image_writes) desc.enabled_features |= RAYMELD_FEATURE_IMAGE_WRITES;
  if (device.float_controls) desc.enabled_features |= RAYMELD_FEATURE_FLOAT_CONTROLS;
  if (device.external_memory_fd) desc.enabled_features |= RAYMELD_FEATURE_EXTERNAL_MEMORY_FD;
  if (device.timeline_semaphore) desc.enabled_features |= RAYMELD_FEATURE_TIMELINE_SEMAPHORE;
  return desc;
}

// Describes a fusion of the size of `subject`.
inline raymeld_fusion_desc fusion_desc(const Subject& subject) {
  raymeld_fusion_desc desc;
  desc.height = uint32_t(subject.lrhs.h);
  desc.width = uint32_t(subject.lrhs.w);
  return desc;
}

inline raymeld_image image_at(const FrameImage& image) {
  const FrameBuffer& view = image.view();
  raymeld_image at;
  at.buffer = view.buffer;
  at.offset_bytes = view.offset_bytes;
  at.pixel_stride = view.pixel_stride;
  at.row_stride = view.row_stride;
  at.channel_stride = view.channel_stride;
  return at;
}

struct ApiFused {
  std::vector<float> values;
  raymeld_status status;
};

inline ApiFused fuse(Fusion& fusion, const Subject& subject) {
  const size_t scale = fusion.info().scale;
  ApiFused fused;
  fused.values.resize(subject.lrhs.data.size() * scale * scale);
  fused.status = fusion.fuse(floats(subject.lrhs).data(), floats(subject.hrls).data(), fused.values.data());
  return fused;
}

// Returns the message of the Failure with `result` that `work` must throw; any other end fails the test.
template <typename Work>
std::string failure_of(raymeld_result result, Work&& work) {
  try {
    work();
  } catch (const Failure& failure) {
    EXPECT_EQ(failure.result(), result) << failure.what();
    return failure.what();
  }
  ADD_FAILURE() << "nothing failed";
  return {};
}

}  // namespace raymeld::test

// Expects `statement` to end in a failure with that result whose message holds every given part.
#define EXPECT_FAILURE(result, statement, ...)                                           \
  do {                                                                                   \
    const std::string message = raymeld::test::failure_of(result, [&] { statement; });   \
    for (const std::string& part : std::initializer_list<std::string>{__VA_ARGS__})      \
      EXPECT_NE(message.find(part), std::string::npos) << message << "\nlacks " << part; \
  } while (false)
