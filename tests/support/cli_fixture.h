// Runs the program as a process, for all tests of it.
#pragma once

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <set>

#include "io/exr.h"
#include "support.h"

namespace raymeld::test {

// Returns what oiiotool would call "64x48+5+3": where a window starts, and its size.
inline Imath::Box2i window(int x, int y, int width, int height) {
  return {{x, y}, {x + width - 1, y + height - 1}};
}

// The models of tests/golden take these channels: three of each layer, and alpha.
inline const std::vector<std::string> kColorNames = {"R", "G", "B"};
inline const std::vector<std::string> kAlphaNames = {"R", "G", "B", "A"};
inline const std::vector<std::string> kLayeredNames = {
    "R", "G", "B", "normal.X", "normal.Y", "normal.Z", "albedo.R", "albedo.G", "albedo.B", "A"};

// Returns the names with those of the layers that --layers needs.
std::vector<std::string> with_split_light(std::vector<std::string> names);

// Returns (names.size(), H, W) between 0 and 1, the same on every machine.
Image random_image(const std::vector<std::string>& names, int width, int height, uint64_t seed);

// Returns the (C, height, width) part of `image` whose top-left pixel is (x, y).
Image crop(const Image& image, int x, int y, int width, int height);

// Returns the top-left pixel of each s x s block: (C, s*h, s*w) -> (C, h, w) (Hou et al. 2021, section 3.3).
Image degrade_nearest(const Image& image, int scale);

void write_image(const std::filesystem::path& path, const std::vector<std::string>& names, const Image& image,
                 const Imath::Box2i& data, const Imath::Box2i& display, Imf::PixelType type = Imf::HALF);
void write_image(const std::filesystem::path& path, const std::vector<std::string>& names, const Image& image,
                 Imf::PixelType type = Imf::HALF);

class Cli : public testing::Test {
 protected:
  // Writes an x4 pair: low.exr 8 x 6 and high.exr 32 x 24 with layers and alpha.
  void SetUp() override;

  ProcessResult run(std::vector<std::string> arguments) const;
  // Returns the arguments that fuse the pair to out.exr with the tiny model of scale 4.
  static std::vector<std::string> fuse(const std::vector<std::string>& more = {});
  // Returns the arguments that make `output` of one render, as floats in fp32: `command` is the command and
  // the input, such as denoise --hrls high.exr.
  static std::vector<std::string> one_render(std::vector<std::string> command, const std::string& model,
                                             const std::vector<std::string>& more, const std::string& output);
  static std::string tiny_model() { return source_path("tests/golden/tiny-x4.safetensors").string(); }

  // Puts fault_layer/ between the program and the driver.
  void add_fault_layer();

  struct CallCount {
    int calls = 0, alive = 0;
  };
  // Returns what the last run called, by function; empty when its instance was not destroyed.
  std::map<std::string, CallCount> calls() const;

  // Puts sync_log/ between the program and the disk; sync_log() returns its log.
  void add_sync_log();
  std::string sync_log() const { return read_file(folder_ / "cache" / "sync.txt"); }

  // Runs the program and holds it back until its stderr holds `text` and, after options.signal, options.then
  // has returned. `hold` and `where` say at which call: RAYMELD_HOLD_SUBMIT and a number, see fault_layer/,
  // or RAYMELD_HOLD_SYNC and a part of a path, see sync_log/.
  ProcessResult run_held(const std::string& hold, const std::string& where,
                         std::vector<std::string> arguments, const std::string& text,
                         ProcessOptions options = {});
  // Returns the number of submits of the last run, which must have had the fault layer.
  std::string submits() const { return std::to_string(calls().at("vkQueueSubmit").calls); }

  // Expects the program to fail, to say all `texts` on stderr, to print nothing and to leave the files as
  // they were.
  ProcessResult expect_error(const std::vector<std::string>& arguments,
                             const std::vector<std::string>& texts) const;

  // Expects the diffuse, specular and other light of out.exr to add up to its color.
  void expect_light_adds_up() const;

  nlohmann::json run_json(const std::vector<std::string>& arguments) const;

  // Returns the names of the files and folders there are, without the cache.
  std::set<std::string> files() const;
  Image read(const std::string& name, const std::vector<std::string>& channels = kColorNames) const {
    return ExrFile(folder_ / name).read(channels);
  }

  TemporaryDirectory folder_;
  std::map<std::string, std::optional<std::string>> environment_;
};

}  // namespace raymeld::test
