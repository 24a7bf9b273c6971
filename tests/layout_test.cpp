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
    {"platform/posix", {"platform"}},
    {"platform/windows", {"platform"}},
    {"engine", {"platform"}},
    {"reference", {}},
    {"io", {"platform"}},
    {"layers", {"engine"}},
    {"networks", {"engine", "io", "layers", "platform"}},
    {"fusion", {"engine", "io", "layers", "networks", "platform"}},
    {"choice", {"engine", "fusion", "io", "networks", "platform"}},
    {"conform", {"engine", "fusion", "io", "layers", "networks", "platform", "reference"}},
    {"api", {"choice", "engine", "fusion", "io", "networks", "platform"}},
    {"cli/common", {"choice", "engine", "fusion", "io", "networks", "platform"}},
    {"cli/fuse", {"cli/common", "choice", "engine", "fusion", "io", "networks", "platform"}},
    {"cli/sequence", {"cli/common", "cli/fuse", "platform"}},
    {"cli/trade", {"cli/common", "cli/fuse", "choice", "conform", "fusion", "io", "networks", "platform"}},
    {"cli",
     {"cli/common", "cli/fuse", "cli/sequence", "choice", "conform", "engine", "fusion", "io", "layers",
      "networks", "platform"}},
};

std::string folder_of(const fs::path& file) {
  return file.parent_path().lexically_relative(kSource).string();
}

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
    const std::string folder = folder_of(file), content = read_file(file);
    ASSERT_TRUE(folder == "." || kBelow.contains(folder)) << folder << " is not in kBelow";
    for (std::sregex_iterator at(content.begin(), content.end(), include), end; at != end; ++at) {
      const fs::path included = kSource / (*at)[1].str();
      if (!fs::exists(included)) continue;  // it lies in shaders/ or include/
      const std::string other = folder_of(included);
      ++seen;
      if (other == folder || other == ".") continue;
      EXPECT_TRUE(folder != "." && kBelow.at(folder).contains(other)) << file << " includes " << included;
    }
  }
  EXPECT_GT(seen, 400u);
}

TEST(Layout, FoldersAreSmallAndNoSourceIsInNone) {
  std::map<std::string, int> sizes;
  for (const fs::path& file : sources()) sizes[folder_of(file)] += file.extension() == ".cpp";
  EXPECT_EQ(sizes["."], 0);
  for (const auto& [folder, size] : sizes) EXPECT_LE(size, 20) << folder;
}

TEST(Layout, OnlyPlatformKnowsTheSystem) {
  const std::regex system(R"(#include <(sys/|windows|unistd|fcntl|dlfcn|link\.h|io\.h|poll))");
  size_t seen = 0;
  for (const fs::path& file : sources()) {
    if (!std::regex_search(read_file(file), system)) continue;
    EXPECT_TRUE(folder_of(file).starts_with("platform/")) << file;
    ++seen;
  }
  EXPECT_GT(seen, 5u);
}

TEST(Layout, EngineKnowsNoNetwork) {
  for (const fs::path& file : sources()) {
    if (folder_of(file) != "engine") continue;
    for (const char* word : {"LRHS", "HRLS"})
      EXPECT_EQ(read_file(file).find(word), std::string::npos) << file << " speaks of " << word;
  }
}

// The kernels of a layer have names of their own, and so have the passes of exposure().
const std::map<std::string, std::string> kLayerOfShader = {
    {"conv2d_columns", "conv2d"},       {"conv2d_matrix", "conv2d"},    {"pointwise", "conv2d"},
    {"pointwise_unshuffled", "conv2d"}, {"winograd_input", "conv2d"},   {"winograd_multiply", "conv2d"},
    {"winograd_output", "conv2d"},      {"winograd_weights", "conv2d"}, {"exposure_sums", "exposure"}};

TEST(Layout, ALayerHasOneNameEverywhere) {
  std::set<std::string> shaders;
  for (const auto& entry : fs::recursive_directory_iterator(source_path("shaders"))) {
    if (entry.path().extension() != ".comp") continue;
    const std::string name = std::regex_replace(entry.path().stem().string(), std::regex("_vectors$"), "");
    const auto layer = kLayerOfShader.find(name);
    shaders.insert(layer == kLayerOfShader.end() ? name : layer->second);
  }
  const std::set<std::string> layers = layer_names();
  EXPECT_EQ(shaders, layers);

  auto references = names_in(source_path("src/reference/reference.h"), R"re(\nBounded (\w+)\()re");
  for (const char* helper :
       {"bilinear", "concat", "pixel_shuffle", "self_weighted", "slice", "space_to_depth"})
    EXPECT_EQ(references.erase(helper), 1u) << helper;
  EXPECT_EQ(references, layers);
  std::set<std::string> cases;
  for (const auto& entry : fs::directory_iterator(kSource / "conform"))
    cases.merge(names_in(entry.path(), R"re((?:run\(|name = |\{)"(\w+))re"));
  for (const std::string& layer : layers)
    EXPECT_TRUE(cases.contains(layer)) << layer << " has no cases in src/conform";
}

// Returns a shader with all that it includes, but for tensor.glsl, which defines both functions.
std::string with_includes(const fs::path& file) {
  std::string text = read_file(file);
  const std::string own = text;
  const std::regex include(R"re(#include "(\w+\.glsl)")re");
  for (auto at = std::sregex_iterator(own.begin(), own.end(), include); at != std::sregex_iterator(); ++at) {
    const std::string name = (*at)[1];
    if (name == "tensor.glsl") continue;
    for (const auto& entry : fs::recursive_directory_iterator(source_path("shaders")))
      if (entry.path().filename() == name) text += with_includes(entry.path());
  }
  return text;
}

// Values that saturate would not be counted otherwise.
TEST(Layout, ShadersThatStoreCountWhatSaturates) {
  int stores = 0;
  for (const auto& entry : fs::recursive_directory_iterator(source_path("shaders"))) {
    if (entry.path().extension() != ".comp") continue;
    const std::string text = with_includes(entry.path());
    const bool counts = text.find("count_saturated();") != std::string::npos;
    EXPECT_EQ(text.find("storable(") != std::string::npos, counts) << entry.path();
    stores += counts;
  }
  EXPECT_GT(stores, 10);
}

}  // namespace
}  // namespace raymeld::test
