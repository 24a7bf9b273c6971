// Tests a device and its driver against the scalar reference and its bounds: every layer with every kernel in
// both precisions at awkward sizes, and whole tiny networks.
#pragma once

#include <functional>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "conform/layer_run.h"
#include "reference/bounds.h"

namespace raymeld::conform {

// Identifies a case.
struct Case {
  std::string layer;   // "conv2d 3x3"
  std::string kernel;  // "F(2, 3) by address"
  reference::Precision precision = reference::Precision::kFp32;
  std::string shape;  // sizes, channels and all else that tells the cases of one kernel apart
};

// kUnsupported means that nothing was tried: the device lacks a feature that the kernel or the precision
// needs, or there is nothing to compare with.
enum class Outcome { kPassed, kFailed, kUnsupported };

struct Finding {
  Case of = {};
  Outcome outcome = Outcome::kPassed;
  reference::Worst worst = {};  // the worst value of all comparisons
  std::string where = {};       // the name of its comparison, where the case has several
  double rms_ratio = 0;         // largest RMS error / allowed RMS error, where the case checks it
  size_t values = 0;            // number of values that were compared
  std::string message = {};     // the failures, or the missing feature
};

// Holds the outputs of networks on a device, by case.
struct Values {
  std::string device;
  std::map<std::string, reference::Planes> outputs = {};
};

enum class Extent { kQuick, kFull };

struct Options {
  Extent extent = Extent::kFull;
  // Holds the outputs of other devices. Two right values differ by no more than the sum of both bounds.
  std::vector<Values> others = {};
  Values* keep = nullptr;                          // receives this device's outputs
  std::function<void(const Finding&)> on_finding;  // called after each case; an exception in it ends the test
};

class Collector;

// Runs all cases of one family of layers.
struct Suite {
  std::string name;
  void (*run)(Collector&);
  // Marks whole networks: Options::others and keep are for them, and their Fusers save their own caches.
  bool networks = false;
};
std::span<const Suite> suites();

// Runs a suite. An exception in a case is a failure of that case, and the other cases run.
void conform(const Suite& suite, const Target& target, const Options& options);

}  // namespace raymeld::conform
