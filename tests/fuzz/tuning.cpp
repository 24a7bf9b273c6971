// Loads a tuning file. Whatever it holds, its kernels must build graphs of a sensible number of passes.
#include <cstdlib>

#include "fusion/tuner.h"
#include "fuzz/memory_file.h"
#include "matrix.h"

namespace {

using namespace raymeld;
using test::kMatrix;

constexpr Conv2dShape kShapes[] = {
    {.height = 7, .width = 9, .channels_in = 5, .channels_out = 3, .kernel = 3},
    {.height = 7, .width = 9, .channels_in = 5, .channels_out = 3, .kernel = 3, .most_tile = 2},
    {.height = 256, .width = 256, .channels_in = 64, .channels_out = 16, .kernel = 1},
};

DeviceInfo device(bool addresses, bool matrices) {
  DeviceInfo info;
  info.buffer_device_address = addresses;
  if (matrices) info.cooperative_matrix = kMatrix;
  return info;
}

void convolve(const Kernels& kernels, const Conv2dShape& shape) {
  const std::vector<float> weight(shape.channels_out * shape.channels_in * shape.kernel * shape.kernel);
  const std::vector<float> bias(shape.channels_out);
  Graph graph(Storage::kFloat16, kernels.addressed);
  const Tensor in = graph.input("in", {shape.height, shape.width, shape.channels_in});
  const Tensor out = graph.tensor("out", {shape.height, shape.width, shape.channels_out});
  conv2d(graph, "conv2d", in, out, {weight, bias}, {.kernel = shape.kernel, .how = kernels.conv2d(shape)});
  graph.plan();
  constexpr size_t kMostPasses = 1000;
  if (graph.passes().size() > kMostPasses) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const test::MemoryFile content({data, size});
  const Tuning tuning = load_tuning(content.path());
  for (const DeviceInfo& info : {device(true, true), device(true, false), device(false, false)}) {
    const Kernels kernels = tuning.kernels(info, Storage::kFloat32);
    for (const Conv2dShape& shape : kShapes) convolve(kernels, shape);
  }
  return 0;
}
