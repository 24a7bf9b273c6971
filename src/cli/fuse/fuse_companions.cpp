// Fuses alpha and the parts of the light beside the color, through the same network.
#include <algorithm>

#include "cli/common/inputs.h"
#include "cli/fuse/fuse.h"
#include "model/constant_layers.h"

namespace raymeld::cli {
namespace {

bool is_even(const Image& image, float value) {
  return std::ranges::all_of(image.data, [=](float other) { return other == value; });
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

Image read_alpha(ExrFile& file, const std::string& channel, const char* role, Console& console) {
  const std::string names[] = {channel};
  Image alpha = file.read(names);
  sanitize_input(alpha, role, file.path(), console);
  return alpha;
}

// Returns images of (3, H, W) each: diffuse, specular, and emission, which is all other light.
std::array<Image, 3> split_light(const Image& read) {
  const size_t count = 3 * read.plane_size();
  std::array<Image, 3> parts;
  for (int i = 0; i < 3; ++i) {
    parts[size_t(i)] = Image(read.width, read.height, 3);
    std::copy_n(read.plane(3 * ((i + 1) % 3)), count, parts[size_t(i)].plane(0));
  }
  Image& rest = parts[2];
  for (size_t i = 0; i < count; ++i)
    rest.data[i] = std::max(rest.data[i] - parts[0].data[i] - parts[1].data[i], 0.0f);
  return parts;
}

std::array<Image, 3> read_light(ExrFile& file, const LayerMap& map, const char* role, Console& console) {
  Image read = load_layers(file, map, kReadLight);
  sanitize_input(read, role, file.path(), console);
  return split_light(read);
}

// Returns the HRLS image of a companion. It has a surface of the same normals that sends out nothing but the
// companion's light. For alpha an albedo that the image holds is white where the pixel is covered.
Image hrls_of(const FuseFrame& frame, const Companion& companion) {
  const bool is_alpha = companion.name == kAlpha;
  Image hrls = frame.images.hrls;
  const size_t count = 3 * hrls.plane_size();
  const auto layers = image_layers(frame.files.model->architecture(), frame.images.constants);
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
void limit_alpha(Image& fused, const Companion& alpha, int scale) {
  const int height = fused.height, width = fused.width;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      float least = alpha.lrhs.at(0, y / scale, x / scale), most = least;
      for (int near_y = std::max(y - 1, 0); near_y <= std::min(y + 1, height - 1); ++near_y) {
        for (int near_x = std::max(x - 1, 0); near_x <= std::min(x + 1, width - 1); ++near_x) {
          const float value = alpha.hrls.at(0, near_y, near_x);
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

bool fuses_alpha(const FuseFiles& files) {
  if (!files.hrls_map.alpha || !files.lrhs_map.alpha) return false;
  const ExrChannel &own = files.lrhs.channel(*files.lrhs_map.alpha),
                   &other = files.hrls.channel(*files.hrls_map.alpha);
  const auto is_plain = [](const ExrChannel& channel) {
    return channel.type != Imf::UINT && channel.x_sampling == 1 && channel.y_sampling == 1;
  };
  return is_plain(own) && is_plain(other) &&
         files.lrhs.header(own.part).dataWindow() == files.lrhs_windows.data;
}

void load_companions(FuseFrame& frame) {
  FuseFiles& files = frame.files;
  const auto add = [&](const std::string& name, Image lrhs, Image hrls) {
    lrhs = for_canvas(files, std::move(lrhs), files.lrhs_windows.data);
    hrls = seen_through(std::move(hrls), files.hrls_windows.data, files.canvas.hrls);
    frame.images.companions.push_back({name, std::move(lrhs), std::move(hrls)});
  };
  if (fuses_alpha(files)) {
    Image lrhs = read_alpha(files.lrhs, *files.lrhs_map.alpha, "LRHS", frame.console);
    Image hrls = read_alpha(files.hrls, *files.hrls_map.alpha, "HRLS", frame.console);
    const float value = hrls.data[0];
    if (!is_even(hrls, value) || !is_even(lrhs, value))
      add(kAlpha, grey(std::move(lrhs)), grey(std::move(hrls)));
  }
  if (!frame.arguments.layers) return;
  auto lrhs = read_light(files.lrhs, files.lrhs_map, "LRHS", frame.console);
  auto hrls = read_light(files.hrls, files.hrls_map, "HRLS", frame.console);
  for (size_t i = 0; i < kLightParts.size(); ++i) {
    for (float& value : lrhs[i].data) value *= files.pair.brightness;
    add(kLightParts[i], std::move(lrhs[i]), std::move(hrls[i]));
  }
}

void fuse_companions(FuseFrame& frame, const FuseOne& fuse) {
  FuseImages& images = frame.images;
  std::map<std::string, Image>& fused = frame.result.companions;
  for (Companion& companion : images.companions) {
    const bool is_alpha = companion.name == kAlpha;
    Image& image = fused[companion.name];
    image = fuse(companion.lrhs, hrls_of(frame, companion), is_alpha ? 1 : images.exposure);
    if (is_alpha) limit_alpha(image, companion, frame.files.canvas.scale);
    image = seen_through(std::move(image), frame.files.canvas.hrls, frame.files.window);
    companion.lrhs = companion.hrls = {};
  }
  if (frame.arguments.layers) share_out(frame.result.fused, fused);
}

}  // namespace raymeld::cli
