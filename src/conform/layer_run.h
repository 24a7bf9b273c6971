#pragma once

#include <deque>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "engine/program.h"
#include "layers/layers.h"
#include "reference/reference.h"

namespace raymeld::conform {

// Holds the device that is tested and its caches. They outlive everything that is made with them.
struct Target {
  const Device& device;
  PipelineCache& cache;
  std::filesystem::path cache_folder;  // folder of `cache` and of Fusers' own caches; empty: none
};

inline constexpr reference::Precision kPrecisions[] = {reference::Precision::kFp32,
                                                       reference::Precision::kFp16};
Storage storage_of(reference::Precision precision);
std::string name_of(reference::Precision precision);

// Runs all passes with descriptor set 0 and makes what they wrote visible to the host.
void run_passes(const Device& device, const Program& program, const Graph& graph);

// Runs a graph once: declare inputs, add layers to graph(), call run(), then read() any layer's output.
class LayerRun {
 public:
  LayerRun(const Target& target, reference::Precision precision, bool addressed = false);

  Graph& graph() { return graph_; }
  // Declares a tensor that run() fills with `values`, rounded to the storage type.
  Tensor input(const std::string& name, const reference::Planes& values);
  Tensor tensor(const std::string& name, int c, int h, int w);
  // Keeps the weights as long as this object lives.
  ConvWeights weights(const reference::Conv& conv);

  void run(const FrameBindings& frame = {}, float exposure = 1, const Place& place = {});
  reference::Planes read(const Tensor& tensor) const;
  Status status() const { return program_->status(); }
  Exposure exposure() const { return program_->exposure(0); }

 private:
  const Target& target_;
  Graph graph_;
  std::vector<std::pair<Tensor, std::vector<float>>> inputs_;
  std::deque<std::vector<float>> weights_;
  std::unique_ptr<Program> program_;
};

}  // namespace raymeld::conform
