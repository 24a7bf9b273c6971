// The parts of the command `trade`: settings are measured over a test set, summed up and reported.
#pragma once

#include <map>

#include "cli/fuse/fuse.h"
#include "cli/trade/journal.h"
#include "cli/trade/test_set.h"
#include "choice/curve.h"
#include "io/png.h"

namespace raymeld::cli {

// What a user can choose for a given pair of renders.
struct TradeSetting {
  std::string model;
  uint32_t scale = 0;
  Precision precision = Precision::kFp32;
  KernelChoice kernels = KernelChoice::kAuto;

  // Of each model one: what a curve and the reports of views are made of.
  bool is_plain() const { return precision == Precision::kFp32 && kernels == KernelChoice::kAuto; }
};

// Of one pair of renders.
struct TradeResult {
  std::string view;
  double time_ms = 0;  // of Fuser::fuse()
  uint64_t memory_bytes = 0;
  Quality quality = {};
};

struct SettingResults {
  TradeSetting setting;
  uint32_t lrhs_spp = 0, hrls_spp = 0;
  double fp64_error = 0;  // the largest difference from the reference in double, in steps of 8-bit sRGB
  std::vector<TradeResult> results = {};  // of each view
};

// Means over the views of what pairs of renders give, and plain ones; `model` is empty for these.
struct RenderResults {
  std::string model;
  uint32_t scale = 1, lrhs_spp = 0, hrls_spp = 0;
  double render_seconds = 0, fuse_seconds = 0;
  double psnr_db = 0, relmse = 0;
};

struct PairResults {
  std::vector<RenderResults> renders;
  std::map<std::string, std::vector<Observation>> observations;  // by model: of each view and pair
};

struct TradeStrip {
  std::string title;
  std::vector<std::string> images = {};
  Picture picture = {};
};

struct Trade {
  DeviceInfo device;
  std::string data;
  std::vector<TestView> views;
  int width = 0, height = 0;  // of the first view
  std::vector<SettingResults> settings;
  PairResults pairs;
  std::vector<TradeStrip> strips;
};

// Every setting over the views, each with its first_pair(). Rounds of a few views each go through all
// settings, so that what else the machine does meets all alike. What `journal` has is not measured again.
// Throws Error and Cancelled.
std::vector<SettingResults> measure_settings(const std::vector<TestView>& views,
                                             const std::vector<TradeSetting>& settings, const Device& device,
                                             Journal& journal, Console& console);

// The settings over all balanced_pairs(), and what plain renders give.
PairResults measure_pairs(const std::vector<TestView>& views, const std::vector<TradeSetting>& settings,
                          const Device& device, Journal& journal, Console& console);

// Of the views that the first of the settings, all of one scale, fuses worst, in the middle and best: LRHS,
// HRLS, what each setting makes of them, the reference; below each its error. A window of at most 256 pixels
// where the first setting is off most.
std::vector<TradeStrip> make_strips(const std::vector<TestView>& views,
                                    const std::vector<SettingResults>& settings, const Device& device);

// Of each image, all of one size with the reference, a window of at most 256 pixels, the one where `judged`
// is off most; below it its error, as heat_map() shows it.
Picture strip_of(const std::vector<Image>& images, const Image& reference, const Image& judged);

// Marks the points of cost and PSNR that bring at least 0.01 dB more than any that costs less, or as much.
std::vector<bool> on_front(const std::vector<std::pair<double, double>>& points);

// What is summed up of a setting's results.
double median_time_ms(const SettingResults& results);
double mean_psnr_db(const SettingResults& results);

nlohmann::ordered_json to_json(const Trade& trade);
// A row for each setting and view.
std::string trade_csv(const Trade& trade);
// One page that needs no other file.
std::string trade_html(const Trade& trade);
// Of the settings that are is_plain(), whose pairs must be measured. Throws Error when there are too few
// scenes.
Curve curve_of(const Trade& trade);

}  // namespace raymeld::cli
