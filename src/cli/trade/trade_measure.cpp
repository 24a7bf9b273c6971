// Measures settings and pairs of renders for raymeld trade.
#include <algorithm>
#include <cmath>
#include <deque>

#include "choice/metrics.h"
#include "cli/common/inputs.h"
#include "cli/trade/trade.h"
#include "conform/model_file.h"
#include "io/exr_window.h"
#include "platform/interrupt.h"

namespace raymeld::cli {
namespace {

using reference::Planes;

constexpr size_t kRounds = 3;
constexpr int kCropSide = 16;  // side of the part that the reference computes, in LRHS pixels

FuseArguments arguments_of(const TestPair& pair, const TradeSetting& setting) {
  FuseArguments arguments;
  arguments.lrhs = pair.lrhs->file;
  arguments.hrls = pair.hrls->file;
  arguments.model = setting.model;
  arguments.precision = setting.precision;
  arguments.kernels = setting.kernels;
  arguments.overflow = Overflow::kRedo;
  arguments.quiet = true;
  return arguments;
}

// Reads a pair of renders as a setting's model takes them; only the color is fused.
std::unique_ptr<FuseFrame> load(const TestPair& pair, const TradeSetting& setting, LastModel& models) {
  const FuseArguments arguments = arguments_of(pair, setting);
  auto frame = std::unique_ptr<FuseFrame>(
      new FuseFrame{arguments, Console(false), open_files(arguments, models), {}, {}, {}});
  load_frame(*frame);
  frame->images.companions.clear();
  return frame;
}

// Measures frames with one FrameFuser, after a first run that is not measured.
class Bench {
 public:
  explicit Bench(const Device& device) : fuser_(device) {}

  // Fuses and measures the frame with `setting`, whose model must be the one that the frame was loaded for.
  TradeResult measure(const TestPair& pair, FuseFrame& frame, const TradeSetting& setting) {
    frame.arguments = arguments_of(pair, setting);
    const auto go_on = [](double) { return !interrupted(); };
    // Some drivers compile a kernel when it first runs.
    if (!std::exchange(warm_, true)) fuser_.fuse(frame, go_on);
    fuser_.fuse(frame, go_on);
    const FuseResult& result = frame.result;
    return {.view = pair.view->name, .time_ms = result.time_ms, .memory_bytes = result.allocated_bytes};
  }

 private:
  FrameFuser fuser_;
  bool warm_ = false;
};

Planes planes_of(const Image& image) {
  Planes planes(image.channels, image.height, image.width);
  std::ranges::copy(image.data, planes.data.begin());
  return planes;
}

// Holds the middle of a frame, small enough for the scalar reference, and the reference's output for it.
struct ReferenceCrop {
  Image lrhs, hrls;  // parts of FuseImages
  Planes output;

  ReferenceCrop(const FuseFrame& frame) {
    const FuseImages& images = frame.images;
    const Architecture& a = frame.files.model->architecture();
    const int scale = int(a.scale), width = std::min(kCropSide, images.lrhs.width),
              height = std::min(kCropSide, images.lrhs.height);
    const Imath::V2i corner((images.lrhs.width - width) / 2, (images.lrhs.height - height) / 2);
    const auto middle = [&](const Image& image, int s) {
      const Imath::Box2i whole({0, 0}, {image.width - 1, image.height - 1});
      return seen_through(image, whole,
                          {corner * s, (corner + Imath::V2i(width, height)) * s - Imath::V2i(1)});
    };
    lrhs = middle(images.lrhs, 1);
    hrls = middle(images.hrls, scale);
    Image all(hrls.width, hrls.height, 3 * int(a.hrls_layers.size()));
    int to = 0, from = 0;
    for (const std::string& layer : a.hrls_layers) {
      const auto constant = images.constants.find(layer);
      for (int c = 0; c < 3; ++c, ++to) {
        if (constant != images.constants.end()) {
          std::fill_n(all.plane(to), all.plane_size(), constant->second[size_t(c)]);
        } else {
          std::copy_n(hrls.plane(from++), all.plane_size(), all.plane(to));
        }
      }
    }
    const std::string& file = frame.files.model->file();
    reference::Architecture architecture = conform::read_architecture(file);
    reference::Weights weights = conform::read_weights(file);
    const auto [lrhs_spp, hrls_spp] = frame.files.model_samples().known(uint32_t(architecture.scale));
    take_samples(architecture, weights, lrhs_spp, hrls_spp);
    output = reference::network(architecture, weights, planes_of(lrhs), planes_of(all),
                                frame.files.model_phase(), reference::Precision::kFp32, {}, images.exposure)
                 .at("output")
                 .value;
  }

