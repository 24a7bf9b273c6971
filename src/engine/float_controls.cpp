#include "engine/float_controls.h"

#include <string_view>

#include "engine/instance.h"

namespace raymeld {
namespace {

// These numbers and layouts are those of the SPIR-V specification, version 1.3, and of
// SPV_KHR_float_controls.
enum Opcode : uint32_t {
  kExtension = 10,
  kEntryPoint = 15,
  kExecutionMode = 16,
  kCapability = 17,
  kTypeFloat = 22
};

struct Control {
  uint32_t capability, mode;
};
constexpr Control kKeepSubnormals{4464, 4459}, kRound{4467, 4462};

constexpr size_t kHeaderWords = 5;

Opcode opcode(uint32_t word) { return static_cast<Opcode>(word & 0xffff); }

void append(std::vector<uint32_t>& code, Opcode instruction, std::initializer_list<uint32_t> operands) {
  code.push_back(static_cast<uint32_t>(operands.size() + 1) << 16 | instruction);
  code.insert(code.end(), operands);
}

void append_extension(std::vector<uint32_t>& code) {
  constexpr std::string_view kName = "SPV_KHR_float_controls";
  std::vector<uint32_t> words(kName.size() / 4 + 1);
  for (size_t i = 0; i < kName.size(); ++i) words[i / 4] |= uint32_t(kName[i]) << (i % 4 * 8);
  code.push_back(static_cast<uint32_t>(words.size() + 1) << 16 | kExtension);
  code.insert(code.end(), words.begin(), words.end());
}

bool has_halves(std::span<const uint32_t> spirv) {
  for (size_t at = kHeaderWords; at < spirv.size(); at += spirv[at] >> 16)
    if (opcode(spirv[at]) == kTypeFloat && spirv[at + 2] == 16) return true;
  return false;
}

}  // namespace

FloatControls find_float_controls(const VulkanFunctions& vk, VkPhysicalDevice physical_device) {
  if (!has_extension(vk, physical_device, VK_KHR_SHADER_FLOAT_CONTROLS_EXTENSION_NAME)) return {};
  auto controls = vk_struct<VkPhysicalDeviceFloatControlsProperties>(
      VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FLOAT_CONTROLS_PROPERTIES);
  auto all =
      vk_struct<VkPhysicalDeviceProperties2>(VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, &controls);
  vk.GetPhysicalDeviceProperties2(physical_device, &all);
  // Where all widths must be alike, 32 bits would have to be asked for as well.
  constexpr auto kAlike = VK_SHADER_FLOAT_CONTROLS_INDEPENDENCE_NONE;
  return {.rounds = controls.shaderRoundingModeRTEFloat16 && controls.roundingModeIndependence != kAlike,
          .keeps_subnormals =
              controls.shaderDenormPreserveFloat16 && controls.denormBehaviorIndependence != kAlike};
}

std::vector<uint32_t> with_float_controls(std::span<const uint32_t> spirv, const FloatControls& promised) {
  if (!promised.any() || !has_halves(spirv)) return {spirv.begin(), spirv.end()};
  std::vector<Control> asked;
  if (promised.rounds) asked.push_back(kRound);
  if (promised.keeps_subnormals) asked.push_back(kKeepSubnormals);
  std::vector<uint32_t> code(spirv.begin(), spirv.begin() + kHeaderWords);
  for (const Control& control : asked) append(code, kCapability, {control.capability});
  // Extensions follow the capabilities, and execution modes the entry point.
  bool extended = false;
  for (size_t at = kHeaderWords; at < spirv.size(); at += spirv[at] >> 16) {
    if (opcode(spirv[at]) != kCapability && !extended) {
      append_extension(code);
      extended = true;
    }
    code.insert(code.end(), spirv.begin() + ptrdiff_t(at), spirv.begin() + ptrdiff_t(at + (spirv[at] >> 16)));
    if (opcode(spirv[at]) != kEntryPoint) continue;
    for (const Control& control : asked) append(code, kExecutionMode, {spirv[at + 2], control.mode, 16});
  }
  return code;
}

}  // namespace raymeld
