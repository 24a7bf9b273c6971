#include <algorithm>
#include <cmath>
#include <functional>
#include <stdexcept>

#include "reference/reference.h"
#include "reference/samples.h"

namespace raymeld::reference {
namespace {

// Returns the values that later layers read as the output of layer `name`.
using Replace = std::function<Bounded(const std::string& name, const Bounded& output)>;

class Run {
 public:
  // If `in_floats` is set, conv2d_in_floats() computes the convolutions.
  Run(const Weights& weights, Precision precision, Replace replace, const Tile& tile, int units,
      bool in_floats)
      : weights_(weights),
        precision_(precision),
        replace_(std::move(replace)),
        tile_(tile),
        units_(units),
        in_floats_(in_floats) {}

  Bounded keep(const std::string& name, Bounded output) {
    Bounded next = replace_(name, output);
    outputs_.insert_or_assign(name, std::move(output));
    return next;
  }

  Bounded conv(const std::string& name, const Bounded& x, bool relu = true) {
    return conv(name, name, x, relu, {});
  }

  Bounded conv(const std::string& name, const std::string& weights_name, const Bounded& x, bool relu,
               const std::vector<const Bounded*>& residuals) {
    return keep(name, convolve(x, weights(weights_name), relu, residuals));
  }

  Bounded conv_lrhs(const Bounded& x, bool centered, const std::vector<const Bounded*>& residuals = {}) {
    Conv conv = weights("lrhs");
    if (centered && !conv.centered_bias.empty()) conv.bias = conv.centered_bias;
    return keep("lrhs", convolve(x, conv, true, residuals));
  }

  Bounded conv_and_shuffle(const std::string& name, const Bounded& x, int r, bool relu = true) {
    return keep(name, pixel_shuffle(convolve(x, weights(name), relu), r));
  }

  Outputs take() { return std::move(outputs_); }

 private:
  Bounded convolve(const Bounded& x, const Conv& conv, bool relu,
                   const std::vector<const Bounded*>& residuals = {}) const {
    if (!in_floats_) return conv2d(x, conv, relu, precision_, residuals, tile_, units_);
    std::vector<const Planes*> values;
    for (const Bounded* residual : residuals) values.push_back(&residual->value);
    return exact(conv2d_in_floats(x.value, conv, relu, precision_, values, tile_));
  }

  const Conv& weights(const std::string& name) const {
    const auto found = weights_.find(name);
    if (found == weights_.end()) throw std::invalid_argument("reference: no weights for " + name);
    return found->second;
  }

