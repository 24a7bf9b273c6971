#pragma once

#include <vulkan/vulkan_core.h>

#include <cstdint>
#include <cstring>
#include <string>

#include "support.h"

// Makes the parts of a file of PipelineCache.
namespace raymeld::test {

// Returns `data` after raymeld's own header, which is a mark, the size, and FNV-1a of the data.
inline std::string sealed_cache(const std::string& data) {
  uint64_t hash = 0xcbf29ce484222325;
  for (const unsigned char byte : data) hash = (hash ^ byte) * 0x100000001b3;
  return "RmCache1" + bytes_of(uint64_t{data.size()}) + bytes_of(hash) + data;
}

// Returns Vulkan's header of a cache that the device's driver wrote.
inline std::string cache_header(const VkPhysicalDeviceProperties& properties) {
  VkPipelineCacheHeaderVersionOne header{
      sizeof(header), VK_PIPELINE_CACHE_HEADER_VERSION_ONE, properties.vendorID, properties.deviceID, {}};
  std::memcpy(header.pipelineCacheUUID, properties.pipelineCacheUUID, VK_UUID_SIZE);
  return bytes_of(header);
}

}  // namespace raymeld::test
