#include "io/layers_from_exr.h"

#include <algorithm>

#include "error.h"

namespace raymeld {
namespace {

// Holds the channels that were read, and finds them by name.
class Planes {
 public:
  Planes(ExrFile& file, std::vector<std::string> names)
      : names_(std::move(names)), image_(file.read(names_)) {}

  int width() const { return image_.width; }
  int height() const { return image_.height; }
  const float* at(const std::string& name) const {
    return image_.plane(int(std::ranges::find(names_, name) - names_.begin()));
  }

 private:
  std::vector<std::string> names_;
  Image image_;
};

std::vector<std::string> channels_needed(const LayerMap& map, std::span<const std::string> wanted) {
  std::vector<std::string> names;
  for (const std::string& layer : wanted)
    for (const ChannelTriple& term : map.layers.at(layer).terms)
      names.insert(names.end(), term.begin(), term.end());
  std::ranges::sort(names);
  names.erase(std::unique(names.begin(), names.end()), names.end());
  return names;
}

// Computes one of a layer's three planes, of `size` pixels, by the rules that look at one pixel at a time.
// For kVariance it copies the color.
void compute_plane(const LayerSource& source, const Planes& planes, int c, size_t size, float* result) {
  const auto term = [&](int i) { return planes.at(source.terms[i][c]); };
  const float* first = term(0);
  if (source.rule == LayerRule::kEquation2) {
    const float *direct = term(1), *indirect = term(2);
    for (size_t i = 0; i < size; ++i) result[i] = first[i] * (direct[i] + indirect[i]);
  } else if (source.rule == LayerRule::kSum) {
    const float* second = term(1);
    for (size_t i = 0; i < size; ++i) result[i] = first[i] + second[i];
  } else {
    std::copy_n(first, size, result);
  }
}

}  // namespace

LayerMap map_layers(const ExrFile& file, const LayerChoice& choice) try {
  return map_layers(file.channel_names(), choice);
} catch (const Error& error) {
  throw Error("cannot map the layers of '{}': {}", file.path().string(), error.what());
}

Image load_layers(ExrFile& file, const LayerMap& map, std::span<const std::string> wanted) {
  require_layers(map, wanted, file.path().string());
  const Planes planes(file, channels_needed(map, wanted));
  Image result(planes.width(), planes.height(), 3 * int(wanted.size()));
  for (size_t i = 0; i < wanted.size(); ++i) {
    const LayerSource& source = map.layers.at(wanted[i]);
    for (int c = 0; c < 3; ++c)
      compute_plane(source, planes, c, result.plane_size(), result.plane(3 * int(i) + c));
    if (source.rule != LayerRule::kVariance) continue;
    Image color(result.width, result.height, 3);
    std::copy_n(result.plane(3 * int(i)), color.data.size(), color.data.data());
    std::ranges::copy(variance_3x3(color).data, result.plane(3 * int(i)));
  }
  return result;
}

Image load_motion(ExrFile& file, const LayerMap& map) {
  const auto& [channels, factors] = *map.motion;
  std::vector<std::string> names(channels.begin(), channels.end());
  if (map.depth) names.push_back(*map.depth);
  const Planes planes(file, names);
  Image result(planes.width(), planes.height(), 4);
  for (int c = 0; c < 2; ++c)
    std::transform(planes.at(channels[c]), planes.at(channels[c]) + result.plane_size(), result.plane(c),
                   [factor = factors[c]](float value) { return factor * value; });
  // The file does not say which depth a point had in the last frame.
  for (int c = 2; map.depth && c < 4; ++c)
    std::copy_n(planes.at(*map.depth), result.plane_size(), result.plane(c));
  return result;
}

}  // namespace raymeld
