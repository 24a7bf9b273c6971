// Builds the pyramid network: a U-Net (Ronneberger et al. 2015) of four levels, of half the full size and so
// on, which predicts kernels for each pixel of the full size and of three of these levels (Bako et al. 2017,
// Vogels et al. 2018). They filter the light of both renders, from the coarsest to the finest. LRHS joins
// the level of its own size and, where it is every s-th pixel of a render, also the pixels that it shows; a
// network of scale 1 has none, and filters the light of HRLS. Frames are padded to whole pixels of the
// coarsest level.
#include <algorithm>
#include <array>
#include <optional>

#include "networks/builder.h"
#include "networks/entries.h"
#include "numbers.h"

namespace raymeld {
namespace {

constexpr uint32_t kLevels = 4;
constexpr uint32_t kSide = 5, kAlbedoSide = 3;  // sides of the kernels that filter light and albedo
constexpr uint32_t kGuideChannels = 12;         // light, color, albedo and normal

// An image of a level begins with light and ends with albedo and normal, which guide the kernels that filter
// the light.
Tensor light_of(const Tensor& image) { return image.slice(0, 3); }
Tensor guides_of(const Tensor& image) { return image.slice(image.shape.channels - 6, 6); }

struct Pyramid {
  Builder& build;
  const Architecture& a = build.a;
  const uint32_t height, width;  // the padded size of LRHS
  const float phase;
  const FrameSize low_frame, full_frame;

  uint32_t size_of(uint32_t side, uint32_t level) const { return (a.scale * side) >> level; }
  Tensor tensor(const std::string& name, uint32_t level, uint32_t channels) const {
    return build.tensor(name, size_of(height, level), size_of(width, level), channels);
  }
  uint32_t features(uint32_t level) const { return a.widths[level - 1]; }

  // Adds LRHS (height, width, 6): its encoded color, and room for its light.
  Tensor encoded_lrhs() const {
    const Tensor lrhs = build.tensor("encode.lrhs", height, width, 6);
    build.encode_lrhs(lrhs.slice(0, 3), low_frame);
    return lrhs;
  }

  // Adds the inputs of the U-Net: room for the light of HRLS, and its encoded layers.
  Tensor encoded_hrls(uint32_t layers) const {
    const Tensor inputs = tensor("encode.hrls", 0, 3 + layers);
    build.encode_hrls("encode.hrls", inputs.slice(3, layers), 0, layers, full_frame);
    return inputs;
  }

  // Adds these inputs where HRLS is joined with the frames before it; the samples of each pixel follow.
  Tensor accumulated(uint32_t layers, const std::optional<Tensor>& lrhs) const {
    Graph& graph = build.graph;
    const auto [lrhs_spp, hrls_spp] = build.samples.known(a.scale);
    const uint32_t channels = build.history_channels;
    const Tensor hrls = tensor("encode.hrls", 0, channels), inputs = tensor("accumulate", 0, 3 + layers + 1);
    build.encode_hrls("encode.hrls", hrls, 0, channels, full_frame);
    AccumulateOptions options{.transfer = a.transfer,
                              .clip = a.clip,
                              .spp = hrls_spp,
                              .channels = channels,
                              .has_depth = build.joining.motion_depth,
                              .scale = a.scale,
                              .frame = full_frame};
    if (lrhs) {
      options.change = build.tensor("light_change", height, width, 2);
      light_change(graph, "light_change", lrhs->slice(0, 3), *options.change, a.transfer, a.scale, channels,
                   low_frame);
    }
    accumulate(graph, "accumulate", hrls, inputs.slice(3, layers + 1), options);
    if (channels < layers) {
      color_variance(graph, "color_variance", inputs.slice(3, 3), inputs.slice(3 + channels, 3), a.transfer,
                     a.clip, full_frame);
    }
    return inputs;
  }

  // Adds the fused image, mixed with that of the last frame.
  Tensor settled(const Tensor& fused, const Tensor& samples) const {
    const Tensor out = tensor("settle", 0, 3);
    settle(build.graph, "settle", fused, samples, out,
           {.transfer = a.transfer,
            .clip = a.clip,
            .spp = build.samples.known(a.scale).hrls,
            .channels = build.history_channels,
            .frame = full_frame});
    return out;
  }

  // Adds the share of each LRHS pixel in the light of its level, which depends on the samples of HRLS.
  Tensor shares_of_lrhs(const Tensor& samples) const {
    const Tensor shares = build.tensor("cell_share", height, width, 1);
    const float certainty = a.lrhs_certainty * build.samples.known(a.scale).lrhs / float(a.scale * a.scale);
    cell_share(build.graph, "cell_share", samples, shares, a.scale, certainty);
    return shares;
  }

  // Adds a 3x3 convolution that adds to its input; that of LRHS's level reads LRHS too.
  Tensor own_layer(uint32_t level, const Tensor& x, const std::optional<Tensor>& lrhs) const {
    const bool joins = level == a.levels();
    const std::string name = joins ? "lrhs" : fmt::format("level.{}", level);
    const Tensor out = tensor(name, level, features(level));
    Conv2dOptions options{.kernel = 3, .relu = true, .residuals = {x}};
    if (joins) options.second_input = lrhs;
    build.conv(name, x, out, options, joins && a.both_samplings && phase > 0 ? "centered_bias" : "bias");
    return out;
  }

