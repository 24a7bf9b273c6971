// Defines the events that the program reacts to: from keys, the window or a script.
#pragma once

#include <cstdint>
#include <string>
#include <vector>
#include <vulkan/vulkan.hpp>

namespace postpass {

struct Event {
  enum Kind { kKey, kResize, kMinimise, kRestore, kQuit };
  Kind kind = kKey;
  char key = 0;            // the key of kKey, in lower case
  vk::Extent2D size = {};  // the new size of kResize
};

struct ScriptedEvent {
  uint64_t frame = 0;  // the frame before which the event happens
  Event event;
};

// Parses a script such as "60:key=h,120:resize=320x256,180:minimise,200:restore,300:quit"; sorts it by frame.
std::vector<ScriptedEvent> parse_script(const std::string& text);

// Parses a size such as "320x256".
vk::Extent2D parse_size(const std::string& text);

}  // namespace postpass
