#pragma once

#include "error.h"

namespace raymeld::test {

// Whether `work` came to its end; an Error is the other right one.
template <typename Work>
bool succeeds(Work&& work) {
  try {
    work();
    return true;
  } catch (const Error&) {
    return false;
  }
}

}  // namespace raymeld::test
