#include "raymeld/raymeld.hpp"

#include <fmt/ranges.h>

#include <algorithm>

#include "fuser.h"
#include "tuner.h"

namespace raymeld {
namespace {

// The options' absent layers. Throws Error naming one that the model needs or does not know.
ConstantLayers absent_layers(const FusionOptions& options, const Model& model) {
  const std::vector<std::string>& optional = model.architecture().optional_layers;
  ConstantLayers absent;
  for (const std::string& layer : options.absent_layers) {
    if (std::ranges::find(optional, layer) == optional.end()) {
      throw Error("model {} cannot do without layer '{}', but without {}", model.name(), layer,
                  optional.empty() ? "none" : fmt::format("{}", fmt::join(optional, ", ")));
    }
    absent[layer] = {};
  }
  return absent;
}

FuserOptions fuser_options(const FusionOptions& options, const Device& device, const Model& model) {
  FuserOptions result;
  result.storage = storage_for(options.precision, device.info(), model);
  result.max_memory_bytes = options.max_memory_bytes;
  const bool centered = options.lrhs_sampling == LrhsSampling::kModel
                            ? model.architecture().lrhs_centered
                            : options.lrhs_sampling == LrhsSampling::kCentered;
  result.exposure = options.exposure;
  result.threshold = options.adaptive_threshold;
  result.changed_only = options.changed_only;
  result.constants = absent_layers(options, model);
  const auto kernels = [&](Storage storage) {
    return options.kernels == KernelChoice::kAuto ? kernels_for(device, storage) : Kernels{};
  };
  result.kernels = kernels(result.storage);
  if (options.precision == Precision::kAuto && result.storage == Storage::kFloat16)
    result.fp32_kernels = kernels(Storage::kFloat32);
  result.phase = lrhs_phase(centered, model.architecture().scale);
  return result;
}

}  // namespace

struct Fusion::State {
  std::unique_ptr<Device> device;
  Model model;
  Fuser fuser;
  std::vector<std::string> hrls_layers;

  State(std::unique_ptr<Device> made, const std::string& file, uint32_t height, uint32_t width,
        const FusionOptions& options)
      : device(std::move(made)),
        model(file),
        fuser(*device, model, height, width, fuser_options(options, *device, model)),
        hrls_layers(image_layers(model.architecture(), absent_layers(options, model))) {}
};

Fusion::Fusion(const std::string& model_file, uint32_t height, uint32_t width, const FusionOptions& options)
    : state_(std::make_unique<State>(Device::create({.selector = options.device}), model_file, height, width,
                                     options)) {}

Fusion::Fusion(const std::string& model_file, uint32_t height, uint32_t width, const FusionOptions& options,
               const ExternalDevice& device)
    : state_(std::make_unique<State>(Device::wrap(device), model_file, height, width, options)) {}

Fusion::~Fusion() = default;
Fusion::Fusion(Fusion&&) noexcept = default;
Fusion& Fusion::operator=(Fusion&&) noexcept = default;

uint32_t Fusion::scale() const { return state_->model.architecture().scale; }

const std::vector<std::string>& Fusion::hrls_layers() const { return state_->hrls_layers; }

const std::vector<std::string>& Fusion::optional_layers() const {
  return state_->model.architecture().optional_layers;
}

uint32_t Fusion::tile_height() const { return state_->fuser.plan().tiling.tile.height; }

uint32_t Fusion::tile_width() const { return state_->fuser.plan().tiling.tile.width; }

void Fusion::record(VkCommandBuffer commands, const FrameBuffer& lrhs, const FrameBuffer& hrls,
                    const FrameBuffer& fused, float exposure) {
  state_->fuser.record(commands, lrhs, hrls, fused, exposure);
}

float Fusion::exposure(const float* lrhs) const { return state_->fuser.exposure(lrhs); }

FusionStatus Fusion::fuse(const float* lrhs, const float* hrls, float* fused) {
  const FuseReport report = state_->fuser.fuse(lrhs, hrls, fused);
  state_->fuser.program().reset_status();
  return {report.status.saturated, report.status.not_finite, float(report.settled_share), report.redone_tiles,
          float(report.kept_share)};
}

FusionStatus Fusion::take_status() {
  Program& program = state_->fuser.program();
  const Status status = program.status();
  const std::optional<SparseGrid>& grid = state_->fuser.graph().sparse();
  const float settled_share = grid ? float(program.settled_blocks()) / float(grid->blocks()) : 0;
  program.reset_status();
  return {status.saturated, status.not_finite, settled_share};
}

}  // namespace raymeld
