// Measurements that are on the disk as soon as they are made, so that a long command goes on after it was
// stopped.
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

  // Goes on with `file` where it was begun for the same `subject`: all that the measurements depend on beside
  // their names. Else begins it anew. Throws Error.
  Journal(const std::filesystem::path& file, const std::string& subject);

  size_t size() const { return values_.size(); }

  // What the journal has under `name`; else what `measure` gives, which it then has, if all of it is finite.
  // Throws Error, and whatever `measure` does.
  Values get(const std::string& name, const std::function<Values()>& measure);

  // Once nothing is to be gone on with.
  void remove();

 private:
  void write(const std::string& line);

  std::filesystem::path path_;
  std::map<std::string, Values> values_;
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> file_{nullptr, std::fclose};
};

}  // namespace raymeld::cli
