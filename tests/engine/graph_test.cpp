#include "engine/graph.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>

#include "conform/model_file.h"
#include "error_of.h"
#include "gpu.h"
#include "layers/shaders.h"
#include "networks/network.h"
#include "subject.h"

namespace raymeld::test {
namespace {

using reference::Planes;

Pass pass(const std::string& name, std::vector<Tensor> reads, std::vector<Tensor> writes) {
  Pass result;
  result.name = name;
  for (const Tensor& t : reads) result.bindings.push_back(read_binding(t));
  for (const Tensor& t : writes) result.bindings.push_back(write_binding(t));
  return result;
}

constexpr Shape kShape{4, 4, 2};

struct Hand {
  explicit Hand(bool keep = true) : graph(Storage::kFloat32, false, keep) {}

  Graph graph;
  Tensor a = graph.input("a", kShape), b = graph.input("b", kShape);

  Tensor add(const std::string& name, std::vector<Tensor> reads) {
    const Tensor out = graph.tensor(name, kShape);
    graph.add(pass(name, std::move(reads), {out}));
    return out;
  }
  std::vector<bool> barriers() {
    graph.plan();
    std::vector<bool> result;
    for (size_t i = 0; i < graph.passes().size(); ++i) result.push_back(graph.barrier_before(i));
    EXPECT_EQ(graph.barrier_count(), size_t(std::count(result.begin(), result.end(), true)));
    return result;
  }
};

using Barriers = std::vector<bool>;

TEST(Barriers, IndependentPassesNeedNone) {
  Hand hand;
  hand.add("c", {hand.a});
  hand.add("d", {hand.b});
  hand.add("e", {hand.a, hand.b});
  EXPECT_EQ(hand.barriers(), (Barriers{false, false, false}));
}

TEST(Barriers, TheExposureIsReadBehindWhatWritesIt) {
  Hand hand;
  const auto add = [&](const std::string& name, const Tensor& in, Access access) {
    Pass with = pass(name, {in}, {hand.graph.tensor(name, kShape)});
    with.bindings.push_back(exposure_binding(access));
    hand.graph.add(with);
  };
  add("c", hand.a, Access::kRead);
  add("d", hand.b, Access::kRead);
  add("e", hand.a, Access::kWrite);
  add("f", hand.b, Access::kRead);
  add("g", hand.a, Access::kRead);
  EXPECT_EQ(hand.barriers(), (Barriers{false, false, true, true, false}));
}

TEST(Barriers, ReadAfterWrite) {
  Hand hand;
  const Tensor c = hand.add("c", {hand.a});
  const Tensor d = hand.add("d", {c});
  hand.add("e", {c, hand.a});  // c has been visible since d's barrier
  hand.add("f", {d});
  EXPECT_EQ(hand.barriers(), (Barriers{false, true, false, true}));
}

TEST(Barriers, WriteAfterReadAndWrite) {
  Hand hand;
  const Tensor c = hand.add("c", {hand.a});
  hand.graph.add(pass("rewrites a", {hand.b}, {hand.a}));  // c's pass reads it
  hand.graph.add(pass("rewrites a again", {hand.b}, {hand.a}));
  hand.graph.add(pass("rewrites c", {hand.b}, {c}));
  EXPECT_EQ(hand.barriers(), (Barriers{false, true, true, false}));
}

TEST(Barriers, SlicesOfOneTensorAreApart) {
  Hand hand;
  const Tensor wide = hand.graph.tensor("wide", {4, 4, 4});
  hand.graph.add(pass("low", {hand.a}, {wide.slice(0, 2)}));
  hand.graph.add(pass("high", {hand.b}, {wide.slice(2, 2)}));
  hand.graph.add(pass("reads across", {wide.slice(1, 2)}, {hand.a}));
  EXPECT_EQ(hand.barriers(), (Barriers{false, false, true}));
}

// After d has read c, its memory is free only from the next barrier on: for g, and not for e.
TEST(Barriers, ReusedMemoryNeedsNoMore) {
  const auto build = [](bool keep) {
    Hand hand(keep);
    const Tensor c = hand.add("c", {hand.a});
    const Tensor d = hand.add("d", {c, hand.b});
    hand.add("e", {hand.b});
    hand.add("f", {d});
    hand.add("g", {hand.b});
    return hand;
  };
  Hand plain = build(true), aliased = build(false);
  EXPECT_EQ(plain.barriers(), (Barriers{false, true, false, true, false}));
  EXPECT_EQ(aliased.barriers(), plain.barriers());
  EXPECT_LT(aliased.graph.activation_bytes(), plain.graph.activation_bytes());
  EXPECT_EQ(aliased.graph.unaliased_bytes() + 2 * Graph::kGuardBytes, plain.graph.activation_bytes());
  const auto place = [&](const std::string& name) {
    for (const TensorRecord& tensor : aliased.graph.tensors())
      if (tensor.name == name) return tensor.offset_bytes;
    throw std::out_of_range(name);
  };
  EXPECT_NE(place("e"), place("c"));
}

// The smaller graph lacks the barrier after which f may write where d reads.
TEST(Barriers, PlacesOfALargerGraphMayNeedMore) {
  const auto build = [](bool chain) {
    Hand hand(false);
    const Tensor c = hand.add("c", {hand.a});
    const Tensor d = hand.add("d", {c, hand.b});
    hand.add("f", chain ? std::vector{d} : std::vector<Tensor>());
    return hand;
  };
  Hand larger = build(true), smaller = build(false);
  EXPECT_EQ(larger.barriers(), (Barriers{false, true, true}));
  EXPECT_EQ(smaller.barriers(), (Barriers{false, true, false}));
  smaller.graph.plan_within(larger.graph);
  Barriers within;
  for (size_t i = 0; i < 3; ++i) within.push_back(smaller.graph.barrier_before(i));
  EXPECT_EQ(within, larger.barriers());
}

TEST(Graph, InputsHavePlacesWithoutPasses) {
  Graph graph(Storage::kFloat32);
  graph.input("a", kShape);
  graph.plan();
  EXPECT_EQ(graph.barrier_count(), 0u);
  EXPECT_GE(graph.activation_bytes(), 2 * Graph::kGuardBytes + 4 * 4 * 2 * sizeof(float));
}

// Vectors of pixels may begin before a tensor and end after it.
TEST(Graph, GuardsAreInFrontOfAndBehindAllTensors) {
  const TemporaryDirectory folder;
  const Subject subject = make_subject(pyramid_architecture(4), 24, 16, 1);
  const Model model(conform::model_file(subject.architecture, subject.weights), "pyramid");
  for (const Storage storage : {Storage::kFloat32, Storage::kFloat16}) {
    for (const bool keep : {false, true}) {
      Graph graph(storage, true, keep);
      network(graph, model, 24, 16, 0);
      graph.plan();
      EXPECT_TRUE(has_guards(graph));
    }
  }
}

TEST(Graph, ReadingWhatNothingWroteIsAnError) {
  Graph graph(Storage::kFloat32);
  const Tensor never = graph.tensor("never", kShape);
  EXPECT_ERROR(graph.add(pass("reader", {never}, {})), "reader", "never");
}

TEST(Graph, EmptyTensorsAreErrors) {
  Graph graph(Storage::kFloat16);
  EXPECT_ERROR(graph.tensor("flat", {0, 4, 1}), "flat");
  EXPECT_ERROR(graph.tensor("thin", {4, 4, 0}), "thin");
}

TEST(Graph, ASliceBeyondTheTensorIsAnError) {
  Graph graph(Storage::kFloat32);
  EXPECT_ERROR(graph.tensor("t", kShape).slice(1, 2), "slice");
}

class LayerShapes : public testing::Test {
 protected:
  Tensor in(Shape shape) { return graph_.input("in", shape); }
  Tensor out(Shape shape) { return graph_.tensor("out", shape); }

