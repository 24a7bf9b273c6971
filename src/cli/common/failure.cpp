#include "cli/common/failure.h"

#include <new>

#include "error.h"

namespace raymeld::cli {

Failure current_failure() try { throw; } catch (const Error& error) {
  return {kError, error.what()};
} catch (const std::bad_alloc&) {
  return {kError, "there is not enough memory for images of this size"};
} catch (const std::exception& error) {
  return {kInternalError, fmt::format("internal error: {}", error.what())};
}

}  // namespace raymeld::cli
