#pragma once

#include <filesystem>
#include <functional>
#include <span>
#include <vector>

#include "io/image.h"

namespace raymeld::cli {

// Throws Error, naming the output, when one cannot be written where it is to go, or is the same file as
// another or as one of `inputs`. To be asked before long work; says nothing about room on the disk.
void check_outputs(std::span<const std::filesystem::path> outputs,
                   std::span<const std::filesystem::path> inputs);

// The files of one run, which appear together at its end: until commit() each lies under a temporary name
// beside its place, and an older file of that name stays as it was. Without commit() nothing stays.
class StagedFiles {
 public:
  StagedFiles() = default;
  ~StagedFiles();
  StagedFiles(const StagedFiles&) = delete;
  StagedFiles& operator=(const StagedFiles&) = delete;

  // Calls `write` with the temporary name; its Errors name `file` instead.
  void add(const std::filesystem::path& file, const std::function<void(const std::filesystem::path&)>& write);
  // Makes the folder unless it is there. Throws Error.
  void add_folder(const std::filesystem::path& folder);
  // Renames all, in the order of add(). Throws Error.
  void commit();

 private:
  struct Staged {
    std::filesystem::path temporary, target;
  };
  std::vector<Staged> files_;
  std::vector<std::filesystem::path> folders_;  // made by add_folder()
};

// (C, H, W) as a NumPy file of little-endian float32, whole or not at all. Format:
// https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html, version 1.0. Throws Error.
void write_npy(const std::filesystem::path& path, std::span<const float> values, size_t channels,
               size_t height, size_t width);

}  // namespace raymeld::cli
