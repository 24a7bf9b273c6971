// A test set on the disk: scenes, each rendered with few and with many samples, and what that took.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "cli/common/console.h"
#include "io/image.h"

namespace raymeld::cli {

struct TestRender {
  std::filesystem::path file;
  uint32_t spp = 0;
  uint32_t scale = 1;  // of LRHS: one of scale x scale pixels
  double seconds = 0;  // that the render took

  double full_seconds() const { return seconds * scale * scale; }  // of as many samples for all pixels
};

// What a render of a scene takes, by the samples of each pixel: a line through the times of all its renders.
struct RenderCost {
  double seconds = 0, seconds_per_sample = 0;  // of all pixels

  double of(uint32_t spp, uint32_t scale = 1) const {
    return (seconds + seconds_per_sample * spp) / (double(scale) * scale);
  }
};

// Whatever else a machine does makes a render slower and never faster, so the line has a quarter of the times
// below it: the least sum of relative deviations, counted three times where they are below.
RenderCost fit_cost(const std::vector<TestRender>& renders);

struct TestView {
  std::string name;
  std::vector<TestRender> lrhs = {}, hrls = {},
                          plain = {};  // each by samples; `plain`: full-size renders, HRLS among them
  std::vector<std::filesystem::path> references = {};
  RenderCost cost = {};
};

// Of a folder's view.json, or of those in its folders, by name: {"files": {NAME: {"spp", "seconds", "scale",
// "layers"}}}. Names that begin with "reference" are halves of the truth, those with a scale that begin with
// "lrhs" are LRHS, those of which the layers are "fusion" HRLS. Throws Error naming the file.
std::vector<TestView> find_views(const std::filesystem::path& folder);

// (3, H, W), the mean of the halves. Throws Error.
Image load_reference(const TestView& view);

// An LRHS and an HRLS render of a view.
struct TestPair {
  const TestView* view;
  const TestRender *lrhs, *hrls;

  double render_seconds() const { return view->cost.of(lrhs->spp, lrhs->scale) + view->cost.of(hrls->spp); }
};

// HRLS of the fewest samples, and LRHS that has as many in all, or about. Throws Error where there is no LRHS
// of that scale.
TestPair first_pair(const TestView& view, uint32_t scale);

// All of which neither has more than twice the samples of the other in all.
std::vector<TestPair> balanced_pairs(const TestView& view, uint32_t scale);

}  // namespace raymeld::cli
