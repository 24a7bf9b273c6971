// Tries layers with shapes that they must refuse.
#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <vector>

#include "error_of.h"
#include "layers/layers.h"

namespace raymeld::test {

using AddLayer = std::function<void(Graph&, const std::vector<Tensor>&)>;

// Expects `add` to take these shapes, and to refuse any that is a row, a column or a channel larger.
inline void expect_only(const std::vector<Shape>& shapes, const AddLayer& add) {
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

}  // namespace raymeld::test
