// Declares the parts of the command `trade`: settings are measured over a test set, summed up and reported.
#pragma once

#include <map>

#include "choice/curve.h"
#include "cli/fuse/fuse.h"
#include "cli/trade/journal.h"
#include "cli/trade/test_set.h"
#include "io/png.h"

namespace raymeld::cli {

// Holds the choices that a user has for a given pair of renders.
struct TradeSetting {
  std::string model;
  uint32_t scale = 0;
  Precision precision = Precision::kFp32;
  KernelChoice kernels = KernelChoice::kAuto;

  // Returns true for one setting of each model; the curve and the strips of views are made of these.
  bool is_plain() const { return precision == Precision::kFp32 && kernels == KernelChoice::kAuto; }
};

// Holds the result for one pair of renders.
struct TradeResult {
  std::string view;
  double time_ms = 0;  // time of Fuser::fuse()
  uint64_t memory_bytes = 0;
  Quality quality = {};
};

struct SettingResults {
  TradeSetting setting;
  uint32_t lrhs_spp = 0, hrls_spp = 0;
  double fp64_error = 0;  // the largest difference from the reference in double, in steps of 8-bit sRGB
  std::vector<TradeResult> results = {};  // one for each view
};

// Holds means over the views for a pair of renders, or for a plain render, which has an empty `model`.
struct RenderResults {
  std::string model;
  uint32_t scale = 1, lrhs_spp = 0, hrls_spp = 0;
  double render_seconds = 0, fuse_seconds = 0;
  double psnr_db = 0, relmse = 0;
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
  int width = 0, height = 0;  // size of the first view
  std::vector<SettingResults> settings;
  std::vector<RenderResults> renders;
  std::vector<TradeStrip> strips;
};

// Measures every setting over the views, each with its first_pair(). Goes through all settings in rounds of a
// few views, so that other work of the machine affects all settings alike. Does not measure again what
// `journal` has. Throws Error and Cancelled.
std::vector<SettingResults> measure_settings(const std::vector<TestView>& views,
                                             const std::vector<TradeSetting>& settings, const Device& device,
                                             Journal& journal, Console& console);

// Measures the settings over all balanced_pairs(), and the plain renders. Throws Error and Cancelled.
std::vector<RenderResults> measure_pairs(const std::vector<TestView>& views,
                                         const std::vector<TradeSetting>& settings, const Device& device,
                                         Journal& journal, Console& console);

// Draws the views with the worst, the median and the best PSNR of the first setting; all settings must have
// one scale. Shows LRHS, HRLS, the image of each setting and the reference, each with its error below, in a
// window of at most 256 pixels a side where the error of the first setting is largest.
std::vector<TradeStrip> make_strips(const std::vector<TestView>& views,
                                    const std::vector<SettingResults>& settings, const Device& device);

// Draws one window of each image, and below it the heat_map() of its error. The window has at most 256 pixels
// a side and lies where the error of `judged` is largest. All images must have the reference's size.
Picture strip_of(const std::vector<Image>& images, const Image& reference, const Image& judged);

// Marks the points (cost, PSNR) whose PSNR is at least 0.01 dB above every marked point that costs no more.
std::vector<bool> on_front(const std::vector<std::pair<double, double>>& points);

// These sum up a setting's results.
double median_time_ms(const SettingResults& results);
double mean_psnr_db(const SettingResults& results);

nlohmann::ordered_json to_json(const Trade& trade);
// Returns a row for each setting and view.
std::string trade_csv(const Trade& trade);
// Returns one page that needs no other file.
std::string trade_html(const Trade& trade);
// Makes a curve of the settings that are is_plain().
Curve curve_of(const Trade& trade);

}  // namespace raymeld::cli
