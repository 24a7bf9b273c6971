// Builds KPCN (Bako et al. 2017), which denoises HRLS: two plain networks predict a kernel for each pixel,
// one for the diffuse radiance divided by albedo, and one for the rest of the color. Both read all layers and
// their gradients. Beyond the paper, both images are filtered in a range that compresses bright pixels.
#include <algorithm>
#include <array>

#include "networks/builder.h"
#include "networks/entries.h"

namespace raymeld {
namespace {

constexpr uint32_t kKernel = 5;  // the side of the convolutions' kernels

// Filters an image by kernels that convolutions of the inputs predict.
Tensor filtered(Builder& build, const std::string& branch, const Tensor& inputs, const Tensor& image) {
  const auto [height, width, channels] = image.shape;
  const Architecture& a = build.a;
  Tensor x = inputs;
  for (uint32_t i = 0; i + 1 < a.depth; ++i) {
    const std::string name = fmt::format("{}.{}", branch, i);
    const Tensor next = build.tensor(name, height, width, a.features);
    build.conv(name, x, next, {.kernel = kKernel, .relu = true});
    x = next;
  }
  const Tensor logits = build.tensor("kernel." + branch, height, width, a.kernel_side * a.kernel_side);
  build.conv("kernel." + branch, x, logits, {.kernel = kKernel});
  const Tensor out = build.tensor("filter." + branch, height, width, 3);
  kernel_filter(build.graph, "filter." + branch, image, logits, out, a.kernel_side);
  return out;
}

}  // namespace

void parse_kpcn(const Entries& entries, Architecture& a) {
  constexpr uint32_t kMostSide = 31;
  constexpr std::array<std::string_view, 4> kFirst{"color", "albedo", "normal", "diffuse"};
  if (std::ranges::mismatch(kFirst, a.hrls_layers).in1 != kFirst.end())
    entries.reject("hrls_layers", "color,albedo,normal,diffuse first, as the network is KPCN");
  if (a.knows_spp) entries.reject("knows_spp", "\"false\", as the network is KPCN");
  a.features = entries.integer("features", 1, kMostChannels);
  a.depth = entries.integer("depth", 2, kMostRepeats);
  a.kernel_side = entries.integer("kernel_side", 1, kMostSide);
  if (a.kernel_side % 2 == 0) entries.reject("kernel_side", "an odd number");
}

void add_kpcn(Builder build, uint32_t height, uint32_t width, float) {
  const Architecture& a = build.a;
  Graph& graph = build.graph;
  const auto encoded = static_cast<uint32_t>(build.hrls_channels.encoded.size()), channels = encoded + 6;
  const Tensor inputs = build.tensor("encode.hrls", height, width, 3 * channels);
  const Tensor hrls = inputs.slice(0, encoded), lit = inputs.slice(encoded, 3),
               rest = inputs.slice(encoded + 3, 3);
  const Tensor color = build.layer(hrls, "color"), albedo = build.layer(hrls, "albedo"),
               diffuse = build.layer(hrls, "diffuse");
  build.encode_hrls("encode.hrls", hrls, 0, encoded);
  const Tensor bright = build.tensor("above_clip", height, width, 3);
  above_clip(graph, "above_clip", a.bright_slot(), bright, a.clip);
  light(graph, "light", diffuse, albedo, lit, a.transfer);
  remainder(graph, "remainder", color, diffuse, rest, a.transfer);
  gradients(graph, "gradients", inputs.slice(0, channels), inputs.slice(channels, 2 * channels));
  const Tensor filtered_light = filtered(build, "diffuse", inputs, lit);
  const Tensor filtered_rest = filtered(build, "rest", inputs, rest);
  const Tensor fused = build.tensor("remodulate", height, width, 3);
  remodulate(graph, "remodulate", filtered_light, albedo, filtered_rest, fused, a.transfer);
  decode(graph, "decode", fused, {a.transfer, nullptr, 1, 0, &bright, a.clip});
}

uint32_t kpcn_halo(const Architecture& a, bool) {
  // A firefly's neighbours and a computed variance reach one pixel further, and so does a gradient.
  return std::max(a.kernel_side / 2 + 1, kKernel / 2 * a.depth + 2);
}

}  // namespace raymeld
