#pragma once

#include <fmt/format.h>

#include <chrono>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "numbers.h"

namespace raymeld::cli {

// Writes to stdout and flushes it. Throws Error.
void print(const std::string& text);

// Returns whether print() was called with any text; a second JSON object would then make stdout unreadable.
bool has_printed();

// Returns indented text that ends with \n. Bytes that are not UTF-8, as in some file names, are replaced.
std::string json_text(const nlohmann::ordered_json& json);

// Writes "raymeld: error: MESSAGE" to stderr.
void complain(const std::string& message);

struct Warning {
  std::string message;
  uint64_t count = 1;  // number of values or pixels concerned
};

nlohmann::ordered_json to_json(const std::vector<Warning>& warnings);

// Writes notes and warnings to stderr. Several threads may write at a time, each with a Console of its own.
class Console {
 public:
  // Every message begins with `about`, such as "frame 7: ".
  explicit Console(bool notes, std::string about = "") : notes_(notes), about_(std::move(about)) {}

  bool notes() const { return notes_; }
  void note(const std::string& text) const;
  void warn(const std::string& message, uint64_t count);
  const std::vector<Warning>& warnings() const { return warnings_; }

 private:
  bool notes_;
  std::string about_;
  std::vector<Warning> warnings_;
};

// Shows the progress of long work: a bar on a terminal, a line every few seconds elsewhere.
class ProgressBar {
 public:
  explicit ProgressBar(const Console& console);
  ~ProgressBar();  // wipes the bar
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;

  void update(double share);  // the share is in [0, 1]

 private:
  using Clock = std::chrono::steady_clock;

  bool shown_, terminal_;
  Clock::time_point last_line_ = Clock::now();
};

class Stopwatch {
 public:
  double ms() const {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace raymeld::cli
