// Loads shared libraries while the program runs.
#pragma once

#include <initializer_list>

namespace raymeld {

// Holds the address of a symbol or, where there is none, why. `reason` is valid until the next call.
struct Symbol {
  void* address = nullptr;
  const char* reason = nullptr;
};

// Loads the first library of `names` that there is, for good, and finds a symbol in it.
Symbol load_symbol(std::initializer_list<const char*> names, const char* symbol);

}  // namespace raymeld
