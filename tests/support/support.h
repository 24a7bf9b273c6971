#pragma once

#include <chrono>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "io/safetensors.h"
#include "reference/samples.h"

namespace raymeld::test {

using reference::awkward_sizes;
using reference::Fill;
using reference::floats;
using reference::planes;
using reference::random_conv;
using reference::random_planes;
using reference::random_weights;
using reference::round_to;
using reference::Size;
using reference::special_values;

// Makes a folder, and removes it with all its content when destroyed.
class TemporaryDirectory {
 public:
  TemporaryDirectory();
  ~TemporaryDirectory();
  TemporaryDirectory(const TemporaryDirectory&) = delete;
  TemporaryDirectory& operator=(const TemporaryDirectory&) = delete;
  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path operator/(const std::filesystem::path& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

// Rounds values to their tensor's type.
void write_safetensors(const std::filesystem::path& path, const SafeTensors& content);

// Returns the bytes of a value as they lie in memory.
template <typename Value>
std::string bytes_of(const Value& value) {
  std::string bytes(sizeof(value), '\0');
  std::memcpy(bytes.data(), &value, sizeof(value));
  return bytes;
}

std::string read_file(const std::filesystem::path& path);
void write_file(const std::filesystem::path& path, std::string_view content);
std::filesystem::path source_path(const std::filesystem::path& relative);  // a path in the repository

// Sets a variable of the environment, or unsets it where `value` is null.
void set_variable(const char* name, const char* value);

// Sets the folder in which programs of this user have their folders of caches.
void set_cache_home(const std::filesystem::path& folder);

// Returns the first groups of all matches of a regular expression in a file.
std::set<std::string> names_in(const std::filesystem::path& file, const char* pattern);

// Returns the names of the layers that src/layers/layers.h declares.
std::set<std::string> layer_names();

// Returns whether RAYMELD_TEST_EXTENT=full asks for every combination of what a test tries.
bool full_extent();

// Returns whether a combination is to be tried: all of them at full extent, else the first of each `step`. A
// step that shares no divisor with the number of values of a factor tries every one of these values.
bool is_tried(size_t index, size_t step);

struct ProcessOptions {
  std::filesystem::path directory = {};  // working directory, or empty for the current one
  std::map<std::string, std::optional<std::string>> environment = {};  // nullopt unsets a variable
  int signal = 0;  // sent once, `signal_delay` after stderr holds `signal_after`
  std::string signal_after = {};
  std::chrono::microseconds signal_delay{0};
  std::function<void()> then = {};  // called once at that moment, also without a signal
};

struct ProcessResult {
  int exit_status = -1;  // -1 when a signal ended it
  int signal = 0;        // the signal that ended it, if any
  std::string out, err;
};

// Runs a process and waits for its end. argv[0] is looked up in PATH, stdin is empty, and signals have their
// default actions. Throws std::system_error when the process cannot start.
ProcessResult run_process(const std::vector<std::string>& argv, const ProcessOptions& options = {});

}  // namespace raymeld::test
