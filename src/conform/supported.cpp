#include "conform/supported.h"

namespace raymeld::conform {

std::string missing_feature(const DeviceInfo& device, const Method& method, reference::Precision precision) {
  if (precision == reference::Precision::kFp16 && !device.storage_16bit) return "16-bit storage";
  // Tiles that are impossible for a 1x1 convolution are impossible for a 3x3 too.
  if (method.kernel.algorithm == Algorithm::kMatrix && !is_possible(method.kernel.matrix, 1))
    return "cooperative matrix";
  const bool by_address = method.addressed || method.kernel.needs_addresses();
  if (by_address && !device.buffer_device_address) return "buffer device address";
  return {};
}

}  // namespace raymeld::conform
