// Estimates how large a network's activations become, from its weights alone.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "layers/layers.h"

namespace raymeld {

// Maps a tensor's name to its exponent: 16 bits hold 2^-exponent times the tensor's values. Tensors that are
// not in the map have 0.
using StorageExponents = std::map<std::string, int>;

// Follows the mean and the variance of every channel through the convolutions of a graph, as if inputs were
// independent and sums normal. The result is an estimate: values that become larger saturate, are counted and
// can be computed again.
class ActivationEstimate {
 public:
  // Takes tensors that no convolution writes for noise between 0 and `range`.
  explicit ActivationEstimate(double range) : range_(range) {}

  // Adds a convolution; they must be added in the order of the network.
  void add(const Graph& graph, const Conv2dLink& link);
  // Adds the output of channel_means(), which gets the exponent of the input.
  void add_means(const Graph& graph, const Tensor& in, const Tensor& out);
  // Adds the output of attend(), which gets the exponent of the input and the residual.
  void add_attended(const Graph& graph, const Tensor& in, const Tensor& logits, const Tensor& residual,
                    const Tensor& out);

  // Returns the largest value expected in a tensor: |mean| + 8 standard deviations of its largest channel.
  // Returns 0 if no convolution writes the tensor.
  double largest(const std::string& tensor) const;

  // Returns the least exponents, up to kMostExponent, with which kHeadroom times the largest value of a
  // tensor is at most 65504. Tensors that are added to each other have the same exponent.
  StorageExponents exponents() const;

  static constexpr double kHeadroom = 2;
  // A larger power of two has no inverse that is a normal float.
  static constexpr double kMostExponent = 126;

 private:
  // Adds to the moments of `out` those of a tensor that share(channel) of is added to it.
  template <typename Share>
  void add_share(const Graph& graph, const Tensor& out, const Tensor& term, const Share& share);

  struct Moments {
    double mean = 0, variance = 0;
  };
  std::vector<Moments> inputs_of(const Graph& graph, const Conv2dLink& link) const;
  Moments sum_of(const Conv2dLink& link, const std::vector<Moments>& inputs, uint32_t o) const;

  double range_;
  std::map<std::string, std::vector<Moments>> tensors_;     // the moments of each channel
  std::vector<std::pair<std::string, std::string>> added_;  // pairs of a tensor and its residual
};

}  // namespace raymeld
