#include "engine/constants.h"

#include <cstring>

#include "engine/commands.h"

namespace raymeld {
std::shared_ptr<const Constants> ConstantPool::get(const Device& device, std::vector<std::byte> content) {
  const std::lock_guard lock(mutex_);
  std::erase_if(known_, [](const auto& known) { return known.expired(); });
  for (const auto& known : known_) {
    if (auto constants = known.lock(); constants && constants->content == content) return constants;
  }
  auto made = std::make_shared<Constants>();
  const uint64_t size_bytes = content.size();
  made->buffer = Buffer(device, size_bytes, Memory::kDevice, "constants");
  if (made->buffer.mapped()) {
    std::memcpy(made->buffer.mapped(), content.data(), size_bytes);
    made->buffer.flush();
  } else {
    const Buffer staging(device, size_bytes, Memory::kUpload, "constants staging");
    std::memcpy(staging.mapped(), content.data(), size_bytes);
    copy_now(device, staging.handle(), made->buffer.handle(), {0, 0, size_bytes}, "upload constants");
  }
  made->content = std::move(content);
  known_.push_back(made);
  return made;
}

}  // namespace raymeld
