#include "reference/samples.h"

#include <fmt/format.h>

#include <bit>
#include <cfloat>
#include <cmath>
#include <limits>
#include <random>

namespace raymeld::reference {
namespace {

// The standard distributions differ between libraries; the engine does not.
double uniform(std::mt19937_64& random) { return double(random() >> 11) * 0x1p-53; }

float draw(std::mt19937_64& random, Fill fill) {
  const double u = uniform(random);
  if (fill == Fill::kIntegers) return float(std::floor(u * 5) - 2);
  if (fill == Fill::kSigns) return float(std::floor(u * 3) - 1);
  if (fill == Fill::kSpecials && uniform(random) < 0.5)
    return special_values()[size_t(u * special_values().size())];
  return float(2 * u - 1);
}

}  // namespace

const std::vector<float>& special_values() {
  constexpr float kInf = std::numeric_limits<float>::infinity(),
                  kNaN = std::numeric_limits<float>::quiet_NaN();
  static const std::vector<float> values = {
      0.0f,        -0.0f,    FLT_TRUE_MIN, -1e-40f,  FLT_MIN, 0x1p-25f, 0x1p-24f,
      -0x1.8p-15f, 65504.0f, -65504.0f,    65519.0f, 65520.f, 6e4f,     1e8f,
      -1e8f,       1e30f,    FLT_MAX,      -FLT_MAX, kInf,    -kInf,    kNaN};
  return values;
}

Planes random_planes(int c, int h, int w, Fill fill, uint64_t seed) {
  std::mt19937_64 random(seed);
  Planes result(c, h, w);
  for (double& v : result.data) v = draw(random, fill);
  return result;
}

Conv random_conv(int out, int in, int kernel, Fill fill, uint64_t seed) {
  std::mt19937_64 random(seed);
  const size_t fan_in = size_t(in) * kernel * kernel;
  const double scale = fill == Fill::kUniform ? std::sqrt(3.0 / double(fan_in)) : 1;
  Conv conv{out, in, kernel, std::vector<double>(out * fan_in), std::vector<double>(out)};
  for (double& v : conv.weight) v = float(scale * draw(random, fill));
  for (double& v : conv.bias) v = draw(random, fill);
  return conv;
}

Conv round_to(Conv conv, Precision precision) {
  for (double& v : conv.weight) v = round_to(v, precision);
  for (double& v : conv.bias) v = float(v);
  for (double& v : conv.centered_bias) v = float(v);
  return conv;
}

// Calls make(name, out, in, kernel) for the convolutions of a pyramid network.
template <typename Make>
void make_pyramid(const Architecture& a, const Make& make) {
  const auto name_of = [](const char* kind, int level) { return fmt::format("{}.{}", kind, level); };
  const int levels = int(a.widths.size()), inputs = 3 + 3 * int(a.hrls_layers.size());
  const auto width = [&](int level) { return level > 0 ? a.widths[size_t(level) - 1] : a.upscaled_features; };
  make("hrls", width(1), 4 * inputs, 3);
  for (int level = 1; level < levels; ++level) {
    const bool joins = 1 << level == a.scale;
    make(joins ? "lrhs" : name_of("level", level), width(level), width(level) + (joins ? 6 : 0), 3);
    make(name_of("down", level + 1), width(level + 1), 4 * width(level), 1);
    make(name_of("kernel", level), level + 1 < levels ? 28 : 27, width(level), 3);
  }
  for (const char* name : {"deep.0", "deep.1"}) make(name, width(levels), width(levels), 3);
  for (int level = 0; level < levels; ++level) {
    make(name_of("up", level), 4 * width(level), width(level + 1), 1);
    make(name_of("join", level), width(level), width(level) + (level > 0 ? width(level) : 12), 3);
  }
  make("rec", 43, width(0), 3);
}

Weights random_weights(const Architecture& a, Precision precision, uint64_t seed) {
  Weights weights;
  const auto make = [&](const std::string& name, int out, int in, int kernel) {
    weights[name] = round_to(random_conv(out, in, kernel, Fill::kUniform, seed + weights.size()), precision);
  };
  const auto add_centered_bias = [&](int features) {
    if (!a.both_samplings) return;
    weights.at("lrhs").centered_bias = random_conv(features, 1, 1, Fill::kUniform, seed + 1000).bias;
  };
  if (a.is_pyramid()) {
    make_pyramid(a, make);
    if (a.scale > 1) add_centered_bias(a.widths[size_t(std::countr_zero(unsigned(a.scale))) - 1]);
    return weights;
  }
  if (a.is_kpcn()) {
    for (const char* branch : {"diffuse", "rest"}) {
      int last = 3 * (3 * int(a.hrls_layers.size()) + 6);  // with the light, the rest and the gradients
      for (int i = 0; i + 1 < a.depth; ++i) {
        make(fmt::format("{}.{}", branch, i), a.features, last, 5);
        last = a.features;
      }
      make(fmt::format("kernel.{}", branch), a.kernel_side * a.kernel_side, last, 5);
    }
    return weights;
  }
  const int features = a.features, steps = std::countr_zero(unsigned(a.scale));
  if (a.upscaler != Upscaler::kNone) {
    const auto make_block = [&](const std::string& name) {
      for (const char* part : {".0", ".1"}) make(name + part, features, features, 3);
      if (a.upscaler == Upscaler::kEdsr) return;
      make(name + ".squeeze", a.squeezed_features, features, 1);
      make(name + ".excite", features, a.squeezed_features, 1);
    };
    make("head", features, 3, 3);
    if (a.upscaler == Upscaler::kEdsr)
      for (int block = 0; block < a.blocks; ++block) make_block(fmt::format("blocks.{}", block));
    for (int g = 0; g < a.groups; ++g) {
      for (int b = 0; b < a.blocks; ++b) make_block(fmt::format("groups.{}.blocks.{}", g, b));
      make(fmt::format("groups.{}.last", g), features, features, 3);
    }
    make("body", features, features, 3);
    for (int i = 0; i < steps; ++i) make(fmt::format("up.{}", i), 4 * features, features, 3);
    make("rec", 3, features, 3);
    return weights;
  }
  const int hrls = 3 * int(a.hrls_layers.size());
  make("lrhs", features, 3, 3);
  add_centered_bias(features);
  make("hrls", features, a.hrls_unshuffled ? a.scale * a.scale * hrls : hrls, a.hrls_kernel);
  for (int i = 0; i < (a.hrls_unshuffled ? 0 : steps); ++i)
    make(fmt::format("down.{}", i), features, 4 * features, 3);
  make("fuse", features, 2 * features, 1);
  for (int g = 0; g < a.groups; ++g) {
    for (int b = 0; b < a.blocks; ++b) {
      const std::string block = fmt::format("groups.{}.blocks.{}", g, b);
      for (int d = 0; d < a.dense_layers; ++d) {
        make(fmt::format("{}.dense.{}", block, d), a.growth, features + d * a.growth, 3);
      }
      make(block + ".merge", features, features + a.dense_layers * a.growth, 1);
    }
  }
  if (a.upscale == Upscale::kDirect) make("up.0", a.scale * a.scale * a.upscaled(), features, 3);
  for (int i = 0; i < (a.upscale == Upscale::kStages ? steps : 0); ++i)
    make(fmt::format("up.{}", i), 4 * features, features, 3);
  int last = a.upscaled() + (a.hrls_guide ? hrls : 0);
  for (int i = 0; i < a.head_layers; ++i) {
    make(fmt::format("head.{}", i), a.head_features, last, 3);
    last = a.head_features;
  }
  make("rec", 3, last, 3);
  return weights;
}

const std::vector<Size>& awkward_sizes() {
  static const std::vector<Size> sizes = {{1, 1},  {1, 2},  {1, 19}, {23, 1},  {2, 3},   {7, 8},
                                          {8, 8},  {9, 7},  {15, 9}, {16, 16}, {17, 15}, {13, 33},
                                          {31, 6}, {5, 64}, {3, 65}, {40, 24}};
  return sizes;
}

std::vector<float> floats(const Planes& planes) { return {planes.data.begin(), planes.data.end()}; }

Planes planes(int c, int h, int w, std::span<const float> values) {
  return {c, h, w, {values.begin(), values.end()}};
}

}  // namespace raymeld::reference
