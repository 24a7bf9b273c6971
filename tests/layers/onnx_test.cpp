// Runs ONNX's own test vectors, which nobody wrote for raymeld, through the layers and the scalar reference.
#include <fmt/ranges.h>

#include "conform/conv2d_trials.h"
#include "gpu.h"
#include "onnx_vectors.h"
#include "within_bounds.h"

namespace raymeld::test {
namespace {

using conform::Method;
using reference::Bounded;
using reference::Conv;
using reference::exact;
using reference::Planes;
using reference::Precision;

const std::map<std::string, OnnxVector>& all_vectors() {
  static const auto vectors =
      onnx_vectors({"Conv", "Relu", "Add", "Concat", "DepthToSpace", "SpaceToDepth", "PixelShuffle"});
  return vectors;
}

// Returns the feature that keeps a vector from being a layer of raymeld, or an empty string.
std::string missing_feature(const OnnxVector& vector) {
  const std::vector<int>& dims = vector.inputs[0].dims;
  if (!vector.output.is_float32) return "elements that are not float32";
  if (vector.op == "Add" && vector.inputs[1].dims != dims) return "broadcasting";
  if (vector.op != "Conv") return "";
  if (dims.size() != 4) return fmt::format("{}-D", dims.size() - 2);
  if (onnx_int(vector.node, "group", 1) != 1) return "groups";
  if (onnx_ints(vector.node, "dilations", {1, 1}) != std::vector{1, 1}) return "dilations";
  return std::ranges::max(std::span(vector.inputs[1].dims).last(2)) > 3 ? "kernels larger than 3" : "";
}

// Returns every kernel that the device can compute in 32 bits.
std::vector<Method> methods(int kernel) {
  std::vector<Method> result =
      conform::conv2d_methods(gpu().info(), uint32_t(kernel), conform::Extent::kQuick);
  std::erase_if(result, [](const Method& method) {
    return method.kernel.algorithm == Algorithm::kMatrix ||
           (method.kernel.needs_addresses() && !gpu().info().buffer_device_address);
  });
  return result;
}

// The first image of a batch is computed in every way, the others directly and in one more way, in turn.
std::vector<Method> methods_of_image(size_t image, int kernel) {
  const std::vector<Method> all = methods(kernel);
  return image == 0 || all.size() == 1 ? all : std::vector{all[0], all[1 + image % (all.size() - 1)]};
}

// Returns a convolution that copies channels. All kernels but Winograd give the same bits.
Conv identity(int channels, int kernel) {
  Conv conv{.out = channels, .in = channels, .kernel = kernel, .weight = {}, .bias = {}};
  conv.weight.resize(size_t(channels) * channels * kernel * kernel);
  conv.bias.resize(size_t(channels));
  const int taps = kernel * kernel;
  for (int c = 0; c < channels; ++c) conv.weight[size_t((c * channels + c) * taps + taps / 2)] = 1;
  return conv;
}

struct Operands {
  const Planes& x;
  const Conv& conv;
  bool relu = false;
  const Planes* residual = nullptr;
  const Planes* second_input = nullptr;
};

Planes run_conv2d(const Operands& operands, const Method& method) {
  const auto& [x, conv, relu, residual, second] = operands;
  conform::LayerRun run(target(), Precision::kFp32, method.addressed);
  const Tensor in = run.input("in", x), out = run.tensor("out", conv.out, x.h, x.w);
  Conv2dOptions options{.kernel = uint32_t(conv.kernel), .relu = relu, .how = method.kernel};
  if (residual) options.residuals = {run.input("residual", *residual)};
  if (second) options.second_input = run.input("second", *second);
  conv2d(run.graph(), "conv", in, out, run.weights(conv), options);
  run.run();
  return run.read(out);
}

testing::AssertionResult equal(const Planes& actual, const Planes& expected) {
  return same_bits(floats(actual), floats(expected));
}

// Shuffles by a 1x1 convolution that changes nothing else.
Planes shuffled(const Planes& x, const Planes& like, uint32_t unshuffle, uint32_t shuffle) {
  const int channels = x.c * int(unshuffle * unshuffle);
  Conv same{.out = channels, .in = channels, .kernel = 1, .weight = {}, .bias = {}};
  same.weight.resize(size_t(channels) * channels);
  same.bias.resize(size_t(channels));
  for (int c = 0; c < channels; ++c) same.weight[size_t(c) * channels + c] = 1;
  conform::LayerRun run(target(), Precision::kFp32);
  const Tensor out = run.tensor("out", like.c, like.h, like.w);
  conv2d(run.graph(), "shuffle", run.input("in", x), out, run.weights(same),
         {.kernel = 1, .unshuffle = unshuffle, .shuffle = shuffle});
  run.run();
  return run.read(out);
}

// A kernel of 3x2 is one of 3x3 whose last column is 0.
Conv square_conv(const OnnxVector& vector) {
  const OnnxArray& weights = vector.inputs[1];
  const auto [out, in, kh, kw] =
      std::tuple(weights.dims[0], weights.dims[1], weights.dims[2], weights.dims[3]);
  Conv conv{.out = out, .in = in, .kernel = std::max(kh, kw) == 1 ? 1 : 3, .weight = {}, .bias = {}};
  conv.weight.resize(size_t(out) * in * conv.kernel * conv.kernel);
  for (int plane = 0; plane < out * in; ++plane)
    for (int y = 0; y < kh; ++y)
      for (int x = 0; x < kw; ++x)
        conv.weight[size_t((plane * conv.kernel + y) * conv.kernel + x)] =
            weights.values[size_t((plane * kh + y) * kw + x)];
  conv.bias.resize(size_t(out));
  if (vector.inputs.size() > 2) std::ranges::copy(vector.inputs[2].values, conv.bias.begin());
  return conv;
}

// Says where ONNX's outputs lie among those of raymeld's convolution, which has stride 1, keeps the size and
// sums over the same inputs. Less padding gives its inner part, and strides give some of its outputs.
struct Places {
  int stride_y, stride_x, first_y, first_x;

