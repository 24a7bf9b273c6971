#pragma once

#include <filesystem>

#include "networks/model.h"
#include "reference/reference.h"

namespace raymeld::test {

// Holds a tiny network with random weights, its raw inputs, and every layer's output as PyTorch computed it
// in float64. The files are tests/golden/tiny-x2 and so on; guided-x2 makes the other choices of the network,
// spp-x4 knows samples, edsr-x4 is EDSR, rcan-x2 is RCAN, kpcn-x1 is KPCN, and
// pyramid-x1 (without LRHS), pyramid-x2 and pyramid-x4 are pyramid networks.
struct Golden {
  reference::Architecture architecture;
  reference::Weights weights;
  reference::Planes lrhs, hrls;
  std::map<std::string, reference::Planes> outputs;  // keyed by the names of reference::network()
  double phase = 0;                                  // phase of the LRHS samples
  double exposure = 1;
  SampleCounts samples = {};  // architecture and weights are those for these samples
};

// Throws when a file or an expected layer is missing, or when a layer is unknown.
Golden load_golden(const std::string& name);
std::filesystem::path golden_model_path(const std::string& name);
inline std::filesystem::path golden_model_path(int scale) {
  return golden_model_path("tiny-x" + std::to_string(scale));
}
// Returns the names of all golden networks.
const std::vector<std::string>& golden_names();

}  // namespace raymeld::test
