#pragma once

#include <fmt/format.h>

#include <stdexcept>
#include <string>
#include <utility>

namespace raymeld {

// Is thrown for bad input or a failing device. The message says what raymeld was doing, names the file or
// layer, and says what was expected. Any other exception but Cancelled is an internal error.
class Error : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;

  template <typename... Args>
  explicit Error(fmt::format_string<Args...> format, Args&&... args)
      : std::runtime_error(fmt::format(format, std::forward<Args>(args)...)) {}
};

// Is thrown when a progress callback or a signal asks for the work to stop; its output has not been written.
class Cancelled : public std::runtime_error {
 public:
  Cancelled() : std::runtime_error("cancelled") {}
};

}  // namespace raymeld
