// Builds the network of Hou et al. 2021, section 4. A layer's name is the key of its weights.
// The LRHS size is (h, w), the scale is s, H = s h and W = s w. C, R, D, B, G and M are as in Architecture,
// and K is the number of HRLS channels.
#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <utility>

#include "networks/builder.h"
#include "networks/entries.h"

namespace raymeld {
namespace {

// The joint base filters in kJointLevels levels. The first, the third and the fifth are candidates, beside
// LRHS and its irradiance.
constexpr uint32_t kFilteredCandidates = 3, kCandidates = 2 + kFilteredCandidates;

struct FusionBuilder : Builder {
  // Returns exp(x). Throws an Error that names the tensor where a float cannot hold it.
  float exponential(const char* name, float x) const {
    const float result = std::exp(x);
    if (std::isfinite(result)) return result;
    throw Error("model {}: tensor {} gives a factor exp({}), which is not finite", model.file(), name, x);
  }

  // Returns the certainty of a pixel of LRHS in the joint filter.
  float lrhs_certainty() const {
    if (!a.knows_spp || a.base != Base::kJoint) return a.lrhs_certainty;
    const auto [lrhs_spp, hrls_spp] = samples.known(a.scale);
    const auto learned = model.joint("certainty", {2});
    return a.lrhs_certainty * lrhs_spp / (hrls_spp * float(a.scale * a.scale)) *
           exponential("joint.certainty", learned[0] + learned[1] * std::log2(hrls_spp));
  }

  // Returns the factors of a level of the joint filter.
  GuideFactors guide_factors(uint32_t level) const {
    if (!a.knows_spp) return {};
    const float log_spp = std::log2(samples.known(a.scale).hrls);
    const auto widths = model.joint("widths", {kJointLevels, 3}),
               by_spp = model.joint("widths_by_spp", {kJointLevels, 3});
    const auto factor = [&](uint32_t guide) {
      const uint32_t i = 3 * level + guide;
      return exponential("joint.widths", widths[i] + by_spp[i] * log_spp);
    };
    return {factor(0), factor(1), factor(2)};
  }

  // Returns Conv2dOptions::constants for a convolution that reads `channels` other channels before HRLS, and
  // the filtered images after HRLS.
  std::vector<std::optional<float>> constants(uint32_t channels) const {
    std::vector<std::optional<float>> result(channels);
    result.insert(result.end(), hrls_channels.constants.begin(), hrls_channels.constants.end());
    result.resize(result.size() + (a.base == Base::kJoint ? 3 * kFilteredCandidates : 0));
    return result;
  }

  // Adds (H, W, K) -> F_HRLS (h, w, C): Eq. 5 and 6, or one convolution of HRLS unshuffled by s.
  Tensor hrls_encoder(const Tensor& hrls) {
    const auto [height, width, channels] = hrls.shape;
    if (a.hrls_encoder == HrlsEncoder::kUnshuffled) {
      const Tensor f_hrls = tensor("hrls", height / a.scale, width / a.scale, a.features);
      conv("hrls", hrls, f_hrls,
           {.kernel = a.hrls_kernel, .relu = true, .unshuffle = a.scale, .constants = constants(0)});
      return f_hrls;
    }
    Tensor x = tensor("hrls", height, width, a.features);
    std::vector<Conv2dLink> links{
        link("hrls", hrls, x, {.kernel = 3, .relu = true, .constants = constants(0)})};
    for (uint32_t i = 0; i < a.levels(); ++i) {
      const std::string name = fmt::format("down.{}", i);
      const Tensor next = tensor(name, x.shape.height / 2, x.shape.width / 2, a.features);
      links.push_back(link(name, x, next, {.kernel = 3, .relu = true, .unshuffle = 2}));
      x = next;
    }
    conv2d_chain(graph, links);
    return x;
  }

