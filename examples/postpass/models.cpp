#include "models.h"

#include <algorithm>
#include <stdexcept>
#include <tuple>

namespace postpass {

Models::Models(const std::filesystem::path& folder) {
  if (!std::filesystem::is_directory(folder))
    throw std::runtime_error(folder.string() + " is no folder of models");
  for (const auto& file : std::filesystem::directory_iterator(folder)) {
    if (file.path().extension() != ".safetensors") continue;
    raymeld::SharedModel model(file.path().string());
    if (!model.info().reads_lrhs || !model.info().reads_hrls) continue;  // frames here have both renders
    const uint32_t scale = model.info().scale;
    all_.push_back({file.path().stem().string(), std::move(model), scale});
  }
  if (all_.empty()) throw std::runtime_error(folder.string() + " has no models (*.safetensors)");
  std::sort(all_.begin(), all_.end(), [](const Entry& a, const Entry& b) {
    return std::tie(a.scale, a.name) < std::tie(b.scale, b.name);
  });
}

size_t Models::find(const std::string& name) const {
  std::string names;
  for (size_t i = 0; i < all_.size(); ++i) {
    if (all_[i].name == name) return i;
    names += (i ? ", " : "") + all_[i].name;
  }
  throw std::runtime_error("no model is called " + name + "; there are " + names);
}

size_t Models::next_scale(size_t index) const {
  const auto& from = all_[index];
  size_t i = index;
  do i = next(i);
  while (all_[i].scale == from.scale && i != index);
  const uint32_t scale = all_[i].scale;
  for (size_t j = i; j < all_.size() && all_[j].scale == scale; ++j)
    if (all_[j].quality() == from.quality()) return j;
  return i;
}

size_t Models::next_quality(size_t index) const {
  size_t i = index;
  do i = next(i);
  while (all_[i].scale != all_[index].scale);
  return i;
}

}  // namespace postpass
