#include <algorithm>
#include <cmath>

#include "networks/builder.h"

namespace raymeld {

#define RAYMELD_NETWORK(name, least_scale, most_scale) \
  void parse_##name(const Entries&, Architecture&);    \
  void add_##name(Builder, uint32_t, uint32_t, float); \
  uint32_t name##_halo(const Architecture&, bool);     \
  constexpr NetworkFunctions k_##name{#name, least_scale, most_scale, parse_##name, add_##name, name##_halo};
RAYMELD_NETWORK(fusion, 2, 8)
RAYMELD_NETWORK(pyramid, 1, 8)
RAYMELD_NETWORK(edsr, 2, 8)
RAYMELD_NETWORK(rcan, 2, 8)
RAYMELD_NETWORK(kpcn, 1, 1)
#undef RAYMELD_NETWORK

const NetworkFunctions& functions_of(NetworkKind kind) {
  switch (kind) {
    case NetworkKind::kPyramid:
      return k_pyramid;
    case NetworkKind::kEdsr:
      return k_edsr;
    case NetworkKind::kRcan:
      return k_rcan;
    case NetworkKind::kKpcn:
      return k_kpcn;
    case NetworkKind::kFusion:
      break;
  }
  return k_fusion;
}

namespace {

// Encodes radiance as shaders/include/transfer.glsl does. Encoded radiance is at most the encoded clip.
double encoded(Transfer transfer, float radiance) {
  return transfer == Transfer::kLog ? std::log1p(8.0 * radiance) / 3 : radiance;
}

}  // namespace

void network(Graph& graph, const Model& model, uint32_t height, uint32_t width, float phase,
             const Conv2dChoice& choose, const StorageExponents& exponents, const ConstantLayers& constants,
             bool compute_variance, const SampleCounts& samples, const std::optional<Joining>& joining) {
  check_constant_layers(model, constants);
  const HrlsChannels channels = hrls_channels(model.architecture(), constants, compute_variance);
  Builder build{
      .graph = graph,
      .model = model,
      .choose = choose,
      .exponents = exponents,
      .hrls_channels = channels,
      .samples = samples,
      .history_channels = joining ? history_channels(model, phase, channels.variance.has_value()) : 0,
      .joining = joining.value_or(Joining{})};
  functions_of(model.architecture().kind).add(build, height, width, phase);
}

ActivationEstimate estimate_activations(const Model& model) {
  Graph graph(Storage::kFloat32);
  const Architecture& a = model.architecture();
  ActivationEstimate estimate(encoded(a.transfer, a.clip));
  const Conv2dChoice choose = conv2d_direct;
  const StorageExponents none;
  const HrlsChannels all = hrls_channels(a, {});
  Builder build{.graph = graph,
                .model = model,
                .choose = choose,
                .exponents = none,
                .hrls_channels = all,
                .estimate = &estimate};
  functions_of(a.kind).add(build, 1, 1, 0);
  return estimate;
}

StorageExponents storage_exponents(const Model& model) {
  StorageExponents exponents = estimate_activations(model).exponents();
  // mix(), decode(), kernel_filter(), compose() and attend() read unscaled values.
  std::erase_if(exponents, [](const auto& entry) {
    const std::string& name = entry.first;
    return name == "rec" || name.starts_with("kernel.") || name.ends_with(".excite");
  });
  return exponents;
}

bool tile_4_is_accurate(const Architecture& a, const ConvWeights& weights, uint32_t channels_in,
                        uint32_t kernel, Algorithm algorithm) {
  constexpr double kMost = 0x1p-10, kUnit = 0x1p-24;
  // reference::winograd_roundings() counts them.
  const uint32_t roundings =
      algorithm == Algorithm::kColumns ? 3 * channels_in + 16 : winograd_channels(channels_in, kernel) + 30;
  return std::sqrt(roundings) * kUnit * encoded(a.transfer, a.clip) *
             winograd_amplification(weights, channels_in, kernel, algorithm) <=
         kMost;
}

uint32_t history_channels(const Model& model, float phase, bool compute_variance) {
  const Architecture& a = model.architecture();
  if (!a.is_pyramid() || !a.knows_spp)
    throw Error("model {} keeps no history, expected a pyramid network that knows the samples of a pixel",
                model.name());
  if (a.reads_lrhs() && phase == 0)
    throw Error("model {}: a history needs an ordinary small render as LRHS, not every {}. pixel",
                model.name(), a.scale);
  const auto variance = std::ranges::find(a.hrls_layers, "variance");
  if (variance == a.hrls_layers.end()) return 3 * uint32_t(a.hrls_layers.size());
  if (!compute_variance || variance + 1 != a.hrls_layers.end())
    throw Error("model {}: a history needs the variance as the last layer, computed by the device",
                model.name());
  return 3 * (uint32_t(a.hrls_layers.size()) - 1);
}

// settle() and accumulate() read one pixel around each, and the LRHS pixels around that, of which
// light_change() reads the neighbours.
uint32_t receptive_halo(const Architecture& a, bool compute_variance, bool temporal) {
  const uint32_t halo = functions_of(a.kind).halo(a, compute_variance);
  return temporal ? halo + divide_up(4, a.grid()) * a.grid() : halo;
}

std::vector<Conv2dShape> conv2d_shapes(const Model& model, uint32_t height, uint32_t width) {
  std::vector<Conv2dShape> shapes;
  const auto note = [&](const Conv2dShape& shape) {
    // link() asks for the shape again where it refuses F(4, 3).
    if (shape.most_tile < 4) shapes.pop_back();
    shapes.push_back(shape);
    return Conv2dKernel{.algorithm = shape.kernel == 1 ? Algorithm::kPointwise : Algorithm::kWinograd,
                        .tile = shape.most_tile};
  };
  Graph graph(Storage::kFloat32);
  network(graph, model, height, width, 0, note);
  return shapes;
}

}  // namespace raymeld
