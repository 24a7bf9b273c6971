#pragma once

#include <gtest/gtest.h>

#include <deque>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "engine/program.h"
#include "layers/layers.h"
#include "reference/reference.h"
#include "support.h"

// What the tests on a device share: the device, one layer run alone, images in buffers, model files.
namespace raymeld::test {

// One device for all tests of a process, with validation and synchronization validation.
const Device& gpu();

// Fails a test during which the validation layers had something to say.
class GpuTest : public testing::Test {
 protected:
  void SetUp() override { gpu(); }
  void TearDown() override;
};

inline constexpr reference::Precision kPrecisions[] = {reference::Precision::kFp32,
                                                       reference::Precision::kFp16};
Storage storage_of(reference::Precision precision);
std::string name_of(reference::Precision precision);

// What a bit-exact layer must keep: the same bits, or NaN for NaN.
testing::AssertionResult same_bits(std::span<const float> actual, std::span<const float> expected);

// An image of floats in a buffer, laid out as a caller might. Everything that is not the image holds
// kUntouched.
class FrameImage {
 public:
  static constexpr float kUntouched = -12345.0f;

  struct Layout {
    uint64_t offset_bytes = 0;
    bool interleaved = false;
    uint32_t pixel_padding = 0;  // floats after each pixel (interleaved) or each plane
    uint32_t row_padding = 0;    // floats after each row
  };

  FrameImage(const Device& device, Shape shape, Memory memory, Layout layout);
  // Planar, dense, filled.
  FrameImage(const Device& device, const reference::Planes& image) : FrameImage(device, image, Layout{}) {}
  FrameImage(const Device& device, const reference::Planes& image, Layout layout);

  FrameBinding binding() const { return {view_, shape_}; }
  const FrameBuffer& view() const { return view_; }
  void write(const reference::Planes& image);
  reference::Planes read() const;
  // How many floats around the image no longer hold kUntouched.
  size_t touched_outside() const;

 private:
  size_t at(uint32_t c, uint32_t y, uint32_t x) const;
  std::span<float> values() const;

  Shape shape_;
  FrameBuffer view_;
  Buffer buffer_;
};

// The layouts that encode reads and decode writes in the tests: dense, interleaved, padded, at an offset that
// is no multiple of the storage alignment.
std::span<const FrameImage::Layout> frame_layouts();

// Runs all passes with descriptor set 0 and makes what they wrote visible to the host.
void run_passes(const Program& program, const Graph& graph);

// A graph run once: declare inputs, add layers to graph(), run(), read what came out.
class LayerRun {
 public:
  explicit LayerRun(reference::Precision precision, bool addressed = false);

  Graph& graph() { return graph_; }
  // A tensor that run() fills, rounding to the storage type.
  Tensor input(const std::string& name, const reference::Planes& values);
  Tensor tensor(const std::string& name, int c, int h, int w);
  // Keeps the weights for as long as the run.
  ConvWeights weights(const reference::Conv& conv);

  void run(const FrameBindings& frame = {}, float exposure = 1);
  reference::Planes read(const Tensor& tensor) const;
  Status status() const { return program_->status(); }

 private:
  Graph graph_;
  std::vector<std::pair<Tensor, std::vector<float>>> inputs_;
  std::deque<std::vector<float>> weights_;
  std::unique_ptr<Program> program_;
};

// One cache of compiled pipelines for the tests of a process, in a folder that goes with it.
PipelineCache& shared_cache();
std::filesystem::path shared_cache_folder();

// A model file as training/ writes it; `other` metadata take the place of what follows from the architecture.
std::map<std::string, std::string> model_metadata(const reference::Architecture& architecture);
void write_model(const std::filesystem::path& path, const reference::Architecture& architecture,
                 const reference::Weights& weights, const std::map<std::string, std::string>& other = {});

}  // namespace raymeld::test
