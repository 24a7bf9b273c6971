#include "platform/folders.h"

#include <dlfcn.h>
#include <link.h>

#include <cstdlib>

namespace raymeld {

namespace fs = std::filesystem;

fs::path default_cache_folder() {
  if (const char* cache = std::getenv("XDG_CACHE_HOME"); cache && cache[0] == '/')
    return fs::path(cache) / "raymeld";
  if (const char* home = std::getenv("HOME"); home && home[0] == '/')
    return fs::path(home) / ".cache" / "raymeld";
  return {};
}

OwnFile own_file() {
  Dl_info info;
  void* loaded = nullptr;
  const auto here = reinterpret_cast<const void*>(&own_file);
  if (!dladdr1(here, &info, &loaded, RTLD_DL_LINKMAP)) return {};
  std::error_code error;
  const char* library = static_cast<const link_map*>(loaded)->l_name;  // "" stands for the program
  if (*library) return {fs::canonical(library, error), true};
  return {fs::read_symlink("/proc/self/exe", error), false};
}

}  // namespace raymeld
