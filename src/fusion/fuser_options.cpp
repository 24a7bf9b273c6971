#include "fusion/fuser_options.h"

#include "fusion/tuner.h"

namespace raymeld {

FuserOptions fuser_options(const Device& device, const Model& model, Precision precision, KernelChoice choice,
                           bool redo, const std::filesystem::path& folder,
                           const std::filesystem::path& shipped) {
  const auto kernels = [&](Storage storage) {
    return choice == KernelChoice::kDirect ? Kernels{} : kernels_for(device, storage, folder, shipped);
  };
  FuserOptions options;
  options.storage = storage_for(precision, device.info(), model);
  options.kernels = kernels(options.storage);
  if ((redo || precision == Precision::kAuto) && options.storage == Storage::kFloat16)
    options.fp32_kernels = kernels(Storage::kFloat32);
  return options;
}

}  // namespace raymeld
