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

// What everything is tried on. All of it outlives what is made with it.
struct Target {
  const Device& device;
  PipelineCache& cache;
  std::filesystem::path cache_folder;  // of `cache`, for a Fuser's own; empty: none on disk
};

inline constexpr reference::Precision kPrecisions[] = {reference::Precision::kFp32,
                                                       reference::Precision::kFp16};
Storage storage_of(reference::Precision precision);
std::string name_of(reference::Precision precision);

// Runs all passes with descriptor set 0 and makes what they wrote visible to the host.
void run_passes(const Device& device, const Program& program, const Graph& graph);

// A graph run once: declare inputs, add layers to graph(), run(), read what came out of any of them.
class LayerRun {
 public:
  LayerRun(const Target& target, reference::Precision precision, bool addressed = false);

  Graph& graph() { return graph_; }
  // A tensor that run() fills, rounding to the storage type.
  Tensor input(const std::string& name, const reference::Planes& values);
  Tensor tensor(const std::string& name, int c, int h, int w);
  // Keeps the weights for as long as the run.
  ConvWeights weights(const reference::Conv& conv);

  void run(const FrameBindings& frame = {}, float exposure = 1);
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
