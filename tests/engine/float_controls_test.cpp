#include "engine/float_controls.h"

#include <gtest/gtest.h>

#include "layers/shaders.h"

namespace raymeld::test {
namespace {

// Holds what a shader asks for: pairs of an execution mode and a number of bits.
using Modes = std::vector<std::pair<uint32_t, uint32_t>>;

constexpr uint32_t kKeepSubnormals = 4459, kRound = 4462;

// Returns the float controls among a shader's execution modes. Fails the test unless its sections are in the
// order of SPIR-V: capabilities, extensions, entry point, execution modes.
Modes modes_of(std::span<const uint32_t> spirv) {
  Modes modes;
  uint32_t entry_point = 0, last = 0;
  const std::map<uint32_t, uint32_t> sections{{17, 1}, {10, 2}, {11, 3}, {14, 4}, {15, 5}, {16, 6}};
  for (size_t at = 5; at < spirv.size(); at += spirv[at] >> 16) {
    const auto section = sections.find(spirv[at] & 0xffff);
    const uint32_t number = section == sections.end() ? 7 : section->second;
    EXPECT_GE(number, last) << "word " << at;
    last = number;
    if (number == 5) entry_point = spirv[at + 2];
    if (number != 6) continue;
    EXPECT_EQ(spirv[at + 1], entry_point);
    if (spirv[at + 2] >= kKeepSubnormals) modes.emplace_back(spirv[at + 2], spirv[at + 3]);
  }
  return modes;
}

TEST(FloatControls, AreAskedForAsFarAsTheDriverPromisesThem) {
  const FloatControls all{.rounds = true, .keeps_subnormals = true};
  for (const Shader& shader : {shaders::kConv2d, shaders::kDecode.buffers}) {
    const std::vector<uint32_t> floats(shader.f32.begin(), shader.f32.end());
    const std::vector<uint32_t> halves(shader.f16.begin(), shader.f16.end());
    EXPECT_EQ(with_float_controls(floats, all), floats);
    EXPECT_EQ(with_float_controls(halves, {}), halves);
    EXPECT_EQ(modes_of(with_float_controls(halves, all)), (Modes{{kRound, 16}, {kKeepSubnormals, 16}}));
    EXPECT_EQ(modes_of(with_float_controls(halves, {.rounds = true})), (Modes{{kRound, 16}}));
  }
}

}  // namespace
}  // namespace raymeld::test
