// Fuses alpha and the parts of the light beside the color, through the same network.
#include <algorithm>
#include <cstring>

#include "cli/common/inputs.h"
#include "cli/fuse/fuse.h"
#include "io/exr_window.h"
#include "networks/constant_layers.h"

namespace raymeld::cli {
namespace {

bool is_even(const ExrRawChannel& channel) {
  const auto& bytes = channel.bytes;
  const size_t size = channel.type == Imf::HALF ? 2 : 4;
  return std::memcmp(bytes.data(), bytes.data() + size, bytes.size() - size) == 0;
}

// Returns a channel with the first value of another one in each pixel of a window.
ExrRawChannel repeated(const ExrRawChannel& channel, const Imath::Box2i& window) {
  ExrRawChannel all{.name = channel.name, .type = channel.type, .data_window = window, .bytes = {}};
  const size_t size = size_bytes_of(channel.type);
  all.bytes.resize(size * size_t(width_of(window)) * size_t(height_of(window)));
  for (size_t at = 0; at < all.bytes.size(); at += size)
    std::memcpy(&all.bytes[at], channel.bytes.data(), size);
  return all;
}

Image as_floats(const ExrRawChannel& channel) {
  Image image(width_of(channel.data_window), height_of(channel.data_window), 1);
  if (channel.type == Imf::HALF) {
    std::vector<half> halves(image.data.size());
    std::memcpy(halves.data(), channel.bytes.data(), channel.bytes.size());
    std::ranges::copy(halves, image.data.begin());
  } else {
    std::memcpy(image.data.data(), channel.bytes.data(), channel.bytes.size());
  }
  return image;
}

// Returns a channel three times, as the network reads a color.
Image grey(Image image) {
  const size_t count = image.plane_size();
  image.channels = 3;
  image.data.resize(3 * count);
  std::copy_n(image.plane(0), count, image.plane(1));
  std::copy_n(image.plane(0), count, image.plane(2));
  return image;
}

// Holds alpha as both files have it, (1, h, w) and (1, H, W).
struct AlphaPair {
  Image lrhs, hrls;
};

bool is_plain(const ExrChannel& channel) {
  return channel.type != Imf::UINT && channel.x_sampling == 1 && channel.y_sampling == 1;
}

// Returns whether LRHS has an alpha of floats that lies as the color does.
bool has_plain_alpha(const FuseFiles& files) {
  if (!files.lrhs_map.alpha) return false;
  const ExrChannel& alpha = files.lrhs.channel(*files.lrhs_map.alpha);
  return is_plain(alpha) && files.lrhs.header(alpha.part).dataWindow() == files.lrhs_windows.data;
}

// Returns whether both files have such an alpha.
bool have_alphas(const FuseFiles& files) {
  return files.hrls_map.alpha && has_plain_alpha(files) &&
         is_plain(files.hrls.channel(*files.hrls_map.alpha));
}

// Returns whether LRHS's alpha is to be upscaled. Throws Error if it cannot be.
bool varies(const FuseFiles& files, const ExrRawChannel& of_lrhs) {
  if (is_even(of_lrhs)) return false;
  if (has_plain_alpha(files)) return true;
  throw Error("LRHS '{}': alpha '{}' must have floats, one for each pixel of the color, to be upscaled",
              files.lrhs.path().string(), of_lrhs.name);
}

// Returns the alphas if they are to be fused. One that is the same everywhere is copied.
std::optional<AlphaPair> varying_alphas(FuseFiles& files, const ExrRawChannel& of_hrls) {
  if (!have_alphas(files)) return {};
  AlphaPair pair{files.lrhs.read(std::array{*files.lrhs_map.alpha}), as_floats(of_hrls)};
  const float value = pair.hrls.data[0];
  const auto is_value = [=](float other) { return other == value; };
  if (is_even(of_hrls) && std::ranges::all_of(pair.lrhs.data, is_value)) return {};
  return pair;
}

// Returns diffuse, specular, and emission, which is all other light, (3, H, W) each, of a color (3, H, W) and
// `split` (6, H, W) of kSplitLight.
std::array<Image, 3> parts_of(const Image& color, const Image& split) {
  std::array<Image, 3> parts;
  parts.fill(Image(color.width, color.height, 3));
  const size_t count = 3 * color.plane_size();
  for (size_t i = 0; i < count; ++i) {
    parts[0].data[i] = split.data[i];
    parts[1].data[i] = split.data[count + i];
    parts[2].data[i] = std::max(color.data[i] - split.data[i] - split.data[count + i], 0.0f);
  }
  return parts;
}

// Returns HRLS's layers kSplitLight, (6, H, W) of the canvas.
Image load_split_hrls(FuseFrame& frame) {
  FuseFiles& files = frame.files;
  Image hrls = load_layers(files.hrls, files.hrls_map, kSplitLight);
  const auto& layers = files.model->architecture().hrls_layers;
  const auto is_read = [&](const std::string& layer) { return std::ranges::count(layers, layer) > 0; };
  if (std::ranges::all_of(kSplitLight, is_read)) {
    sanitize(hrls);  // load_hrls() has warned
  } else {
    sanitize_input(hrls, "HRLS", files.hrls.path(), frame.console);
  }
  return seen_through(std::move(hrls), files.hrls_windows.data, files.canvas.hrls);
}

// Returns the HRLS image of a companion. It has a surface of the same normals that sends out nothing but the
// companion's light. For alpha an albedo that the image holds is white where the pixel is covered.
Image hrls_of(const FuseFrame& frame, const Companion& companion) {
  if (!frame.files.reads_hrls()) return {};
  const bool is_alpha = companion.name == kAlpha;
  Image hrls = frame.images.hrls;
  const size_t count = 3 * hrls.plane_size();
  const auto layers = frame.files.layers_without(frame.images.constants);
  for (size_t i = 0; i < layers.size(); ++i) {
    const std::string& layer = layers[i];
    float* planes = hrls.plane(int(3 * i));
    const bool is_light = layer == "color" || layer == companion.name;
    if (is_light || (is_alpha && (layer == "albedo" || layer == "diffuse"))) {
      std::copy_n(companion.hrls.plane(0), count, planes);
    } else if (layer == "diffuse" || layer == "specular") {
      std::fill_n(planes, count, 0.0f);
    } else if (layer == "variance") {
      std::ranges::copy(variance_3x3(companion.hrls).data, planes);
    }
  }
  return hrls;
}

// Limits a fused alpha to what HRLS has in the 3x3 pixels around, and LRHS in the cell: only edges change.
// Where there is no HRLS, the 3x3 pixels are LRHS's.
void limit_alpha(Image& fused, const Companion& alpha, int scale) {
  const bool has_hrls = !alpha.hrls.data.empty();
  const Image& around = has_hrls ? alpha.hrls : alpha.lrhs;
  for (int y = 0; y < fused.height; ++y) {
    for (int x = 0; x < fused.width; ++x) {
      float least = alpha.lrhs.at(0, y / scale, x / scale), most = least;
      const int at_y = has_hrls ? y : y / scale, at_x = has_hrls ? x : x / scale;
      for (int near_y = std::max(at_y - 1, 0); near_y <= std::min(at_y + 1, around.height - 1); ++near_y) {
        for (int near_x = std::max(at_x - 1, 0); near_x <= std::min(at_x + 1, around.width - 1); ++near_x) {
          const float value = around.at(0, near_y, near_x);
          least = std::min(least, value), most = std::max(most, value);
        }
      }
      const float mean = (fused.at(0, y, x) + fused.at(1, y, x) + fused.at(2, y, x)) / 3;
      fused.at(0, y, x) = std::clamp(mean, least, most);
    }
  }
}

// Scales the fused parts so that they add up to the fused color. Light that no part has becomes the last's.
void share_out(const Image& color, std::map<std::string, Image>& parts) {
  float *diffuse = parts.at(kLightParts[0]).plane(0), *specular = parts.at(kLightParts[1]).plane(0),
        *rest = parts.at(kLightParts[2]).plane(0);
  for (size_t i = 0; i < color.data.size(); ++i) {
    const float sum = diffuse[i] + specular[i] + rest[i];
    for (float* part : {diffuse, specular, rest}) part[i] = sum > 0 ? part[i] / sum * color.data[i] : 0;
    if (!(sum > 0)) rest[i] = color.data[i];
  }
}

}  // namespace

bool load_alpha(FuseFrame& frame, const ExrRawChannel& of_hrls) {
  FuseFiles& files = frame.files;
  auto alphas = varying_alphas(files, of_hrls);
  if (!alphas) return false;
  sanitize_lrhs(alphas->lrhs, files, frame.console);
  sanitize_input(alphas->hrls, "HRLS", files.hrls.path(), frame.console);
  frame.images.companions.push_back(
      {kAlpha, 1, for_canvas(files, grey(std::move(alphas->lrhs)), files.lrhs_windows.data),
       seen_through(grey(std::move(alphas->hrls)), files.hrls_windows.data, files.canvas.hrls)});
  return true;
}

void load_lrhs_alpha(FuseFrame& frame) {
  FuseFiles& files = frame.files;
  if (!files.lrhs_map.alpha) return;
  ExrRawChannel alpha = files.lrhs.read_raw(*files.lrhs_map.alpha);
  if (!varies(files, alpha)) {
    sanitize_passed(alpha, true, "LRHS", files.lrhs.path(), frame.console);
    frame.images.passed.push_back(repeated(alpha, files.window));
    return;
  }
  Image values = as_floats(alpha);
  sanitize_lrhs(values, files, frame.console);
  frame.images.companions.push_back(
      {kAlpha, 1, for_canvas(files, grey(std::move(values)), files.lrhs_windows.data), {}});
}

void load_light(FuseFrame& frame) {
  FuseFiles& files = frame.files;
  const FuseImages& images = frame.images;
  Image lrhs = load_layers(files.lrhs, files.lrhs_map, kSplitLight);
  sanitize_lrhs(lrhs, files, frame.console);
  match_brightness(files, lrhs);
  lrhs = for_canvas(files, std::move(lrhs), files.lrhs_windows.data);
  std::array<Image, 3> low = parts_of(images.lrhs, lrhs), high;
  if (files.reads_hrls()) high = parts_of(first_channels(images.hrls, 3), load_split_hrls(frame));
  for (size_t i = 0; i < kLightParts.size(); ++i)
    frame.images.companions.push_back({kLightParts[i], 2 + i, std::move(low[i]), std::move(high[i])});
}

int count_runs(FuseFiles& files, const FuseArguments& arguments) {
  const auto& alpha = files.hrls_map.alpha;
  const auto is_fused = [&] {
    if (!files.reads_hrls()) return varies(files, files.lrhs.read_raw(*alpha));
    return have_alphas(files) && varying_alphas(files, files.hrls.read_raw(*alpha));
  };
  const bool fuses_alpha = alpha && is_fused();
  return 1 + (fuses_alpha ? 1 : 0) + (arguments.layers ? int(kLightParts.size()) : 0);
}

void fuse_companions(FuseFrame& frame, const FuseOne& fuse) {
  FuseImages& images = frame.images;
  std::map<std::string, Image>& fused = frame.result.companions;
  for (Companion& companion : images.companions) {
    const bool is_alpha = companion.name == kAlpha;
    Image& image = fused[companion.name];
    image = fuse(companion, hrls_of(frame, companion), is_alpha ? 1 : images.exposure);
    if (frame.time.is_lead_in) continue;
    if (is_alpha) limit_alpha(image, companion, frame.files.canvas.scale);
    image = seen_through(std::move(image), frame.files.canvas.hrls, frame.files.window);
    companion.lrhs = companion.hrls = {};
  }
  if (frame.arguments.layers && !frame.time.is_lead_in) share_out(frame.result.fused, fused);
}

}  // namespace raymeld::cli