  // Adds G groups of B residual dense blocks, F_0 -> F_DF (h, w, C), Eq. 7 and 8. Each of a block's D layers
  // reads the block's input and the channels of the layers before it, and appends R channels to the tensor
  // that holds them.
  Tensor trunk(const Tensor& f_lrhs, const Tensor& f_0) {
    const auto [height, width, channels] = f_0.shape;
    Tensor x = f_0;
    for (uint32_t g = 0; g < a.groups; ++g) {
      const Tensor group_input = x;
      for (uint32_t b = 0; b < a.blocks; ++b) {
        const std::string name = fmt::format("groups.{}.blocks.{}", g, b);
        const bool last_of_group = b + 1 == a.blocks, last = last_of_group && g + 1 == a.groups;
        const Tensor dense = tensor(name + ".dense", height, width, a.dense_layers * a.growth);
        for (uint32_t d = 0; d < a.dense_layers; ++d) {
          Conv2dOptions options{.kernel = 3, .relu = true};
          if (d > 0) options.second_input = dense.slice(0, d * a.growth);
          conv(fmt::format("{}.dense.{}", name, d), x, dense.slice(d * a.growth, a.growth), options);
        }
        std::vector<Tensor> residuals{x};
        if (last_of_group) residuals.push_back(group_input);
        if (last) residuals.push_back(a.long_skip == LongSkip::kLrhs ? f_lrhs : f_0);
        const Tensor next = tensor(name + ".merge", height, width, channels);
        conv(name + ".merge", x, next,
             {.kernel = 1, .relu = a.merge_relu, .residuals = residuals, .second_input = dense});
        x = next;
      }
    }
    return x;
  }

  // Adds convolutions of `x` into as many `features`, the first with `options`. Each but the first adds to
  // its input.
  Tensor residual_layers(std::vector<Conv2dLink>& links, const std::string& name, uint32_t layers,
                         uint32_t features, Tensor x, Conv2dOptions options) {
    for (uint32_t i = 0; i < layers; ++i) {
      const std::string layer = fmt::format("{}.{}", name, i);
      const Tensor next = tensor(layer, x.shape.height, x.shape.width, features);
      if (i > 0) options = {.kernel = 3, .relu = true, .residuals = {x}};
      links.push_back(link(layer, x, next, options));
      x = next;
    }
    return x;
  }

  // Adds F_DF (h, w, C) -> (H / 2, W / 2, E), which is upscaled, and convolved together with HRLS.
  Tensor upscale_to_half(std::vector<Conv2dLink>& links, const Tensor& deep, const Tensor& hrls) {
    const Tensor skip = tensor("half_skip", hrls.shape.height / 2, hrls.shape.width / 2, a.half_features);
    conv("half_skip", hrls, skip, {.kernel = 3, .relu = true, .unshuffle = 2, .constants = constants(0)});
    const Tensor up = shuffled(links, "half_up", deep, a.scale / 2, a.half_features);
    return residual_layers(links, "half_layers", a.half_layers, a.half_features, up,
                           {.kernel = 3, .relu = true, .second_input = skip});
  }

  // Adds F_DF (h, w, C) -> (H, W, M), as Upscale says.
  Tensor upscale(std::vector<Conv2dLink>& links, Tensor x, const Tensor& hrls) {
    if (a.upscale == Upscale::kHalf) x = upscale_to_half(links, x, hrls);
    const uint32_t steps = a.upscale == Upscale::kStages ? a.levels() : 1;
    const uint32_t factor = a.upscale == Upscale::kDirect ? a.scale : 2;
    for (uint32_t i = 0; i < steps; ++i)
      x = shuffled(links, fmt::format("up.{}", i), x, factor, a.upscaled_features);
    return x;
  }

  // Demodulates HRLS and LRHS by albedo, filters them, and writes (H, W, 3 kFilteredCandidates), the
  // remodulated candidates. Albedo, normal and the irradiance of LRHS guide the filter. The irradiance is
  // computed here too, into channels 3 to 5 of encode.lrhs.
  void joint_candidates(const Tensor& lrhs, const Tensor& hrls, const Tensor& candidates,
                        const JointOptions& options) {
    const Tensor albedo = layer(hrls, "albedo"), normal = layer(hrls, "normal");
    irradiance(graph, "irradiance", lrhs.slice(0, 3), albedo, normal, lrhs.slice(3, 3), options);
    const Tensor lights = tensor("demodulate", hrls.shape.height, hrls.shape.width, 5);
    demodulate(graph, "demodulate", layer(hrls, "color"), albedo, lrhs, lights, options);
    Tensor x = lights.slice(0, 4);
    for (uint32_t level = 0; level < kJointLevels; ++level) {
      const Tensor next = tensor(fmt::format("joint.{}", level), hrls.shape.height, hrls.shape.width, 4);
      joint_filter(graph, fmt::format("joint.{}", level), x, albedo, normal, lights.slice(4, 1), next,
                   1u << level, guide_factors(level));
      x = next;
      if (level % 2 == 0) {
        remodulate(graph, fmt::format("remodulate.{}", level + 1), x.slice(0, 3), albedo,
                   candidates.slice(level / 2 * 3, 3), a.transfer);
      }
    }
  }

