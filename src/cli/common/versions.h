#pragma once

#include <fmt/format.h>

#include "engine/vulkan.h"

namespace raymeld::cli {

// Formats a version of Vulkan, such as "1.3.239".
inline std::string version_text(uint32_t version) {
  return fmt::format("{}.{}.{}", VK_API_VERSION_MAJOR(version), VK_API_VERSION_MINOR(version),
                     VK_API_VERSION_PATCH(version));
}

}  // namespace raymeld::cli
