#include "cli/fuse.h"
#include "cli/interrupt.h"
#include "tuner.h"

namespace raymeld::cli {
namespace {

namespace fs = std::filesystem;

void dump_layers(const fs::path& folder, Fuser& fuser, const Image& fused, StagedFiles& staged) {
  const auto write = [&](const std::string& name, std::span<const float> values, const Shape& shape) {
    staged.add(folder / (name + ".npy"),
               [&](AtomicFile& file) { write_npy(file, values, shape.channels, shape.height, shape.width); });
  };
  staged.add_folder(folder);
  for (const Pass* layer : fuser.graph().layers()) {
    check_interrupted();
    if (const Tensor* output = layer->output()) {
      write(layer->name, fuser.program().read(*output), output->shape);
    } else {
      write(layer->name, fused.data,
            {uint32_t(fused.height), uint32_t(fused.width), uint32_t(fused.channels)});
    }
  }
}

FuserOptions options_in(Storage storage, const FuseArguments& arguments, const FuseFiles& files,
                        const Device& device) {
  const bool direct = arguments.kernels == KernelChoice::kDirect;
  return {.storage = storage,
          .max_memory_bytes = arguments.max_memory_mib << 20,
          .kernels = direct ? Kernels{} : kernels_for(device, storage),
          .phase = files.phase,
          .exposure = arguments.input_exposure,
          .keep_activations = !arguments.dump.empty(),
          .profile = arguments.profile};
}

FuseResult run_with(const FuserOptions& options, const FuseArguments& arguments, const FuseFiles& files,
                    const FuseImages& images, const Device& device, const Console& console,
                    StagedFiles& staged) {
  FuseResult result;
  result.storage = options.storage;
  console.note(fmt::format("fusing {} x {} with {} on {} ({})", images.hrls.width, images.hrls.height,
                           files.model.name(), device.info().name, precision_name(options.storage)));
  ProgressBar bar(console);
  Fuser fuser(device, files.model, uint32_t(images.lrhs.height), uint32_t(images.lrhs.width), options);
  check_interrupted();
  Image fused;
  const auto progress = [&](double share) {
    bar.update(share);
    return !interrupted();
  };
  // Some drivers compile a kernel when it first runs, so times are taken of a second frame.
  if (options.profile) fuser.fuse(images.lrhs, images.hrls, fused, progress);
  result.report = fuser.fuse(images.lrhs, images.hrls, fused, progress);
  result.tiling = fuser.plan().tiling;
  result.allocated_bytes = fuser.allocated_bytes();
  if (!arguments.dump.empty()) dump_layers(arguments.dump_folder(), fuser, fused, staged);
  result.fused = seen_through(std::move(fused), files.canvas.hrls, files.hrls_windows.data);
  return result;
}

}  // namespace

const char* precision_name(Storage storage) { return storage == Storage::kFloat16 ? "fp16" : "fp32"; }

FuserOptions fuser_options(const FuseArguments& arguments, const FuseFiles& files, const Device& device) {
  return options_in(storage_for(arguments.precision, device.info()), arguments, files, device);
}

// With "auto", whatever 16 bits cannot hold is done again in 32.
FuseResult run_frame(const FuseArguments& arguments, const FuseFiles& files, const FuseImages& images,
                     const Device& device, Console& console, StagedFiles& staged) {
  const FuserOptions options = fuser_options(arguments, files, device);
  const bool may_repeat = arguments.precision == Precision::kAuto && options.storage == Storage::kFloat16;
  try {
    FuseResult result = run_with(options, arguments, files, images, device, console, staged);
    const uint64_t saturated = result.report.status.saturated;
    if (saturated == 0) return result;
    const std::string what =
        fmt::format("{} values within the network passed the largest 16-bit float, 65504", saturated);
    console.warn(what + (may_repeat ? "; fusing again in fp32" : "; --precision fp32 has room for them"),
                 saturated);
    if (!may_repeat) return result;
  } catch (const Error& error) {
    if (!may_repeat) throw;
    console.warn(fmt::format("fp16: {}; fusing again in fp32", error.what()), 1);
  }
  return run_with(options_in(Storage::kFloat32, arguments, files, device), arguments, files, images, device,
                  console, staged);
}

}  // namespace raymeld::cli
