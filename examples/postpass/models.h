#pragma once

#include <filesystem>
#include <raymeld/raymeld.hpp>
#include <string>
#include <vector>

namespace postpass {

// The models of a folder: SCALE-QUALITY.safetensors, as x4-fast; by scale, then quality.
class Models {
 public:
  explicit Models(const std::filesystem::path& folder);

  size_t find(const std::string& name) const;  // throws if there is none
  const raymeld::SharedModel& operator[](size_t index) const { return all_[index].model; }
  const std::string& name(size_t index) const { return all_[index].name; }

  // Where the keys lead to from one of them; itself if nowhere.
  size_t next(size_t index) const { return (index + 1) % all_.size(); }
  size_t next_scale(size_t index) const;    // of the same quality if there is one
  size_t next_quality(size_t index) const;  // of the same scale

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
