#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "platform/atomic_file.h"

namespace raymeld::cli {

// Throws Error, naming the output, when one cannot be written where it is to go, or is the same file as
// another or as one of `inputs`. To be asked before long work; says nothing about room on the disk.
void check_outputs(std::span<const std::filesystem::path> outputs,
                   std::span<const std::filesystem::path> inputs);

// Throws Error unless each of the outputs has a folder that can be written to.
void check_folders(std::span<const std::filesystem::path> outputs);

// The files of one run, which appear at its end: whole, in the order of add(), one after the other, so that
// where the last is there all are. Without commit() nothing stays, and older files stay as they were.
class StagedFiles {
 public:
  StagedFiles() = default;
  ~StagedFiles();
  StagedFiles(const StagedFiles&) = delete;
  StagedFiles& operator=(const StagedFiles&) = delete;

  // Calls `write` and waits for the disk to have it. Throws Error.
  void add(const std::filesystem::path& file, const std::function<void(AtomicFile&)>& write);
  // Makes the folder unless it is there. Throws Error.
  void add_folder(const std::filesystem::path& folder);
  // Throws Error.
  void commit();

 private:
  std::vector<std::unique_ptr<AtomicFile>> files_;
  std::vector<std::filesystem::path> folders_;  // made by add_folder()
};

// (C, H, W) as a NumPy file of little-endian float32. Format:
// https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html, version 1.0. Throws Error.
void write_npy(AtomicFile& file, std::span<const float> values, size_t channels, size_t height, size_t width);

}  // namespace raymeld::cli
