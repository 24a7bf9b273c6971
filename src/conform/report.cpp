#include "conform/report.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <set>

namespace raymeld::conform {

void Report::add(const Finding& finding) {
  const Case& of = finding.of;
  auto row = std::ranges::find_if(rows_, [&](const Row& r) {
    return std::tie(r.layer, r.kernel, r.precision) == std::tie(of.layer, of.kernel, of.precision);
  });
  if (row == rows_.end())
    row = rows_.insert(row, {.layer = of.layer, .kernel = of.kernel, .precision = of.precision});
  if (finding.outcome == Outcome::kUnsupported) {
    ++row->unsupported;
    row->missing = finding.message;
    return;
  }
  if (row->tried() == 0 || finding.worst.ratio > row->worst.worst.ratio) row->worst = finding;
  ++(finding.outcome == Outcome::kPassed ? row->passed : row->failed);
  if (finding.outcome == Outcome::kFailed) failures_.push_back(finding);
}

size_t Report::cases(Outcome outcome) const {
  size_t count = 0;
  for (const Row& row : rows_) {
    count += outcome == Outcome::kPassed   ? row.passed
             : outcome == Outcome::kFailed ? row.failed
                                           : row.unsupported;
  }
  return count;
}

std::string Report::complaint() const {
  if (!failures_.empty()) return fmt::format("{} of the device's cases failed", failures_.size());
  if (cases(Outcome::kPassed) > 0) return {};
  std::set<std::string> missing;
  for (const Row& row : rows_) missing.insert(row.missing);
  return fmt::format("no case passed: {} are unsupported ({})", cases(Outcome::kUnsupported),
                     fmt::join(missing, ", "));
}

std::string place(const Finding& finding) {
  const auto& [ratio, c, y, x, actual, expected, bound, failures] = finding.worst;
  const std::string what = finding.where.empty() ? "" : finding.where + ", ";
  return fmt::format("{}{}, at c {}, y {}, x {}", what, finding.of.shape, c, y, x);
}

}  // namespace raymeld::conform
