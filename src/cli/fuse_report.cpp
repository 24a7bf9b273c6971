#include "cli/fuse.h"

namespace raymeld::cli {
namespace {

// Operations, or bytes, in `time_ms`, in thousands of millions a second; 0 where no time was measured.
double giga_per_second(double count, double time_ms) { return time_ms > 0 ? count / time_ms * 1e-6 : 0; }

std::string row(const std::string& name, double time_ms, double flop, double bytes) {
  return fmt::format("{:<30} {:>12.3f} {:>10.2f} {:>10.2f}\n", name, time_ms, giga_per_second(flop, time_ms),
                     giga_per_second(bytes, time_ms));
}

const char* rule_name(LayerRule rule) {
  switch (rule) {
    case LayerRule::kRead:
      return "read";
    case LayerRule::kEquation2:
      return "color * (direct + indirect)";
    case LayerRule::kSum:
      return "sum";
    case LayerRule::kVariance:
      return "variance";
  }
  return "";
}

}  // namespace

std::string profile_text(const FuseReport& report) {
  std::string text;
  PassTime total;
  for (const auto& [what, times] : {std::pair("layer", &report.layers), {"kernel", &report.kernels}}) {
    text += fmt::format("{:<30} {:>12} {:>10} {:>10}\n", what, "ms", "GFLOP/s", "GB/s");
    total = {};
    for (const PassTime& time : *times) {
      text += row(time.name, time.time_ms, time.flop, time.bytes);
      total.time_ms += time.time_ms;
      total.flop += time.flop;
      total.bytes += time.bytes;
    }
  }
  return text + row("total", total.time_ms, total.flop, total.bytes);
}

nlohmann::ordered_json to_json(const std::vector<PassTime>& times) {
  auto json = nlohmann::ordered_json::array();
  for (const PassTime& time : times) {
    json.push_back({{"name", time.name},
                    {"ms", time.time_ms},
                    {"gflop_per_s", giga_per_second(time.flop, time.time_ms)},
                    {"gb_per_s", giga_per_second(time.bytes, time.time_ms)}});
  }
  return json;
}

nlohmann::ordered_json to_json(const LayerMap& map) {
  auto json = nlohmann::ordered_json::object();
  for (const auto& [layer, source] : map.layers)
    json[layer] = {{"rule", rule_name(source.rule)}, {"channels", source.terms}};
  return json;
}

}  // namespace raymeld::cli
