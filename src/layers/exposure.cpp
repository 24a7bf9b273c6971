// Adds the layer that computes the exposure of an image, in two passes.
#include <algorithm>
#include <cmath>

#include "layers/layers.h"
#include "layers/shaders.h"
#include "params.h"

namespace raymeld {

void exposure(Graph& graph, const std::string& name, FrameSlot slot, uint32_t height, uint32_t width,
              float key) {
  constexpr uint32_t kMostSums = RAYMELD_SUMMANDS;  // a workgroup sums up no more
  const double pixels = double(height) * width;
  const bool possible = pixels > 0 && pixels < double{1u << 31} && key > 0;
  if (!possible)
    throw Error("layer {}: {} x {} pixels and a key of {}, expected 1 to 2^31 - 1 pixels and a positive key",
                name, width, height, key);
  const uint32_t count = std::min(kMostSums, divide_up(height * width, RAYMELD_SUMMANDS));
  const Tensor sums = graph.scratch(name + ".sums", count);
  Pass first;
  first.name = name;
  first.shader = &(graph.frame_images().inputs ? shaders::kExposureSumsImage : shaders::kExposureSums);
  first.bindings = {frame_binding(graph, slot), write_binding(sums)};
  first.set_push(params::ExposureSums{{}, height, width, count * RAYMELD_SUMMANDS});
  first.groups = {count, 1, 1};
  first.bytes = 3 * sizeof(float) * pixels;
  graph.add(std::move(first));
  Pass second;
  second.name = name;
  second.shader = &shaders::kExposure;
  second.bindings = {read_binding(sums), exposure_binding(Access::kWrite)};
  second.set_push(params::FoundExposure{count, float(std::sqrt(double{key}) * pixels)});
  graph.add(std::move(second));
}

}  // namespace raymeld