  // Adds (H, W, M), and the guide as second input, if any -> (H, W, 3), or (H, W, 8) for a joint base.
  Tensor reconstruct(std::vector<Conv2dLink>& links, Tensor x, std::optional<Tensor> guide) {
    const auto [height, width, channels] = x.shape;
    const auto with_guide = [&](Conv2dOptions options) {
      if (guide) options.constants = constants(x.shape.channels);
      options.second_input = std::exchange(guide, std::nullopt);
      return options;
    };
    if (a.head_layers > 0)
      x = residual_layers(links, "head", a.head_layers, a.head_features, x,
                          with_guide({.kernel = 3, .relu = true}));
    const Tensor fused = tensor("rec", height, width, a.base == Base::kJoint ? 3 + kCandidates : 3);
    links.push_back(link("rec", x, fused, with_guide({.kernel = 3})));
    return fused;
  }
};

// Reads the base, which needs the layers that guide the joint filter.
Base base(const Entries& entries, std::span<const std::string> hrls_layers) {
  if (entries.text("base") != "joint") {
    return entries.choice("base", "bilinear", "none") ? Base::kBilinear : Base::kNone;
  }
  for (const char* layer : {"albedo", "normal"}) {
    if (std::ranges::find(hrls_layers, layer) == hrls_layers.end()) {
      entries.reject("base", fmt::format("\"bilinear\" or \"none\", as hrls_layers has no {}", layer));
    }
  }
  return Base::kJoint;
}

// Sets hrls_encoder and hrls_kernel. Models from before there was a choice of kernel have no entry for it.
void parse_encoder(const Entries& entries, Architecture& a) {
  const bool full = entries.choice("hrls_encoder", "full", "unshuffled");
  a.hrls_encoder = full ? HrlsEncoder::kFull : HrlsEncoder::kUnshuffled;
  if (!entries.has("hrls_kernel")) return;
  a.hrls_kernel = entries.choice("hrls_kernel", "1", "3") ? 1 : 3;
  if (full && a.hrls_kernel != 3) entries.reject("hrls_kernel", "\"3\", as HRLS is not unshuffled");
}

// Sets upscale, upscaled_features, half_features and half_layers. Only models that upscale by half size need
// entries for the last two.
void parse_upscale(const Entries& entries, Architecture& a) {
  const bool half = entries.text("upscale") == "half";
  a.upscale = half                                            ? Upscale::kHalf
              : entries.choice("upscale", "stages", "direct") ? Upscale::kStages
                                                              : Upscale::kDirect;
  a.upscaled_features = entries.integer("upscaled_features", 1, kMostChannels);
  if (a.upscale == Upscale::kStages && a.upscaled_features != a.features) {
    entries.reject("upscaled_features",
                   fmt::format("{}, the features that are upscaled in stages", a.features));
  }
  if (!half) return;
  a.half_features = entries.integer("half_features", 1, kMostChannels);
  a.half_layers = entries.integer("half_layers", 1, kMostRepeats);
}

}  // namespace

void parse_fusion(const Entries& entries, Architecture& a) {
  a.features = entries.integer("features", 1, kMostChannels);
  a.growth = entries.integer("growth", 1, kMostChannels);
  a.dense_layers = entries.integer("dense_layers", 1, kMostRepeats);
  a.blocks = entries.integer("blocks", 1, kMostRepeats);
  a.groups = entries.integer("groups", 1, kMostRepeats);
  a.long_skip = entries.choice("long_skip", "lrhs", "fused") ? LongSkip::kLrhs : LongSkip::kFused;
  a.merge_relu = entries.choice("merge_relu", "true", "false");
  a.base = base(entries, a.hrls_layers);
  parse_encoder(entries, a);
  parse_upscale(entries, a);
  a.hrls_guide = entries.choice("guide", "hrls", "none");
  a.head_features = entries.integer("head_features", 0, kMostChannels);
  a.head_layers = entries.integer("head_layers", 0, kMostRepeats);
  if ((a.head_layers > 0) != (a.head_features > 0)) {
    entries.reject("head_layers", a.head_features > 0 ? "at least 1, as there are head_features"
                                                      : "0, as there are no head_features");
  }
}

void add_fusion(Builder builder, uint32_t height, uint32_t width, float phase) {
  FusionBuilder build{builder};
  const Architecture& a = build.a;
  Graph& graph = build.graph;
  const uint32_t full_height = a.scale * height, full_width = a.scale * width;
  const HrlsChannels& hrls_channels = build.hrls_channels;
  const bool joint = a.base == Base::kJoint;
  const JointOptions joint_options{a.transfer, a.scale, phase, build.lrhs_certainty()};

  // A joint base puts the irradiance after the encoded LRHS, and the filtered images after the encoded HRLS.
  const Tensor lrhs = build.tensor("encode.lrhs", height, width, joint ? 6 : 3);
  const uint32_t layers = static_cast<uint32_t>(hrls_channels.encoded.size());
  const uint32_t k = layers + (joint ? 3 * kFilteredCandidates : 0);
  const Tensor hrls = build.tensor("encode.hrls", full_height, full_width, k);
  const Tensor filtered = hrls.slice(layers, k - layers);
  build.encode_lrhs(lrhs.slice(0, 3));
  build.encode_hrls("encode.hrls", hrls, 0, layers);
  const Tensor bright = build.tensor("above_clip", height, width, 3);
  above_clip(graph, "above_clip", kLrhsSlot, bright, a.clip);
  if (joint) build.joint_candidates(lrhs, hrls, filtered, joint_options);

  const Tensor convolved = hrls.slice(hrls_channels.unread, k - hrls_channels.unread);
  const Tensor f_hrls = build.hrls_encoder(convolved);
  const Tensor f_lrhs = build.tensor("lrhs", height, width, a.features);
  const bool centered = phase > 0;
  build.conv("lrhs", lrhs, f_lrhs, {.kernel = 3, .relu = true},
             a.both_samplings && centered ? "centered_bias" : "bias");  // Eq. 4
  const Tensor f_0 = build.tensor("fuse", height, width, a.features);
  build.conv("fuse", f_lrhs, f_0, {.kernel = 1, .relu = true, .second_input = f_hrls});
  const Tensor deep = build.trunk(f_lrhs, f_0);  // F_DF
  std::vector<Conv2dLink> links;
  const Tensor full = build.upscale(links, deep, convolved);
  const Tensor fused = build.reconstruct(links, full, a.hrls_guide ? std::optional(convolved) : std::nullopt);
  conv2d_chain(graph, links);
  if (!joint) {
    const Tensor* base = a.base == Base::kBilinear ? &lrhs : nullptr;
    return decode(graph, "decode", fused, {a.transfer, base, a.scale, phase, &bright, a.clip});
  }
  const Tensor mixed = build.tensor("mix", full_height, full_width, 3);
  mix(graph, "mix", fused, lrhs, build.layer(hrls, "albedo"), filtered, mixed, joint_options);
  decode(graph, "decode", mixed, {a.transfer, nullptr, a.scale, phase, &bright, a.clip});
}

// The longest path of LRHS goes through the trunk, and that of HRLS through it or the joint filter.
uint32_t fusion_halo(const Architecture& a, bool compute_variance) {
  uint32_t x = a.scale - 1;
  x += a.head_layers + 1;  // head.i, rec
  switch (a.upscale) {
    case Upscale::kDirect:
      x = x / a.scale + 1;  // up.0
      break;
    case Upscale::kHalf:
      x = x / 2 + 1 + a.half_layers;  // up.0, half_layers.i
      x = x / (a.scale / 2) + 1;      // half_up; half_skip reaches less far than the trunk
      break;
    case Upscale::kStages:
      for (uint32_t i = 0; i < a.levels(); ++i) x = x / 2 + 1;  // up.i
  }
  x += a.groups * a.blocks * a.dense_layers;  // the trunk
  const uint32_t lrhs = x + 1;
  if (a.hrls_encoder == HrlsEncoder::kUnshuffled) {
    x = a.scale * (x + a.hrls_kernel / 2) + a.scale - 1;  // hrls
  } else {
    for (uint32_t i = 0; i < a.levels(); ++i) x = 2 * (x + 1) + 1;  // down.i
    x += 1;                                                         // hrls
  }
  if (compute_variance) x += 1;
  if (a.base != Base::kJoint) return std::max(x / a.scale, lrhs);
  x += (1u << kJointLevels) - 1;  // joint.i
  // The upsampled irradiance, a mean of 3x3, reaches further than the neighbours of a firefly.
  return x / a.scale + 2;
}

}  // namespace raymeld
