#include "platform/folders.h"

#include <windows.h>

#include <cstdlib>
#include <string>

namespace raymeld {

namespace fs = std::filesystem;

fs::path default_cache_folder() {
  const wchar_t* data = _wgetenv(L"LOCALAPPDATA");
  return data && fs::path(data).is_absolute() ? fs::path(data) / "raymeld" : fs::path();
}

OwnFile own_file() {
  HMODULE module = nullptr;
  if (!GetModuleHandleExW(
          GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS | GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT,
          reinterpret_cast<LPCWSTR>(&own_file), &module))
    return {};
  std::wstring path(32768, L'\0');  // no path of Windows is longer
  path.resize(GetModuleFileNameW(module, path.data(), DWORD(path.size())));
  return {path, module != GetModuleHandleW(nullptr)};
}

}  // namespace raymeld
