#include "gpu.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "engine/commands.h"
#include "io/safetensors.h"

namespace raymeld::test {

using reference::Architecture;
using reference::LayerKind;
using reference::Planes;
using reference::Precision;

namespace {

// RAYMELD_TEST_VALIDATION=0 is for machines that have a device but no layers, gpu-assisted for accesses of
// shaders.
Validation wished_validation() {
  const char* value = std::getenv("RAYMELD_TEST_VALIDATION");
  const std::string wish = value ? value : "";
  if (wish == "0") return Validation::kNone;
  if (wish == "gpu-assisted") return Validation::kGpuAssisted;
  if (!wish.empty()) throw Error("RAYMELD_TEST_VALIDATION is '{}', expected 0 or gpu-assisted", wish);
  return Validation::kSynchronization;
}

}  // namespace

const Device& gpu() {
  static const std::unique_ptr<Device> device =
      Device::create({.selector = {}, .validation = wished_validation()});
  return *device;
}

void GpuTest::TearDown() {
  static size_t seen = 0;
  const std::vector<std::string>& messages = gpu().messages();
  for (; seen < messages.size(); ++seen) ADD_FAILURE() << messages[seen];
}

Storage storage_of(Precision precision) {
  return precision == Precision::kFp16 ? Storage::kFloat16 : Storage::kFloat32;
}

std::string name_of(Precision precision) { return precision == Precision::kFp16 ? "fp16" : "fp32"; }

testing::AssertionResult same_bits(std::span<const float> actual, std::span<const float> expected) {
  if (actual.size() != expected.size()) {
    return testing::AssertionFailure() << actual.size() << " values, expected " << expected.size();
  }
  for (size_t i = 0; i < actual.size(); ++i) {
    const bool same = std::bit_cast<uint32_t>(actual[i]) == std::bit_cast<uint32_t>(expected[i]);
    if (same || (std::isnan(actual[i]) && std::isnan(expected[i]))) continue;
    return testing::AssertionFailure()
           << fmt::format("value {} of {} is {:a}, expected {:a}", i, actual.size(), actual[i], expected[i]);
  }
  return testing::AssertionSuccess();
}

FrameImage::FrameImage(const Device& device, Shape shape, Memory memory, Layout layout) : shape_(shape) {
  const auto [h, w, c] = shape;
  view_.offset_bytes = layout.offset_bytes;
  view_.pixel_stride = layout.interleaved ? c + layout.pixel_padding : 1;
  view_.row_stride = w * view_.pixel_stride + layout.row_padding;
  view_.channel_stride = layout.interleaved ? 1 : h * view_.row_stride + layout.pixel_padding;
  const uint64_t floats =
      layout.interleaved ? uint64_t{h} * view_.row_stride : uint64_t{c} * view_.channel_stride;
  buffer_ = Buffer(device, layout.offset_bytes + floats * sizeof(float), memory, "frame image");
  view_.buffer = buffer_.handle();
  std::ranges::fill(values(), kUntouched);
}

FrameImage::FrameImage(const Device& device, const Planes& image, Layout layout)
    : FrameImage(device, {uint32_t(image.h), uint32_t(image.w), uint32_t(image.c)}, Memory::kUpload, layout) {
  write(image);
}

size_t FrameImage::at(uint32_t c, uint32_t y, uint32_t x) const {
  return view_.offset_bytes / 4 + size_t{c} * view_.channel_stride + size_t{y} * view_.row_stride +
         size_t{x} * view_.pixel_stride;
}

std::span<float> FrameImage::values() const {
  return {static_cast<float*>(buffer_.mapped()), buffer_.size_bytes() / sizeof(float)};
}

void FrameImage::write(const Planes& image) {
  for (uint32_t c = 0; c < shape_.channels; ++c) {
    for (uint32_t y = 0; y < shape_.height; ++y) {
      for (uint32_t x = 0; x < shape_.width; ++x) {
        values()[at(c, y, x)] = float(image.at(int(c), int(y), int(x)));
      }
    }
  }
}

Planes FrameImage::read() const {
  buffer_.invalidate();
  Planes image(int(shape_.channels), int(shape_.height), int(shape_.width));
  for (uint32_t c = 0; c < shape_.channels; ++c) {
    for (uint32_t y = 0; y < shape_.height; ++y) {
      for (uint32_t x = 0; x < shape_.width; ++x) {
        image.at(int(c), int(y), int(x)) = values()[at(c, y, x)];
      }
    }
  }
  return image;
}

size_t FrameImage::touched_outside() const {
  std::vector<float> rest(values().begin(), values().end());
  for (uint32_t c = 0; c < shape_.channels; ++c) {
    for (uint32_t y = 0; y < shape_.height; ++y) {
      for (uint32_t x = 0; x < shape_.width; ++x) rest[at(c, y, x)] = kUntouched;
    }
  }
  return rest.size() - size_t(std::ranges::count(rest, kUntouched));
}

std::span<const FrameImage::Layout> frame_layouts() {
  static const FrameImage::Layout layouts[] = {
      {},
      {.interleaved = true},
      {.offset_bytes = 20, .interleaved = true, .pixel_padding = 1},
      {.offset_bytes = 4096 + 4, .pixel_padding = 3, .row_padding = 5},
      {.offset_bytes = 12, .interleaved = true, .pixel_padding = 2, .row_padding = 7},
  };
  return layouts;
}

void run_passes(const Program& program, const Graph& graph) {
  Commands pool(gpu());
  const VkCommandBuffer commands = pool.begin("layers");
  program.record(commands, 0, 0, graph.passes().size());
  auto barrier = vk_struct<VkMemoryBarrier>(VK_STRUCTURE_TYPE_MEMORY_BARRIER);
  barrier.srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT;
  barrier.dstAccessMask = VK_ACCESS_HOST_READ_BIT;
  gpu().vk().CmdPipelineBarrier(commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0,
                                1, &barrier, 0, nullptr, 0, nullptr);
  pool.end(commands);
  gpu().submit_and_wait(commands);
}

LayerRun::LayerRun(Precision precision, bool addressed) : graph_(storage_of(precision), addressed) {}

Tensor LayerRun::input(const std::string& name, const Planes& values) {
  const Tensor result = graph_.input(name, {uint32_t(values.h), uint32_t(values.w), uint32_t(values.c)});
  inputs_.emplace_back(result, floats(values));
  return result;
}

Tensor LayerRun::tensor(const std::string& name, int c, int h, int w) {
  return graph_.tensor(name, {uint32_t(h), uint32_t(w), uint32_t(c)});
}

ConvWeights LayerRun::weights(const reference::Conv& conv) {
  const auto& weight = weights_.emplace_back(conv.weight.begin(), conv.weight.end());
  const auto& bias = weights_.emplace_back(conv.bias.begin(), conv.bias.end());
  return {weight, bias};
}

void LayerRun::run(const FrameBindings& frame, float exposure) {
  graph_.plan();
  program_ = std::make_unique<Program>(gpu(), graph_, shared_cache(), 1);
  for (const auto& [tensor, values] : inputs_) program_->write(tensor, values);
  program_->bind(0, frame);
  program_->set_exposure(0, exposure);
  run_passes(*program_, graph_);
}

Planes LayerRun::read(const Tensor& tensor) const {
  return planes(int(tensor.shape.channels), int(tensor.shape.height), int(tensor.shape.width),
                program_->read(tensor));
}

std::filesystem::path shared_cache_folder() {
  gpu();  // outlives the folder
  static const TemporaryDirectory folder;
  return folder.path();
}

PipelineCache& shared_cache() {
  static PipelineCache cache(gpu(), shared_cache_folder());
  return cache;
}

std::map<std::string, std::string> model_metadata(const Architecture& a) {
  using reference::Base;
  // Layers are known by kind here; one name for each kind and place will do.
  std::vector<std::string> radiance{"color", "diffuse", "specular"}, layers;
  for (const LayerKind kind : a.hrls_layers) {
    if (kind == LayerKind::kRadiance) {
      layers.push_back(radiance.front());
      radiance.erase(radiance.begin());
    } else {
      layers.push_back(kind == LayerKind::kAlbedo   ? "albedo"
                       : kind == LayerKind::kNormal ? "normal"
                                                    : "variance");
    }
  }
  return {{"format", "raymeld.model"},
          {"format_version", "1"},
          {"name", "test"},
          {"version", "1"},
          {"scale", std::to_string(a.scale)},
          {"features", std::to_string(a.features)},
          {"growth", std::to_string(a.growth)},
          {"dense_layers", std::to_string(a.dense_layers)},
          {"blocks", std::to_string(a.blocks)},
          {"groups", std::to_string(a.groups)},
          {"hrls_layers", fmt::format("{}", fmt::join(layers, ","))},
          {"long_skip", a.long_skip_fused ? "fused" : "lrhs"},
          {"merge_relu", a.merge_relu ? "true" : "false"},
          {"transfer", a.transfer == reference::Transfer::kLog ? "log" : "linear"},
          {"clip", fmt::format("{}", a.clip)},
          {"base", a.base == Base::kJoint      ? "joint"
                   : a.base == Base::kBilinear ? "bilinear"
                                               : "none"},
          {"hrls_encoder", a.hrls_unshuffled ? "unshuffled" : "full"},
          {"upscale", a.upscale_direct ? "direct" : "stages"},
          {"upscaled_features", std::to_string(a.upscaled())},
          {"guide", a.hrls_guide ? "hrls" : "none"},
          {"head_features", std::to_string(a.head_features)},
          {"head_layers", std::to_string(a.head_layers)},
          {"lrhs_sampling", a.both_samplings ? "nearest,centered" : "nearest"},
          {"optional_layers", ""},
          {"exposure_key", "0"},
          {"lrhs_certainty", fmt::format("{}", a.lrhs_certainty)}};
}

void write_model(const std::filesystem::path& path, const Architecture& architecture,
                 const reference::Weights& weights, const std::map<std::string, std::string>& other) {
  SafeTensors content;
  content.metadata = other;
  content.metadata.merge(model_metadata(architecture));
  for (const auto& [name, conv] : weights) {
    const auto [out, in, kernel] = std::tuple(size_t(conv.out), size_t(conv.in), size_t(conv.kernel));
    content.tensors[name + ".weight"] = {
        TensorType::kF32, {out, in, kernel, kernel}, {conv.weight.begin(), conv.weight.end()}};
    content.tensors[name + ".bias"] = {TensorType::kF32, {out}, {conv.bias.begin(), conv.bias.end()}};
    if (conv.centered_bias.empty()) continue;
    content.tensors[name + ".centered_bias"] = {
        TensorType::kF32, {out}, {conv.centered_bias.begin(), conv.centered_bias.end()}};
  }
  write_safetensors(path, content);
}

}  // namespace raymeld::test
