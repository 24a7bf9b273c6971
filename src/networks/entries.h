// Reads the metadata of a model's file; docs/model-format.md lists the entries.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "networks/model.h"

namespace raymeld {

inline constexpr uint32_t kMostChannels = 1024, kMostRepeats = 64;

// Holds the metadata of `file`. What is asked for must be there and be right, else an Error names the file,
// the entry and what was expected.
class Entries {
 public:
  Entries(const std::map<std::string, std::string>& metadata, const std::string& file)
      : metadata_(metadata), file_(file) {}

  const std::string& text(const std::string& key) const;
  bool has(const std::string& key) const { return metadata_.contains(key); }
  uint32_t integer(const std::string& key, uint32_t least, uint32_t most) const;
  // Returns so many integers, which stand between commas.
  std::vector<uint32_t> integers(const std::string& key, size_t count, uint32_t least, uint32_t most) const;
  // Returns the entry, a positive number, or 0 where `or_zero` allows it.
  float number(const std::string& key, bool or_zero) const;
  // Returns whether the entry is `yes`; it must be `yes` or `no`.
  bool choice(const std::string& key, const std::string& yes, const std::string& no) const;
  // Returns the texts between the commas, or none if the entry is empty.
  std::vector<std::string> list(const std::string& key) const;
  [[noreturn]] void reject(const std::string& key, const std::string& expected) const;

 private:
  const std::map<std::string, std::string>& metadata_;
  const std::string& file_;
};

}  // namespace raymeld
