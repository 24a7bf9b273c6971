// Keeps weights, biases and tables on a device, one copy for all Programs that have the same ones.
#pragma once

#include <cstddef>
#include <memory>
#include <mutex>
#include <vector>

#include "engine/buffer.h"

namespace raymeld {

struct Constants {
  std::vector<std::byte> content;
  Buffer buffer;
};

// Shares the constants of one device. Any threads may use it.
class ConstantPool {
 public:
  // Returns the constants with this content that somebody still has; else uploads them, submits and waits.
  // Throws Error, and OutOfMemory.
  std::shared_ptr<const Constants> get(const Device& device, std::vector<std::byte> content);

 private:
  std::mutex mutex_;
  std::vector<std::weak_ptr<const Constants>> known_;
};

}  // namespace raymeld
