#pragma once

#include <tuple>

#include "conform/conform.h"

namespace raymeld::conform {

// Sums up the cases of one layer with one kernel in one precision.
struct Row {
  std::string layer, kernel;
  reference::Precision precision;
  size_t passed = 0, failed = 0, unsupported = 0;
  Finding worst = {};        // the finding with the largest error / bound
  std::string missing = {};  // the reason why cases are unsupported

  size_t tried() const { return passed + failed; }
};

// Sums findings up.
class Report {
 public:
  void add(const Finding& finding);

  const std::vector<Row>& rows() const { return rows_; }  // ordered by their first case
  const std::vector<Finding>& failures() const { return failures_; }
  size_t cases(Outcome outcome) const;
  // Says why the device does not conform: a case failed, or none passed. The result is empty where it does.
  std::string complaint() const;

 private:
  std::vector<Row> rows_;
  std::vector<Finding> failures_;
};

// Returns the place of a finding's worst value: "random, 3 -> 8 channels, 9 x 7, at c 1, y 0, x 3".
std::string place(const Finding& finding);

}  // namespace raymeld::conform
