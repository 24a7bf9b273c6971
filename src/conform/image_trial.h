// Makes the images that layers other than convolutions are tried with.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <span>

#include "conform/collector.h"
#include "reference/transfer.h"

namespace raymeld::conform {

// Describes one run of a layer that reads images. The images hold values as the device would store them.
struct ImageTrial {
  const Target& target;
  const Method& method;
  reference::Precision precision;
  bool log;
  int scale;
  float phase;
  reference::Size size;  // the size of LRHS
  uint64_t seed;

  Transfer transfer() const { return log ? Transfer::kLog : Transfer::kLinear; }
  reference::Transfer expected_transfer() const {
    return log ? reference::Transfer::kLog : reference::Transfer::kLinear;
  }
  double clip() const { return log ? 1000 : 100; }
  reference::Size full() const { return enlarged(scale); }
  reference::Size enlarged(int by) const { return {by * size.h, by * size.w}; }
  std::string shape() const {
    return fmt::format("x{}, {}, phase {:g}, {} x {} from {} x {}", scale, log ? "log" : "linear", phase,
                       full().h, full().w, size.h, size.w);
  }

  // Returns an image of value(u) with random u in [0, 1], both ends among them.
  template <typename Value>
  reference::Planes image(int channels, const reference::Size& of, uint64_t salt, const Value& value) const {
    reference::Planes image =
        reference::random_planes(channels, of.h, of.w, reference::Fill::kUniform, 100 * seed + salt);
    for (double& v : image.data) v = value(std::clamp(0.55 * v + 0.5, 0.0, 1.0));
    return round_to(image, precision);
  }
  // Returns encoded radiance from 0 to the clip.
  reference::Planes radiance(int channels, const reference::Size& of, uint64_t salt) const {
    return image(channels, of, salt,
                 [&](double u) { return reference::apply(expected_transfer(), clip() * std::pow(u, 4)); });
  }
};

// Runs one layer, which add() adds to the graph, of these inputs. It writes (h, w, channels).
template <typename Add>
reference::Planes run_layer(const ImageTrial& c, const std::vector<reference::Planes>& inputs,
                            const reference::Size& size, const Add& add, int channels = 3) {
  LayerRun run(c.target, c.precision, c.method.addressed);
  std::vector<Tensor> tensors;
  for (const reference::Planes& input : inputs)
    tensors.push_back(run.input(fmt::format("input {}", tensors.size()), input));
  const Tensor out = run.tensor("out", channels, size.h, size.w);
  add(run.graph(), tensors, out);
  run.run();
  return run.read(out);
}

struct ImageLayer {
  const char* name;
  void (*check)(Check&, const ImageTrial&);
};

// Tries layers in buffers and by address and in both precisions, each at all awkward sizes, and with both
// transfers, three scales and two phases.
void try_layers(const Collector& collector, std::span<const ImageLayer> layers);

}  // namespace raymeld::conform
