#include "networks/entries.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>

namespace raymeld {
namespace {

// Returns the integer that all of the text is, or nothing if it is none or out of range.
std::optional<uint32_t> parsed(const std::string& text, uint32_t least, uint32_t most) {
  uint32_t number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  const bool whole = error == std::errc() && end == text.data() + text.size();
  return whole && number >= least && number <= most ? std::optional(number) : std::nullopt;
}

}  // namespace

const std::string& Entries::text(const std::string& key) const {
  const auto found = metadata_.find(key);
  if (found == metadata_.end()) throw Error("model {}: metadata entry \"{}\" is missing", file_, key);
  return found->second;
}

uint32_t Entries::integer(const std::string& key, uint32_t least, uint32_t most) const {
  const std::optional<uint32_t> number = parsed(text(key), least, most);
  if (!number) reject(key, fmt::format("an integer from {} to {}", least, most));
  return *number;
}

std::vector<uint32_t> Entries::integers(const std::string& key, size_t count, uint32_t least,
                                        uint32_t most) const {
  const std::vector<std::string> items = list(key);
  std::vector<uint32_t> result;
  for (const std::string& item : items) {
    const std::optional<uint32_t> number = parsed(item, least, most);
    if (number) result.push_back(*number);
  }
  if (items.size() != count || result.size() != count)
    reject(key, fmt::format("{} integers from {} to {}", count, least, most));
  return result;
}

float Entries::number(const std::string& key, bool or_zero) const {
  const std::string& value = text(key);
  float number = 0;
  const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), number);
  if (error != std::errc() || end != value.data() + value.size() || !std::isfinite(number) || number < 0 ||
      (number == 0 && !or_zero)) {
    reject(key, or_zero ? "a positive number or 0" : "a positive number");
  }
  return number;
}

bool Entries::choice(const std::string& key, const std::string& yes, const std::string& no) const {
  const std::string& value = text(key);
  if (value != yes && value != no) reject(key, fmt::format("\"{}\" or \"{}\"", yes, no));
  return value == yes;
}

std::vector<std::string> Entries::list(const std::string& key) const {
  const std::string& value = text(key);
  std::vector<std::string> items;
  for (size_t begin = 0; begin <= value.size() && !value.empty();) {
    const size_t end = std::min(value.find(',', begin), value.size());
    items.push_back(value.substr(begin, end - begin));
    begin = end + 1;
  }
  return items;
}

void Entries::reject(const std::string& key, const std::string& expected) const {
  throw Error("model {}: metadata entry \"{}\" is \"{}\", expected {}", file_, key, text(key), expected);
}

}  // namespace raymeld
