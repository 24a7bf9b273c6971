// Finds the folders and files that a system gives a program.
#pragma once

#include <filesystem>

namespace raymeld {

// Returns $XDG_CACHE_HOME/raymeld, else $HOME/.cache/raymeld, and on Windows %LOCALAPPDATA%\raymeld. Returns
// an empty path when no variable holds an absolute path: then nothing is cached on disk.
std::filesystem::path default_cache_folder();

// Names the file that this code was loaded from.
struct OwnFile {
  std::filesystem::path path;  // empty if unknown
  bool is_library = false;     // false: it is the program itself
};
OwnFile own_file();

}  // namespace raymeld
