#include "fuzz/memory_file.h"

#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <string>
#include <system_error>

namespace raymeld::test {

MemoryFile::MemoryFile(std::span<const uint8_t> content) : descriptor_(memfd_create("input", MFD_CLOEXEC)) {
  if (descriptor_ < 0 || write(descriptor_, content.data(), content.size()) != ssize_t(content.size()))
    throw std::system_error(errno, std::generic_category(), "a file in memory");
  path_ = "/proc/self/fd/" + std::to_string(descriptor_);
}

MemoryFile::~MemoryFile() { close(descriptor_); }

}  // namespace raymeld::test