  Planes pick(const Planes& all, const Planes& like) const {
    Planes result(like.c, like.h, like.w);
    for (int c = 0; c < like.c; ++c)
      for (int y = 0; y < like.h; ++y)
        for (int x = 0; x < like.w; ++x)
          result.at(c, y, x) = all.at(c, first_y + stride_y * y, first_x + stride_x * x);
    return result;
  }
};

Places places(const OnnxVector& vector, int kernel) {
  const std::vector<int> strides = onnx_ints(vector.node, "strides", {1, 1});
  std::vector<int> pads = onnx_ints(vector.node, "pads", {0, 0, 0, 0});
  const std::string automatic = onnx_text(vector.node, "auto_pad", "NOTSET");
  for (size_t i = 0; i < 2 && automatic.starts_with("SAME"); ++i) {
    const int size = vector.inputs[0].dims[i + 2], window = vector.inputs[1].dims[i + 2];
    const int both = std::max(0, ((size - 1) / strides[i]) * strides[i] + window - size);
    pads[i] = automatic == "SAME_LOWER" ? (both + 1) / 2 : both / 2;
  }
  const Places found{.stride_y = strides[0],
                     .stride_x = strides[1],
                     .first_y = kernel / 2 - pads[0],
                     .first_x = kernel / 2 - pads[1]};
  EXPECT_GE(std::min(found.first_y, found.first_x), 0) << "more padding than the kernel's half";
  const std::vector<int>&in = vector.inputs[0].dims, &out = vector.output.dims;
  EXPECT_LT(found.first_y + found.stride_y * (out[2] - 1), in[2]);
  EXPECT_LT(found.first_x + found.stride_x * (out[3] - 1), in[3]);
  return found;
}

// Bounds the difference of ONNX's value and raymeld's: each errs by its own bound against the exact sum.
Bounded published(const Planes& values, const Planes& own_bound, const Planes& our_bound) {
  Bounded result{values, own_bound};
  std::ranges::transform(own_bound.data, our_bound.data, result.bound.data.begin(), std::plus{});
  return result;
}

void check_conv(const OnnxVector& vector) {
  const Conv conv = square_conv(vector);
  const Places at = places(vector, conv.kernel);
  const std::vector<Planes> inputs = to_images(vector.inputs[0], 1), outputs = to_images(vector.output, 1);
  for (size_t i = 0; i < inputs.size(); ++i) {
    SCOPED_TRACE(fmt::format("image {}", i));
    std::map<reference::Tile, Bounded> sums;
    for (const Method& method : methods_of_image(i, conv.kernel)) {
      if (!sums.contains(method.tile()))
        sums[method.tile()] =
            reference::conv2d(exact(inputs[i]), conv, false, Precision::kFp32, {}, method.tile());
      const Planes direct_bound = at.pick(sums.at({}).bound, outputs[i]);
      if (method.kernel.algorithm == Algorithm::kDirect) {
        const Bounded onnx{outputs[i], direct_bound};
        EXPECT_TRUE(within_bounds("reference", at.pick(sums.at({}).value, outputs[i]), onnx));
      }
      const Bounded expected =
          published(outputs[i], direct_bound, at.pick(sums.at(method.tile()).bound, outputs[i]));
      const Planes device = at.pick(run_conv2d({inputs[i], conv}, method), outputs[i]);
      EXPECT_TRUE(within_bounds("conv2d " + method.name, device, expected));
    }
  }
}

// ReLU and the residual are the last steps of a convolution, here of one that copies its input.
void check_copied(const OnnxVector& vector) {
  const int axis = std::max(0, int(vector.output.dims.size()) - 3);
  const std::vector<Planes> x = to_images(vector.inputs[0], axis), expected = to_images(vector.output, axis);
  const bool relu = vector.op == "Relu";
  const std::vector<Planes> residuals = relu ? std::vector<Planes>{} : to_images(vector.inputs[1], axis);
  for (size_t i = 0; i < x.size(); ++i) {
    for (const int kernel : {1, 3}) {
      const Conv copy = identity(x[i].c, kernel);
      const Bounded residual = relu ? Bounded{} : exact(residuals[i]);
      std::vector<const Bounded*> bounded;
      if (!relu) bounded.push_back(&residual);
      const auto sum_of = [&](const reference::Tile& tile) {
        return reference::conv2d(exact(x[i]), copy, relu, Precision::kFp32, bounded, tile);
      };
      EXPECT_TRUE(equal(sum_of({}).value, expected[i])) << "the reference, rounded once";
      for (const Method& method : methods(kernel)) {
        SCOPED_TRACE(fmt::format("kernel {}, {}", kernel, method.name));
        const Planes device = run_conv2d(
            {.x = x[i], .conv = copy, .relu = relu, .residual = relu ? nullptr : &residuals[i]}, method);
        EXPECT_TRUE(method.tile().down > 1 || equal(device, expected[i]));
        EXPECT_TRUE(within_bounds(vector.op, device, {expected[i], sum_of(method.tile()).bound}));
      }
    }
  }
}

// Concatenates in two ways: one convolution reads a second input, and two convolutions write slices of one
// tensor.
void check_concat(const OnnxVector& vector) {
  const int rank = int(vector.output.dims.size()), said = onnx_int(vector.node, "axis", 1);
  const int axis = said < 0 ? said + rank : said;
  const std::vector<Planes> a = to_images(vector.inputs[0], axis), b = to_images(vector.inputs[1], axis),
                            expected = to_images(vector.output, axis);
  for (size_t i = 0; i < a.size(); ++i) {
    EXPECT_TRUE(equal(reference::concat(exact(a[i]), exact(b[i])).value, expected[i]));
    const Conv both = identity(expected[i].c, 1), first = identity(a[i].c, 1), second = identity(b[i].c, 1);
    for (const Method& method : methods(1)) {
      SCOPED_TRACE(fmt::format("image {}, {}", i, method.name));
      EXPECT_TRUE(equal(run_conv2d({.x = a[i], .conv = both, .second_input = &b[i]}, method), expected[i]));
      conform::LayerRun run(target(), Precision::kFp32, method.addressed);
      const Tensor in_a = run.input("a", a[i]), in_b = run.input("b", b[i]);
      const Tensor out = run.tensor("out", expected[i].c, a[i].h, a[i].w);
      const Conv2dOptions options{.kernel = 1, .how = method.kernel};
      conv2d(run.graph(), "first", in_a, out.slice(0, uint32_t(a[i].c)), run.weights(first), options);
      conv2d(run.graph(), "second", in_b, out.slice(uint32_t(a[i].c), uint32_t(b[i].c)), run.weights(second),
             options);
      run.run();
      EXPECT_TRUE(equal(run.read(out), expected[i]));
    }
  }
}

// Moves channel (r dy + dx) C + c of ONNX's order DCR to channel c r r + r dy + dx of raymeld's, which is
// ONNX's CRD.
Planes in_our_order(const Planes& dcr, int r) {
  Planes ours(dcr.c, dcr.h, dcr.w);
  const int channels = dcr.c / (r * r), plane = dcr.h * dcr.w;
  for (int c = 0; c < channels; ++c)
    for (int place = 0; place < r * r; ++place)
      std::copy_n(&dcr.data[dcr.index(place * channels + c, 0, 0)], plane,
                  &ours.data[ours.index(c * r * r + place, 0, 0)]);
  return ours;
}

void check_pixel_shuffle(const OnnxVector& vector) {
  std::vector<Planes> inputs = to_images(vector.inputs[0], 1);
  const std::vector<Planes> outputs = to_images(vector.output, 1);
  const bool is_dcr = vector.op == "DepthToSpace" && onnx_text(vector.node, "mode", "DCR") == "DCR";
  for (size_t i = 0; i < inputs.size(); ++i) {
    const int r = outputs[i].h / inputs[i].h;
    const Planes x = is_dcr ? in_our_order(inputs[i], r) : inputs[i];
    EXPECT_TRUE(equal(reference::pixel_shuffle(exact(x), r).value, outputs[i]));
    EXPECT_TRUE(equal(shuffled(x, outputs[i], 1, uint32_t(r)), outputs[i]));
  }
}

void check_space_to_depth(const OnnxVector& vector) {
  const std::vector<Planes> inputs = to_images(vector.inputs[0], 1), outputs = to_images(vector.output, 1);
  const int r = onnx_int(vector.node, "blocksize", 0);
  for (size_t i = 0; i < inputs.size(); ++i) {
    const Planes expected = in_our_order(outputs[i], r);
    EXPECT_TRUE(equal(reference::space_to_depth(exact(inputs[i]), r).value, expected));
    EXPECT_TRUE(equal(shuffled(inputs[i], expected, uint32_t(r), 1), expected));
  }
}

std::vector<std::string> layers_among_vectors() {
  std::vector<std::string> names;
  for (const auto& [name, vector] : all_vectors())
    if (missing_feature(vector).empty()) names.push_back(name);
  return names;
}

class OnnxTest : public GpuTest, public testing::WithParamInterface<std::string> {};

TEST_P(OnnxTest, GivesWhatIsPublished) {
  const OnnxVector& vector = all_vectors().at(GetParam());
  if (vector.op == "Conv") return check_conv(vector);
  if (vector.op == "Relu" || vector.op == "Add") return check_copied(vector);
  if (vector.op == "Concat") return check_concat(vector);
  if (vector.op == "SpaceToDepth") return check_space_to_depth(vector);
  check_pixel_shuffle(vector);
}

GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(OnnxTest);  // AreAllThere skips where there are none
INSTANTIATE_TEST_SUITE_P(Vectors, OnnxTest, testing::ValuesIn(layers_among_vectors()), [](const auto& info) {
  std::string name = info.param;
  std::ranges::replace_if(
      name, [](unsigned char c) { return !std::isalnum(c); }, '_');
  return name;
});

// The counts are those of version 1.12 of the package; a newer version may have more.
TEST(OnnxVectors, AreAllThere) {
  if (all_vectors().empty()) GTEST_SKIP() << "the package libonnx-testdata is not installed";
  std::map<std::string, int> layers;
  std::map<std::string, std::vector<std::string>> others;
  for (const auto& [name, vector] : all_vectors()) {
    const std::string missing = missing_feature(vector);
    ++layers[vector.op];
    if (missing.empty()) continue;
    --layers[vector.op];
    others[vector.op + " with " + missing].push_back(name);
  }
  for (const auto& [op, count] : layers) fmt::print("{}: {} vectors are layers of raymeld\n", op, count);
  for (const auto& [what, names] : others)
    fmt::print("{}: not a layer of raymeld: {} ({})\n", what, names.size(), fmt::join(names, ", "));
  const std::map<std::string, int> least = {{"Add", 1},          {"Concat", 13},      {"Conv", 11},
                                            {"DepthToSpace", 4}, {"PixelShuffle", 1}, {"Relu", 3},
                                            {"SpaceToDepth", 2}};
  for (const auto& [op, count] : least) EXPECT_GE(layers[op], count) << op;
}

}  // namespace
}  // namespace raymeld::test
