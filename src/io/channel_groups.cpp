#include "io/channel_groups.h"

#include <algorithm>

namespace raymeld {

ChannelGroups::ChannelGroups(std::span<const std::string> names) {
  for (const std::string& name : names) {
    const size_t dot = name.rfind('.');
    const std::string prefix = dot == std::string::npos ? "" : name.substr(0, dot);
    if (!names_.contains(prefix)) prefixes_.push_back(prefix);
    names_[prefix].emplace(dot == std::string::npos ? name : name.substr(dot + 1), name);
  }
}

std::optional<std::string> ChannelGroups::find(const std::string& prefix, const std::string& channel) const {
  const auto group = names_.find(prefix);
  if (group == names_.end()) return std::nullopt;
  const auto found = group->second.find(channel);
  return found == group->second.end() ? std::nullopt : std::optional(found->second);
}

bool ChannelGroups::has_channel(const std::string& name) const {
  return std::ranges::any_of(names_, [&](const auto& group) {
    return std::ranges::any_of(group.second, [&](const auto& channel) { return channel.second == name; });
  });
}

std::optional<ChannelTriple> ChannelGroups::triple(const std::string& prefix) const {
  for (const ChannelTriple& names :
       {ChannelTriple{"R", "G", "B"}, {"r", "g", "b"}, {"X", "Y", "Z"}, {"x", "y", "z"}}) {
    const auto a = find(prefix, names[0]), b = find(prefix, names[1]), c = find(prefix, names[2]);
    if (a && b && c) return ChannelTriple{*a, *b, *c};
  }
  const auto grey = find(prefix, "Y");
  const bool is_alone = !find(prefix, "R") && !find(prefix, "X") && !is_luminance_chroma(prefix);
  return grey && is_alone ? std::optional(ChannelTriple{*grey, *grey, *grey}) : std::nullopt;
}

std::optional<std::string> ChannelGroups::alpha(const std::string& prefix) const {
  const auto upper = find(prefix, "A");
  return upper ? upper : find(prefix, "a");
}

std::optional<std::array<std::string, 2>> ChannelGroups::pair(const std::string& prefix) const {
  for (const auto& [x, y] :
       {std::pair("X", "Y"), {"x", "y"}, {"U", "V"}, {"u", "v"}, {"R", "G"}, {"r", "g"}}) {
    const auto first = find(prefix, x), second = find(prefix, y);
    if (first && second) return std::array{*first, *second};
  }
  return std::nullopt;
}

std::optional<std::string> ChannelGroups::depth(const std::string& prefix) const {
  for (const char* other : {"X", "x", "U", "u"})
    if (find(prefix, other)) return std::nullopt;
  for (const char* name : {"Z", "z", "V", "v"})
    if (const auto found = find(prefix, name)) return found;
  return std::nullopt;
}

bool ChannelGroups::is_luminance_chroma(const std::string& prefix) const {
  return find(prefix, "Y") && (find(prefix, "RY") || find(prefix, "BY"));
}

}  // namespace raymeld
