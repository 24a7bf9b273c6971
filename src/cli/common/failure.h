// The one place where exceptions become messages and exit statuses.
#pragma once

#include <string>

namespace raymeld::cli {

inline constexpr int kInternalError = 1, kError = 2, kInterrupted = 130;

struct Failure {
  int status = kError;
  std::string message;
};

// What the exception that is being handled means to the user. To be called in a catch block.
Failure current_failure();

}  // namespace raymeld::cli
