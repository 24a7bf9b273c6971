#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "error_of.h"
#include "gpu.h"
#include "reference/transfer.h"
#include "within_bounds.h"

namespace raymeld::test {
namespace {

using reference::Bounded;
using reference::exact;
using reference::Planes;
using reference::Precision;
using reference::slice;

class JointTest : public GpuTest {};

// What one run of a layer reads and how. The images hold what the device would store.
struct Case {
  static constexpr float kCertainty = 10;

  Precision precision;
  bool log;
  int scale;
  float phase;
  Size size;  // of LRHS
  uint64_t seed;

  JointOptions options() const {
    return {log ? Transfer::kLog : Transfer::kLinear, uint32_t(scale), phase, kCertainty};
  }
  reference::Transfer transfer() const {
    return log ? reference::Transfer::kLog : reference::Transfer::kLinear;
  }
  double clip() const { return log ? 1000 : 100; }
  Size full() const { return {scale * size.h, scale * size.w}; }
  std::string name(const char* layer) const {
    return fmt::format("{} {} {}", layer, log ? "log" : "linear", name_of(precision));
  }

  // What `value` makes of numbers in [0, 1], both ends among them.
  Planes image(int channels, const Size& size, uint64_t salt,
               const std::function<double(double)>& value) const {
    Planes image = random_planes(channels, size.h, size.w, Fill::kUniform, 100 * seed + salt);
    for (double& v : image.data) v = value(std::clamp(0.55 * v + 0.5, 0.0, 1.0));
    return round_to(image, precision);
  }
  // From 0 to the clip.
  Planes radiance(int channels, const Size& size, uint64_t salt) const {
    return image(channels, size, salt,
                 [&](double u) { return reference::apply(transfer(), clip() * std::pow(u, 4)); });
  }
  // Color, albedo and normal, as one tensor.
  Planes hrls() const {
    Planes all = radiance(3, full(), 1);
    const Planes albedo = image(3, full(), 2, [](double u) { return u; });
    const Planes normal = image(3, full(), 3, [](double u) { return 2 * u - 1; });
    for (const Planes& layer : {albedo, normal}) {
      all.data.insert(all.data.end(), layer.data.begin(), layer.data.end());
      all.c += layer.c;
    }
    return all;
  }
};

// Both precisions, transfers and phases at all scales, each with another size.
void for_each_case(const std::function<void(const Case&)>& check) {
  uint64_t next = 0;
  for (const Precision precision : kPrecisions) {
    for (const bool log : {false, true}) {
      for (const int scale : {2, 4, 8}) {
        for (const float phase : {0.0f, (float(scale) - 1) / 2}) {
          const Size& size = awkward_sizes()[next % 12];
          SCOPED_TRACE(fmt::format("{}, {}, x{}, phase {}, {} x {}", name_of(precision),
                                   log ? "log" : "linear", scale, phase, size.h, size.w));
          check({precision, log, scale, phase, size, ++next});
        }
      }
    }
  }
}

TEST_F(JointTest, Irradiance) {
  for_each_case([](const Case& c) {
    const Planes low = c.radiance(6, c.size, 0), hrls = c.hrls();
    LayerRun run(c.precision);
    const Tensor lrhs = run.input("lrhs", low), high = run.input("hrls", hrls), out = lrhs.slice(3, 3);
    irradiance(run.graph(), "irradiance", lrhs.slice(0, 3), high.slice(3, 3), high.slice(6, 3), out,
               c.options());
    run.run();
    const Bounded all = exact(hrls);
    const Bounded expected =
        reference::irradiance(slice(exact(low), 0, 3), slice(all, 3, 3), slice(all, 6, 3), c.transfer(),
                              c.scale, c.phase, c.precision);
    EXPECT_TRUE(within_bounds(c.name("irradiance"), run.read(out), expected));
    EXPECT_EQ(run.read(lrhs.slice(0, 3)).data, slice(exact(low), 0, 3).value.data);
  });
}

TEST_F(JointTest, Light) {
  for_each_case([](const Case& c) {
    const Planes low = c.radiance(6, c.size, 0), hrls = c.hrls();
    LayerRun run(c.precision);
    const Tensor lrhs = run.input("lrhs", low), high = run.input("hrls", hrls);
    const Tensor out = run.tensor("out", 5, c.full().h, c.full().w);
    light(run.graph(), "light", high.slice(0, 3), high.slice(3, 3), lrhs, out, c.options());
    run.run();
    const Bounded all = exact(hrls);
    const Bounded expected = reference::light(slice(all, 0, 3), slice(all, 3, 3), exact(low),
                                              Case::kCertainty, c.transfer(), c.scale, c.phase, c.precision);
    EXPECT_TRUE(within_bounds(c.name("light"), run.read(out), expected));
  });
}

// Brightness varies within the width of the filter, or about as much as it can.
TEST_F(JointTest, Filter) {
  for_each_case([](const Case& c) {
    const Planes hrls = c.hrls();
    for (const double range : {0.1, c.clip()}) {
      Planes x = c.image(3, c.full(), 4, [](double u) { return 30 * u; });
      const Planes certainty = c.image(1, c.full(), 6, [](double u) { return 1 + 60 * u; });
      x.data.insert(x.data.end(), certainty.data.begin(), certainty.data.end());
      x.c = 4;
      const Planes brightness =
          c.image(1, c.full(), 5, [&](double u) { return reference::apply(c.transfer(), 1 + range * u); });
      const uint32_t step = 1u << c.seed % 5;
      LayerRun run(c.precision);
      const Tensor in = run.input("in", x), guide = run.input("brightness", brightness);
      const Tensor high = run.input("hrls", hrls), out = run.tensor("out", 4, c.full().h, c.full().w);
      joint_filter(run.graph(), "filter", in, high.slice(3, 3), high.slice(6, 3), guide, out, step);
      run.run();
      const Bounded expected =
          reference::joint_filter(exact(x), slice(exact(hrls), 3, 3), slice(exact(hrls), 6, 3),
                                  exact(brightness), int(step), c.precision);
      EXPECT_TRUE(within_bounds(c.name("joint_filter"), run.read(out), expected)) << "step " << step;
    }
  });
}

TEST_F(JointTest, Relight) {
  for_each_case([](const Case& c) {
    const double brightest = std::log1p(0.2 * c.clip() / 0.4) / 0.2;
    const Planes hrls = c.hrls(), x = c.image(3, c.full(), 4, [&](double u) { return brightest * u; });
    LayerRun run(c.precision);
    const Tensor in = run.input("in", x), high = run.input("hrls", hrls);
    const Tensor out = run.tensor("out", 9, c.full().h, c.full().w).slice(3, 3);
    relight(run.graph(), "relight", in, high.slice(3, 3), out, c.options().transfer);
    run.run();
    const Bounded expected =
        reference::relight(exact(x), slice(exact(hrls), 3, 3), c.transfer(), c.precision);
    EXPECT_TRUE(within_bounds(c.name("relight"), run.read(out), expected));
  });
}

TEST_F(JointTest, WhatRelightCannotStoreSaturates) {
  LayerRun run(Precision::kFp16);
  const Tensor in = run.input("in", Planes(3, 1, 1, {1, 52, 52}));
  const Tensor albedo = run.input("albedo", Planes(3, 1, 1, {1, 1, 1})), out = run.tensor("out", 3, 1, 1);
  relight(run.graph(), "relight", in, albedo, out, Transfer::kLinear);
  run.run();
  EXPECT_EQ(run.read(out).at(1, 0, 0), 65504);
  EXPECT_EQ(run.status().saturated, 2u);
}

// Logits of a few, and now and then of +-80.
TEST_F(JointTest, Mix) {
  for_each_case([](const Case& c) {
    const Planes low = c.radiance(6, c.size, 0), hrls = c.hrls(), filtered = c.radiance(9, c.full(), 4);
    const Planes rec = c.image(8, c.full(), 5, [](double u) {
      return u == 0 ? -80 : u == 1 ? 80 : 8 * u - 4;
    });
    LayerRun run(c.precision);
    const Tensor in = run.input("rec", rec), lrhs = run.input("lrhs", low), high = run.input("hrls", hrls);
    const Tensor candidates = run.input("candidates", filtered);
    const Tensor out = run.tensor("out", 3, c.full().h, c.full().w);
    mix(run.graph(), "mix", in, lrhs, high.slice(3, 3), candidates, out, c.options());
    run.run();
    const Bounded expected = reference::mix(exact(rec), exact(low), slice(exact(hrls), 3, 3), exact(filtered),
                                            c.transfer(), c.scale, c.phase, c.precision);
    EXPECT_TRUE(within_bounds(c.name("mix"), run.read(out), expected));
  });
}

using AddLayer = std::function<void(Graph&, const std::vector<Tensor>&)>;

// `add` takes tensors of these shapes, and none that is a row, a column or a channel larger.
void expect_only(const std::vector<Shape>& shapes, const AddLayer& add) {
  const auto try_shapes = [&](const std::vector<Shape>& tried) {
    Graph graph(Storage::kFloat32);
    std::vector<Tensor> tensors;
    for (const Shape& shape : tried)
      tensors.push_back(graph.input(fmt::format("t{}", tensors.size()), shape));
    add(graph, tensors);
  };
  EXPECT_NO_THROW(try_shapes(shapes));
  for (size_t i = 0; i < shapes.size(); ++i) {
    for (uint32_t Shape::*side : {&Shape::height, &Shape::width, &Shape::channels}) {
      std::vector<Shape> wrong = shapes;
      ++(wrong[i].*side);
      SCOPED_TRACE(fmt::format("tensor {}", i));
      EXPECT_ERROR(try_shapes(wrong), "layer odd one", "expected");
    }
  }
}

TEST_F(JointTest, WrongShapesAreErrors) {
  const Shape low{2, 3, 3}, full{8, 12, 3}, full_1{8, 12, 1}, full_4{8, 12, 4}, full_5{8, 12, 5},
      low_6{2, 3, 6};
  const JointOptions options{.transfer = Transfer::kLog, .scale = 4};
  const char* name = "odd one";
  expect_only({low, full, full, low}, [&](Graph& graph, const std::vector<Tensor>& t) {
    irradiance(graph, name, t[0], t[1], t[2], t[3], options);
  });
  expect_only({full, full, low_6, full_5}, [&](Graph& graph, const std::vector<Tensor>& t) {
    light(graph, name, t[0], t[1], t[2], t[3], options);
  });
  expect_only({full_4, full, full, full_1, full_4}, [&](Graph& graph, const std::vector<Tensor>& t) {
    joint_filter(graph, name, t[0], t[1], t[2], t[3], t[4], 2);
  });
  expect_only({full, full, full}, [&](Graph& graph, const std::vector<Tensor>& t) {
    relight(graph, name, t[0], t[1], t[2], Transfer::kLog);
  });
  expect_only({{8, 12, 8}, low_6, full, {8, 12, 9}, full}, [&](Graph& graph, const std::vector<Tensor>& t) {
    mix(graph, name, t[0], t[1], t[2], t[3], t[4], options);
  });
}

}  // namespace
}  // namespace raymeld::test
