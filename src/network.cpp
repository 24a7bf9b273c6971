// The network of Hou et al. 2021, section 4, as prose. A layer's name is the key of its weights.
// h, w: the LRHS size; s: the scale; H = s h, W = s w; C, R, D, B, G, K as in Architecture.
#include "network.h"

namespace raymeld {
namespace {

struct Builder {
  Graph& graph;
  const Model& model;
  const Architecture& a = model.architecture();

  Tensor tensor(const std::string& name, uint32_t height, uint32_t width, uint32_t channels) {
    return graph.tensor(name, {height, width, channels});
  }

  void conv(const std::string& name, const Tensor& in, const Tensor& out, const Conv2dOptions& options) {
    const uint32_t channels_out = out.shape.channels, channels_in = in.shape.channels;
    conv2d(graph, name, in, out, model.conv(name, channels_out, channels_in, options.kernel), options);
  }

  // (H, W, K) -> F_HRLS (h, w, C), Eq. 5 and 6.
  void hrls_encoder(const Tensor& hrls, const Tensor& f_hrls) {
    Tensor x = tensor("hrls", hrls.shape.height, hrls.shape.width, a.features);
    conv("hrls", hrls, x, {.kernel = 3, .relu = true});
    for (uint32_t i = 0; i < a.levels(); ++i) {
      const std::string name = fmt::format("down.{}", i);
      const uint32_t height = x.shape.height / 2, width = x.shape.width / 2;
      const Tensor deep = tensor(name + ".space_to_depth", height, width, 4 * a.features);
      space_to_depth(graph, name + ".space_to_depth", x, deep);
      x = i + 1 == a.levels() ? f_hrls : tensor(name, height, width, a.features);
      conv(name, deep, x, {.kernel = 3, .relu = true});
    }
  }

  // G groups of B residual dense blocks on F_0 -> F_DF (h, w, C), Eq. 7 and 8. A block's features are one
  // tensor of C + D R channels: its input, then what each dense layer appends.
  Tensor trunk(const Tensor& f_lrhs, Tensor features) {
    const uint32_t height = f_lrhs.shape.height, width = f_lrhs.shape.width;
    const Tensor f_0 = features.slice(0, a.features);
    for (uint32_t g = 0; g < a.groups; ++g) {
      const Tensor group_input = features.slice(0, a.features);
      for (uint32_t b = 0; b < a.blocks; ++b) {
        const std::string name = fmt::format("groups.{}.blocks.{}", g, b);
        const bool last_of_group = b + 1 == a.blocks, last = last_of_group && g + 1 == a.groups;
        const Tensor block_input = features.slice(0, a.features);
        for (uint32_t d = 0; d < a.dense_layers; ++d) {
          const uint32_t known = a.features + d * a.growth;
          conv(fmt::format("{}.dense.{}", name, d), features.slice(0, known), features.slice(known, a.growth),
               {.kernel = 3, .relu = true});
        }
        std::vector<Tensor> residuals{block_input};
        if (last_of_group) residuals.push_back(group_input);
        if (last) residuals.push_back(a.long_skip == LongSkip::kLrhs ? f_lrhs : f_0);
        const Tensor next = last            ? tensor("trunk", height, width, a.features)
                            : last_of_group ? block_features(g + 1, 0)
                                            : block_features(g, b + 1);
        conv(name + ".merge", features, next.slice(0, a.features),
             {.kernel = 1, .relu = a.merge_relu, .residuals = residuals});
        features = next;
      }
    }
    return features;
  }

  Tensor block_features(uint32_t g, uint32_t b) {
    const std::string name = fmt::format("groups.{}.blocks.{}.features", g, b);
    return tensor(name, lrhs_height, lrhs_width, a.features + a.dense_layers * a.growth);
  }

  // F_DF (h, w, C) -> (H, W, C), Eq. 9.
  Tensor upscale(Tensor x) {
    for (uint32_t i = 0; i < a.levels(); ++i) {
      const std::string name = fmt::format("up.{}", i);
      const Tensor deep = tensor(name, x.shape.height, x.shape.width, 4 * a.features);
      conv(name, x, deep, {.kernel = 3, .relu = true});
      x = tensor(name + ".pixel_shuffle", 2 * x.shape.height, 2 * x.shape.width, a.features);
      pixel_shuffle(graph, name + ".pixel_shuffle", deep, x);
    }
    return x;
  }

  uint32_t lrhs_height, lrhs_width;
};

}  // namespace

void network(Graph& graph, const Model& model, uint32_t height, uint32_t width, float phase) {
  Builder build{.graph = graph, .model = model, .lrhs_height = height, .lrhs_width = width};
  const Architecture& a = model.architecture();
  const uint32_t full_height = a.scale * height, full_width = a.scale * width;
  const std::vector<ChannelKind> hrls_kinds = a.hrls_kinds(), lrhs_kinds(3, ChannelKind::kRadiance);

  const Tensor lrhs = build.tensor("encode.lrhs", height, width, 3);
  const Tensor hrls =
      build.tensor("encode.hrls", full_height, full_width, static_cast<uint32_t>(hrls_kinds.size()));
  encode(graph, "encode.lrhs", FrameSlot::kLrhs, lrhs, lrhs_kinds, a.transfer, a.clip);
  encode(graph, "encode.hrls", FrameSlot::kHrls, hrls, hrls_kinds, a.transfer, a.clip);

  const Tensor both = build.tensor("encoders", height, width, 2 * a.features);  // F_LRHS, F_HRLS
  const Tensor f_lrhs = both.slice(0, a.features), f_hrls = both.slice(a.features, a.features);
  build.conv("lrhs", lrhs, f_lrhs, {.kernel = 3, .relu = true});  // Eq. 4
  build.hrls_encoder(hrls, f_hrls);

  const Tensor features = build.block_features(0, 0);
  build.conv("fuse", both, features.slice(0, a.features), {.kernel = 1, .relu = true});  // F_0
  const Tensor full = build.upscale(build.trunk(f_lrhs, features));                      // (H, W, C)
  const Tensor fused = build.tensor("rec", full_height, full_width, 3);
  build.conv("rec", full, fused, {.kernel = 3});
  decode(graph, "decode", fused, {a.transfer, a.bilinear_base ? &lrhs : nullptr, a.scale, phase});
}

// Follows the right-most pixel of cell 0 back through the longest path: a 3x3 reaches one pixel further at
// its own resolution, a shuffle moves to the pixel of the other resolution that lies furthest out.
uint32_t receptive_halo(const Architecture& a) {
  uint32_t x = a.scale - 1;
  x += 1;                                                         // rec
  for (uint32_t i = 0; i < a.levels(); ++i) x = x / 2 + 1;        // up.i
  x += a.groups * a.blocks * a.dense_layers;                      // the trunk
  for (uint32_t i = 0; i < a.levels(); ++i) x = 2 * (x + 1) + 1;  // down.i
  x += 1;                                                         // hrls
  return x / a.scale;
}

}  // namespace raymeld