  // Returns the largest difference, in steps of an 8-bit sRGB display.
  double error(const FuseFrame& frame, const TradeSetting& setting, const Device& device) const {
    FuseArguments arguments = frame.arguments;
    arguments.precision = setting.precision;
    arguments.kernels = setting.kernels;
    const FuserOptions options = options_of(arguments, frame.files, device, frame.images.constants);
    Image fused;
    Fuser(device, *frame.files.model, uint32_t(lrhs.height), uint32_t(lrhs.width), options)
        .fuse(lrhs, hrls, fused, {}, frame.images.exposure);
    double largest = 0;
    for (size_t i = 0; i < fused.data.size(); ++i) {
      const double difference =
          double(linear_to_srgb(fused.data[i])) - double(linear_to_srgb(float(output.data[i])));
      largest = std::max(largest, 255 * std::abs(difference));
    }
    return largest;
  }
};

std::vector<std::string> models_in(const std::vector<TradeSetting>& settings) {
  std::vector<std::string> models;
  for (const TradeSetting& setting : settings) {
    if (std::ranges::find(models, setting.model) == models.end()) models.push_back(setting.model);
  }
  return models;
}

std::string name_of(const TradeSetting& setting) {
  return fmt::format("{} {} {}", setting.model, int(setting.precision), int(setting.kernels));
}

// Holds views with their first pairs, each read for one model when it is first asked for.
class LoadedViews {
 public:
  struct Loaded {
    TestPair pair;
    std::unique_ptr<FuseFrame> frame;
    Image reference;
  };

  LoadedViews(const TradeSetting& setting, LastModel& models) : setting_(setting), models_(models) {}

  Loaded& of(const TestView& view) {
    std::unique_ptr<Loaded>& loaded = views_[view.name];
    if (!loaded) {
      const TestPair pair = first_pair(view, setting_.scale);
      loaded.reset(new Loaded{pair, load(pair, setting_, models_), load_reference(view)});
    }
    return *loaded;
  }

 private:
  const TradeSetting& setting_;  // any setting of the model
  LastModel& models_;
  std::map<std::string, std::unique_ptr<Loaded>> views_;
};

Journal::Values measure_view(LoadedViews& loaded, Bench& bench, const TestView& view,
                             const TradeSetting& setting) {
  auto& [pair, frame, reference] = loaded.of(view);
  const TradeResult result = bench.measure(pair, *frame, setting);
  const Quality quality = measure(frame->result.fused, reference);
  return {result.time_ms, double(result.memory_bytes), quality.psnr_db, quality.relmse_bcr,
          quality.relmse_gharbi};
}

TradeResult result_from(const std::string& view, const Journal::Values& values) {
  return {.view = view,
          .time_ms = values.at(0),
          .memory_bytes = uint64_t(values.at(1)),
          .quality = {values.at(2), values.at(3), values.at(4)}};
}

// Measures the errors of a model's settings against the scalar reference, on the first view.
void measure_errors(std::vector<SettingResults*>& of_model, LoadedViews& loaded, const TestView& view,
                    const Device& device, Journal& journal) {
  std::optional<ReferenceCrop> crop;
  for (SettingResults* of : of_model) {
    const auto error = [&]() -> Journal::Values {
      const FuseFrame& frame = *loaded.of(view).frame;
      if (!crop) crop.emplace(frame);
      return {crop->error(frame, of->setting, device)};
    };
    of->fp64_error = journal.get("error: " + name_of(of->setting), error).at(0);
  }
}

}  // namespace

std::vector<SettingResults> measure_settings(const std::vector<TestView>& views,
                                             const std::vector<TradeSetting>& settings, const Device& device,
                                             Journal& journal, Console& console) {
  std::vector<SettingResults> all;
  for (const TradeSetting& setting : settings) {
    const TestPair pair = first_pair(views.front(), setting.scale);
    all.push_back({setting, pair.lrhs->spp, pair.hrls->spp});
  }
  LastModel models;
  const size_t rounds = std::min(kRounds, views.size());
  ProgressBar bar(console);
  size_t done = 0;
  const auto measure_round = [&](size_t round, std::vector<SettingResults*>& of_model) {
    LoadedViews loaded(of_model.front()->setting, models);
    for (SettingResults* of : of_model) {
      Bench bench(device);
      for (size_t v = round; v < views.size(); v += rounds) {
        check_interrupted();
        const auto measure = [&] { return measure_view(loaded, bench, views[v], of->setting); };
        const std::string name = fmt::format("{}: {}", views[v].name, name_of(of->setting));
        of->results.push_back(result_from(views[v].name, journal.get(name, measure)));
        bar.update(double(++done) / double(views.size() * settings.size()));
      }
    }
    if (round == 0) measure_errors(of_model, loaded, views.front(), device, journal);
  };
  for (size_t round = 0; round < rounds; ++round) {
    for (const std::string& model : models_in(settings)) {
      std::vector<SettingResults*> of_model;
      for (SettingResults& of : all) {
        if (of.setting.model == model) of_model.push_back(&of);
      }
      measure_round(round, of_model);
    }
  }
  return all;
}

namespace {

Journal::Values measure_pair(Bench& bench, const TestPair& pair, const TradeSetting& setting,
                             const Image& reference, LastModel& models) {
  const auto frame = load(pair, setting, models);
  const TradeResult result = bench.measure(pair, *frame, setting);
  const Quality quality = measure(frame->result.fused, reference);
  return {result.time_ms / 1000, quality.psnr_db, quality.relmse_bcr};
}

Journal::Values measure_plain(const TestRender& render, const Image& reference) {
  ExrFile file(render.file);
  Image image = load_layers(file, map_color(file, {}), kColor);
  sanitize(image);
  const Quality quality = measure(image, reference);
  return {quality.psnr_db, quality.relmse_bcr};
}

// Computes means over views for each model, scale and number of samples.
class RenderMeans {
 public:
  void add(const RenderResults& one) {
    auto& [sum, count] =
        sums_.try_emplace({one.model, one.scale, one.hrls_spp, one.lrhs_spp}, one, 0).first->second;
    if (count++ == 0) return;
    sum.render_seconds += one.render_seconds, sum.fuse_seconds += one.fuse_seconds;
    sum.psnr_db += one.psnr_db, sum.relmse += one.relmse;
  }

