#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "io/safetensors.h"
#include "reference.h"

namespace raymeld::test {

enum class Fill {
  kUniform,   // in [-1, 1)
  kIntegers,  // -2 .. 2: sums are exact in fp32, and in fp16 while they stay below 2^11
  kSpecials,  // every other value one of special_values()
};

// -0, subnormals, the limits of half and float, fireflies, Inf, NaN.
const std::vector<float>& special_values();

// Floats; the same seed gives the same values on every machine.
reference::Planes random_planes(int c, int h, int w, Fill fill, uint64_t seed);

// kUniform weights are scaled by 1 / sqrt(in * kernel^2), which keeps activations near 1 through many layers.
reference::Conv random_conv(int out, int in, int kernel, Fill fill, uint64_t seed);
// What the device reads: weights in the storage type, biases in fp32.
reference::Conv round_to(reference::Conv conv, reference::Precision precision);

// For `architecture`, uniform, by the model file's names; rounded as above.
reference::Weights random_weights(const reference::Architecture& architecture, reference::Precision precision,
                                  uint64_t seed);

struct Size {
  int h, w;
};
// 1x1, single rows and columns, primes, tile sizes and one more or less than a tile.
const std::vector<Size>& awkward_sizes();

std::vector<float> floats(const reference::Planes& planes);
reference::Planes planes(int c, int h, int w, std::span<const float> values);

// Gone, with all that it holds, when this goes.
class TemporaryDirectory {
 public:
  TemporaryDirectory();
  ~TemporaryDirectory();
  TemporaryDirectory(const TemporaryDirectory&) = delete;
  TemporaryDirectory& operator=(const TemporaryDirectory&) = delete;
  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path operator/(const std::filesystem::path& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

// Values are rounded to the tensor's type.
void write_safetensors(const std::filesystem::path& path, const SafeTensors& content);

std::string read_file(const std::filesystem::path& path);
void write_file(const std::filesystem::path& path, std::string_view content);
std::filesystem::path source_path(const std::filesystem::path& relative);  // within the repository

struct ProcessOptions {
  std::filesystem::path directory = {};                                // where it runs; empty: here
  std::map<std::string, std::optional<std::string>> environment = {};  // set, or unset where nullopt
  int signal = 0;                 // sent once, as soon as stderr holds ...
  std::string signal_after = {};  // ... this text
};

struct ProcessResult {
  int exit_status = -1;  // -1 when a signal ended it
  int signal = 0;        // the one that did
  std::string out, err;
};

// Waits for its end. argv[0] is looked up in PATH; stdin is empty, signals act by default.
// Throws std::system_error when it cannot
// start.
ProcessResult run_process(const std::vector<std::string>& argv, const ProcessOptions& options = {});

}  // namespace raymeld::test
