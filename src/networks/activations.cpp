#include "networks/activations.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace raymeld {
namespace {

const std::string& name_of(const Graph& graph, const Tensor& tensor) {
  return graph.tensors()[tensor.id].name;
}

}  // namespace

// Returns the moments of a convolution's input channels, each as often as unshuffling makes channels of it.
std::vector<ActivationEstimate::Moments> ActivationEstimate::inputs_of(const Graph& graph,
                                                                       const Conv2dLink& link) const {
  std::vector<Moments> inputs;
  const auto append = [&](const Tensor& tensor) {
    const auto known = tensors_.find(name_of(graph, tensor));
    for (uint32_t c = 0; c < tensor.shape.channels; ++c) {
      const Moments channel = known == tensors_.end() ? Moments{range_ / 2, range_ * range_ / 4}
                                                      : known->second.at(tensor.channel_offset + c);
      inputs.insert(inputs.end(), size_t{link.options.unshuffle} * link.options.unshuffle, channel);
    }
  };
  append(link.in);
  if (link.options.second_input) append(*link.options.second_input);
  return inputs;
}

// Returns the moments of output channel `o` before residuals. Neighbouring pixels may be alike or
// independent; the larger variance of the two counts.
ActivationEstimate::Moments ActivationEstimate::sum_of(const Conv2dLink& link,
                                                       const std::vector<Moments>& inputs, uint32_t o) const {
  const size_t taps = size_t{link.options.kernel} * link.options.kernel;
  const float* weight = link.weights.weight.data() + o * inputs.size() * taps;
  Moments sum{link.weights.bias_of(o), 0};
  for (const auto& [mean, variance] : inputs) {
    double total = 0, squares = 0;
    for (size_t tap = 0; tap < taps; ++tap, ++weight) {
      total += *weight;
      squares += double{*weight} * *weight;
    }
    sum.mean += mean * total;
    sum.variance += variance * std::max(squares, total * total);
  }
  if (!link.options.relu || sum.variance == 0) {
    if (link.options.relu) sum.mean = std::max(sum.mean, 0.0);
    return sum;
  }
  // These are the moments of a rectified normal distribution.
  const double deviation = std::sqrt(sum.variance), t = sum.mean / deviation;
  const double above = std::erfc(-t / std::numbers::sqrt2) / 2;
  const double density = std::exp(-t * t / 2) / std::sqrt(2 * std::numbers::pi);
  const double mean = sum.mean * above + deviation * density;
  const double square = (sum.mean * sum.mean + sum.variance) * above + sum.mean * deviation * density;
  return {mean, std::max(0.0, square - mean * mean)};
}

void ActivationEstimate::add(const Graph& graph, const Conv2dLink& link) {
  const std::vector<Moments> inputs = inputs_of(graph, link);
  std::vector<Moments>& channels = tensors_[name_of(graph, link.out)];
  channels.resize(graph.tensors()[link.out.id].shape.channels);
  const uint32_t shuffled = link.options.shuffle * link.options.shuffle;
  for (uint32_t o = 0; o < link.out.shape.channels * shuffled; ++o) {
    const Moments sum = sum_of(link, inputs, o);
    Moments& channel = channels.at(link.out.channel_offset + o / shuffled);
    if (o % shuffled == 0) channel = {};
    if (std::abs(sum.mean) > std::abs(channel.mean)) channel.mean = sum.mean;
    channel.variance = std::max(channel.variance, sum.variance);
  }
  for (const Tensor& residual : link.options.residuals)
    add_share(graph, link.out, residual, [](uint32_t) { return 1.0; });
}

// Means over many pixels hardly vary.
void ActivationEstimate::add_means(const Graph& graph, const Tensor& in, const Tensor& out) {
  add_share(graph, out, in, [](uint32_t) { return 1.0; });
  for (Moments& channel : tensors_.at(name_of(graph, out))) channel.variance = 0;
}

void ActivationEstimate::add_attended(const Graph& graph, const Tensor& in, const Tensor& logits,
                                      const Tensor& residual, const Tensor& out) {
  const std::vector<Moments>& known = tensors_.at(name_of(graph, logits));
  add_share(graph, out, in, [&](uint32_t c) { return 1 / (1 + std::exp(-known.at(c).mean)); });
  add_share(graph, out, residual, [](uint32_t) { return 1.0; });
}

template <typename Share>
void ActivationEstimate::add_share(const Graph& graph, const Tensor& out, const Tensor& term,
                                   const Share& share) {
  std::vector<Moments>& channels = tensors_[name_of(graph, out)];
  channels.resize(graph.tensors()[out.id].shape.channels);
  const std::string& name = name_of(graph, term);
  added_.emplace_back(name_of(graph, out), name);
  for (uint32_t c = 0; c < out.shape.channels; ++c) {
    const Moments& other = tensors_.at(name).at(term.channel_offset + c);
    Moments& channel = channels.at(out.channel_offset + c);
    channel.mean += share(c) * other.mean;
    channel.variance += share(c) * share(c) * other.variance;
  }
}

double ActivationEstimate::largest(const std::string& tensor) const {
  double most = 0;
  const auto known = tensors_.find(tensor);
  if (known == tensors_.end()) return most;
  for (const auto& [mean, variance] : known->second)
    most = std::max(most, std::abs(mean) + 8 * std::sqrt(variance));
  return most;
}

StorageExponents ActivationEstimate::exponents() const {
  StorageExponents result;
  for (const auto& [name, channels] : tensors_) {
    const double over = largest(name) * kHeadroom / 65504;
    result[name] = over > 1 ? static_cast<int>(std::ceil(std::min(std::log2(over), kMostExponent))) : 0;
  }
  for (bool changed = true; changed;) {
    changed = false;
    for (const auto& [a, b] : added_) {
      int &first = result.at(a), &second = result.at(b);
      changed |= first != second;
      first = second = std::max(first, second);
    }
  }
  return result;
}

}  // namespace raymeld
