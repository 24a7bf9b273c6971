// Tests the worst that renders may hold and weights may do: nothing is silently wrong, and nothing spreads.
#include <gtest/gtest.h>

#include <cfloat>
#include <cmath>
#include <limits>

#include "error_of.h"
#include "fusion/fuser.h"
#include "fusion/tuner.h"
#include "networks/network.h"
#include "subject.h"
#include "within_bounds.h"

namespace raymeld::test {
namespace {

using reference::Architecture;
using reference::LayerKind;
using reference::Planes;
using reference::Precision;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

class ExtremesTest : public GpuTest {
 protected:
  Model model_of(const Subject& subject, const std::string& exposure_key = "0") {
    return saved_model(folder_.path(), subject, {{"exposure_key", exposure_key}});
  }

  TemporaryDirectory folder_;
};

struct Fused {
  Planes image;
  FuseReport report;
};

Fused fuse(Fuser& fuser, const Planes& lrhs, const Planes& hrls) {
  Image image;
  Fused fused;
  fused.report = fuser.fuse(image_of(lrhs), image_of(hrls), image);
  fused.image = planes_of(image);
  return fused;
}

Fuser make_fuser(const Model& model, const Planes& lrhs, const FuserOptions& options) {
  return Fuser(gpu(), model, uint32_t(lrhs.h), uint32_t(lrhs.w), options, shared_cache_folder());
}

Fused fuse_once(const Model& model, const Planes& lrhs, const Planes& hrls, const FuserOptions& options) {
  Fuser fuser = make_fuser(model, lrhs, options);
  return fuse(fuser, lrhs, hrls);
}

// Returns the tile that the kernels choose for a 3x3 convolution.
reference::Tile tile_of(const Kernels& kernels) {
  const Conv2dShape shape{.height = 8, .width = 8, .channels_in = 4, .channels_out = 4, .kernel = 3};
  return conform::Method{.name = {}, .kernel = kernels.conv2d(shape)}.tile();
}

// Returns every storage and choice of kernels that differs on this device.
std::vector<FuserOptions> all_options() {
  std::vector<FuserOptions> all;
  const Kernels defaults = default_kernels(gpu().info(), Storage::kFloat32);
  for (const Precision precision : kPrecisions) {
    all.push_back({.storage = storage_of(precision)});
    if (tile_of(defaults).down > 1) all.push_back({.storage = storage_of(precision), .kernels = defaults});
  }
  return all;
}

std::string text_of(const FuserOptions& options) {
  return fmt::format("{} {}", options.storage == Storage::kFloat16 ? "fp16" : "fp32",
                     tile_of(options.kernels).down > 1 ? "default kernels" : "direct");
}

// --- Values of renders

using Change = std::function<void(Planes& lrhs, Planes& hrls)>;

Change both(const std::function<double(double)>& value) {
  return [value](Planes& lrhs, Planes& hrls) {
    for (Planes* image : {&lrhs, &hrls})
      for (double& v : image->data) v = float(value(v));
  };
}

// The channels of HRLS are color, albedo and normal, three each.
const std::vector<std::pair<std::string, Change>>& input_classes() {
  static const std::vector<std::pair<std::string, Change>> classes = [] {
    std::vector<std::pair<std::string, Change>> all;
    for (const double value : {0.0, -0.0, 1e-40, double(FLT_TRUE_MIN), 1e-30, 65504.0, 65520.0, 1e8, 1e30,
                               double(FLT_MAX), -1.0, -1e30, kNaN, kInfinity, -kInfinity})
      all.emplace_back(fmt::format("all {:g}", value), both([value](double) { return value; }));
    for (const double factor : {1e-40, 1e-30, 65504.0, 1e8, 1e30})
      all.emplace_back(fmt::format("noise times {:g}", factor),
                       both([factor](double v) { return v * factor; }));
    all.emplace_back("checkerboard", [](Planes& lrhs, Planes& hrls) {
      for (Planes* image : {&lrhs, &hrls})
        for (size_t i = 0; i < image->data.size(); ++i)
          image->data[i] = (i + i / size_t(image->w)) % 2 ? 1e4 : 0;
    });
    all.emplace_back("blocks of NaN and infinity", [](Planes& lrhs, Planes& hrls) {
      for (Planes* image : {&lrhs, &hrls}) {
        for (int c = 0; c < image->c; ++c)
          for (int y = 0; y < image->h / 2; ++y)
            for (int x = 0; x < image->w / 2; ++x) image->at(c, y, x) = c % 3 ? kInfinity : kNaN;
      }
    });
    all.emplace_back("albedo and normals out of range", [](Planes&, Planes& hrls) {
      for (int c = 3; c < 9; ++c)
        for (int y = 0; y < hrls.h; ++y)
          for (int x = 0; x < hrls.w; ++x) hrls.at(c, y, x) *= 1e3;
    });
    all.emplace_back("black LRHS of a bright HRLS", [](Planes& lrhs, Planes& hrls) {
      for (double& v : lrhs.data) v = 0;
      for (double& v : hrls.data) v = float(std::abs(v) * 1e3);
    });
    return all;
  }();
  return classes;
}

// The output is not only finite, but as near to the exact one as rounding leaves it.
TEST_F(ExtremesTest, WhateverTheImagesHoldTheOutputKeepsTheBounds) {
  for (const Architecture& architecture :
       {unshuffled_architecture(2), small_architecture(2), pyramid_architecture(2)}) {
    const Subject subject = make_subject(architecture, 4, 5, 21);
    const Model model = model_of(subject);
    for (const FuserOptions& options : all_options()) {
      const Precision precision = options.storage == Storage::kFloat16 ? Precision::kFp16 : Precision::kFp32;
      const conform::Method direct = conform::direct_method(gpu().info());
      Fuser fuser = make_fuser(model, subject.lrhs, options);
      reference::Weights weights;
      for (const auto& [name, conv] : subject.weights) weights[name] = round_to(conv, precision);
      for (const auto& [name, change] : input_classes()) {
        SCOPED_TRACE(name + ", " + text_of(options));
        Planes lrhs = subject.lrhs, hrls = subject.hrls;
        change(lrhs, hrls);
        const Fused fused = fuse(fuser, lrhs, hrls);
        EXPECT_EQ(fused.report.status.not_finite, 0u);
        EXPECT_EQ(fused.report.status.saturated, 0u);
        const auto expected = reference::network(architecture, weights, lrhs, hrls, 0, precision, {}, 1,
                                                 tile_of(options.kernels), direct.units(precision));
        EXPECT_TRUE(within_bounds(text_of(options), fused.image, expected.at("output")));
      }
    }
  }
}

// A model with an exposure key sees the same picture at any brightness. Powers of two do not round.
TEST_F(ExtremesTest, AnyBrightnessGivesTheSamePicture) {
  for (const Architecture& architecture : {unshuffled_architecture(4), pyramid_architecture(4)}) {
    const Subject subject = make_subject(architecture, 6, 5, 22);
    const Model model = model_of(subject, "0.18");
    Planes lrhs = subject.lrhs, hrls = subject.hrls;
    for (Planes* image : {&lrhs, &hrls})
      for (double& v : image->data) v = float(std::abs(v));
    for (const FuserOptions& options : all_options()) {
      Fuser fuser = make_fuser(model, lrhs, options);
      const Planes expected = fuse(fuser, lrhs, hrls).image;
      for (int stops = -20; stops <= 12; stops += 4) {
        SCOPED_TRACE(fmt::format("2^{}, {}", stops, text_of(options)));
        Planes low = lrhs, high = hrls;
        for (double& v : low.data) v = std::ldexp(v, stops);
        for (int c = 0; c < 3; ++c)
          for (int y = 0; y < high.h; ++y)
            for (int x = 0; x < high.w; ++x) high.at(c, y, x) = std::ldexp(high.at(c, y, x), stops);
        const Planes fused = fuse(fuser, low, high).image;
        size_t different = 0;
        for (size_t i = 0; i < fused.data.size(); ++i)
          different += fused.data[i] != std::min(std::ldexp(expected.data[i], stops), 65504.0);
        EXPECT_EQ(different, 0u);
      }
    }
  }
}

// --- A scene for the stock models: two walls of different albedo under smooth light, a floor below.

struct Scene {
  Planes lrhs, hrls, truth;
};

// Returns a scene with all six layers of the stock models. HRLS has the noise of few samples.
Scene make_scene(int scale, int height, int width, double brightness) {
  Planes full(18, height * scale, width * scale);
  const Planes noise = random_planes(1, full.h, full.w, Fill::kUniform, 31);
  Scene scene{Planes(3, height, width), full, Planes(3, full.h, full.w)};
  for (int y = 0; y < full.h; ++y) {
    for (int x = 0; x < full.w; ++x) {
      const bool floor = 3 * y > 2 * full.h;
      const double light = brightness * (0.6 + 0.4 * std::sin(0.05 * x) * std::cos(0.04 * y));
      const double noisy = light * (1 + 0.8 * noise.at(0, y, x));
      for (int c = 0; c < 3; ++c) {
        const double albedo = floor ? 0.25 + 0.1 * c : 2 * x < full.w ? 0.7 - 0.2 * c : 0.5;
        scene.truth.at(c, y, x) = float(albedo * light);
        scene.hrls.at(c, y, x) = scene.hrls.at(9 + c, y, x) = float(albedo * noisy);
        scene.hrls.at(3 + c, y, x) = float(albedo);
        scene.hrls.at(6 + c, y, x) = c == (floor ? 1 : 2) ? 1 : 0;
        scene.hrls.at(15 + c, y, x) = float(0.1 * light * light);
        if (y % scale == 0 && x % scale == 0) scene.lrhs.at(c, y / scale, x / scale) = float(albedo * light);
      }
    }
  }
  return scene;
}

Model stock_model(const std::string& name) { return Model(source_path("models/" + name + ".safetensors")); }

// Returns the difference in steps of an 8-bit sRGB display whose white is `white`.
double display_difference(double a, double b, double white) {
  const auto shown = [white](double v) {
    const double x = std::clamp(v / white, 0.0, 1.0);
    return 255 * (x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1 / 2.4) - 0.055);
  };
  return std::abs(shown(a) - shown(b));
}

struct Difference {
  double largest = 0;  // the largest difference in steps of the display
  double darkest = 1;  // the least ratio of bad to clean
  size_t too_far = 0;  // the number of values that differ although they do not depend on the pixel
  size_t values = 0;   // the number of values that do not depend on the pixel
};

// Tells which pixels of the output depend on the input at a coordinate, in one direction.
using DependsOn = std::function<bool(int output, int input)>;

// A network of direct kernels reaches as far as its taps. Each 3x3 or 5x5 of Winograd reaches a tile instead
// of a pixel, at its own resolution: a value changes how all of its tile is rounded.
DependsOn within_reach(const Model& model, int lrhs_width, int tile) {
  const int scale = int(model.architecture().scale);
  int reach = scale * (int(receptive_halo(model.architecture())) + 1);
  for (const Conv2dShape& shape : conv2d_shapes(model, 1, uint32_t(lrhs_width)))
    if (shape.kernel > 1 && tile > 1) reach += (tile - 1) * scale * lrhs_width / int(shape.width);
  return [reach](int output, int input) { return std::abs(output - input) <= reach; };
}

Difference compare(const Planes& bad, const Planes& clean, int y, int x, const DependsOn& depends,
                   double white) {
  Difference result;
  for (int c = 0; c < 3; ++c) {
    for (int v = 0; v < clean.h; ++v) {
      for (int u = 0; u < clean.w; ++u) {
        const double a = bad.at(c, v, u), b = clean.at(c, v, u);
        const bool outside = !depends(v, y) || !depends(u, x);
        result.values += outside;
        result.too_far += outside && a != b;
        result.largest = std::max(result.largest, display_difference(a, b, white));
        result.darkest = std::min(result.darkest, a / b);
      }
    }
  }
  return result;
}

// A bad pixel of HRLS changes only its surroundings: values that count as 0 are not seen, fireflies are
// dimmed to less than 14 steps of 255 (x4-fast: 13.1), and neither leaves a black hole.
TEST_F(ExtremesTest, ABadPixelOfHrlsIsDimmedAndStaysWhereItIs) {
  const Model model = stock_model("x4-fast");
  size_t combinations = 0;
  for (const double brightness : {1.0, 1e-3}) {
    const Scene scene = make_scene(4, 24, 40, brightness);
    for (const FuserOptions& options : all_options()) {
      if (!is_tried(combinations++, 7)) continue;
      Fuser fuser = make_fuser(model, scene.lrhs, options);
      const Planes clean = fuse(fuser, scene.lrhs, scene.hrls).image;
      const DependsOn depends = within_reach(model, scene.lrhs.w, tile_of(options.kernels).down);
      for (const double value : {1e4, 1e8, 1e30, double(FLT_MAX), kInfinity, -kInfinity, kNaN, -1e8, 0.0}) {
        SCOPED_TRACE(fmt::format("{:g} at brightness {}, {}", value, brightness, text_of(options)));
        Planes hrls = scene.hrls;
        for (int c = 0; c < 3; ++c) hrls.at(c, 30, 50) = hrls.at(9 + c, 30, 50) = value;
        const Planes fused = fuse(fuser, scene.lrhs, hrls).image;
        const Difference difference = compare(fused, clean, 30, 50, depends, brightness);
        EXPECT_EQ(difference.too_far, 0u);
        EXPECT_LT(difference.largest, value > 0 ? 14 : 1);
        EXPECT_GT(difference.darkest, 0.85);
      }
    }
  }
}

// Pixels that do not depend on a bad pixel have the bits of a clean render, with Winograd's tiles too.
TEST_F(ExtremesTest, ABadPixelReachesAsFarAsItsKernelsSay) {
  const Subject subject = make_subject(unshuffled_architecture(2), 10, 96, 28);
  const Model model = model_of(subject);
  for (const FuserOptions& options : all_options()) {
    Fuser fuser = make_fuser(model, subject.lrhs, options);
    const Planes clean = fuse(fuser, subject.lrhs, subject.hrls).image;
    const DependsOn depends = within_reach(model, subject.lrhs.w, tile_of(options.kernels).down);
    for (const double value : {1e8, kInfinity, kNaN}) {
      SCOPED_TRACE(fmt::format("{:g}, {}", value, text_of(options)));
      Planes hrls = subject.hrls;
      for (int c = 0; c < hrls.c; ++c) hrls.at(c, 9, 8) = value;
      const Planes fused = fuse(fuser, subject.lrhs, hrls).image;
      const Difference difference = compare(fused, clean, 9, 8, depends, 1);
      EXPECT_EQ(difference.too_far, 0u);
      EXPECT_GT(difference.values, clean.data.size() / 4);
      EXPECT_NE(fused.data, clean.data);
    }
  }
}

// --- Radiance above the clip

double sum_of(const Planes& image, int c) {
  double sum = 0;
  for (int y = 0; y < image.h; ++y)
    for (int x = 0; x < image.w; ++x) sum += image.at(c, y, x);
  return sum;
}

// The stock models see radiance up to 100 times the exposure. A lamp of 10,000 still keeps its light, and the
// picture has the edges of HRLS.
TEST_F(ExtremesTest, ALampBeyondTheClipKeepsItsLight) {
  const std::array lamp{1e4, 6e3, 3e3};
  size_t combinations = 0;
  for (const bool centered : {false, true}) {
    Scene scene = make_scene(4, 40, 40, 0.5);
    const int first = 36, last = 36 + 12;
    for (int c = 0; c < 3; ++c) {
      for (int y = first; y < last; ++y) {
        for (int x = first; x < last; ++x) {
          scene.hrls.at(c, y, x) = scene.truth.at(c, y, x) = lamp[size_t(c)];
          scene.hrls.at(15 + c, y, x) = 0;
          scene.lrhs.at(c, y / 4, x / 4) = lamp[size_t(c)];
        }
      }
    }
    const Model model = stock_model("x4-fast");
    for (FuserOptions options : all_options()) {
      if (!is_tried(combinations++, 3)) continue;
      SCOPED_TRACE(text_of(options) + (centered ? ", centered" : ", nearest"));
      options.phase = lrhs_phase(centered, 4);
      const Planes fused = fuse_once(model, scene.lrhs, scene.hrls, options).image;
      for (int c = 0; c < 3; ++c) {
        EXPECT_NEAR(sum_of(fused, c), sum_of(scene.truth, c), 0.06 * sum_of(scene.truth, c));
        EXPECT_NEAR(fused.at(c, 44, 44), lamp[size_t(c)], 0.07 * lamp[size_t(c)]);
        // The lamp's light ends within three pixels of its edges.
        EXPECT_LT(fused.at(c, 44, last + 3), 2);
        EXPECT_LT(fused.at(c, first - 4, 44), 2);
      }
    }
  }
}

// --- Winograd beside fireflies

// Winograd F(4, 3) may spread a firefly over its tile by less than a quarter of a step of a display.
TEST_F(ExtremesTest, FirefliesDoNotSpreadThroughWinograd) {
  if (tile_of(default_kernels(gpu().info(), Storage::kFloat32)).down == 1)
    GTEST_SKIP() << "no Winograd by default here";
  const double brightness = 1e-2;
  Scene scene = make_scene(4, 24, 24, brightness);
  const Planes at = random_planes(2, 1, 40, Fill::kUniform, 32);
  for (int i = 0; i < 40; ++i) {
    const int y = int((at.at(0, 0, i) + 1) / 2 * 95), x = int((at.at(1, 0, i) + 1) / 2 * 95);
    for (int c = 0; c < 3; ++c) scene.hrls.at(c, y, x) = scene.hrls.at(9 + c, y, x) = 1e8;
  }
  for (const char* name : {"x4-fast", "x4-balanced"}) {
    const Model model = stock_model(name);
    const Planes direct = fuse_once(model, scene.lrhs, scene.hrls, {}).image;
    const Planes fast = fuse_once(model, scene.lrhs, scene.hrls,
                                  {.kernels = default_kernels(gpu().info(), Storage::kFloat32)})
                            .image;
    double largest = 0;
    for (size_t i = 0; i < fast.data.size(); ++i)
      largest = std::max(largest, display_difference(fast.data[i], direct.data[i], brightness));
    RecordProperty(fmt::format("largest_difference_{}", name), fmt::format("{:.3g}", largest));
    EXPECT_LT(largest, 0.25) << name;
  }
}

// --- Weights

// Returns a network with the weights of He et al. 2015 times `gain`, which let the paper's residual sums grow
// by half in each block.
Subject he_scaled(int blocks, double gain) {
  Architecture a = small_architecture(2);
  a.features = a.growth = 8;
  a.dense_layers = 4;
  a.blocks = blocks;
  a.groups = 3;
  a.has_base = false;
  Subject subject = make_subject(a, 8, 8, 23);
  for (auto& [name, conv] : subject.weights) {
    for (double& w : conv.weight) w = float(w * gain * std::sqrt(2));
    for (double& b : conv.bias) b = 0;
  }
  for (Planes* image : {&subject.lrhs, &subject.hrls})
    for (double& v : image->data) v = float(std::abs(v));
  return subject;
}

// Returns the largest magnitude in all layers of the last frame.
double largest_activation(Fuser& fuser) {
  double largest = 0;
  for (const Pass* layer : fuser.graph().layers()) {
    if (!layer->output()) continue;
    for (const float v : fuser.program().read(*layer->output()))
      largest = std::max(largest, std::abs(double(v)));
  }
  return largest;
}

double relative_difference(const Planes& a, const Planes& b) {
  double squares = 0, total = 0;
  for (size_t i = 0; i < a.data.size(); ++i) {
    squares += (a.data[i] - b.data[i]) * (a.data[i] - b.data[i]);
    total += b.data[i] * b.data[i];
  }
  return std::sqrt(squares / total);
}

// Activations of 1e5, and fireflies' of many times that, are stored in 16 bits over a power of two.
TEST_F(ExtremesTest, ActivationsBeyondHalfAreScaled) {
  Subject subject = he_scaled(5, 1.1);
  // The last layer scales them down, so that the output's own limit plays no part.
  for (double& w : subject.weights.at("rec").weight) w = float(w * 0x1p-10);
  const Model model = model_of(subject);
  for (const double firefly : {0.0, 1e8}) {
    Planes hrls = subject.hrls;
    if (firefly > 0)
      for (int i = 0; i < 6; ++i) hrls.at(0, 2 * i + 1, 15 - 2 * i) = firefly;
    Fuser single = make_fuser(model, subject.lrhs, {.keep_activations = true});
    const Fused expected = fuse(single, subject.lrhs, hrls);
    EXPECT_GT(largest_activation(single), 65504);
    for (const FuserOptions& options : all_options()) {
      if (options.storage != Storage::kFloat16) continue;
      const Fused fused = fuse_once(model, subject.lrhs, hrls, options);
      EXPECT_EQ(fused.report.status.saturated, 0u);
      EXPECT_LT(relative_difference(fused.image, expected.image), 4e-3) << text_of(options);
    }
  }
}

// The estimate bounds how large activations become, whatever the number of layers.
TEST_F(ExtremesTest, EstimatesHoldAndAreNotFarOff) {
  for (const int blocks : {1, 3, 5}) {
    const Subject subject = he_scaled(blocks, 1.0);
    const Model model = model_of(subject);
    Fuser fuser = make_fuser(model, subject.lrhs, {.keep_activations = true});
    Planes bright = subject.hrls, low = subject.lrhs;
    for (double& v : bright.data) v *= 100;  // 100 is the clip
    for (double& v : low.data) v *= 100;
    fuse(fuser, low, bright);
    const ActivationEstimate estimate = estimate_activations(model);
    size_t compared = 0;
    for (const Pass* layer : fuser.graph().layers()) {
      const Tensor* output = layer->output();
      const double expected = output ? estimate.largest(fuser.graph().tensors()[output->id].name) : 0;
      if (expected == 0) continue;
      ++compared;
      double largest = 0;
      for (const float v : fuser.program().read(*output)) largest = std::max(largest, std::abs(double(v)));
      EXPECT_LT(largest, expected) << layer->name;
      EXPECT_GT(largest, expected / 100) << layer->name;
    }
    EXPECT_GT(compared, 3u * 5u * size_t(blocks));  // more than all layers of the trunk
  }
}

TEST_F(ExtremesTest, LayersOfNothingButZerosNeedNoScaling) {
  Subject subject = make_subject(small_architecture(2), 3, 4, 27);
  std::ranges::fill(subject.weights.at("fuse").weight, 0.0);
  std::ranges::fill(subject.weights.at("fuse").bias, 0.0);
  EXPECT_EQ(storage_exponents(model_of(subject)).at("fuse"), 0);
}

// A group of RCAN is scaled, and its logits are not.
TEST_F(ExtremesTest, AttentionFollowsTheExponentsOfStorage) {
  Subject subject = make_subject(rcan_architecture(2), 9, 11, 24);
  for (double& w : subject.weights.at("groups.0.blocks.0.1").weight) w = float(w * 3e4);
  for (double& w : subject.weights.at("groups.0.blocks.0.squeeze").weight) w = float(w * 1e-5);
  for (double& w : subject.weights.at("groups.0.last").weight) w = float(w * 1e-5);
  const Model model = model_of(subject);
  const StorageExponents exponents = storage_exponents(model);
  const int scaled = exponents.at("groups.0.blocks.0.1");
  EXPECT_GT(scaled, 0);
  for (const char* tensor : {"groups.0.blocks.0.means", "groups.0.blocks.0.attend"})
    EXPECT_EQ(exponents.at(tensor), scaled) << tensor;
  EXPECT_FALSE(exponents.contains("groups.0.blocks.0.excite"));
  Image narrow, wide;
  for (const auto& [storage, fused] : {std::pair(Storage::kFloat16, &narrow), {Storage::kFloat32, &wide}}) {
    Fuser fuser(gpu(), model, 9, 11, {.storage = storage}, shared_cache_folder());
    EXPECT_EQ(fuser.fuse(image_of(subject.lrhs), image_of(subject.hrls), *fused).status.saturated, 0u);
  }
  const float most = *std::ranges::max_element(wide.data);
  for (size_t i = 0; i < wide.data.size(); ++i) ASSERT_NEAR(narrow.data[i], wide.data[i], most * 0x1p-6) << i;
}

TEST_F(ExtremesTest, TheStockModelsNeedNoScaling) {
  for (const auto& entry : std::filesystem::directory_iterator(source_path("models"))) {
    if (entry.path().extension() != ".safetensors") continue;
    for (const auto& [tensor, exponent] : storage_exponents(Model(entry.path())))
      EXPECT_EQ(exponent, 0) << tensor;
  }
}

// Some tiles of the frame overflow. They have the bits of fp32, and the other tiles have those of fp16.
TEST_F(ExtremesTest, OnlyTilesThatOverflowAreDoneAgain) {
  Subject subject = make_subject(small_architecture(2), 20, 96, 24);
  // The left is bright and has an enormous residual.
  for (Planes* image : {&subject.lrhs, &subject.hrls}) {
    for (int c = 0; c < image->c; ++c)
      for (int y = 0; y < image->h; ++y)
        for (int x = 0; x < image->w; ++x)
          image->at(c, y, x) =
              c > 2 ? 0 : float(std::abs(image->at(c, y, x)) * (12 * x < image->w ? 1 : 1e-4));
  }
  for (auto& [name, conv] : subject.weights) std::ranges::fill(conv.bias, 0.0);
  for (double& w : subject.weights.at("rec").weight) w = float(std::abs(w) * 3e4);
  const Model model = model_of(subject);
  FuserOptions half{.storage = Storage::kFloat16, .exposure = 16}, redo = half;
  redo.fp32_kernels = Kernels{};
  const FusePlan whole = plan_fusion(model, 20, 96, gpu().info(), redo);
  redo.max_memory_bytes =
      2 * (whole.graph.constant_bytes() + (whole.graph.activation_bytes() + whole.frame_bytes) / 2);
  half.max_memory_bytes = redo.max_memory_bytes / 2;
  Fuser fuser = make_fuser(model, subject.lrhs, redo);
  const Fused fused = fuse(fuser, subject.lrhs, subject.hrls);
  const uint32_t tiles = fuser.plan().tiling.count();
  EXPECT_GT(fused.report.redone_tiles, 0u);
  EXPECT_LT(fused.report.redone_tiles, tiles);
  EXPECT_EQ(fused.report.status.saturated, 0u);
  EXPECT_LE(fuser.allocated_bytes(), redo.max_memory_bytes);

  const Fused saturated = fuse_once(model, subject.lrhs, subject.hrls, half);
  const Planes single = fuse_once(model, subject.lrhs, subject.hrls, {.exposure = 16}).image;
  EXPECT_GT(saturated.report.status.saturated, 0u);
  uint32_t redone = 0;
  for (uint32_t i = 0; i < tiles; ++i) {
    const Tile at = fuser.plan().tiling.at(i);
    size_t off_single = 0, off_half = 0;
    for (int c = 0; c < 3; ++c) {
      for (uint32_t y = 2 * at.core_y; y < 2 * (at.core_y + at.core.height); ++y) {
        for (uint32_t x = 2 * at.core_x; x < 2 * (at.core_x + at.core.width); ++x) {
          off_single += fused.image.at(c, int(y), int(x)) != single.at(c, int(y), int(x));
          off_half += fused.image.at(c, int(y), int(x)) != saturated.image.at(c, int(y), int(x));
        }
      }
    }
    EXPECT_TRUE(off_single == 0 || off_half == 0) << "tile " << i;
    redone += off_single == 0 && off_half > 0;
  }
  EXPECT_GT(redone, 0u);
  EXPECT_LE(redone, fused.report.redone_tiles);
  EXPECT_EQ(fuse(fuser, subject.lrhs, subject.hrls).image.data, fused.image.data);
}

TEST_F(ExtremesTest, WeightsBeyondHalfTakeFp32) {
  Subject subject = make_subject(small_architecture(2), 3, 4, 25);
  subject.weights.at("fuse").weight[3] = 65520;
  DeviceInfo device = gpu().info();
  device.is_cpu = false;
  device.storage_16bit = true;
  EXPECT_EQ(storage_for(raymeld::Precision::kAuto, device, model_of(subject)), Storage::kFloat32);
  subject.weights.at("fuse").weight[3] = 1;
  subject.weights.at("fuse").bias[0] = 7e4;  // biases have 32 bits
  EXPECT_EQ(storage_for(raymeld::Precision::kAuto, device, model_of(subject)), Storage::kFloat16);
  EXPECT_EQ(storage_for(raymeld::Precision::kAuto, device, model_of(he_scaled(5, 2.0))), Storage::kFloat32);
}

// Sums below -FLT_MAX are reported, though a ReLU would make them 0.
TEST_F(ExtremesTest, OverflowBelowZeroIsNotHiddenByReLU) {
  for (const char* layer : {"hrls", "fuse", "up.0"}) {
    Subject subject = make_subject(small_architecture(2), 3, 4, 26);
    for (double& v : subject.lrhs.data) v = 100;
    for (double& v : subject.hrls.data) v = 100;
    for (const char* before : {"hrls", "lrhs", "fuse"})
      for (double& w : subject.weights.at(before).weight) w = std::abs(w);
    for (double& w : subject.weights.at(layer).weight) w = -3e38;
    const Model model = model_of(subject);
    for (const Kernels& kernels : {Kernels{}, default_kernels(gpu().info(), Storage::kFloat32)}) {
      EXPECT_ERROR(fuse_once(model, subject.lrhs, subject.hrls, {.kernels = kernels}), "not finite");
    }
  }
}

}  // namespace
}  // namespace raymeld::test
