#include "conform/values.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "error.h"
#include "io/input_file.h"
#include "platform/atomic_file.h"

namespace raymeld::conform {
namespace {

using Json = nlohmann::ordered_json;

// JSON has neither NaN nor infinity, so they are written as "nan", "inf" and "-inf".
Json to_json(const std::vector<double>& values) {
  Json json = Json::array();
  for (const double value : values)
    json.push_back(std::isfinite(value) ? Json(value) : Json(fmt::format("{}", value)));
  return json;
}

std::vector<double> to_values(const Json& json) {
  std::vector<double> values;
  for (const Json& value : json)
    values.push_back(value.is_string() ? std::stod(value.get<std::string>()) : value.get<double>());
  return values;
}

}  // namespace

void write_values(const std::filesystem::path& file, const Values& values) {
  Json json{{"device", values.device}, {"outputs", Json::object()}};
  for (const auto& [name, output] : values.outputs)
    json["outputs"][name] = {{"shape", {output.c, output.h, output.w}}, {"values", to_json(output.data)}};
  write_whole(file, json.dump());
}

Values read_values(const std::filesystem::path& file) {
  check_input_file(file);
  try {
    std::ifstream stream(file);
    const Json json = Json::parse(stream);
    Values values{.device = json.at("device")};
    for (const auto& [name, output] : json.at("outputs").items()) {
      const auto shape = output.at("shape").get<std::array<int, 3>>();
      values.outputs[name] = {shape[0], shape[1], shape[2], to_values(output.at("values"))};
    }
    return values;
  } catch (const std::exception& error) {
    throw Error("'{}' is no file of raymeld conform --values: {}", file.string(), error.what());
  }
}

}  // namespace raymeld::conform