  // Returns the means of what all views have.
  std::vector<RenderResults> of(size_t views) const {
    std::vector<RenderResults> means;
    const double share = 1.0 / double(views);
    for (const auto& [key, entry] : sums_) {
      if (entry.second != views) continue;
      RenderResults& mean = means.emplace_back(entry.first);
      mean.render_seconds *= share, mean.fuse_seconds *= share, mean.psnr_db *= share, mean.relmse *= share;
    }
    return means;
  }

 private:
  std::map<std::tuple<std::string, uint32_t, uint32_t, uint32_t>, std::pair<RenderResults, size_t>> sums_;
};

}  // namespace

std::vector<RenderResults> measure_pairs(const std::vector<TestView>& views,
                                         const std::vector<TradeSetting>& settings, const Device& device,
                                         Journal& journal, Console& console) {
  RenderMeans means;
  std::deque<Bench> benches;
  for (size_t i = 0; i < settings.size(); ++i) benches.emplace_back(device);
  LastModel models;
  ProgressBar bar(console);
  for (size_t v = 0; v < views.size(); ++v) {
    const TestView& view = views[v];
    const Image reference = load_reference(view);
    for (const TestRender& plain : view.plain) {
      const auto measure = [&] { return measure_plain(plain, reference); };
      const auto values = journal.get(fmt::format("{}: {} spp", view.name, plain.spp), measure);
      means.add({"", 1, 0, plain.spp, view.cost.of(plain.spp), 0, values.at(0), values.at(1)});
    }
    for (size_t i = 0; i < settings.size(); ++i) {
      const TradeSetting& setting = settings[i];
      for (const TestPair& pair : sensible_pairs(view, setting.scale)) {
        check_interrupted();
        const uint32_t lrhs_spp = pair.lrhs->spp, hrls_spp = pair.hrls->spp;
        const auto measure = [&] { return measure_pair(benches[i], pair, setting, reference, models); };
        const auto values = journal.get(
            fmt::format("{}: {} {}-{} spp", view.name, setting.model, lrhs_spp, hrls_spp), measure);
        means.add({setting.model, setting.scale, lrhs_spp, hrls_spp, pair.render_seconds(), values.at(0),
                   values.at(1), values.at(2)});
      }
      bar.update((double(v) + double(i + 1) / double(settings.size())) / double(views.size()));
    }
  }
  return means.of(views.size());
}

std::vector<TradeStrip> make_strips(const std::vector<TestView>& views,
                                    const std::vector<SettingResults>& settings, const Device& device) {
  std::vector<TradeResult> results = settings.front().results;
  std::ranges::sort(results, {}, [](const TradeResult& result) { return result.quality.psnr_db; });
  const size_t last = results.size() - 1;
  std::vector<std::pair<size_t, std::string>> shown{{0, last > 0 ? ": the worst" : ""}};
  if (last > 1) shown.push_back({results.size() / 2, ": the median"});
  if (last > 0) shown.push_back({last, ": the best"});

  std::vector<TradeStrip> strips;
  for (const auto& [rank, place] : shown) {
    check_interrupted();
    const TestView& view = *std::ranges::find(views, results[rank].view, &TestView::name);
    const uint32_t scale = settings.front().setting.scale;
    const TestPair pair = first_pair(view, scale);
    const Image truth = load_reference(view);
    TradeStrip strip{fmt::format("{}, {}{}", view.name, settings.front().setting.model, place),
                     {"LRHS, bicubic", "HRLS"},
                     {}};
    std::vector<Image> images;
    LastModel models;
    for (const SettingResults& of : settings) {
      const auto frame = load(pair, of.setting, models);
      if (images.empty()) {
        images.push_back(upsample_bicubic(frame->images.lrhs, int(scale), frame->files.model_phase()));
        images.push_back(first_channels(frame->images.hrls, 3));
      }
      Bench(device).measure(pair, *frame, of.setting);
      images.push_back(std::move(frame->result.fused));
      strip.images.push_back(of.setting.model);
    }
    images.push_back(truth);
    strip.images.push_back("reference");
    strip.picture = strip_of(images, truth, images[2]);
    strips.push_back(std::move(strip));
  }
  return strips;
}

}  // namespace raymeld::cli
