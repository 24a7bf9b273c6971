// The conformance test of a device and its driver: every layer by every kernel in both precisions at awkward
// sizes, and whole tiny networks, against the scalar reference and its bounds.
#pragma once

#include <functional>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "conform/layer_run.h"
#include "reference/bounds.h"

namespace raymeld::conform {

// What was tried.
struct Case {
  std::string layer;   // "conv2d 3x3"
  std::string kernel;  // "F(2, 3) by address"
  reference::Precision precision = reference::Precision::kFp32;
  std::string shape;  // sizes, channels, and whatever else tells the cases of one kernel apart
};

// kUnsupported: the device lacks a feature that the kernel or the precision takes, or there is nothing to
// compare with; nothing was tried.
enum class Outcome { kPassed, kFailed, kUnsupported };

struct Finding {
  Case of = {};
  Outcome outcome = Outcome::kPassed;
  reference::Worst worst = {};  // of all comparisons of the case
  std::string where = {};       // which of them that was, where there are several
  double rms_ratio = 0;         // the largest RMS error over the one allowed, where that was asked
  size_t values = 0;            // that were compared
  std::string message = {};     // what failed, or the feature that is missing
};

// What networks gave on a device, by case.
struct Values {
  std::string device;
  std::map<std::string, reference::Planes> outputs = {};
};

enum class Extent { kQuick, kFull };

struct Options {
  Extent extent = Extent::kFull;
  // What other devices gave. Two right values differ by no more than both bounds.
  std::vector<Values> others = {};
  Values* keep = nullptr;                          // where this device's own go
  std::function<void(const Finding&)> on_finding;  // after each case; what it throws ends the test
};

class Collector;

// All cases of one family of layers.
struct Suite {
  std::string name;
  void (*run)(Collector&);
  // Of whole networks: what Options::others and keep are of. Their Fusers save pipeline caches of their own.
  bool networks = false;
};
std::span<const Suite> suites();

// Runs a suite; an exception in a case is its failure, and the others go on.
void conform(const Suite& suite, const Target& target, const Options& options);

}  // namespace raymeld::conform
