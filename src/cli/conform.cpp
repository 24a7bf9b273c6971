// Checks a device and its driver against the scalar reference.
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "cli/common/commands.h"
#include "cli/common/console.h"
#include "cli/common/outputs.h"
#include "cli/common/versions.h"
#include "conform/report.h"
#include "conform/values.h"
#include "engine/kernel_pool.h"
#include "platform/folders.h"
#include "platform/interrupt.h"

namespace raymeld::cli {
namespace {

using conform::Finding;
using conform::Outcome;
using conform::Report;
using conform::Row;
using Json = nlohmann::ordered_json;

struct ConformArguments {
  std::string device;
  std::vector<std::string> suites;
  bool full = false, json = false;
  std::filesystem::path values;
  std::vector<std::filesystem::path> against;
};

const char* verdict(const Row& row) {
  if (row.failed > 0) return "FAILED";
  return row.tried() > 0 ? "passed" : "unsupported";
}

void print_rows(const Report& report) {
  print(fmt::format("{:<28} {:<22} {:<9} {:>5}  {:>13}  {:<11} {}\n", "layer", "kernel", "precision", "cases",
                    "error / bound", "verdict", "place of that error"));
  for (const Row& row : report.rows()) {
    if (row.tried() == 0) continue;
    print(fmt::format("{:<28} {:<22} {:<9} {:>5}  {:>13.3g}  {:<11} {}\n", row.layer, row.kernel,
                      conform::name_of(row.precision), row.tried(), row.worst.worst.ratio, verdict(row),
                      row.worst.worst.ratio > 0 ? place(row.worst) : ""));
  }
  for (const Row& row : report.rows()) {
    if (row.unsupported == 0) continue;
    print(fmt::format("{:<28} {:<22} {:<9} {:>5}  unsupported: {}\n", row.layer, row.kernel,
                      conform::name_of(row.precision), row.unsupported, row.missing));
  }
  for (const Finding& finding : report.failures()) {
    print(fmt::format("FAILED {}, {}, {}, {}: {}\n", finding.of.layer, finding.of.kernel,
                      conform::name_of(finding.of.precision), finding.of.shape, finding.message));
  }
}

Json to_json(const Row& row) {
  const reference::Worst& worst = row.worst.worst;
  Json json{{"layer", row.layer},
            {"kernel", row.kernel},
            {"precision", conform::name_of(row.precision)},
            {"verdict", verdict(row)},
            {"passed", row.passed},
            {"failed", row.failed},
            {"unsupported", row.unsupported}};
  if (row.unsupported > 0) json["missing"] = row.missing;
  if (row.tried() == 0) return json;
  // JSON has no infinity.
  json["worst"] = {{"ratio", std::isfinite(worst.ratio) ? Json(worst.ratio) : Json("infinite")},
                   {"case", row.worst.of.shape},
                   {"comparison", row.worst.where},
                   {"c", worst.c},
                   {"y", worst.y},
                   {"x", worst.x}};
  return json;
}

Json to_json(const Report& report, const DeviceInfo& device, bool full) {
  Json json{{"raymeld", RAYMELD_VERSION},
            {"device", device.name},
            {"driver", device.driver},
            {"api_version", version_text(device.api_version)},
            {"extent", full ? "full" : "quick"},
            {"passed", report.cases(Outcome::kPassed)},
            {"failed", report.cases(Outcome::kFailed)},
            {"unsupported", report.cases(Outcome::kUnsupported)},
            {"rows", Json::array()},
            {"failures", Json::array()}};
  for (const Row& row : report.rows()) json["rows"].push_back(to_json(row));
  for (const Finding& finding : report.failures()) {
    json["failures"].push_back({{"layer", finding.of.layer},
                                {"kernel", finding.of.kernel},
                                {"precision", conform::name_of(finding.of.precision)},
                                {"case", finding.of.shape},
                                {"message", finding.message}});
  }
  return json;
}

// Returns the suites of these names, or all suites when there are no names.
std::vector<conform::Suite> chosen_suites(const std::vector<std::string>& names) {
  std::vector<conform::Suite> chosen;
  for (const conform::Suite& suite : conform::suites()) {
    if (names.empty() || std::ranges::find(names, suite.name) != names.end()) chosen.push_back(suite);
  }
  return chosen;
}

void run(const ConformArguments& arguments) {
  const std::vector<conform::Suite> suites = chosen_suites(arguments.suites);
  if (!(arguments.values.empty() && arguments.against.empty()) &&
      std::ranges::none_of(suites, &conform::Suite::networks))
    throw Error("--values and --against need the suite 'network', which --suite does not name");
  if (!arguments.values.empty()) check_outputs(std::span(&arguments.values, 1), arguments.against);
  std::vector<conform::Values> others;
  for (const auto& file : arguments.against) others.push_back(conform::read_values(file));
  const auto device = Device::create({arguments.device});
  device->kernels().keep(256);  // the cases of one kernel variant share most pipelines
  const DeviceInfo& info = device->info();
  const Console console(!arguments.json);
  console.note(fmt::format("testing {} ({})", info.name, info.driver));
  const std::filesystem::path folder = default_cache_folder();
  Report report;
  conform::Values values{.device = info.name + ", " + info.driver};
  const conform::Options options{.extent = arguments.full ? conform::Extent::kFull : conform::Extent::kQuick,
                                 .others = std::move(others),
                                 .keep = &values,
                                 .on_finding = [&](const Finding& finding) {
                                   report.add(finding);
                                   check_interrupted();
                                 }};
  for (const conform::Suite& suite : suites) {
    PipelineCache cache(*device, folder);
    conform::conform(suite, {*device, cache, folder}, options);
    if (!suite.networks) cache.save();  // the networks' Fusers save their own, which this would replace
  }
  if (!arguments.values.empty()) conform::write_values(arguments.values, values);

  if (arguments.json) {
    print(json_text(to_json(report, info, arguments.full)));
  } else {
    print_rows(report);
    print(fmt::format("{} ({}): {} cases passed, {} failed, {} unsupported\n", info.name, info.driver,
                      report.cases(Outcome::kPassed), report.cases(Outcome::kFailed),
                      report.cases(Outcome::kUnsupported)));
  }
  if (const std::string complaint = report.complaint(); !complaint.empty()) throw Error("{}", complaint);
}

}  // namespace

void add_conform(CLI::App& app) {
  auto arguments = std::make_shared<ConformArguments>();
  CLI::App* command = app.add_subcommand(
      "conform",
      "Checks a device and its driver against the scalar reference, layer by layer and in whole networks");
  command->add_option(
      "--device", arguments->device,
      "Runs on this Vulkan device: its index in raymeld devices, its UUID or part of its name");
  auto* quick = command->add_flag("--quick")->description("Runs some sizes and networks (the default)");
  command->add_flag("--full", arguments->full, "Runs all sizes and networks, which takes minutes on a CPU")
      ->excludes(quick);
  std::vector<std::string> names;
  for (const conform::Suite& suite : conform::suites()) names.push_back(suite.name);
  command
      ->add_option("--suite", arguments->suites,
                   fmt::format("Runs only these suites, out of {}", fmt::join(names, ", ")))
      ->delimiter(',')
      ->check(CLI::IsMember(names))
      ->type_name("NAME,...");
  command->add_option("--values", arguments->values, "Writes the outputs of the networks to this file")
      ->type_name("FILE");
  command
      ->add_option("--against", arguments->against,
                   "Compares the outputs of the networks with those of another device, which --values wrote "
                   "to this file")
      ->type_name("FILE");
  command->add_flag("--json", arguments->json, "Prints one JSON object instead of text");
  command->footer(
      "Exit status: 0 if cases passed and none failed, else 2. Cases that need a feature which the device\n"
      "lacks are listed as unsupported.\n\nExample:\n  raymeld conform --full --device llvmpipe");
  command->callback([arguments] { run(*arguments); });
}

}  // namespace raymeld::cli
