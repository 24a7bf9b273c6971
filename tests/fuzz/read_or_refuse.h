#pragma once

#include "error.h"

namespace raymeld::test {

// An Error is as right as a success; whatever else is thrown is not.
template <typename Work>
void read_or_refuse(Work&& work) {
  try {
    work();
  } catch (const Error&) {
  }
}

}  // namespace raymeld::test
