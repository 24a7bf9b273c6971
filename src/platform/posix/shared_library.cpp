#include "platform/shared_library.h"

#include <dlfcn.h>

namespace raymeld {

Symbol load_symbol(std::span<const char* const> names, const char* symbol) {
  for (const char* name : names) {
    if (void* library = dlopen(name, RTLD_NOW | RTLD_LOCAL)) {
      void* address = dlsym(library, symbol);
      return {address, address ? nullptr : dlerror()};
    }
  }
  return {nullptr, dlerror()};
}

std::span<const char* const> vulkan_loaders() {
#ifdef __APPLE__
  static constexpr const char* kNames[] = {"libvulkan.1.dylib", "libvulkan.dylib", "libMoltenVK.dylib"};
#else
  static constexpr const char* kNames[] = {"libvulkan.so.1", "libvulkan.so"};
#endif
  return kNames;
}

}  // namespace raymeld
