#pragma once

#include <filesystem>
#include <raymeld/raymeld.hpp>
#include <string>
#include <vector>

namespace postpass {

// Holds the models of a folder, whose files are SCALE-QUALITY.safetensors, such as x4-fast.safetensors. They
// are sorted by scale, then by name.
class Models {
 public:
  explicit Models(const std::filesystem::path& folder);

  size_t find(const std::string& name) const;  // throws if there is none
  const raymeld::SharedModel& operator[](size_t index) const { return all_[index].model; }
  const std::string& name(size_t index) const { return all_[index].name; }

  // Return the model that a key leads to from `index`, or `index` if there is no other.
  size_t next(size_t index) const { return (index + 1) % all_.size(); }
  size_t next_scale(size_t index) const;    // a model of the same quality, if there is one
  size_t next_quality(size_t index) const;  // a model of the same scale

 private:
  struct Entry {
    std::string name;
    raymeld::SharedModel model;
    uint32_t scale;
    std::string quality() const { return name.substr(name.find('-') + 1); }
  };
  std::vector<Entry> all_;
};

}  // namespace postpass
