#pragma once

#include <tuple>

#include "conform/conform.h"

namespace raymeld::conform {

// The cases of one layer by one kernel in one precision.
struct Row {
  std::string layer, kernel;
  reference::Precision precision;
  size_t passed = 0, failed = 0, unsupported = 0;
  Finding worst = {};        // of those that were tried
  std::string missing = {};  // why the others were not

  size_t tried() const { return passed + failed; }
};

// Findings summed up.
class Report {
 public:
  void add(const Finding& finding);

  const std::vector<Row>& rows() const { return rows_; }  // in the order of their first case
  const std::vector<Finding>& failures() const { return failures_; }
  size_t cases(Outcome outcome) const;
  // Says why the device does not conform: a case failed, or none passed. Empty where it does.
  std::string complaint() const;

 private:
  std::vector<Row> rows_;
  std::vector<Finding> failures_;
};

// Where a finding's worst value is: "random, 3 -> 8 channels, 9 x 7, at c 1, y 0, x 3".
std::string place(const Finding& finding);

}  // namespace raymeld::conform
