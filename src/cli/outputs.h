#pragma once

#include <filesystem>
#include <span>
#include <vector>

#include "io/image.h"

namespace raymeld::cli {

// Throws Error, naming `output`, when it cannot be written where it is to go, or is one of `inputs`. To be
// asked before long work; says nothing about room on the disk.
void check_output(const std::filesystem::path& output, std::span<const std::filesystem::path> inputs);

// The files, and folders, of one run: removed again, the last first, unless all of them could be written. A
// folder that holds anything else stays.
class WrittenFiles {
 public:
  WrittenFiles() = default;
  ~WrittenFiles();
  WrittenFiles(const WrittenFiles&) = delete;
  WrittenFiles& operator=(const WrittenFiles&) = delete;

  void add(std::filesystem::path file) { files_.push_back(std::move(file)); }
  void keep() { files_.clear(); }

 private:
  std::vector<std::filesystem::path> files_;
};

// (C, H, W) as a NumPy file of little-endian float32, whole or not at all. Format:
// https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html, version 1.0. Throws Error.
void write_npy(const std::filesystem::path& path, std::span<const float> values, size_t channels,
               size_t height, size_t width);

}  // namespace raymeld::cli
