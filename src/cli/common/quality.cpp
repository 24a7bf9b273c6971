#include "cli/common/quality.h"

#include <fmt/format.h>

#include "choice/metrics.h"

namespace raymeld::cli {

Quality measure(const Image& image, const Image& reference) {
  return {psnr_srgb(image, reference), relmse(image, reference, kRelMseBcr),
          relmse(image, reference, kRelMseGharbi)};
}

std::string table(const QualityTable& rows) {
  std::string text =
      fmt::format("{:<13} {:>10} {:>12} {:>14}\n", "", "psnr_db", "relmse_bcr", "relmse_gharbi");
  for (const auto& [name, quality] : rows) {
    text += fmt::format("{:<13} {:>10.4g} {:>12.4g} {:>14.4g}\n", name, quality.psnr_db, quality.relmse_bcr,
                        quality.relmse_gharbi);
  }
  return text;
}

nlohmann::ordered_json to_json(const QualityTable& rows) {
  auto json = nlohmann::ordered_json::object();
  for (const auto& [name, quality] : rows) {
    json[name] = {{"psnr_db", quality.psnr_db},
                  {"relmse_bcr", quality.relmse_bcr},
                  {"relmse_gharbi", quality.relmse_gharbi}};
  }
  return json;
}

}  // namespace raymeld::cli
