// Builds the network of Hou et al. 2021, section 4. A layer's name is the key of its weights.
// The LRHS size is (h, w), the scale is s, H = s h and W = s w. C, R, D, B, G and M are as in Architecture,
// and K is the number of HRLS channels.
#include <algorithm>
#include <utility>

#include "networks/builder.h"
#include "networks/entries.h"

namespace raymeld {
namespace {

struct FusionBuilder : Builder {
  // Adds (H, W, K) -> F_HRLS (h, w, C): Eq. 5 and 6, or one convolution of HRLS unshuffled by s.
  Tensor hrls_encoder(const Tensor& hrls) {
    const auto [height, width, channels] = hrls.shape;
    if (a.hrls_encoder == HrlsEncoder::kUnshuffled) {
      const Tensor f_hrls = tensor("hrls", height / a.scale, width / a.scale, a.features);
      conv("hrls", hrls, f_hrls, {.kernel = a.hrls_kernel, .relu = true, .unshuffle = a.scale});
      return f_hrls;
    }
    Tensor x = tensor("hrls", height, width, a.features);
    std::vector<Conv2dLink> links{link("hrls", hrls, x, {.kernel = 3, .relu = true})};
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

  // Adds F_DF (h, w, C) -> (H, W, M), as Upscale says.
  Tensor upscale(std::vector<Conv2dLink>& links, Tensor x) {
    const uint32_t steps = a.upscale == Upscale::kStages ? a.levels() : 1;
    const uint32_t factor = a.upscale == Upscale::kDirect ? a.scale : 2;
    for (uint32_t i = 0; i < steps; ++i)
      x = shuffled(links, fmt::format("up.{}", i), x, factor, a.upscaled_features);
    return x;
  }

  // Adds (H, W, M) -> (H, W, 3). The first convolution has the guide as second input, if any. Those of the
  // head but the first add to their input.
  Tensor reconstruct(std::vector<Conv2dLink>& links, Tensor x, std::optional<Tensor> guide) {
    const auto add = [&](const std::string& layer, uint32_t features, Conv2dOptions options) {
      options.second_input = std::exchange(guide, std::nullopt);
      const Tensor next = tensor(layer, x.shape.height, x.shape.width, features);
      links.push_back(link(layer, x, next, options));
      x = next;
    };
    for (uint32_t i = 0; i < a.head_layers; ++i) {
      Conv2dOptions options{.kernel = 3, .relu = true};
      if (i > 0) options.residuals = {x};
      add(fmt::format("head.{}", i), a.head_features, options);
    }
    add("rec", 3, {.kernel = 3});
    return x;
  }
};

// Sets hrls_encoder and hrls_kernel. Models from before there was a choice of kernel have no entry for it.
void parse_encoder(const Entries& entries, Architecture& a) {
  const bool full = entries.choice("hrls_encoder", "full", "unshuffled");
  a.hrls_encoder = full ? HrlsEncoder::kFull : HrlsEncoder::kUnshuffled;
  if (!entries.has("hrls_kernel")) return;
  a.hrls_kernel = entries.choice("hrls_kernel", "1", "3") ? 1 : 3;
  if (full && a.hrls_kernel != 3) entries.reject("hrls_kernel", "\"3\", as HRLS is not unshuffled");
}

// Sets upscale and upscaled_features.
void parse_upscale(const Entries& entries, Architecture& a) {
  a.upscale = entries.choice("upscale", "stages", "direct") ? Upscale::kStages : Upscale::kDirect;
  a.upscaled_features = entries.integer("upscaled_features", 1, kMostChannels);
  if (a.upscale == Upscale::kStages && a.upscaled_features != a.features) {
    entries.reject("upscaled_features",
                   fmt::format("{}, the features that are upscaled in stages", a.features));
  }
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
  a.has_base = entries.choice("base", "bilinear", "none");
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

  const Tensor lrhs = build.tensor("encode.lrhs", height, width, 3);
  const auto k = static_cast<uint32_t>(build.hrls_channels.encoded.size());
  const Tensor hrls = build.tensor("encode.hrls", full_height, full_width, k);
  build.encode_lrhs(lrhs);
  build.encode_hrls("encode.hrls", hrls, 0, k);
  const Tensor bright = build.tensor("above_clip", height, width, 3);
  above_clip(graph, "above_clip", kLrhsSlot, bright, a.clip);

  const Tensor f_hrls = build.hrls_encoder(hrls);
  const Tensor f_lrhs = build.tensor("lrhs", height, width, a.features);
  const bool centered = phase > 0;
  build.conv("lrhs", lrhs, f_lrhs, {.kernel = 3, .relu = true},
             a.both_samplings && centered ? "centered_bias" : "bias");  // Eq. 4
  const Tensor f_0 = build.tensor("fuse", height, width, a.features);
  build.conv("fuse", f_lrhs, f_0, {.kernel = 1, .relu = true, .second_input = f_hrls});
  const Tensor deep = build.trunk(f_lrhs, f_0);  // F_DF
  std::vector<Conv2dLink> links;
  const Tensor full = build.upscale(links, deep);
  const Tensor fused = build.reconstruct(links, full, a.hrls_guide ? std::optional(hrls) : std::nullopt);
  conv2d_chain(graph, links);
  decode(graph, "decode", fused, {a.transfer, a.has_base ? &lrhs : nullptr, a.scale, phase, &bright, a.clip});
}

// The longest path of both goes through the trunk.
uint32_t fusion_halo(const Architecture& a, bool compute_variance) {
  uint32_t x = a.scale - 1;
  x += a.head_layers + 1;  // head.i, rec
  if (a.upscale == Upscale::kDirect) {
    x = x / a.scale + 1;  // up.0
  } else {
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
  return std::max(x / a.scale, lrhs);
}

}  // namespace raymeld
