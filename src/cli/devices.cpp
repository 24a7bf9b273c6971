#include <nlohmann/json.hpp>

#include "cli/common/commands.h"
#include "cli/common/console.h"
#include "cli/common/versions.h"
#include "engine/device.h"
#include "error.h"

namespace raymeld::cli {
namespace {

std::string matrix_text(const CooperativeMatrix& matrix) {
  return fmt::format("{}x{}x{}", matrix.m, matrix.n, matrix.k);
}

const char* yes_no(bool value) { return value ? "yes" : "no"; }

const char* promised(bool value) { return value ? "promised" : "not promised"; }

void print_device(const DeviceInfo& device) {
  print(fmt::format("{}: {}\n", device.index, device.name));
  const auto row = [](const char* name, const std::string& value) {
    print(fmt::format("   {:<28} {}\n", name, value));
  };
  row("type", device.type);
  row("UUID", device.uuid);
  row("driver", device.driver);
  row("Vulkan", version_text(device.api_version));
  row("memory", fmt::format("{:.0f} MiB", double(device.memory_bytes) / kMebibyte));
  row("largest binding", fmt::format("{:.0f} MiB", double(device.max_storage_range_bytes) / kMebibyte));
  row("largest allocation", fmt::format("{:.0f} MiB", double(device.max_allocation_bytes) / kMebibyte));
  row("subgroup size", std::to_string(device.subgroup_size));
  row("16-bit storage", yes_no(device.storage_16bit));
  row("16-bit arithmetic", yes_no(device.float16_arithmetic));
  row("rounds 16 bits to nearest", promised(device.float_controls.rounds));
  row("keeps 16-bit subnormals", promised(device.float_controls.keeps_subnormals));
  row("cooperative matrix", device.cooperative_matrix ? matrix_text(*device.cooperative_matrix) : "no");
  row("dot products of halves", yes_no(device.half_dots));
  row("writes images of any format", yes_no(device.image_writes));
  row("buffer device address", yes_no(device.buffer_device_address));
  row("timestamps",
      device.timestamp_period_ns > 0 ? fmt::format("every {:g} ns", device.timestamp_period_ns) : "no");
}

using Json = nlohmann::ordered_json;

Json to_json(const DeviceInfo& device) {
  return {{"index", device.index},
          {"name", device.name},
          {"type", device.type},
          {"uuid", device.uuid},
          {"driver", device.driver},
          {"api_version", version_text(device.api_version)},
          {"memory_bytes", device.memory_bytes},
          {"max_binding_bytes", device.max_storage_range_bytes},
          {"max_allocation_bytes", device.max_allocation_bytes},
          {"subgroup_size", device.subgroup_size},
          {"storage_16bit", device.storage_16bit},
          {"float16", device.float16_arithmetic},
          {"rounds_16bit_to_nearest", device.float_controls.rounds},
          {"keeps_16bit_subnormals", device.float_controls.keeps_subnormals},
          {"cooperative_matrix",
           device.cooperative_matrix ? Json(matrix_text(*device.cooperative_matrix)) : Json()},
          {"half_dots", device.half_dots},
          {"image_writes", device.image_writes},
          {"buffer_device_address", device.buffer_device_address},
          {"timestamp_period_ns", device.timestamp_period_ns}};
}

void list(bool json) {
  const std::vector<DeviceInfo> devices = list_devices();
  if (!json) {
    for (const DeviceInfo& device : devices) print_device(device);
    return;
  }
  auto all = Json::array();
  for (const DeviceInfo& device : devices) all.push_back(to_json(device));
  print(json_text(Json{{"devices", all}}));
}

}  // namespace

void add_devices(CLI::App& app) {
  CLI::App* command =
      app.add_subcommand("devices", "Lists the Vulkan devices and the features that raymeld uses");
  auto json = std::make_shared<bool>(false);
  command->add_flag("--json", *json, "Prints one JSON object instead of text");
  command->footer("Examples:\n  raymeld devices\n  raymeld fuse ... --device 1");
  command->callback([json] { list(*json); });
}

}  // namespace raymeld::cli
