// Reads a test set: scenes, each rendered with few and with many samples, and the times of the renders.
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
  uint32_t scale = 1;  // LRHS has one pixel for scale x scale
  double seconds = 0;  // time of the render

  double full_seconds() const { return seconds * scale * scale; }  // time for as many samples in all pixels
};

// Gives the time of rendering a scene as a line over the samples a pixel, fitted to the times of its renders.
struct RenderCost {
  double seconds = 0, seconds_per_sample = 0;  // all pixels together

  double of(uint32_t spp, uint32_t scale = 1) const {
    return (seconds + seconds_per_sample * spp) / (double(scale) * scale);
  }
};

// Fits a line that has a quarter of the times below it, as other work of a machine makes a render slower and
// never faster. Minimizes the sum of relative deviations, in which times below the line count three times.
RenderCost fit_cost(const std::vector<TestRender>& renders);

struct TestView {
  std::string name;
  std::vector<TestRender> lrhs = {}, hrls = {},
                          plain = {};  // each sorted by samples; `plain`: full-size renders, HRLS among them
  std::vector<std::filesystem::path> references = {};
  RenderCost cost = {};
};

// Reads a folder's view.json, or those of its subfolders in the order of their names: {"files": {NAME:
// {"spp", "seconds", "scale", "layers"}}}. Files whose names begin with "reference" are halves of the
// reference, and full-size files with the layers "fusion" are HRLS. Files with a scale whose names begin with
// "lowres" are LRHS, or else those whose names begin with "lrhs". Files with the layers "guides" are left
// out. Throws Error, naming the file.
std::vector<TestView> find_views(const std::filesystem::path& folder);

// Returns the mean of the reference's halves, (3, H, W). Throws Error.
Image load_reference(const TestView& view);

// Holds an LRHS and an HRLS render of a view.
struct TestPair {
  const TestView* view;
  const TestRender *lrhs, *hrls;

  double render_seconds() const { return view->cost.of(lrhs->spp, lrhs->scale) + view->cost.of(hrls->spp); }
};

// Returns the HRLS of the fewest samples and the LRHS whose total of samples is nearest to it. Throws Error
// when there is no LRHS of that scale.
TestPair first_pair(const TestView& view, uint32_t scale);

// Returns all pairs in which LRHS has at most as many samples in all as HRLS, and at least an eighth of them.
std::vector<TestPair> sensible_pairs(const TestView& view, uint32_t scale);

}  // namespace raymeld::cli
