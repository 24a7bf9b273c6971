#include "cli/trade/test_set.h"

#include <algorithm>
#include <cmath>
#include <fstream>

#include "cli/common/inputs.h"
#include "error.h"

namespace raymeld::cli {
namespace {

namespace fs = std::filesystem;

constexpr const char* kManifest = "view.json";

TestView load_view(const fs::path& folder) try {
  std::ifstream stream(folder / kManifest);
  const nlohmann::json json = nlohmann::json::parse(stream);
  TestView view{.name = fs::canonical(folder).filename().string()};
  std::vector<TestRender> all, decimated;
  for (const auto& [name, entry] : json.at("files").items()) {
    const TestRender render{folder / name, entry.at("spp"), entry.value("scale", 1u),
                            entry.value("seconds", 0.0)};
    if (render.spp == 0 || render.scale == 0)
      throw Error("file {} has {} samples and scale {}, expected at least 1 of each", name, render.spp,
                  render.scale);
    if (!fs::is_regular_file(render.file)) throw Error("there is no file {}", name);
    if (name.starts_with("reference")) {
      view.references.push_back(render.file);
      continue;
    }
    const std::string layers = entry.value("layers", "");
    if (layers == "guides") continue;  // it is a render without light
    all.push_back(render);
    if (render.scale > 1) {
      if (name.starts_with("lowres")) view.lrhs.push_back(render);
      if (name.starts_with("lrhs")) decimated.push_back(render);
      continue;
    }
    view.plain.push_back(render);
    if (layers == "fusion") view.hrls.push_back(render);
  }
  if (view.lrhs.empty()) view.lrhs = decimated;
  for (auto* renders : {&view.lrhs, &view.hrls, &view.plain})
    std::ranges::sort(*renders, {}, &TestRender::spp);
  if (view.hrls.empty() || view.lrhs.empty() || view.references.empty())
    throw Error("there are {} HRLS, {} LRHS and {} references, expected at least one of each",
                view.hrls.size(), view.lrhs.size(), view.references.size());
  view.cost = fit_cost(all);
  return view;
} catch (const std::exception& error) {
  throw Error("test set '{}': {}", (folder / kManifest).string(), error.what());
}

// Returns the number of samples for each full-size pixel.
double samples(const TestRender& render) {
  return double(render.spp) / (double(render.scale) * render.scale);
}

}  // namespace

RenderCost fit_cost(const std::vector<TestRender>& renders) {
  RenderCost cost;
  constexpr double kQuartile = 0.25;
  std::vector<double> weights(renders.size(), 1);
  for (int step = 0; step < 100; ++step) {
    double n = 0, x = 0, y = 0, xx = 0, xy = 0;
    for (size_t i = 0; i < renders.size(); ++i) {
      const double full = renders[i].full_seconds();
      if (full <= 0) continue;
      const double w = weights[i] / (full * full), spp = renders[i].spp;
      n += w, x += w * spp, y += w * full, xx += w * spp * spp, xy += w * spp * full;
    }
    const double determinant = n * xx - x * x;
    if (!(determinant > 1e-12 * n * xx)) return n > 0 ? RenderCost{0, xy / xx} : RenderCost{};
    cost = {(y * xx - x * xy) / determinant, (n * xy - x * y) / determinant};
    for (size_t i = 0; i < renders.size(); ++i) {
      const double full = renders[i].full_seconds();
      if (full <= 0) continue;
      const double late = 1 - cost.of(renders[i].spp) / full;
      weights[i] = (late > 0 ? kQuartile : 1 - kQuartile) / (std::abs(late) + 1e-3);
    }
  }
  return cost;
}

std::vector<TestView> find_views(const fs::path& folder) {
  std::error_code error;
  if (fs::is_regular_file(folder / kManifest, error)) return {load_view(folder)};
  std::vector<fs::path> folders;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    if (fs::is_regular_file(entry.path() / kManifest, error)) folders.push_back(entry.path());
  }
  if (folders.empty())
    throw Error("test set '{}': there is no {} in it or in its folders", folder.string(), kManifest);
  std::ranges::sort(folders);
  std::vector<TestView> views;
  for (const fs::path& path : folders) views.push_back(load_view(path));
  return views;
}

Image load_reference(const TestView& view) {
  Image mean;
  Console silent(false);
  for (const fs::path& path : view.references) {
    ExrFile file(path);
    Image half = load_layers(file, map_color(file, {}), kColor);
    sanitize_input(half, "reference", path, silent);
    if (mean.data.empty()) mean = Image(half.width, half.height, half.channels);
    if (half.data.size() != mean.data.size())
      throw Error("reference '{}' has another size than '{}'", path.string(),
                  view.references.front().string());
    for (size_t i = 0; i < mean.data.size(); ++i)
      mean.data[i] += half.data[i] / float(view.references.size());
  }
  return mean;
}

TestPair first_pair(const TestView& view, uint32_t scale) {
  const TestRender& hrls = view.hrls.front();
  const TestRender* best = nullptr;
  const auto distance = [&](const TestRender& lrhs) {
    return std::abs(std::log2(samples(lrhs) / samples(hrls)));
  };
  for (const TestRender& lrhs : view.lrhs) {
    if (lrhs.scale == scale && (!best || distance(lrhs) < distance(*best))) best = &lrhs;
  }
  if (!best) throw Error("view {} has no LRHS of scale {}", view.name, scale);
  return {&view, best, &hrls};
}

std::vector<TestPair> sensible_pairs(const TestView& view, uint32_t scale) {
  std::vector<TestPair> pairs;
  for (const TestRender& hrls : view.hrls) {
    for (const TestRender& lrhs : view.lrhs) {
      const double ratio = samples(lrhs) / samples(hrls);
      if (lrhs.scale == scale && ratio >= 0.125 && ratio <= 1) pairs.push_back({&view, &lrhs, &hrls});
    }
  }
  return pairs;
}

}  // namespace raymeld::cli
