#include "cli/conform_values.h"

#include <fstream>
#include <nlohmann/json.hpp>

#include "error.h"
#include "io/atomic_file.h"
#include "io/input_file.h"

namespace raymeld::cli {

using Json = nlohmann::ordered_json;

void write_values(const std::filesystem::path& file, const conform::Values& values) {
  Json json{{"device", values.device}, {"outputs", Json::object()}};
  for (const auto& [name, output] : values.outputs)
    json["outputs"][name] = {{"shape", {output.c, output.h, output.w}}, {"values", output.data}};
  const std::string text = json.dump();
  AtomicFile out(file);
  out.write(text.data(), text.size());
  out.commit();
}

conform::Values read_values(const std::filesystem::path& file) {
  check_input_file(file);
  try {
    std::ifstream stream(file);
    const Json json = Json::parse(stream);
    conform::Values values{.device = json.at("device")};
    for (const auto& [name, output] : json.at("outputs").items()) {
      const auto shape = output.at("shape").get<std::array<int, 3>>();
      values.outputs[name] = {shape[0], shape[1], shape[2], output.at("values").get<std::vector<double>>()};
    }
    return values;
  } catch (const std::exception& error) {
    throw Error("'{}' is no file of raymeld conform --values: {}", file.string(), error.what());
  }
}

}  // namespace raymeld::cli
