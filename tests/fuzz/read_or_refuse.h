#pragma once

#include "error.h"

namespace raymeld::test {

// Accepts success and an Error; any other exception is a failure.
template <typename Work>
void read_or_refuse(Work&& work) {
  try {
    work();
  } catch (const Error&) {
  }
}

}  // namespace raymeld::test