  Graph graph_{Storage::kFloat32};
  std::vector<float> weight_ = std::vector<float>(3 * 2 * 9), bias_ = std::vector<float>(3);
  ConvWeights weights_{weight_, bias_};
};

TEST_F(LayerShapes, Conv2d) {
  const Tensor x = in({5, 4, 2}), y = out({5, 4, 3});
  conv2d(graph_, "right", x, y, weights_, {.kernel = 3});
  const auto wrong = [&](const Tensor& from, const Tensor& to, const Conv2dOptions& options) {
    return error_of([&] { conv2d(graph_, "my layer", from, to, weights_, options); });
  };
  const std::vector<Tensor> four(4, y), other{x};
  for (const std::string& message :
       {wrong(x, y, {.kernel = 2}), wrong(x, y, {.kernel = 1}), wrong(x, out({4, 5, 3}), {.kernel = 3}),
        wrong(in({5, 4, 3}), y, {.kernel = 3}), wrong(x, out({5, 4, 4}), {.kernel = 3}),
        wrong(x, y, {.kernel = 3, .residuals = four}), wrong(x, y, {.kernel = 3, .residuals = other}),
        wrong(x, y, {.kernel = 3, .second_input = x}),
        wrong(in({5, 4, 1}), y, {.kernel = 3, .second_input = in({4, 5, 1})})}) {
    EXPECT_TRUE(contains(message, "layer my layer")) << message;
  }
  EXPECT_ERROR(conv2d(graph_, "my layer", x, y, {weight_, std::span(bias_).first(2)}, {.kernel = 3}),
               "my layer", "2 biases, expected 3");
}

TEST_F(LayerShapes, EncodeAndDecode) {
  const std::vector<EncodedChannel> two(2), many(9, {.value = 0.5f}), far{{.channel = 56}};
  EXPECT_ERROR(encode(graph_, "enc", kLrhsSlot, out({4, 4, 3}), two, Transfer::kLinear, 1), "layer enc",
               "2 channels to encode, expected 3");
  EXPECT_ERROR(encode(graph_, "enc", kLrhsSlot, out({4, 4, 9}), many, Transfer::kLinear, 1), "layer enc",
               "channel 8");
  EXPECT_ERROR(encode(graph_, "enc", kLrhsSlot, out({4, 4, 1}), far, Transfer::kLinear, 1), "layer enc",
               "channel 0");
  EXPECT_ERROR(encode(graph_, "enc", kLrhsSlot, out({4, 4, 2}), two, Transfer::kLinear, 0), "layer enc",
               "clip");
  const Tensor rec = in({8, 8, 3}), base = in({4, 4, 3}), other = in({4, 4, 2});
  decode(graph_, "right", rec, {.base = &base, .scale = 2});
  EXPECT_ERROR(decode(graph_, "dec", rec, {.base = &base, .scale = 4}), "layer dec", "scale 4");
  EXPECT_ERROR(decode(graph_, "dec", rec, {.base = &other, .scale = 2}), "layer dec", "4x4x2");
}

class GraphTest : public GpuTest {};

TEST_F(GraphTest, WhatTheDeviceCannotBindIsAnError) {
  Graph graph(Storage::kFloat32);
  const auto side = uint32_t(std::sqrt(double(gpu().info().max_storage_range_bytes) / 4)) + 1;
  const Tensor vast = graph.input("vast", {side, side, 1});
  const std::array weight{1.0f}, bias{0.0f};
  conv2d(graph, "big layer", vast, graph.tensor("copy", {side, side, 1}), {weight, bias}, {.kernel = 1});
  graph.plan();
  EXPECT_ERROR(Program(gpu(), graph, shared_cache(), 1), "binds", gpu().info().name);
}

TEST(Graph, KeepsSomeRowsOfATensor) {
  Graph graph(Storage::kFloat32);
  const Tensor tall = graph.tensor("tall", {100, 64, 3}), whole = graph.tensor("whole", {16, 64, 3});
  EXPECT_EQ(graph.rows_mask(tall), ~0u);
  graph.keep_rows(tall, 8);
  EXPECT_EQ(graph.rows_mask(tall), 7u);
  EXPECT_EQ(graph.plane(tall), plane_stride(8 * 64, Storage::kFloat32));
  EXPECT_EQ(graph.size_bytes(tall), uint64_t{graph.plane(tall)} * 3 * 4);
  EXPECT_EQ(graph.tensors()[tall.id].size_bytes, graph.size_bytes(tall));
  EXPECT_EQ(graph.offset_bytes(tall.slice(2, 1)), uint64_t{graph.plane(tall)} * 2 * 4);
  graph.keep_rows(whole, 16);  // all rows
  EXPECT_EQ(graph.rows_mask(whole), ~0u);
  EXPECT_ERROR(graph.keep_rows(whole, 3), "whole", "3 rows");
  graph.add(pass("writer", {}, {whole}));
  EXPECT_ERROR(graph.keep_rows(whole, 4), "whole", "4 rows");
}

// Chooses Winograd for 3x3 layers, and small bands for all layers.
Conv2dKernel banded(const Conv2dShape& shape) {
  const uint32_t tile = shape.channels_out % 2 ? 2 : 4;  // tiles of both sizes read each other's rows
  return {.algorithm = shape.kernel == 1 ? Algorithm::kPointwise : Algorithm::kWinograd,
          .tile = tile,
          .outputs = 8,
          .channels = 8,
          .band = 8};
}

// Runs the whole network, where almost every tensor takes another's memory. Banded kernels keep only a few
// rows of some tensors.
TEST_F(GraphTest, KeepingAllActivationsMakesTheSameBits) {
  const TemporaryDirectory folder;
  const std::vector<Kernels> direct{{}}, all{{}, {.conv2d = banded}, {.addressed = true, .conv2d = banded}};
  size_t combinations = 0;
  for (const auto& shape : {small_architecture, guided_architecture}) {
    const Subject subject = make_subject(shape(4), 9, 5, 1);
    write_model(folder / "model.safetensors", subject.architecture, subject.weights);
    const Model model(folder / "model.safetensors");
    for (const Kernels& kernels : gpu().info().buffer_device_address ? all : direct) {
      for (const Storage storage : {Storage::kFloat32, Storage::kFloat16}) {
        if (!is_tried(combinations++, 5)) continue;
        std::vector<Planes> outputs;
        for (const bool keep : {true, false}) {
          Graph graph(storage, kernels.addressed, keep);
          network(graph, model, 9, 5, 0, kernels.conv2d);
          graph.plan();
          const auto tensors = graph.tensors();
          const bool cut = std::any_of(tensors.begin(), tensors.end(),
                                       [](const TensorRecord& t) { return t.rows < t.shape.height; });
          const Conv2dShape any_3x3{
              .height = 1, .width = 1, .channels_in = 1, .channels_out = 1, .kernel = 3};
          const bool is_banded = kernels.conv2d(any_3x3).algorithm == Algorithm::kWinograd;
          EXPECT_EQ(cut, is_banded && !keep);
          if (!keep && !is_banded) {
            EXPECT_LT(graph.activation_bytes(), graph.unaliased_bytes() / 4 * 3);
          }
          Program program(gpu(), graph, shared_cache(), 1);
          const FrameImage lrhs(gpu(), subject.lrhs), hrls(gpu(), subject.hrls);
          const FrameImage fused(gpu(), Shape{36, 20, 3});
          program.bind(0, {lrhs.binding(), hrls.binding(), fused.binding()});
          run_passes(gpu(), program, graph);
          outputs.push_back(fused.read());
        }
        EXPECT_TRUE(same_bits(floats(outputs[1]), floats(outputs[0])));
      }
    }
  }
}

TEST_F(GraphTest, AFilledTensorHasOneValueAndOthersStay) {
  for (const Storage storage : {Storage::kFloat32, Storage::kFloat16}) {
    Graph graph(storage, false, true);
    const Tensor in = graph.input("in", {5, 7, 3});
    const Tensor other = graph.input("other", {3, 2, 2});
    const std::vector<float> weight(3), bias(1);
    conv2d(graph, "conv", in, graph.tensor("out", {5, 7, 1}), {weight, bias}, {.kernel = 1});
    graph.plan();
    Program program(gpu(), graph, shared_cache(), 1);
    program.write(other, std::vector<float>(12, 2.0f));
    program.fill(in, 0.5f);
    EXPECT_EQ(program.read(in), std::vector<float>(105, 0.5f));
    EXPECT_EQ(program.read(other), std::vector<float>(12, 2.0f));
  }
}

// Returns each pass's reads and writes of activations, whether it finds them by address or by buffer.
std::vector<std::vector<std::tuple<std::string, uint32_t, Access>>> accesses_of(const Graph& graph) {
  std::vector<std::vector<std::tuple<std::string, uint32_t, Access>>> all;
  for (const Pass& pass : graph.passes()) {
    auto& own = all.emplace_back();
    for (const Binding& binding : pass.bindings)
      if (binding.kind == Binding::Kind::kTensor)
        own.emplace_back(graph.tensors()[binding.tensor.id].name, binding.tensor.channel_offset,
                         binding.access);
  }
  return all;
}

// Validation does not see accesses by address, so these barriers rest on what the passes declare. It does see
// accesses to buffers, and both kinds of passes must declare the same.
TEST(Graph, PassesByAddressHaveTheAccessesAndBarriersOfThoseWithBuffers) {
  const TemporaryDirectory folder;
  for (const auto& shape :
       {small_architecture, guided_architecture, pyramid_architecture, unshuffled_architecture}) {
    const Subject subject = make_subject(shape(4), 9, 5, 1);
    write_model(folder / "model.safetensors", subject.architecture, subject.weights);
    const Model model(folder / "model.safetensors");
    for (const Conv2dChoice& choose : {Conv2dChoice(conv2d_direct), Conv2dChoice(banded)}) {
      for (const Storage storage : {Storage::kFloat32, Storage::kFloat16}) {
        Graph buffers(storage), addressed(storage, true);
        for (Graph* graph : {&buffers, &addressed}) {
          network(*graph, model, 9, 5, 0, choose);
          graph->plan();
        }
        ASSERT_EQ(addressed.passes().size(), buffers.passes().size());
        EXPECT_EQ(accesses_of(addressed), accesses_of(buffers));
        EXPECT_GT(addressed.barrier_count(), 8u);
        for (size_t i = 0; i < buffers.passes().size(); ++i)
          EXPECT_EQ(addressed.barrier_before(i), buffers.barrier_before(i))
              << i << ": " << buffers.passes()[i].name;
      }
    }
  }
}

}  // namespace
}  // namespace raymeld::test
