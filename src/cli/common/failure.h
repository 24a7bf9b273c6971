// Turns exceptions into messages and exit statuses; no other file does that.
#pragma once

#include <string>

namespace raymeld::cli {

inline constexpr int kInternalError = 1, kError = 2, kInterrupted = 130;

struct Failure {
  int status = kError;
  std::string message;
};

// Returns the message and exit status for the exception being handled. Must be called in a catch block.
Failure current_failure();

}  // namespace raymeld::cli
