#pragma once

#include <functional>

#include "conform/conform.h"
#include "reference/samples.h"

namespace raymeld::conform {

// How a layer is computed: by which kernel, with activations in buffers or by address.
struct Method {
  std::string name;
  Conv2dKernel kernel = {};
  bool addressed = false;

  // The arguments of reference::conv2d().
  int tile() const { return int(kernel.winograd_tile()); }
  int units() const { return kernel.algorithm == Algorithm::kMatrix ? reference::kMatrixUnits : 1; }
};

// Of layers with one kernel.
std::span<const Method> plain_methods();
// Two sizes of tiles, so small that a convolution has several: those that the device's matrices and its
// shared memory allow. Where they allow none, one that is impossible, and so unsupported.
std::vector<MatrixTiles> matrix_tiles(const DeviceInfo& device, uint32_t kernel);

// What a case's comparisons are handed to; its finding keeps the worst of them.
class Check {
 public:
  explicit Check(Finding& finding) : finding_(finding) {}

  // `what`: which of several comparisons this is.
  void within(const reference::Planes& actual, const reference::Bounded& expected,
              const std::string& what = {});
  // The RMS error is at most so large.
  void rms(const reference::Planes& actual, const reference::Planes& truth, double allowed,
           const std::string& what);
  // The same bits, or NaN for NaN.
  void same_bits(const reference::Planes& actual, const reference::Planes& expected,
                 const std::string& what = {});
  void that(bool holds, const std::string& otherwise);

 private:
  void take(const reference::Worst& worst, size_t values, const std::string& what);

  Finding& finding_;
};

class Collector {
 public:
  Collector(const Target& target, const Options& options) : target_(target), options_(options) {}

  const Target& target() const { return target_; }
  const Device& device() const { return target_.device; }
  const Options& options() const { return options_; }
  bool full() const { return options_.extent == Extent::kFull; }
  // All awkward sizes, or some.
  std::span<const reference::Size> sizes() const;

  // One case, unless the device lacks what it takes.
  void run(const std::string& layer, const Method& method, reference::Precision precision,
           const std::string& shape, const std::function<void(Check&)>& body) const;
  // One that cannot be tried, for want of what `missing` names.
  void unsupported(const Case& of, const std::string& missing) const;
  // Calls `body` for all ways in both precisions; matrices are of 16-bit storage only.
  static void for_each(std::span<const Method> methods,
                       const std::function<void(const Method&, reference::Precision)>& body);

 private:
  void judge(Finding finding, const std::function<void(Check&)>& body) const;

  const Target& target_;
  const Options& options_;
};

}  // namespace raymeld::conform
