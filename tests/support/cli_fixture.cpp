#include "cli_fixture.h"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>

#include "io/exr_window.h"

namespace raymeld::test {

std::vector<std::string> with_split_light(std::vector<std::string> names) {
  for (const char* layer : {"diffuse", "specular"})
    for (const char* color : {"R", "G", "B"}) names.push_back(fmt::format("{}.{}", layer, color));
  return names;
}

Image random_image(const std::vector<std::string>& names, int width, int height, uint64_t seed) {
  Image image(width, height, int(names.size()));
  image.data = floats(random_planes(image.channels, height, width, Fill::kUniform, seed));
  for (float& value : image.data) value = 0.5f * value + 0.5f;
  return image;
}

Image crop(const Image& image, int x, int y, int width, int height) {
  Image part(width, height, image.channels);
  for (int c = 0; c < image.channels; ++c)
    for (int row = 0; row < height; ++row)
      std::copy_n(&image.plane(c)[(y + row) * image.width + x], width, &part.at(c, row, 0));
  return part;
}

Image degrade_nearest(const Image& image, int scale) {
  Image low(image.width / scale, image.height / scale, image.channels);
  for (int c = 0; c < low.channels; ++c)
    for (int y = 0; y < low.height; ++y)
      for (int x = 0; x < low.width; ++x) low.at(c, y, x) = image.at(c, y * scale, x * scale);
  return low;
}

void write_image(const std::filesystem::path& path, const std::vector<std::string>& names, const Image& image,
                 const Imath::Box2i& data, const Imath::Box2i& display, Imf::PixelType type) {
  ExrOutput output;
  output.source = Imf::Header(display, data);
  for (size_t c = 0; c < names.size(); ++c) output.planes.push_back({names[c], type, image.plane(int(c))});
  write_exr(path, output);
}

void write_image(const std::filesystem::path& path, const std::vector<std::string>& names, const Image& image,
                 Imf::PixelType type) {
  const Imath::Box2i whole = window(0, 0, image.width, image.height);
  write_image(path, names, image, whole, whole, type);
}

void Cli::SetUp() {
  write_image(folder_ / "low.exr", kColorNames, random_image(kColorNames, 8, 6, 1));
  write_image(folder_ / "high.exr", kLayeredNames, random_image(kLayeredNames, 32, 24, 2));
  environment_ = {{"XDG_CACHE_HOME", (folder_ / "cache").string()}, {"RAYMELD_MODELS", std::nullopt}};
}

ProcessResult Cli::run(std::vector<std::string> arguments) const {
  arguments.insert(arguments.begin(), RAYMELD_PROGRAM);
  return run_process(arguments, {.directory = folder_.path(), .environment = environment_});
}

std::vector<std::string> Cli::fuse(const std::vector<std::string>& more) {
  std::vector<std::string> arguments = {"fuse", "--lrhs",  "low.exr", "--hrls",    "high.exr",
                                        "-o",   "out.exr", "--model", tiny_model()};
  arguments.insert(arguments.end(), more.begin(), more.end());
  return arguments;
}

std::vector<std::string> Cli::one_render(std::vector<std::string> command, const std::string& model,
                                         const std::vector<std::string>& more, const std::string& output) {
  command.insert(command.end(),
                 {"-o", output, "--model", model, "--precision", "fp32", "--output-type", "float"});
  command.insert(command.end(), more.begin(), more.end());
  return command;
}

void Cli::expect_light_adds_up() const {
  const Image color = read("out.exr");
  std::vector<float> sum(color.data.size());
  for (const char* part : {"diffuse", "specular", "emission"}) {
    const Image light =
        read("out.exr", {fmt::format("{}.R", part), fmt::format("{}.G", part), fmt::format("{}.B", part)});
    for (size_t i = 0; i < sum.size(); ++i) sum[i] += light.data[i];
  }
  for (size_t i = 0; i < sum.size(); ++i) ASSERT_NEAR(sum[i], color.data[i], 1e-4 * (1 + color.data[i]));
}

void Cli::add_fault_layer() {
  environment_["VK_LAYER_PATH"] = RAYMELD_FAULT_LAYER;
  environment_["VK_INSTANCE_LAYERS"] = "VK_LAYER_RAYMELD_faults";
  environment_["NODEVICE_SELECT"] = "1";  // turns off Mesa's layer, whose calls are not the program's
  environment_["RAYMELD_CALLS"] = (folder_ / "cache" / "calls.txt").string();
}

std::map<std::string, Cli::CallCount> Cli::calls() const {
  std::map<std::string, CallCount> result;
  std::ifstream stream(folder_ / "cache" / "calls.txt");
  std::string function;
  for (CallCount count; stream >> function >> count.calls >> count.alive;) result[function] = count;
  return result;
}

void Cli::add_sync_log() {
  environment_["LD_PRELOAD"] = RAYMELD_SYNC_LOG_LIBRARY;
  environment_["RAYMELD_SYNC_LOG"] = (folder_ / "cache" / "sync.txt").string();
  // AddressSanitizer would ask to be loaded first.
  environment_["ASAN_OPTIONS"] = "detect_leaks=0:verify_asan_link_order=0";
}

ProcessResult Cli::run_held(const std::string& hold, const std::string& where,
                            std::vector<std::string> arguments, const std::string& text,
                            ProcessOptions options) {
  const std::filesystem::path gate = folder_ / "cache" / "gate", late = gate.string() + ".late";
  std::filesystem::remove(gate);
  options.directory = folder_.path();
  options.environment = environment_;
  options.environment[hold] = where + " " + gate.string();
  options.signal_after = text;
  options.then = [gate, then = options.then] {
    if (then) then();
    write_file(gate, "");
  };
  arguments.insert(arguments.begin(), RAYMELD_PROGRAM);
  const ProcessResult result = run_process(arguments, options);
  EXPECT_TRUE(std::filesystem::exists(gate)) << "never said '" << text << "': " << result.err;
  EXPECT_FALSE(std::filesystem::exists(late)) << "did not say '" << text << "' while it was held";
  return result;
}

ProcessResult Cli::expect_error(const std::vector<std::string>& arguments,
                                const std::vector<std::string>& texts) const {
  const std::set<std::string> before = files();
  const ProcessResult result = run(arguments);
  EXPECT_EQ(result.exit_status, 2) << result.err;
  EXPECT_EQ(result.out, "");
  for (const std::string& text : texts)
    EXPECT_NE(result.err.find(text), std::string::npos) << "'" << text << "' in: " << result.err;
  EXPECT_EQ(files(), before);
  return result;
}

nlohmann::json Cli::run_json(const std::vector<std::string>& arguments) const {
  const ProcessResult result = run(arguments);
  EXPECT_EQ(result.exit_status, 0) << result.err;
  return nlohmann::json::parse(result.out);
}

std::set<std::string> Cli::files() const {
  std::set<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(folder_.path()))
    names.insert(entry.path().filename().string());
  names.erase("cache");
  return names;
}

}  // namespace raymeld::test
