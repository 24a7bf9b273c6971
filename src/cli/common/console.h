#pragma once

#include <fmt/format.h>

#include <chrono>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "numbers.h"

namespace raymeld::cli {

// To stdout, at once. Throws Error.
void print(const std::string& text);

// Says if print() was called with any text: a second object of JSON would then make stdout unreadable.
bool has_printed();

// Indented, ending with \n; bytes of file names that are no UTF-8 are replaced.
std::string json_text(const nlohmann::ordered_json& json);

// "raymeld: error: MESSAGE" to stderr.
void complain(const std::string& message);

struct Warning {
  std::string message;
  uint64_t count = 1;  // of the values or pixels concerned
};

nlohmann::ordered_json to_json(const std::vector<Warning>& warnings);

// What the program says on stderr beside errors. Threads may say things at once, each with a Console of its
// own.
class Console {
 public:
  // `about`: begins every message, such as "frame 7: ".
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

// How far a long piece of work is: a bar on a terminal, a line every few seconds elsewhere.
class ProgressBar {
 public:
  explicit ProgressBar(const Console& console);
  ~ProgressBar();  // wipes the bar
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;

  void update(double share);  // in [0, 1]

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