  Tensor down(uint32_t level, const Tensor& x) const {
    const std::string name = fmt::format("down.{}", level);
    const Tensor out = tensor(name, level, features(level));
    build.conv(name, x, out, {.kernel = 1, .relu = true, .unshuffle = 2});
    return out;
  }

  // Upscales `x` to `level`.
  Tensor up(uint32_t level, uint32_t channels, const Tensor& x) const {
    std::vector<Conv2dLink> links;
    const Tensor out =
        build.shuffled(links, fmt::format("up.{}", level), x, 2, channels, {.kernel = 1, .relu = true});
    conv2d_chain(build.graph, links);
    return out;
  }

  // Convolves `x` together with `skip`.
  Tensor join(uint32_t level, const Tensor& x, const Tensor& skip) const {
    const std::string name = fmt::format("join.{}", level);
    const Tensor out = tensor(name, level, x.shape.channels);
    build.conv(name, x, out, {.kernel = 3, .relu = true, .second_input = skip});
    return out;
  }

  // Predicts the kernels that filter the light of a level.
  Tensor kernels(uint32_t level, const Tensor& x, bool has_coarse) const {
    const std::string name = fmt::format("kernel.{}", level);
    const Tensor out = tensor(name, level, kSide * kSide + (has_coarse ? 3 : 2));
    build.conv(name, x, out, {.kernel = 3});
    return out;
  }

  // Filters the light of a level's image.
  Tensor filtered(uint32_t level, const Tensor& image, const Tensor& kernels,
                  const std::optional<Tensor>& coarse) const {
    const std::string name = fmt::format("filter.{}", level);
    const Tensor out = tensor(name, level, 3);
    kernel_filter(build.graph, name, light_of(image), kernels, out, kSide, {coarse, guides_of(image)});
    return out;
  }

  // Halves the image of the level before.
  Tensor pooled(uint32_t level, const Tensor& image, const std::optional<Blend>& blend) const {
    const std::string name = fmt::format("pool.{}", level);
    const Tensor out = tensor(name, level, kPooledChannels);
    pool(build.graph, name, image, out, blend);
    return out;
  }

  // Returns what takes a share of the pooled light of a level: LRHS, at the level of its size. Adds the
  // shares that depend on the `samples` of HRLS, where each pixel has its own.
  std::optional<Blend> blend(uint32_t level, const std::optional<Tensor>& lrhs,
                             const std::optional<Tensor>& samples) const {
    if (level != a.levels()) return {};
    const float certainty = lrhs_certainty(), cell = float(a.scale * a.scale);
    Blend result{.other = lrhs->slice(3, 3), .share = certainty / (certainty + cell)};
    if (samples) result.shares = shares_of_lrhs(*samples);
    return result;
  }

  // Returns the certainty of a pixel of LRHS, where one of HRLS has 1.
  float lrhs_certainty() const {
    const auto [lrhs_spp, hrls_spp] = build.samples.known(a.scale);
    return a.lrhs_certainty * (a.knows_spp ? lrhs_spp / (hrls_spp * float(a.scale * a.scale)) : 1);
  }

