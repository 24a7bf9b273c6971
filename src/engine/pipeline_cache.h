#pragma once

#include <filesystem>

#include "engine/device.h"

namespace raymeld {

// Returns a name of a device and its driver's version, for the names of files.
std::string device_key(const VkPhysicalDeviceProperties& properties);

// Keeps a VkPipelineCache on disk between runs, one file for each device and driver version. A file that is
// damaged, foreign or half-written is ignored; writers replace the file whole, so concurrent ones cannot mix.
class PipelineCache {
 public:
  // Reads `folder`/pipelines-<device_key>.bin when it is there and sound, and never throws for a bad or
  // unreadable file. If the device's owner has a cache, uses that one and no file.
  PipelineCache(const Device& device, const std::filesystem::path& folder);
  ~PipelineCache();
  PipelineCache(const PipelineCache&) = delete;
  PipelineCache& operator=(const PipelineCache&) = delete;

  VkPipelineCache handle() const { return cache_; }
  const std::filesystem::path& file() const { return file_; }
  bool loaded() const { return !loaded_data_.empty(); }

  // Writes the cache when it has changed. A cache that cannot be written is no error: returns false.
  bool save() const;

 private:
  const Device& device_;
  std::filesystem::path file_;
  VkPipelineCache cache_ = VK_NULL_HANDLE;
  std::vector<char> loaded_data_;
};

}  // namespace raymeld
