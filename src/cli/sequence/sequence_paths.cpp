#include <array>
#include <set>

#include "cli/sequence/sequence.h"

namespace raymeld::cli {
namespace {

namespace fs = std::filesystem;

struct PathOption {
  const char* name;
  std::string FuseArguments::*path;
  bool written;
};

constexpr std::array<PathOption, 8> kPathOptions = {
    {{"--lrhs", &FuseArguments::lrhs, false},
     {"--hrls", &FuseArguments::hrls, false},
     {"--guides", &FuseArguments::guides, false},
     {"--reference", &FuseArguments::reference, false},
     {"--output", &FuseArguments::output, true},
     {"--preview", &FuseArguments::preview, true},
     {"--preview-before-after", &FuseArguments::before_after, true},
     {"--dump", &FuseArguments::dump, true}}};

// Makes the folder of `path` canonical, so that two names of one file are equal.
std::string with_full_folder(const std::string& path) {
  const fs::path given = path.substr(0, path.find_last_not_of('/') + 1);
  std::error_code error;
  return fs::weakly_canonical(fs::absolute(given.parent_path() / "."), error) / given.filename();
}

// Throws Error when an output is written twice or is an input. Only file names have frame numbers, so folders
// are resolved once and not for each frame.
void check_distinct(FuseArguments patterns, std::span<const int> frames) {
  for (const PathOption& option : kPathOptions) {
    std::string& path = patterns.*option.path;
    if (!path.empty()) path = with_full_folder(path);
  }
  const auto each_path = [&](bool written, const auto& visit) {
    for (const int frame : frames) {
      for (const PathOption& option : kPathOptions) {
        const std::string& pattern = patterns.*option.path;
        if (option.written == written && !pattern.empty()) visit(frame_path(pattern, frame));
      }
    }
  };
  std::set<std::string> outputs;
  each_path(true, [&](const std::string& path) {
    if (!outputs.insert(path).second) throw Error("cannot write '{}': two outputs have this name", path);
  });
  each_path(false, [&](const std::string& path) {
    if (outputs.contains(path)) throw Error("cannot write '{}': it is an input of the sequence", path);
  });
}

}  // namespace

FuseArguments of_frame(const FuseArguments& patterns, int frame) {
  FuseArguments arguments = patterns;
  for (const PathOption& option : kPathOptions) {
    arguments.*option.path = frame_path(patterns.*option.path, frame);
  }
  return arguments;
}

void check_no_patterns(const FuseArguments& arguments) {
  for (const PathOption& option : kPathOptions) {
    if (is_pattern(arguments.*option.path)) {
      throw Error("{} '{}' has a # for the number of a frame, which needs --frames", option.name,
                  arguments.*option.path);
    }
  }
}

void check_patterns(const FuseArguments& patterns, std::span<const int> frames) {
  const Task task = patterns.task();
  if (task == Task::kDenoise && !is_pattern(patterns.hrls))
    throw Error("--frames: --hrls '{}' has no # for the frame's number in its file name", patterns.hrls);
  if (task == Task::kUpscale && !is_pattern(patterns.lrhs))
    throw Error("--frames: --lrhs '{}' has no # for the frame's number in its file name", patterns.lrhs);
  if (!is_pattern(patterns.lrhs) && !is_pattern(patterns.hrls)) {
    throw Error(
        "--frames: neither --lrhs '{}' nor --hrls '{}' has a # for the frame's number in its file name",
        patterns.lrhs, patterns.hrls);
  }
  for (const PathOption& option : kPathOptions) {
    const std::string& path = patterns.*option.path;
    if (option.written && !path.empty() && !is_pattern(path)) {
      throw Error(
          "{} '{}' has no # for the frame's number in its file name: all frames would be written to it",
          option.name, path);
    }
  }
  check_distinct(patterns, frames);
}

}  // namespace raymeld::cli
