// Writes measurements to the disk as soon as they are made, so that a command that was stopped can continue.
#pragma once

#include <cstdio>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace raymeld::cli {

class Journal {
 public:
  using Values = std::vector<double>;

  // Continues `file` if it was begun for the same `subject`, which holds all that measurements depend on
  // beside their names. Else begins a new file. Throws Error.
  Journal(const std::filesystem::path& file, const std::string& subject);

  size_t size() const { return values_.size(); }

  // Returns the values that the journal has under `name`. If it has none, calls `measure` and keeps its
  // values if all are finite. Throws Error, and what `measure` throws.
  Values get(const std::string& name, const std::function<Values()>& measure);

  // Removes the file; called when the command has finished.
  void remove();

 private:
  void write(const std::string& line);

  std::filesystem::path path_;
  std::map<std::string, Values> values_;
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> file_{nullptr, std::fclose};
};

}  // namespace raymeld::cli
