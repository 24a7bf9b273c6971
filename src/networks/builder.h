// Adds a model's network to a graph. A layer's name is the key of its weights.
#pragma once

#include "networks/network.h"

namespace raymeld {

// Has what the networks share.
struct Builder {
  Graph& graph;
  const Model& model;
  const Conv2dChoice& choose;
  const StorageExponents& exponents;
  const HrlsChannels& hrls_channels;
  SampleCounts samples = {};
  uint32_t history_channels = 0;  // HRLS channels that history_channels() returned; 0: no history is kept
  Joining joining = {};           // matters where a history is kept
  ActivationEstimate* estimate = nullptr;  // follows the convolutions, unless null
  const Architecture& a = model.architecture();

  Tensor tensor(const std::string& name, uint32_t height, uint32_t width, uint32_t channels);

  // Returns a convolution with the weights of layer `name`.
  Conv2dLink link(const std::string& name, const Tensor& in, const Tensor& out, Conv2dOptions options,
                  const std::string& bias = "bias");

  void conv(const std::string& name, const Tensor& in, const Tensor& out, const Conv2dOptions& options,
            const std::string& bias = "bias");

  // Adds a convolution that upscales `x` by `factor` into as many `features`; `options` says all else of it.
  Tensor shuffled(std::vector<Conv2dLink>& links, const std::string& name, const Tensor& x, uint32_t factor,
                  uint32_t features, Conv2dOptions options = {.kernel = 3, .relu = true});

  // Encodes the color of LRHS (h, w, 3).
  void encode_lrhs(const Tensor& lrhs, const std::optional<FrameSize>& frame = {});

  // Encodes channels [first, last) of `hrls`: from one buffer, or each layer from its own image. The variance
  // is written by variance() where the device computes it.
  void encode_hrls(const std::string& name, const Tensor& hrls, uint32_t first, uint32_t last,
                   const std::optional<FrameSize>& frame = {});

  // Returns the channels of a layer of the encoded HRLS.
  Tensor layer(const Tensor& hrls, const std::string& name) const;
};

class Entries;

// Holds what a network's file defines.
struct NetworkFunctions {
  const char* name;  // the entry `network` of docs/model-format.md
  uint32_t least_scale, most_scale;
  // Reads the entries that are this network's own.
  void (*parse)(const Entries& entries, Architecture& a);
  // Adds the network for an LRHS of this size.
  void (*add)(Builder build, uint32_t height, uint32_t width, float phase);
  // Returns what receptive_halo() does. It follows the right-most output pixel of LRHS pixel 0 back through
  // the longest paths to LRHS and to HRLS: a 3x3 reaches one pixel further at its own resolution, a 5x5 two,
  // and a shuffle moves to the outermost pixel of the other resolution.
  uint32_t (*halo)(const Architecture& a, bool compute_variance);
};

const NetworkFunctions& functions_of(NetworkKind kind);

}  // namespace raymeld
