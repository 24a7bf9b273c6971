// Checks the layout of src/: which folder may include which, and how large folders are.
#include <gtest/gtest.h>

#include <fstream>
#include <regex>

#include "support.h"

namespace raymeld::test {
namespace {

namespace fs = std::filesystem;

const fs::path kSource = source_path("src");

// Maps each folder of src/ to the others that its sources may include. Files in src/ itself are for all.
const std::map<std::string, std::set<std::string>> kBelow = {
    {"platform", {}},
    {"engine", {}},
    {"reference", {}},
    {"io", {"platform"}},
    {"layers", {"engine"}},
    {"model", {"engine", "io", "layers"}},
    {"fusion", {"engine", "io", "layers", "model"}},
    {"choice", {"engine", "fusion", "io", "model", "platform"}},
    {"conform", {"engine", "fusion", "io", "layers", "model", "platform", "reference"}},
    {"api", {"engine", "fusion", "io", "model"}},
    {"cli/common", {"choice", "engine", "fusion", "io", "model", "platform"}},
    {"cli/fuse", {"cli/common", "choice", "engine", "fusion", "io", "model", "platform"}},
    {"cli/sequence", {"cli/common", "cli/fuse", "platform"}},
    {"cli/trade", {"cli/common", "cli/fuse", "choice", "conform", "fusion", "io", "model", "platform"}},
    {"cli",
     {"cli/common", "cli/fuse", "cli/sequence", "choice", "conform", "engine", "fusion", "io", "layers",
      "model", "platform"}},
};

std::string room_of(const fs::path& file) { return file.parent_path().lexically_relative(kSource).string(); }

std::vector<fs::path> sources() {
  std::vector<fs::path> files;
  for (const auto& entry : fs::recursive_directory_iterator(kSource))
    if (entry.path().extension() == ".cpp" || entry.path().extension() == ".h") files.push_back(entry.path());
  return files;
}

TEST(Layout, IncludesRunDown) {
  const std::regex include(R"re(#include "([^"]+)")re");
  size_t seen = 0;
  for (const fs::path& file : sources()) {
    const std::string room = room_of(file), content = read_file(file);
    ASSERT_TRUE(room == "." || kBelow.contains(room)) << room << " is no room";
    for (std::sregex_iterator at(content.begin(), content.end(), include), end; at != end; ++at) {
      const fs::path included = kSource / (*at)[1].str();
      if (!fs::exists(included)) continue;  // it lies in shaders/ or include/
      const std::string other = room_of(included);
      ++seen;
      if (other == room || other == ".") continue;
      EXPECT_TRUE(room != "." && kBelow.at(room).contains(other)) << file << " includes " << included;
    }
  }
  EXPECT_GT(seen, 400u);
}

TEST(Layout, RoomsAreSmallAndNoSourceIsInNone) {
  std::map<std::string, int> sizes;
  for (const fs::path& file : sources()) sizes[room_of(file)] += file.extension() == ".cpp";
  EXPECT_EQ(sizes["."], 0);
  for (const auto& [room, size] : sizes) EXPECT_LE(size, 20) << room;
}

TEST(Layout, EngineKnowsNoNetwork) {
  for (const fs::path& file : sources()) {
    if (room_of(file) != "engine") continue;
    for (const char* word : {"LRHS", "HRLS"})
      EXPECT_EQ(read_file(file).find(word), std::string::npos) << file << " speaks of " << word;
  }
}

}  // namespace
}  // namespace raymeld::test
