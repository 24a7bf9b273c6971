// Measures what speed costs in quality, on a device and a test set.
#include "cli/trade/trade.h"

#include <algorithm>

#include "cli/common/commands.h"
#include "cli/common/models.h"
#include "cli/common/precisions.h"
#include "networks/stock_models.h"
#include "platform/interrupt.h"

namespace raymeld::cli {
namespace {

namespace fs = std::filesystem;

struct TradeArguments {
  std::string data = RAYMELD_DATA_DIR, output = "trade", device, curve;
  std::vector<std::string> models;
  size_t views = 0;  // 0: all
  bool quick = false;
};

// Returns each model in fp32, and in fp16 if the device supports it, with automatic and with direct kernels.
// `quick` leaves only fp32 with automatic kernels.
std::vector<TradeSetting> settings_of(const std::vector<std::string>& models, const DeviceInfo& device,
                                      bool quick) {
  std::vector<TradeSetting> settings;
  for (const std::string& name : models) {
    const Model model(find_model(name));
    const TradeSetting plain{name, model.architecture().scale};
    const auto add = [&](Precision precision, KernelChoice kernels) {
      TradeSetting setting = plain;
      setting.precision = precision, setting.kernels = kernels;
      settings.push_back(setting);
    };
    settings.push_back(plain);
    if (quick) continue;
    add(Precision::kFp32, KernelChoice::kDirect);
    if (!device.storage_16bit) continue;
    add(Precision::kFp16, KernelChoice::kAuto);
    add(Precision::kFp16, KernelChoice::kDirect);
  }
  return settings;
}

std::vector<TradeSetting> plain_ones(const std::vector<TradeSetting>& settings) {
  std::vector<TradeSetting> plain;
  std::ranges::copy_if(settings, std::back_inserter(plain), &TradeSetting::is_plain);
  return plain;
}

// Returns the models that were asked for, or else the stock models of whose scale the test set has LRHS.
std::vector<std::string> usable_models(const std::vector<std::string>& asked, const TestView& view) {
  std::vector<std::string> models;
  for (const std::string& name : asked.empty() ? stock_models() : asked) {
    const Architecture architecture = Model(find_model(name)).architecture();
    const bool fuses = architecture.reads_lrhs() && architecture.reads_hrls();
    if (!asked.empty() && !fuses)
      throw Error("model {} reads one render, and trade measures models of pairs", name);
    const uint32_t scale = architecture.scale;
    const bool has_lrhs = std::ranges::find(view.lrhs, scale, &TestRender::scale) != view.lrhs.end();
    if ((has_lrhs && fuses) || !asked.empty()) models.push_back(name);
  }
  return models;
}

std::vector<TradeStrip> strips_of(const Trade& trade, const Device& device) {
  std::vector<TradeStrip> strips;
  for (const uint32_t scale : {2, 4, 8}) {
    std::vector<SettingResults> plain;
    for (const SettingResults& of : trade.settings) {
      if (of.setting.is_plain() && of.setting.scale == scale) plain.push_back(of);
    }
    if (plain.empty()) continue;
    std::ranges::sort(plain, {}, median_time_ms);
    for (TradeStrip& strip : make_strips(trade.views, plain, device)) strips.push_back(std::move(strip));
  }
  return strips;
}

std::string summary(const Trade& trade) {
  std::string text = fmt::format("{:<14} {:>5} {:>8} {:>11} {:>9} {:>9} {:>9}\n", "model", "", "kernels",
                                 "time in ms", "MiB", "PSNR/dB", "RelMSE");
  const auto json = to_json(trade);
  for (const auto& row : json.at("settings")) {
    text += fmt::format("{:<14} {:>5} {:>8} {:>11.1f} {:>9.1f} {:>9.3f} {:>9.5f}{}\n",
                        row.at("model").get<std::string>(), row.at("precision").get<std::string>(),
                        row.at("kernels").get<std::string>(), row.at("time_ms").at("median").get<double>(),
                        row.at("memory_bytes").get<double>() / kMebibyte, row.at("psnr_db").get<double>(),
                        row.at("relmse").get<double>(), row.at("time_front") ? "  on the front" : "");
  }
  return text;
}

// Returns a line that differs when the file was changed.
std::string stamp(const fs::path& file) {
  std::error_code error;  // ignored: what a missing file has for numbers is written
  return fmt::format("{} {} {}\n", fs::absolute(file).string(), fs::file_size(file, error),
                     fs::last_write_time(file, error).time_since_epoch().count());
}

// Returns all that measurements depend on beside view and setting.
std::string subject_of(const Trade& trade, const std::vector<TradeSetting>& settings, const fs::path& data) {
  std::string text = fmt::format("{}{} {}\n{}\n", stamp(fs::canonical("/proc/self/exe")), trade.device.name,
                                 trade.device.driver, fs::canonical(data).string());
  for (const TradeSetting& setting : plain_ones(settings)) text += stamp(find_model(setting.model));
  for (const TestView& view : trade.views) {
    for (const auto* renders : {&view.lrhs, &view.plain}) {
      for (const TestRender& render : *renders) text += stamp(render.file);
    }
    for (const fs::path& reference : view.references) text += stamp(reference);
  }
  return text;
}

void write_text(StagedFiles& files, const fs::path& file, const std::string& text) {
  files.add(file, [&](AtomicFile& out) { out.write(text.data(), text.size()); });
}

// Returns the points of a curve that are not measured here, as their models do not fuse.
std::vector<CurvePoint> other_points(const fs::path& file) {
  if (!fs::exists(file)) return {};
  std::vector<CurvePoint> points = load_curve(file).points;
  std::erase_if(points, [](const CurvePoint& point) { return point.task == Task::kFuse; });
  return points;
}

Curve with(Curve curve, const std::vector<CurvePoint>& points) {
  curve.points.insert(curve.points.end(), points.begin(), points.end());
  return curve;
}

void run(const TradeArguments& arguments) {
  const fs::path folder = arguments.output;
  const std::vector<CurvePoint> others = other_points(arguments.curve);
  Trade trade;
  trade.views = find_views(arguments.data);
  trade.data = fs::canonical(arguments.data).filename().string();
  if (arguments.views > 0 && arguments.views < trade.views.size()) trade.views.resize(arguments.views);
  const Image reference = load_reference(trade.views.front());
  trade.width = reference.width, trade.height = reference.height;
  std::error_code error;
  fs::create_directories(folder, error);
  const std::vector<fs::path> outputs{folder / "trade.csv", folder / "trade.json", folder / "trade.html"};
  check_folders(outputs);

  const auto device = Device::create({.selector = arguments.device});
  trade.device = device->info();
  const std::vector<TradeSetting> settings =
      settings_of(usable_models(arguments.models, trade.views.front()), trade.device, arguments.quick);
  if (settings.empty()) throw Error("test set '{}' has no LRHS of the scale of any model", arguments.data);
  Console console(true);
  console.note(
      fmt::format("{} settings, {} views, on {}", settings.size(), trade.views.size(), trade.device.name));
  Journal journal(folder / "measured.jsonl", subject_of(trade, settings, arguments.data));
  if (journal.size() > 0) console.note(fmt::format("continuing after {} measurements", journal.size()));
  trade.settings = measure_settings(trade.views, settings, *device, journal, console);
  if (!arguments.quick) {
    console.note("measuring pairs of renders");
    trade.renders = measure_pairs(trade.views, plain_ones(settings), *device, journal, console);
  }
  trade.strips = strips_of(trade, *device);

  StagedFiles files;
  write_text(files, outputs[0], trade_csv(trade));
  write_text(files, outputs[1], json_text(to_json(trade)));
  write_text(files, outputs[2], trade_html(trade));
  if (!arguments.curve.empty()) save_curve(arguments.curve, with(curve_of(trade), others));
  files.commit();
  journal.remove();
  print(summary(trade));
  console.note(fmt::format("wrote {}", outputs[2].string()));
}

}  // namespace

void add_trade(CLI::App& app) {
  auto arguments = std::make_shared<TradeArguments>();
  CLI::App* command = app.add_subcommand(
      "trade", "Measures quality, time and memory of models, precisions and kernels over a test set");
  command
      ->add_option("--data", arguments->data,
                   "Reads the test set from this folder, of one view or of a folder for each view; without "
                   "it the sample pair")
      ->type_name("DIR");
  command
      ->add_option("-o,--output", arguments->output,
                   "Writes trade.csv, trade.json and the report trade.html here")
      ->type_name("DIR")
      ->capture_default_str();
  command->add_option(
      "--device", arguments->device,
      "Runs on this Vulkan device: its index in raymeld devices, its UUID or part of its name");
  command
      ->add_option("--model", arguments->models,
                   "Measures these models: names, scales such as x4, or files; without it all stock models")
      ->delimiter(',');
  command->add_option("--views", arguments->views, "Measures only the first N views")
      ->type_name("N")
      ->check(CLI::Range(size_t{1}, size_t{1'000'000}));
  command->add_flag("--quick", arguments->quick,
                    "Measures only one setting of each model, in fp32, and one pair of renders of each view");
  command
      ->add_option("--curve", arguments->curve,
                   "Writes the curve that fuse --quality and --budget choose by, such as models/curve.json")
      ->type_name("FILE");
  command->footer(
      "Example:\n  raymeld trade --data TEST -o report\n"
      "When it was stopped, the same command continues it: measured.jsonl in the folder holds the "
      "measurements.");
  command->callback([arguments] { run(*arguments); });
}

}  // namespace raymeld::cli
