// Whole networks on a device against the reference; the tests hold those of PyTorch's goldens to it too.
#pragma once

#include <filesystem>

#include "conform/collector.h"
#include "fusion/fuser.h"

namespace raymeld::conform {

// A small network and one frame for it.
struct Subject {
  reference::Architecture architecture;
  reference::Weights weights;
  reference::Planes lrhs, hrls;
};
// Random weights and images.
Subject make_subject(const reference::Architecture& architecture, int height, int width, uint64_t seed);

struct NetworkRun {
  std::map<std::string, reference::Planes> layers;  // by the reference's names
  reference::Planes output;
  FuseReport report;
};

// One frame through a Fuser that keeps all activations.
NetworkRun run_network(const Target& target, const Model& model, const Subject& subject,
                       FuserOptions options);

// How a network is computed: Method::kernel is that of the 3x3 convolutions, by which the 1x1 are chosen
// too. From network to network (`index`) activations in buffers and by address take turns.
std::vector<Method> network_methods(const DeviceInfo& device, size_t index);

// How a network is run.
struct NetworkTrial {
  Method method;
  reference::Precision precision = reference::Precision::kFp32;
  float phase = 0;
  float exposure = 1;
};

// Three cases of `name`: each layer against the reference fed with the device's own values; the output with
// bounds carried through all layers, and the RMS errors of all layers; and, where other devices' values are
// given, against theirs.
void conform_one(const Collector& collector, const std::string& name, const Subject& subject,
                 const NetworkTrial& trial);

}  // namespace raymeld::conform
