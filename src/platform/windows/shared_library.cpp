#include "platform/shared_library.h"

#include <windows.h>

#include <string>
#include <system_error>

namespace raymeld {

Symbol load_symbol(std::span<const char* const> names, const char* symbol) {
  for (const char* name : names) {
    const HMODULE library = LoadLibraryA(name);
    if (!library) continue;
    if (const FARPROC address = GetProcAddress(library, symbol))
      return {reinterpret_cast<void*>(address), nullptr};
    break;
  }
  const DWORD error = GetLastError();
  static thread_local std::string reason;
  reason = std::system_category().message(int(error));
  return {nullptr, reason.c_str()};
}

std::span<const char* const> vulkan_loaders() {
  static constexpr const char* kNames[] = {"vulkan-1.dll"};
  return kNames;
}

}  // namespace raymeld
