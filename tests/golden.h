#pragma once

#include <filesystem>

#include "reference/reference.h"

namespace raymeld::test {

// A tiny network with random weights, its raw inputs, and every layer's output as PyTorch computed it in
// float64: tests/golden/tiny-x2 and so on, guided-x2 with the other choices of the network, joint-x2 with a
// joint base.
struct Golden {
  reference::Architecture architecture;
  reference::Weights weights;
  reference::Planes lrhs, hrls;
  std::map<std::string, reference::Planes> outputs;  // by the names of reference::network
  double phase = 0;                                  // of the LRHS samples
  double exposure = 1;
};

// Throws when a file is missing or holds other layers than its weights and "output".
Golden load_golden(const std::string& name);
std::filesystem::path golden_model_path(const std::string& name);
inline std::filesystem::path golden_model_path(int scale) {
  return golden_model_path("tiny-x" + std::to_string(scale));
}
// The names there are.
const std::vector<std::string>& golden_names();

}  // namespace raymeld::test
