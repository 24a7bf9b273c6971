#include "engine/pipeline_cache.h"

#include <cstring>
#include <fstream>

#include "error.h"
#include "platform/atomic_file.h"

namespace raymeld {
namespace {

constexpr uint64_t kMagic = 0x3165686361436d52;  // "RmCache1"
constexpr uint64_t kMostFileBytes = 256 << 20;

struct FileHeader {
  uint64_t magic;
  uint64_t size_bytes;
  uint64_t checksum;
};

// Returns the 64-bit FNV-1a hash, which finds truncation and bit rot. It need not do more.
uint64_t checksum_of(const std::vector<char>& data) {
  uint64_t hash = 0xcbf29ce484222325;
  for (unsigned char byte : data) hash = (hash ^ byte) * 0x100000001b3;
  return hash;
}

// Returns whether Vulkan's own header (section 10.7.3 of the specification) is this device's.
bool fits_device(const std::vector<char>& data, const VkPhysicalDeviceProperties& properties) {
  VkPipelineCacheHeaderVersionOne wanted{
      sizeof(wanted), VK_PIPELINE_CACHE_HEADER_VERSION_ONE, properties.vendorID, properties.deviceID, {}};
  std::memcpy(wanted.pipelineCacheUUID, properties.pipelineCacheUUID, VK_UUID_SIZE);
  return data.size() >= sizeof(wanted) && std::memcmp(data.data(), &wanted, sizeof(wanted)) == 0;
}

std::vector<char> read_cache(const std::filesystem::path& file,
                             const VkPhysicalDeviceProperties& properties) {
  std::error_code error;
  const uint64_t file_bytes = std::filesystem::file_size(file, error);
  if (error || file_bytes < sizeof(FileHeader) || file_bytes > kMostFileBytes) return {};
  std::ifstream stream(file, std::ios::binary);
  FileHeader header{};
  stream.read(reinterpret_cast<char*>(&header), sizeof(header));
  if (!stream || header.magic != kMagic || header.size_bytes != file_bytes - sizeof(header)) return {};
  std::vector<char> data(header.size_bytes);
  stream.read(data.data(), static_cast<std::streamsize>(data.size()));
  if (!stream || checksum_of(data) != header.checksum || !fits_device(data, properties)) return {};
  return data;
}

}  // namespace

std::string device_key(const VkPhysicalDeviceProperties& properties) {
  std::string uuid;
  for (uint8_t byte : properties.pipelineCacheUUID) uuid += fmt::format("{:02x}", byte);
  return fmt::format("{:04x}-{:04x}-{:08x}-{}", properties.vendorID, properties.deviceID,
                     properties.driverVersion, uuid);
}

PipelineCache::PipelineCache(const Device& device, const std::filesystem::path& folder) : device_(device) {
  const VkPhysicalDeviceProperties& properties = device.properties();
  if (device.pipeline_cache()) {
    cache_ = device.pipeline_cache();
    return;
  }
  if (!folder.empty()) {
    file_ = folder / fmt::format("pipelines-{}.bin", device_key(properties));
    loaded_data_ = read_cache(file_, properties);
  }
  auto info = vk_struct<VkPipelineCacheCreateInfo>(VK_STRUCTURE_TYPE_PIPELINE_CACHE_CREATE_INFO);
  info.initialDataSize = loaded_data_.size();
  info.pInitialData = loaded_data_.data();
  check(device.vk().CreatePipelineCache(device.handle(), &info, device.allocator(), &cache_),
        "creating a pipeline cache");
}

PipelineCache::~PipelineCache() {
  if (!device_.pipeline_cache())
    device_.vk().DestroyPipelineCache(device_.handle(), cache_, device_.allocator());
}

bool PipelineCache::save() const {
  if (file_.empty()) return false;
  size_t size_bytes = 0;
  const VulkanFunctions& vk = device_.vk();
  if (vk.GetPipelineCacheData(device_.handle(), cache_, &size_bytes, nullptr) != VK_SUCCESS) return false;
  std::vector<char> data(size_bytes);
  if (vk.GetPipelineCacheData(device_.handle(), cache_, &size_bytes, data.data()) != VK_SUCCESS) return false;
  data.resize(size_bytes);
  if (data == loaded_data_) return true;

  std::error_code error;
  std::filesystem::create_directories(file_.parent_path(), error);
  try {
    const FileHeader header{kMagic, data.size(), checksum_of(data)};
    AtomicFile file(file_);
    file.write(&header, sizeof(header));
    file.write(data.data(), data.size());
    file.publish();  // the checksum finds what a power cut leaves
    return true;
  } catch (const std::exception&) {
    return false;
  }
}

}  // namespace raymeld
