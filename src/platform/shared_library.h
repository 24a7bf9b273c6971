// Loads shared libraries while the program runs.
#pragma once

#include <span>

namespace raymeld {

// Holds the address of a symbol or, where there is none, why. `reason` is valid until the next call.
struct Symbol {
  void* address = nullptr;
  const char* reason = nullptr;
};

// Loads the first library of `names` that there is, for good, and finds a symbol in it.
Symbol load_symbol(std::span<const char* const> names, const char* symbol);

// Names the files in which this system may have the Vulkan loader, the likeliest first.
std::span<const char* const> vulkan_loaders();

}  // namespace raymeld
