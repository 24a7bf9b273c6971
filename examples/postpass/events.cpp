#include "events.h"

#include <algorithm>
#include <cstdio>
#include <sstream>
#include <stdexcept>

namespace postpass {

vk::Extent2D parse_size(const std::string& text) {
  vk::Extent2D size;
  char rest = 0;
  constexpr uint32_t kMost = 8192;
  if (std::sscanf(text.c_str(), "%5ux%5u%c", &size.width, &size.height, &rest) != 2 || size.width == 0 ||
      size.height == 0 || size.width > kMost || size.height > kMost)
    throw std::runtime_error("a size of " + text + ", expected WIDTHxHEIGHT, each from 1 to 8192");
  return size;
}

namespace {

Event parse_event(const std::string& text) {
  const auto follows = [&](const std::string& start) { return text.rfind(start, 0) == 0; };
  if (text == "key=space") return {.key = ' '};
  if (follows("key=") && text.size() == 5) return {.key = text[4]};
  if (follows("resize=")) return {.kind = Event::kResize, .size = parse_size(text.substr(7))};
  if (text == "minimise") return {.kind = Event::kMinimise};
  if (text == "restore") return {.kind = Event::kRestore};
  if (text == "quit") return {.kind = Event::kQuit};
  throw std::runtime_error("a scripted event of " + text +
                           ", expected key=K, key=space, resize=WxH, minimise, restore or quit");
}

}  // namespace

std::vector<ScriptedEvent> parse_script(const std::string& text) {
  std::vector<ScriptedEvent> script;
  std::istringstream parts(text);
  for (std::string part; std::getline(parts, part, ',');) {
    const size_t colon = part.find(':');
    if (colon == 0 || colon > 9 || part.find_first_not_of("0123456789") != colon)
      throw std::runtime_error("a part of the script of " + part + ", expected FRAME:EVENT");
    script.push_back({std::stoull(part), parse_event(part.substr(colon + 1))});
  }
  std::stable_sort(script.begin(), script.end(),
                   [](const ScriptedEvent& a, const ScriptedEvent& b) { return a.frame < b.frame; });
  return script;
}

}  // namespace postpass
