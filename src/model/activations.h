// How large a network's activations become, told from its weights alone.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "layers/layers.h"

namespace raymeld {

// By the tensor's name: 16 bits hold 2^-exponent times what the tensor stands for. Those that are not there
// have 0.
using StorageExponents = std::map<std::string, int>;

// Follows mean and variance of every channel through the convolutions of a graph, as if its inputs were
// independent and sums normal. An estimate: what becomes larger than expected saturates, is counted and can
// be computed again.
class ActivationEstimate {
 public:
  // `range`: what the tensors that no convolution writes may reach; they are taken for noise between 0 and
  // that.
  explicit ActivationEstimate(double range) : range_(range) {}

  // In the order of the network.
  void add(const Graph& graph, const Conv2dLink& link);

  // What is expected of a tensor: |mean| + 8 standard deviations of its largest channel. 0: no convolution
  // writes it.
  double largest(const std::string& tensor) const;

  // The least exponents, up to kMostExponent, that leave kHeadroom between these and 65504, one for all
  // tensors that are added to each other.
  StorageExponents exponents() const;

  static constexpr double kHeadroom = 2;
  static constexpr double kMostExponent = 126;  // of powers of two that have an inverse

 private:
  struct Moments {
    double mean = 0, variance = 0;
  };
  std::vector<Moments> inputs_of(const Graph& graph, const Conv2dLink& link) const;
  Moments sum_of(const Conv2dLink& link, const std::vector<Moments>& inputs, uint32_t o) const;

  double range_;
  std::map<std::string, std::vector<Moments>> tensors_;     // each channel's
  std::vector<std::pair<std::string, std::string>> added_;  // of which one is a residual of the other
};

}  // namespace raymeld
