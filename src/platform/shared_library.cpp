#include "platform/shared_library.h"

#include <dlfcn.h>

namespace raymeld {

Symbol load_symbol(std::initializer_list<const char*> names, const char* symbol) {
  for (const char* name : names) {
    if (void* library = dlopen(name, RTLD_NOW | RTLD_LOCAL)) {
      void* address = dlsym(library, symbol);
      return {address, address ? nullptr : dlerror()};
    }
  }
  return {nullptr, dlerror()};
}

}  // namespace raymeld
