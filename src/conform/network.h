// Compares whole networks on a device with the reference. The tests do so with PyTorch's goldens too.
#pragma once

#include <filesystem>

#include "conform/collector.h"
#include "fusion/fuser.h"

namespace raymeld::conform {

// Holds a small network and one frame for it.
struct Subject {
  reference::Architecture architecture;
  reference::Weights weights;
  reference::Planes lrhs, hrls;
};
// Returns a subject with random weights and images.
Subject make_subject(const reference::Architecture& architecture, int height, int width, uint64_t seed);

struct NetworkRun {
  std::map<std::string, reference::Planes> layers;  // outputs by the reference's names
  reference::Planes output;
  FuseReport report;
};

// Runs one frame through a Fuser that keeps all activations.
NetworkRun run_network(const Target& target, const Model& model, const Subject& subject,
                       FuserOptions options);

// Returns the methods to compute a network with. Method::kernel is the kernel of 3x3 convolutions, and that
// of 1x1 and 5x5 ones follows from it. Activations of the networks (`index`) are in buffers and
// by address in turns.
std::vector<Method> network_methods(const DeviceInfo& device, size_t index);

// Returns kernels that compute a network's 3x3 convolutions by the method.
Kernels kernels_of(const Method& method);

// Says how a network is run.
struct NetworkTrial {
  Method method;
  reference::Precision precision = reference::Precision::kFp32;
  float phase = 0;
  float exposure = 1;
};

// Runs the cases of `name`. The first compares each layer with the reference, fed with the device's own
// values. The second compares the output with bounds carried through all layers, and checks the RMS errors of
// all layers. Further cases compare the output with those of Options::others.
void conform_one(const Collector& collector, const std::string& name, const Subject& subject,
                 const NetworkTrial& trial);

}  // namespace raymeld::conform
