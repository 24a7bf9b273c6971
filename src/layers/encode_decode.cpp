// Adds the layers that convert between scene linear images and the network's range.
#include "layers/shapes.h"
#include "layers/upsampled.h"

namespace raymeld {
namespace {

static_assert(static_cast<int>(ChannelKind::kRadiance) == RAYMELD_RADIANCE);
static_assert(static_cast<int>(ChannelKind::kAlbedo) == RAYMELD_ALBEDO);
static_assert(static_cast<int>(ChannelKind::kNormal) == RAYMELD_NORMAL);
static_assert(static_cast<int>(ChannelKind::kVariance) == RAYMELD_VARIANCE);
static_assert(std::size(params::Encode{}.constants) == kMostConstants);

double elements(const Tensor& tensor) {
  return static_cast<double>(tensor.shape.pixels() * tensor.shape.channels);
}

void check_clip(const std::string& name, float clip) {
  if (!(clip > 0)) throw Error("layer {}: clip {} is not positive", name, clip);
}

constexpr uint32_t kImageChannels = 3;  // channels of a frame's image

void check_image(const std::string& name, const Tensor& tensor) {
  if (tensor.shape.channels != kImageChannels) {
    throw Error("layer {}: an image of {} channels, expected {}", name, tensor.shape.channels,
                kImageChannels);
  }
}

}  // namespace

void encode(Graph& graph, const std::string& name, FrameSlot slot, const Tensor& out,
            std::span<const EncodedChannel> channels, Transfer transfer, float clip,
            const std::optional<FrameSize>& frame) {
  if (channels.size() != out.shape.channels) {
    throw Error("layer {}: {} channels to encode, expected {}", name, channels.size(), out.shape.channels);
  }
  check_clip(name, clip);
  const bool from_image = graph.frame_images().inputs;
  if (from_image) check_image(name, out);
  const FrameSize read = frame_size(name, out, frame);
  params::Encode params{{},
                        out.shape.height,
                        out.shape.width,
                        read.height,
                        read.width,
                        graph.plane(out),
                        transfer == Transfer::kLog,
                        clip,
                        {},
                        {}};
  if (channels.size() > 4 * std::size(params.channels)) {
    throw Error("layer {}: {} channels, expected at most {}", name, channels.size(),
                4 * std::size(params.channels));
  }
  uint32_t constants = 0;
  for (size_t c = 0; c < channels.size(); ++c) {
    const auto& [kind, channel, value] = channels[c];
    if (value ? constants == std::size(params.constants) : channel >= RAYMELD_FIRST_CONSTANT)
      throw Error("layer {}: channel {} is one constant too many, or its source is out of range", name, c);
    const uint32_t source = value ? RAYMELD_FIRST_CONSTANT + constants : channel;
    params.channels[c / 4] |= (static_cast<uint32_t>(kind) | source << 2) << c % 4 * 8;
    if (value) params.constants[constants++] = *value;
  }
  Pass pass = pass_of(graph, name, from_image ? shaders::kEncodeImage : shaders::kEncode,
                      {frame_binding(graph, slot), exposure_binding(), write_binding(out)});
  pass.set_push(params);
  pass.groups = strip_groups(out.shape);
  if (from_image) pass.groups[2] /= kImageChannels;
  pass.bytes = elements(out) * static_cast<double>(element_bytes(graph.storage())) +
               static_cast<double>(4 * (channels.size() - constants) * out.shape.pixels());
  graph.add(std::move(pass));
}

void variance(Graph& graph, const std::string& name, const Tensor& out, Transfer transfer, float clip,
              const std::optional<FrameSize>& frame) {
  check_clip(name, clip);
  check_image(name, out);
  Pass pass = pass_of(graph, name, graph.frame_images().inputs ? shaders::kVarianceImage : shaders::kVariance,
                      {frame_binding(graph, kHrlsSlot), exposure_binding(), write_binding(out)});
  const FrameSize read = frame_size(name, out, frame);
  pass.set_push(params::Variance{{},
                                 out.shape.height,
                                 out.shape.width,
                                 read.height,
                                 read.width,
                                 graph.plane(out),
                                 transfer == Transfer::kLog,
                                 clip});
  pass.groups = pixel_groups(out.shape);
  pass.bytes = elements(out) * static_cast<double>(4 + element_bytes(graph.storage()));
  graph.add(std::move(pass));
}

void above_clip(Graph& graph, const std::string& name, FrameSlot slot, const Tensor& out, float clip) {
  check_clip(name, clip);
  Pass pass =
      pass_of(graph, name, graph.frame_images().inputs ? shaders::kAboveClipImage : shaders::kAboveClip,
              {frame_binding(graph, slot), exposure_binding(), write_binding(out)});
  pass.set_push(params::AboveClip{{}, out.shape.height, out.shape.width, graph.plane(out), clip});
  pass.groups = element_groups(out.shape);
  pass.bytes = elements(out) * static_cast<double>(4 + element_bytes(graph.storage()));
  graph.add(std::move(pass));
}

void decode(Graph& graph, const std::string& name, const Tensor& in, const DecodeOptions& options) {
  if (options.above_clip) check_clip(name, options.clip);
  const FrameSize written = frame_size(name, in, options.frame);
  double low_elements = 0;
  for (const Tensor* low : {options.base, options.above_clip}) {
    if (!low) continue;
    low_elements += elements(*low);
    const auto [height, width, channels] = low->shape;
    if (channels == in.shape.channels && height * options.scale == written.height &&
        width * options.scale == written.width) {
      continue;
    }
    throw Error("layer {}: LRHS of {}x{}x{} does not fit an output of {}x{}x{} at scale {}", name, height,
                width, channels, written.height, written.width, in.shape.channels, options.scale);
  }
  const Tensor& base = options.base ? *options.base : in;
  const Tensor& above_clip = options.above_clip ? *options.above_clip : base;
  const bool to_image = graph.frame_images().output;
  if (to_image) check_image(name, in);
  Pass pass = pass_of(graph, name, to_image ? shaders::kDecodeImage : shaders::kDecode,
                      {frame_binding(graph, kFusedSlot), exposure_binding(), read_binding(in),
                       read_binding(base), read_binding(above_clip)});
  pass.set_push(
      params::Decode{{},
                     written.height,
                     written.width,
                     upsampled(graph, in, above_clip, options.transfer, options.scale, options.phase),
                     options.base != nullptr,
                     options.above_clip ? options.clip : 0});
  pass.groups = strip_groups(in.shape);
  if (to_image) pass.groups[2] = 1;
  pass.bytes = elements(in) * static_cast<double>(4 + element_bytes(graph.storage())) +
               low_elements * static_cast<double>(element_bytes(graph.storage()));
  graph.add(std::move(pass));
}

}  // namespace raymeld
