// Writes the measurements of raymeld trade as JSON, CSV and HTML, and makes a curve of them.
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "cli/trade/trade.h"
#include "cli/trade/trade_page.h"

namespace raymeld::cli {
namespace {

using Json = nlohmann::ordered_json;
using Values = std::vector<double>;

// Smaller steps do not count: kernels round differently, and the figures of docs/ have two decimals.
constexpr double kLeastStepDb = 0.01;

// Encodes bytes as RFC 4648 defines it.
std::string base64(std::span<const char> bytes) {
  constexpr std::string_view kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (size_t at = 0; at < bytes.size(); at += 3) {
    const size_t count = std::min<size_t>(3, bytes.size() - at);
    uint32_t group = 0;
    for (size_t i = 0; i < 3; ++i) group = group << 8 | (i < count ? uint8_t(bytes[at + i]) : 0);
    for (size_t i = 0; i < 4; ++i) text += i <= count ? kDigits[group >> (18 - 6 * i) & 63] : '=';
  }
  return text;
}

// Interpolates linearly between neighbours; `q` is from 0 to 1.
double quantile(Values values, double q) {
  std::ranges::sort(values);
  const double at = q * double(values.size() - 1);
  const auto below = size_t(at);
  return std::lerp(values[below], values[std::min(below + 1, values.size() - 1)], at - double(below));
}

double mean(const Values& values) {
  double sum = 0;
  for (const double value : values) sum += value;
  return sum / double(values.size());
}

template <typename Member>
Values values_of(const SettingResults& of, const Member& member) {
  Values values;
  for (const TradeResult& result : of.results) values.push_back(member(result));
  return values;
}

Values times_ms(const SettingResults& of) {
  return values_of(of, [](const TradeResult& result) { return result.time_ms; });
}

double memory_bytes(const SettingResults& of) {
  return std::ranges::max(
      values_of(of, [](const TradeResult& result) { return double(result.memory_bytes); }));
}

double mean_relmse(const SettingResults& of) {
  return mean(values_of(of, [](const TradeResult& result) { return result.quality.relmse_bcr; }));
}

const char* precision_of(const TradeSetting& setting) {
  return setting.precision == Precision::kFp16 ? "fp16" : "fp32";
}

const char* kernels_of(const TradeSetting& setting) {
  return setting.kernels == KernelChoice::kDirect ? "direct" : "auto";
}

// Marks the settings on the front of cost and PSNR of their scale.
template <typename Cost>
std::vector<bool> fronts(const std::vector<SettingResults>& settings, const Cost& cost) {
  std::vector<bool> result(settings.size());
  for (size_t i = 0; i < settings.size(); ++i) {
    std::vector<std::pair<double, double>> points;
    size_t own = 0;
    for (size_t j = 0; j < settings.size(); ++j) {
      if (settings[j].setting.scale != settings[i].setting.scale) continue;
      if (j == i) own = points.size();
      points.emplace_back(cost(settings[j]), mean_psnr_db(settings[j]));
    }
    result[i] = on_front(points)[own];
  }
  return result;
}

Json settings_json(const Trade& trade) {
  const std::vector<bool> time_front = fronts(trade.settings, median_time_ms),
                          memory_front = fronts(trade.settings, memory_bytes);
  Json json = Json::array();
  for (size_t i = 0; i < trade.settings.size(); ++i) {
    const SettingResults& of = trade.settings[i];
    const Values times = times_ms(of);
    json.push_back({{"id", i},
                    {"scale", of.setting.scale},
                    {"model", of.setting.model},
                    {"precision", precision_of(of.setting)},
                    {"kernels", kernels_of(of.setting)},
                    {"lrhs_spp", of.lrhs_spp},
                    {"hrls_spp", of.hrls_spp},
                    {"time_ms",
                     {{"lower", quantile(times, 0.25)},
                      {"median", quantile(times, 0.5)},
                      {"upper", quantile(times, 0.75)}}},
                    {"memory_bytes", uint64_t(memory_bytes(of))},
                    {"psnr_db", mean_psnr_db(of)},
                    {"relmse", mean_relmse(of)},
                    {"fp64_error", of.fp64_error},
                    {"time_front", bool(time_front[i])},
                    {"memory_front", bool(memory_front[i])}});
  }
  return json;
}

Json renders_json(const Trade& trade) {
  std::vector<std::pair<double, double>> points;
  for (const RenderResults& render : trade.renders)
    points.emplace_back(render.render_seconds + render.fuse_seconds, render.psnr_db);
  const std::vector<bool> front = on_front(points);
  Json json = Json::array();
  for (size_t i = 0; i < trade.renders.size(); ++i) {
    const RenderResults& render = trade.renders[i];
    json.push_back({{"scale", render.scale},
                    {"model", render.model},
                    {"lrhs_spp", render.lrhs_spp},
                    {"hrls_spp", render.hrls_spp},
                    {"render_s", render.render_seconds},
                    {"fuse_s", render.fuse_seconds},
                    {"psnr_db", render.psnr_db},
                    {"relmse", render.relmse},
                    {"front", bool(front[i])}});
  }
  return json;
}

}  // namespace

std::vector<bool> on_front(const std::vector<std::pair<double, double>>& points) {
  std::vector<size_t> order(points.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::ranges::stable_sort(order, {},
                           [&](size_t i) { return std::pair(points[i].first, -points[i].second); });
  std::vector<bool> front(points.size());
  double best = -std::numeric_limits<double>::infinity();
  for (const size_t i : order) {
    if (points[i].second < best + kLeastStepDb) continue;
    front[i] = true;
    best = points[i].second;
  }
  return front;
}

double median_time_ms(const SettingResults& results) { return quantile(times_ms(results), 0.5); }

double mean_psnr_db(const SettingResults& results) {
  return mean(values_of(results, [](const TradeResult& result) { return result.quality.psnr_db; }));
}

Json to_json(const Trade& trade) {
  Json json{{"raymeld", RAYMELD_VERSION},     {"device", trade.device.name},
            {"driver", trade.device.driver},  {"data", trade.data},
            {"views", Json::array()},         {"settings", settings_json(trade)},
            {"renders", renders_json(trade)}, {"measurements", Json::array()}};
  for (const TestView& view : trade.views)
    json["views"].push_back({{"name", view.name}, {"width", trade.width}, {"height", trade.height}});
  for (size_t i = 0; i < trade.settings.size(); ++i) {
    for (const TradeResult& result : trade.settings[i].results) {
      json["measurements"].push_back({{"view", result.view},
                                      {"setting", i},
                                      {"time_ms", result.time_ms},
                                      {"psnr_db", result.quality.psnr_db},
                                      {"relmse", result.quality.relmse_bcr}});
    }
  }
  return json;
}

std::string trade_csv(const Trade& trade) {
  std::string text =
      "view,scale,lrhs_spp,hrls_spp,model,precision,kernels,time_ms,memory_bytes,psnr_db,relmse,"
      "fp64_error\n";
  for (const SettingResults& of : trade.settings) {
    for (const TradeResult& result : of.results) {
      text += fmt::format(
          "{},{},{},{},{},{},{},{:.2f},{},{:.4f},{:.6f},{:.4g}\n", result.view, of.setting.scale, of.lrhs_spp,
          of.hrls_spp, of.setting.model, precision_of(of.setting), kernels_of(of.setting), result.time_ms,
          result.memory_bytes, result.quality.psnr_db, result.quality.relmse_bcr, of.fp64_error);
    }
  }
  return text;
}

std::string trade_html(const Trade& trade) {
  Json json = to_json(trade);
  json["strips"] = Json::array();
  for (const TradeStrip& strip : trade.strips) {
    json["strips"].push_back({{"title", strip.title},
                              {"images", strip.images},
                              {"width", strip.picture.width},
                              {"height", strip.picture.height},
                              {"png", base64(png_bytes(strip.picture))}});
  }
  std::string data = json.dump();
  for (size_t at = 0; (at = data.find('<', at)) != std::string::npos;) data.replace(at, 1, "\\u003c");
  std::string page = kTradePage;
  constexpr std::string_view kPlace = R"(<script type="application/json" id="data">{}</script>)";
  const size_t at = page.find(kPlace);
  return page.replace(at + kPlace.find("{}"), 2, data);
}

Curve curve_of(const Trade& trade) {
  Curve curve{trade.device.name, trade.data, {}};
  for (const SettingResults& of : trade.settings) {
    if (!of.setting.is_plain()) continue;
    curve.points.push_back({of.setting.model, of.setting.scale, median_time_ms(of), mean_psnr_db(of)});
  }
  return curve;
}

}  // namespace raymeld::cli