  const Weights& weights_;
  const Precision precision_;
  const Replace replace_;
  const Tile tile_;
  const int units_;
  const bool in_floats_;
  Outputs outputs_;
};

Bounded encode_all(const Architecture& a, const Planes& hrls, Precision precision, double exposure) {
  if (hrls.c != 3 * int(a.hrls_layers.size())) throw std::invalid_argument("reference: HRLS channels");
  Bounded result;
  for (size_t i = 0; i < a.hrls_layers.size(); ++i) {
    const auto first = hrls.data.begin() + hrls.index(3 * int(i), 0, 0);
    const Planes layer(3, hrls.h, hrls.w, {first, first + 3 * size_t(hrls.h) * hrls.w});
    const Bounded encoded = encode(layer, a.hrls_layers[i], a.transfer, a.clip, precision, exposure);
    result = i == 0 ? encoded : concat(result, encoded);
  }
  return result;
}

Bounded dense_layers(Run& run, const Architecture& a, const std::string& block, Bounded features) {
  for (int d = 0; d < a.dense_layers; ++d) {
    features = concat(features, run.conv(block + ".dense." + std::to_string(d), features));
  }
  return features;
}

// The last merge adds the group's input and the long skip before it is stored, so all round as one layer.
Bounded trunk(Run& run, const Architecture& a, const Bounded& fused, const Bounded& long_skip) {
  Bounded x = fused;
  for (int g = 0; g < a.groups; ++g) {
    const std::string group = "groups." + std::to_string(g);
    const Bounded group_input = x;
    for (int b = 0; b < a.blocks; ++b) {
      const std::string block = group + ".blocks." + std::to_string(b), merge = block + ".merge";
      const Bounded block_input = x, features = dense_layers(run, a, block, x);
      const auto merged = [&](const std::string& name, const std::vector<const Bounded*>& residuals) {
        return run.conv(name, merge, features, a.merge_relu, residuals);
      };
      x = merged(merge, {&block_input});
      if (b + 1 < a.blocks) continue;
      x = merged(group, {&block_input, &group_input});
      if (g + 1 == a.groups) x = merged("trunk", {&block_input, &group_input, &long_skip});
    }
  }
  return x;
}

Bounded encode_hrls(Run& run, const Architecture& a, const Bounded& hrls) {
  if (a.hrls_unshuffled) return run.conv("hrls", space_to_depth(hrls, a.scale));
  Bounded x = run.conv("hrls", hrls);
  for (int i = 0; 1 << i < a.scale; ++i) x = run.conv("down." + std::to_string(i), space_to_depth(x, 2));
  return x;
}

// Adds convolutions to `x`, each but the first with its input added.
Bounded residual_layers(Run& run, const std::string& name, int layers, Bounded x) {
  for (int i = 0; i < layers; ++i) {
    const std::string layer = name + "." + std::to_string(i);
    std::vector<const Bounded*> residuals;
    if (i > 0) residuals.push_back(&x);
    x = run.conv(layer, layer, x, true, residuals);
  }
  return x;
}

Bounded upscale(Run& run, const Architecture& a, Bounded x) {
  if (a.upscale == Upscale::kDirect) return run.conv_and_shuffle("up.0", x, a.scale);
  for (int i = 0; 1 << i < a.scale; ++i) x = run.conv_and_shuffle("up." + std::to_string(i), x, 2);
  return x;
}

// Returns x with the size (h, w): its last row and column are repeated, or what lies beyond is dropped.
Bounded fitted(const Bounded& x, int h, int w) {
  Bounded result = exact(Planes(x.value.c, h, w));
  for (int c = 0; c < x.value.c; ++c) {
    for (int y = 0; y < h; ++y) {
      for (int column = 0; column < w; ++column) {
        const size_t from = x.value.index(c, std::min(y, x.value.h - 1), std::min(column, x.value.w - 1));
        result.value.at(c, y, column) = x.value.data[from];
        result.bound.at(c, y, column) = x.bound.data[from];
      }
    }
  }
  return result;
}

struct Frame {
  const Planes &lrhs, &hrls;
  double phase, exposure;
};

// Runs the pyramid network of src/networks/pyramid.cpp.
Outputs pyramid_outputs(Run& run, const Architecture& a, const Frame& frame, Precision precision) {
  const auto& [lrhs, hrls, phase, exposure] = frame;
  const int levels = int(a.widths.size()), grid = a.grid(), s = a.scale;
  const int h = (lrhs.h + grid - 1) / grid * grid, w = (lrhs.w + grid - 1) / grid * grid;
  const Bounded high =
      run.keep("encode.hrls", fitted(encode_all(a, hrls, precision, exposure), s * h, s * w));
  Bounded low = slice(high, 0, 3), cell;
  if (s > 1)
    low = run.keep("encode.lrhs",
                   fitted(encode(lrhs, LayerKind::kRadiance, a.transfer, a.clip, precision, exposure), h, w));
  const Bounded above = run.keep("above_clip", above_clip(lrhs, a.clip, precision, exposure));
  const Bounded albedo = slice(high, 3, 3);
  std::optional<Decimated> decimated;
  if (s > 1 && phase == 0) decimated.emplace(Decimated{low, s, a.lrhs_certainty});
  const Bounded lit = run.keep("light", light(slice(high, 0, 3), albedo, a.transfer, precision, decimated));
  const Bounded inputs = concat(lit, high);
  if (s > 1) cell = run.keep("cell_light", cell_light(low, albedo, a.transfer, s, phase, precision));
  std::vector<Bounded> images{slice(inputs, 0, 12)};
  const double share = a.lrhs_certainty / (a.lrhs_certainty + s * s);
  for (int level = 1; level < levels; ++level) {
    const Bounded* other = 1 << level == s ? &cell : nullptr;
    const std::string number = std::to_string(level);
    images.push_back(run.keep("pool." + number, pool(images.back(), precision, other, share)));
  }

  const auto residual = [&](const std::string& name, const Bounded& x) {
    return run.conv(name, name, x, true, {&x});
  };
  std::vector<Bounded> x{inputs, run.conv("hrls", space_to_depth(inputs, 2))};
  for (int level = 1; level < levels; ++level) {
    Bounded& own = x.back();
    own = 1 << level == s ? run.conv_lrhs(concat(own, concat(low, cell)), phase > 0, {&own})
                          : residual("level." + std::to_string(level), own);
    x.push_back(run.conv("down." + std::to_string(level + 1), space_to_depth(own, 2)));
  }
  Bounded deep = x.back();
  for (const char* name : {"deep.0", "deep.1"}) deep = residual(name, deep);
  const auto up = [&](int level, const Bounded& skip) {
    deep = run.conv_and_shuffle("up." + std::to_string(level), deep, 2);
    deep = run.conv("join." + std::to_string(level), concat(deep, skip));
  };
  const auto guides = [&](int level) { return slice(images[level], images[level].value.c - 6, 6); };
  const auto filtered = [&](int level, const Bounded& logits, const Bounded* coarse) {
    const Bounded surfaces = guides(level);
    return run.keep("filter." + std::to_string(level),
                    kernel_filter(slice(images[level], 0, 3), logits, 5, precision, coarse, &surfaces));
  };
  Bounded coarse;
  for (int level = levels - 1; level > 0; --level) {
    up(level, x[level]);
    const Bounded logits = run.conv("kernel." + std::to_string(level), deep, false);
    coarse = filtered(level, logits, level + 1 < levels ? &coarse : nullptr);
  }
  up(0, images[0]);
  const Bounded rec = run.conv("rec", deep, false);
  const Bounded sharp = filtered(0, slice(rec, 15, 28), &coarse);
  const Bounded fused =
      run.keep("compose", compose(slice(rec, 0, 15), sharp, guides(0), low, a.transfer, s, phase, precision));
  const Bounded upsampled = self_weighted(above, s, phase);
  run.keep("output", decode(fitted(fused, hrls.h, hrls.w), nullptr, a.transfer, Precision::kFp32, exposure,
                            &upsampled, a.clip));
  return run.take();
}

// Returns the features of EDSR before they are upscaled.
Bounded edsr_features(Run& run, const Architecture& a, const Bounded& head) {
  Bounded x = head;
  for (int block = 0; block < a.blocks; ++block) {
    const std::string name = "blocks." + std::to_string(block);
    const Bounded inner = run.conv(name + ".0", x);
    x = run.conv(name + ".1", name + ".1", inner, false, {&x});
  }
  return x;
}

// Returns the features of RCAN before they are upscaled.
Bounded rcan_features(Run& run, const Architecture& a, const Bounded& head, Precision precision) {
  Bounded x = head;
  for (int g = 0; g < a.groups; ++g) {
    const std::string group = "groups." + std::to_string(g);
    const Bounded group_input = x;
    for (int b = 0; b < a.blocks; ++b) {
      const std::string name = group + ".blocks." + std::to_string(b);
      const Bounded inner = run.conv(name + ".1", run.conv(name + ".0", x), false);
      const Bounded means = run.keep(name + ".means", channel_means(inner, precision));
      const Bounded logits = run.conv(name + ".excite", run.conv(name + ".squeeze", means), false);
      x = run.keep(name + ".attend", attend(inner, logits, x, precision));
    }
    x = run.conv(group + ".last", group + ".last", x, false, {&group_input});
  }
  return x;
}

// Runs the networks of src/networks/edsr.cpp and rcan.cpp.
Outputs upscaler_outputs(Run& run, const Architecture& a, const Frame& frame, Precision precision) {
  const auto& [lrhs, hrls, phase, exposure] = frame;
  const Bounded low =
      run.keep("encode.lrhs", encode(lrhs, LayerKind::kRadiance, a.transfer, a.clip, precision, exposure));
  const Bounded above = run.keep("above_clip", above_clip(lrhs, a.clip, precision, exposure));
  const Bounded head = run.conv("head", low, false);
  Bounded x =
      a.upscaler == Upscaler::kEdsr ? edsr_features(run, a, head) : rcan_features(run, a, head, precision);
  x = run.conv("body", "body", x, false, {&head});
  for (int i = 0; 1 << i < a.scale; ++i) x = run.conv_and_shuffle("up." + std::to_string(i), x, 2, false);
  x = run.conv("rec", x, false);
  const Bounded base = bilinear(low, a.scale, phase), upsampled = self_weighted(above, a.scale, phase);
  run.keep("output", decode(x, &base, a.transfer, Precision::kFp32, exposure, &upsampled, a.clip));
  return run.take();
}

// Runs the network of src/networks/kpcn.cpp.
Outputs kpcn_outputs(Run& run, const Architecture& a, const Frame& frame, Precision precision) {
  const auto& [lrhs, hrls, phase, exposure] = frame;
  const Bounded high = run.keep("encode.hrls", encode_all(a, hrls, precision, exposure));
  const Bounded above = run.keep("above_clip", above_clip(lrhs, a.clip, precision, exposure));
  const Bounded albedo = slice(high, 3, 3), diffuse = slice(high, 9, 3);
  const Bounded lit = run.keep("light", light(diffuse, albedo, a.transfer, precision));
  const Bounded rest = run.keep("remainder", remainder(slice(high, 0, 3), diffuse, a.transfer, precision));
  const Bounded images = concat(high, concat(lit, rest));
  const Bounded inputs = concat(images, run.keep("gradients", gradients(images, precision)));
  const auto filtered = [&](const std::string& branch, const Bounded& image) {
    Bounded x = inputs;
    for (int i = 0; i + 1 < a.depth; ++i) x = run.conv(branch + "." + std::to_string(i), x);
    const Bounded logits = run.conv("kernel." + branch, x, false);
    return run.keep("filter." + branch, kernel_filter(image, logits, a.kernel_side, precision));
  };
  const Bounded filtered_light = filtered("diffuse", lit), filtered_rest = filtered("rest", rest);
  const Bounded fused =
      run.keep("remodulate", remodulate(filtered_light, albedo, filtered_rest, a.transfer, precision));
  run.keep("output", decode(fused, nullptr, a.transfer, Precision::kFp32, exposure, &above, a.clip));
  return run.take();
}

Outputs outputs_of(Run& run, const Architecture& a, const Frame& frame, Precision precision) {
  if (a.upscaler != Upscaler::kNone) return upscaler_outputs(run, a, frame, precision);
  if (a.is_pyramid()) return pyramid_outputs(run, a, frame, precision);
  if (a.is_kpcn()) return kpcn_outputs(run, a, frame, precision);
  const auto& [lrhs, hrls, phase, exposure] = frame;
  const Bounded low =
      run.keep("encode.lrhs", encode(lrhs, LayerKind::kRadiance, a.transfer, a.clip, precision, exposure));
  const Bounded high = run.keep("encode.hrls", encode_all(a, hrls, precision, exposure));
  const Bounded f_lrhs = run.conv_lrhs(low, phase > 0);
  const Bounded fused = run.conv("fuse", concat(f_lrhs, encode_hrls(run, a, high)));
  Bounded x = upscale(run, a, trunk(run, a, fused, a.long_skip_fused ? fused : f_lrhs));
  if (a.hrls_guide) x = concat(x, high);
  x = run.conv("rec", residual_layers(run, "head", a.head_layers, x), false);
  const Bounded base = bilinear(low, a.scale, phase);
  const Bounded above = run.keep("above_clip", above_clip(lrhs, a.clip, precision, exposure));
  const Bounded upsampled = self_weighted(above, a.scale, phase);
  run.keep("output", decode(x, a.has_base ? &base : nullptr, a.transfer, Precision::kFp32, exposure,
                            &upsampled, a.clip));
  return run.take();
}

}  // namespace

void take_samples(Architecture& architecture, Weights& weights, double lrhs_spp, double hrls_spp) {
  if (!architecture.knows_spp) return;
  for (const auto& [name, spp] : {std::pair("lrhs", lrhs_spp), {"hrls", hrls_spp}}) {
    if (!weights.contains(name)) continue;  // a network of scale 1 has no layer for LRHS
    Conv& conv = weights.at(name);
    for (std::vector<double>* bias : {&conv.bias, &conv.centered_bias})
      for (size_t o = 0; o < bias->size(); ++o) (*bias)[o] += conv.by_spp[o] * std::log2(spp);
    conv.by_spp.clear();
  }
  architecture.lrhs_certainty *= lrhs_spp / (hrls_spp * architecture.scale * architecture.scale);
  architecture.knows_spp = false;
}

Outputs network(const Architecture& a, const Weights& weights, const Planes& lrhs, const Planes& hrls,
                double phase, Precision precision, const std::map<std::string, Planes>& given,
                double exposure, const Tile& tile, int units) {
  const auto replace = [&](const std::string& name, const Bounded& output) {
    const auto replacement = given.find(name);
    return replacement == given.end() ? output : exact(replacement->second);
  };
  Run run(weights, precision, replace, tile, units, false);
  return outputs_of(run, a, {lrhs, hrls, phase, exposure}, precision);
}

std::map<std::string, Planes> network_in_floats(const Architecture& a, const Weights& weights,
                                                const Planes& lrhs, const Planes& hrls, double phase,
                                                Precision precision, double exposure, const Tile& tile) {
  std::map<std::string, Planes> values;
  uint64_t seed = 0;
  const auto draw = [&](const std::string& name, const Bounded& output) {
    const Planes& value = output.value;
    Planes drawn = random_planes(value.c, value.h, value.w, Fill::kUniform, ++seed);
    for (size_t i = 0; i < drawn.data.size(); ++i)
      drawn.data[i] = value.data[i] + drawn.data[i] * output.bound.data[i];
    return exact(values.insert_or_assign(name, std::move(drawn)).first->second);
  };
  Run run(weights, precision, draw, tile, 1, true);
  outputs_of(run, a, {lrhs, hrls, phase, exposure}, precision);
  return values;
}

}  // namespace raymeld::reference
