#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "platform/atomic_file.h"

namespace raymeld::cli {

// Throws Error, naming the output, when an output cannot be written to its place, or is the same file as
// another one or as one of `inputs`. Serves before long work; does not look at the room on the disk.
void check_outputs(std::span<const std::filesystem::path> outputs,
                   std::span<const std::filesystem::path> inputs);

// Throws Error unless each of the outputs has a folder that can be written to.
void check_folders(std::span<const std::filesystem::path> outputs);

// Holds the files of one run until commit() makes them appear: whole, one by one in the order of add(), so
// that all exist if the last one does. Without commit() no file stays, and older files are unchanged.
class StagedFiles {
 public:
  StagedFiles() = default;
  ~StagedFiles();
  StagedFiles(const StagedFiles&) = delete;
  StagedFiles& operator=(const StagedFiles&) = delete;

  // Calls `write` and waits until the disk has the file's content. Throws Error.
  void add(const std::filesystem::path& file, const std::function<void(AtomicFile&)>& write);
  // Makes the folder unless it exists. Throws Error.
  void add_folder(const std::filesystem::path& folder);
  // Throws Error.
  void commit();

 private:
  std::vector<std::unique_ptr<AtomicFile>> files_;
  std::vector<std::filesystem::path> folders_;  // made by add_folder()
};

// Writes values of shape (C, H, W) as a NumPy file of little-endian float32. Format:
// https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html, version 1.0. Throws Error.
void write_npy(AtomicFile& file, std::span<const float> values, size_t channels, size_t height, size_t width);

}  // namespace raymeld::cli
