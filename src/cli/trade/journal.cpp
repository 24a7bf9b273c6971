#include "cli/trade/journal.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>

#include "error.h"

namespace raymeld::cli {
namespace {

// Replaces bytes that are not UTF-8, as in some file names.
std::string text_of(const nlohmann::json& json) {
  return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

// Adds a line's values. Returns false if the line was not written to its end.
bool read_line(const std::string& line, std::map<std::string, Journal::Values>& values) try {
  const nlohmann::json json = nlohmann::json::parse(line);
  values[json.at(0)] = json.at(1).get<Journal::Values>();
  return true;
} catch (const nlohmann::json::exception&) {
  return false;
}

}  // namespace

Journal::Journal(const std::filesystem::path& file, const std::string& subject) : path_(file) {
  const std::string first = text_of(subject);
  uintmax_t size = 0;  // size of the whole lines in bytes
  std::ifstream stream(file);
  std::string line;
  if (std::getline(stream, line) && !stream.eof() && line == first) {
    size = line.size() + 1;
    while (std::getline(stream, line) && !stream.eof() && read_line(line, values_)) size += line.size() + 1;
  }
  std::error_code error;
  if (size > 0) std::filesystem::resize_file(file, size, error);
  if (error) throw Error("opening '{}': {}", file.string(), error.message());
  file_.reset(std::fopen(file.c_str(), size > 0 ? "a" : "w"));
  if (!file_) throw Error("opening '{}': {}", file.string(), std::strerror(errno));
  if (size == 0) write(first);
}

void Journal::write(const std::string& line) {
  if (std::fputs((line + "\n").c_str(), file_.get()) < 0 || std::fflush(file_.get()) != 0)
    throw Error("writing '{}': {}", path_.string(), std::strerror(errno));
}

Journal::Values Journal::get(const std::string& name, const std::function<Values()>& measure) {
  const auto found = values_.find(name);
  if (found != values_.end()) return found->second;
  Values values = measure();
  if (std::ranges::all_of(values, [](double value) { return std::isfinite(value); })) {
    write(text_of({name, values}));
    values_[name] = values;
  }
  return values;
}

void Journal::remove() {
  file_.reset();
  std::error_code error;
  std::filesystem::remove(path_, error);
}

}  // namespace raymeld::cli
