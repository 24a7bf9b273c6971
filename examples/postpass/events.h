// What happens to the program: keys, the window, a script.
#pragma once

#include <cstdint>
#include <string>
#include <vector>
#include <vulkan/vulkan.hpp>

namespace postpass {

struct Event {
  enum Kind { kKey, kResize, kMinimise, kRestore, kQuit };
  Kind kind = kKey;
  char key = 0;            // of kKey, in lower case
  vk::Extent2D size = {};  // of kResize
};

struct ScriptedEvent {
  uint64_t frame = 0;  // before which it happens
  Event event;
};

// "60:key=h,120:resize=320x256,180:minimise,200:restore,300:quit", in order of frames.
std::vector<ScriptedEvent> parse_script(const std::string& text);

// "320x256"
vk::Extent2D parse_size(const std::string& text);

}  // namespace postpass
