#include "cli/common/outputs.h"

#include <cerrno>
#include <cstring>

#include "error.h"
#include "platform/files.h"

namespace raymeld::cli {

namespace fs = std::filesystem;

namespace {

bool is_same_file(const fs::path& a, const fs::path& b) {
  std::error_code error;
  const auto full = [&](const fs::path& path) { return fs::weakly_canonical(fs::absolute(path), error); };
  return fs::equivalent(a, b, error) || full(a) == full(b);
}

void check_folder(const fs::path& output) {
  std::error_code error;
  const fs::path folder = output.has_parent_path() ? output.parent_path() : ".";
  if (!fs::is_directory(folder, error)) {
    throw Error("cannot write '{}': there is no folder '{}'", output.string(), folder.string());
  }
  if (!may_write_in(folder)) {
    throw Error("cannot write '{}': folder '{}': {}", output.string(), folder.string(), std::strerror(errno));
  }
}

void check_place(const fs::path& output) {
  std::error_code error;
  if (fs::is_directory(output, error)) throw Error("cannot write '{}': it is a folder", output.string());
  if (fs::exists(output, error) && !fs::is_regular_file(output, error)) {
    throw Error("cannot write '{}': it is not a regular file", output.string());
  }
  check_folder(output);
}

}  // namespace

void check_outputs(std::span<const fs::path> outputs, std::span<const fs::path> inputs) {
  for (size_t i = 0; i < outputs.size(); ++i) {
    const fs::path& output = outputs[i];
    check_place(output);
    for (const fs::path& input : inputs) {
      if (is_same_file(output, input)) {
        throw Error("cannot write '{}': it is the same file as the input '{}'", output.string(),
                    input.string());
      }
    }
    for (const fs::path& other : outputs.first(i)) {
      if (is_same_file(output, other)) {
        throw Error("cannot write '{}': it is the same file as the output '{}'", output.string(),
                    other.string());
      }
    }
  }
}

void check_folders(std::span<const fs::path> outputs) {
  for (const fs::path& output : outputs) check_folder(output);
}

StagedFiles::~StagedFiles() {
  files_.clear();
  std::error_code error;
  for (const fs::path& folder : folders_) fs::remove(folder, error);
}

void StagedFiles::add(const fs::path& path, const std::function<void(AtomicFile&)>& write) {
  auto file = std::make_unique<AtomicFile>(path);
  write(*file);
  file->finish();
  files_.push_back(std::move(file));
}

void StagedFiles::add_folder(const fs::path& folder) {
  std::error_code error;
  if (fs::create_directory(folder, error)) folders_.push_back(folder);
  if (error) throw Error("cannot make the folder '{}': {}", folder.string(), error.message());
}

void StagedFiles::commit() {
  for (const auto& file : files_) file->publish();
  for (const auto& file : files_) file->sync_folder();
  files_.clear();
  folders_.clear();
}

void write_npy(AtomicFile& file, std::span<const float> values, size_t channels, size_t height,
               size_t width) {
  constexpr size_t kPrefixBytes = 10, kAlignmentBytes = 64;
  std::string header = fmt::format("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}, {}, {}), }}",
                                   channels, height, width);
  // The values start at a multiple of 64 bytes, after a line end.
  const size_t unpadded = kPrefixBytes + header.size() + 1;
  header.append((kAlignmentBytes - unpadded % kAlignmentBytes) % kAlignmentBytes, ' ');
  header += '\n';
  const std::string prefix = {
      '\x93', 'N', 'U', 'M', 'P', 'Y', 1, 0, char(header.size() % 256), char(header.size() / 256)};
  file.write(prefix.data(), prefix.size());
  file.write(header.data(), header.size());
  file.write(values.data(), values.size_bytes());
}

}  // namespace raymeld::cli