  void add() const {
    Graph& graph = build.graph;
    const auto layers = static_cast<uint32_t>(build.hrls_channels.encoded.size());
    const Tensor bright = build.tensor("above_clip", low_frame.height, low_frame.width, 3);
    above_clip(graph, "above_clip", a.bright_slot(), bright, a.clip);
    std::optional<Tensor> lrhs;
    if (a.reads_lrhs()) lrhs = encoded_lrhs();
    const Tensor inputs = build.history_channels > 0 ? accumulated(layers, lrhs) : encoded_hrls(layers);
    const Tensor lit = inputs.slice(0, 3), hrls = inputs.slice(3, layers);
    const Tensor albedo = build.layer(hrls, "albedo"), color = build.layer(hrls, "color");
    if (lrhs) {
      cell_light(graph, "cell_light", lrhs->slice(0, 3), albedo, lrhs->slice(3, 3), a.transfer, a.scale,
                 phase);
    }
    std::optional<Decimated> decimated;
    if (lrhs && phase == 0) decimated = {lrhs->slice(0, 3), a.scale, lrhs_certainty()};
    light(graph, "light", color, albedo, lit, a.transfer, decimated);
    std::optional<Tensor> samples;
    if (build.history_channels > 0) samples = inputs.slice(3 + layers, 1);

    // Pooling and filtering need no barrier of their own: each runs beside a convolution that does not need
    // its result.
    std::array<Tensor, kLevels> images{inputs.slice(0, kGuideChannels)};
    std::array<Tensor, kLevels + 1> x;
    x[1] = tensor("hrls", 1, features(1));
    build.conv("hrls", inputs, x[1], {.kernel = 3, .relu = true, .unshuffle = 2});
    for (uint32_t level = 1; level < kLevels; ++level) {
      images[level] = pooled(level, images[level - 1], blend(level, lrhs, samples));
      x[level] = own_layer(level, x[level], lrhs);
      x[level + 1] = down(level + 1, x[level]);
    }
    Tensor deep = x[kLevels];
    for (uint32_t i = 0; i < 2; ++i) {
      const std::string name = fmt::format("deep.{}", i);
      const Tensor out = tensor(name, kLevels, features(kLevels));
      build.conv(name, deep, out, {.kernel = 3, .relu = true, .residuals = {deep}});
      deep = out;
    }
    Tensor larger = up(kLevels - 1, features(kLevels - 1), deep);
    std::optional<Tensor> coarse;
    for (uint32_t level = kLevels - 1; level > 0; --level) {
      deep = join(level, larger, x[level]);
      larger = up(level - 1, level > 1 ? features(level - 1) : a.upscaled_features, deep);
      // The filter comes next, so that caches still hold its kernels.
      const Tensor logits = kernels(level, deep, coarse.has_value());
      coarse = filtered(level, images[level], logits, coarse);
    }

    const Tensor full = join(0, larger, images[0]);
    constexpr uint32_t kComposed = 4 + kAlbedoSide * kAlbedoSide + 2, kLogits = kSide * kSide + 3;
    const Tensor rec = tensor("rec", 0, kComposed + kLogits);
    build.conv("rec", full, rec, {.kernel = 3});
    const Tensor sharp = filtered(0, images[0], rec.slice(kComposed, kLogits), coarse);
    const Tensor fused = tensor("compose", 0, 3);
    compose(graph, "compose", rec.slice(0, kComposed), sharp, guides_of(images[0]),
            lrhs ? lrhs->slice(0, 3) : color, fused, a.transfer, a.scale, phase);
    const Tensor shown = samples && build.joining.settles ? settled(fused, *samples) : fused;
    decode(graph, "decode", shown, {a.transfer, nullptr, a.scale, phase, &bright, a.clip, full_frame});
  }
};

// Returns the right-most LRHS pixel that the output pixels of LRHS pixel `own` of a pyramid network depend
// on. `result` and `joined` are the right-most pixels of filter.i and join.i that are needed, level by level.
uint32_t pyramid_reach(const Architecture& a, uint32_t own, bool compute_variance) {
  const auto levels = static_cast<uint32_t>(a.widths.size());
  uint32_t result = a.scale * (own + 1) - 1, joined = result + 1;  // rec; filter.0 reaches less far than hrls
  std::vector<uint32_t> skipped;
  for (uint32_t level = 1; level < levels; ++level) {
    skipped.push_back(joined + 1);
    result = (result + 1) / 2;                        // upsampled bilinearly
    joined = std::max((joined + 1) / 2, result + 1);  // join and up of the level above, or kernel
  }
  skipped.push_back(joined + 1);
  uint32_t x = (joined + 1) / 2 + 2, lrhs = 0;  // join, up, deep.i
  for (uint32_t level = levels - 1; level > 0; --level) {
    x = std::max(2 * x + 1, skipped[level]) + 1;  // down, and level or lrhs
    if (level == a.levels()) lrhs = x;
  }
  x = 2 * (x + 1) + 1;  // hrls
  x += 1;               // a firefly's neighbours
  if (compute_variance) x += 1;
  return std::max(x / a.scale, lrhs);
}

}  // namespace

// The layers that guide the last level come first.
void parse_pyramid(const Entries& entries, Architecture& a) {
  constexpr std::array<std::string_view, 3> kFirst{"color", "albedo", "normal"};
  if (std::ranges::mismatch(kFirst, a.hrls_layers).in1 != kFirst.end())
    entries.reject("hrls_layers", "color,albedo,normal first, as the network is a pyramid");
  a.widths = entries.integers("widths", kLevels, 1, kMostChannels);
  a.upscaled_features = entries.integer("upscaled_features", 1, kMostChannels);
  if (a.reads_lrhs()) a.lrhs_certainty = entries.number("lrhs_certainty", true);
}

void add_pyramid(Builder build, uint32_t height, uint32_t width, float phase) {
  const Architecture& a = build.a;
  const uint32_t grid = a.grid();
  Pyramid{.build = build,
          .height = divide_up(height, grid) * grid,
          .width = divide_up(width, grid) * grid,
          .phase = phase,
          .low_frame = FrameSize{height, width},
          .full_frame = FrameSize{a.scale * height, a.scale * width}}
      .add();
}

// Returns the largest reach of the LRHS pixels within one of the coarsest level, as whole ones.
uint32_t pyramid_halo(const Architecture& a, bool compute_variance) {
  uint32_t most = 0;
  for (uint32_t own = 0; own < a.grid(); ++own)
    most = std::max(most, pyramid_reach(a, own, compute_variance) - own);
  return divide_up(most, a.grid()) * a.grid();
}

}  // namespace raymeld
