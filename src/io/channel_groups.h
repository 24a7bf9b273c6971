#pragma once

#include <array>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "io/layer_map.h"

namespace raymeld {

// Groups a file's channels by prefix. The prefix is everything before the last dot, as names of layers may
// hold dots and spaces.
class ChannelGroups {
 public:
  explicit ChannelGroups(std::span<const std::string> names);

  // Lists the prefixes in the order of the file.
  const std::vector<std::string>& prefixes() const { return prefixes_; }
  bool has_channel(const std::string& name) const;
  // Returns the names of the prefix's R, G, B or X, Y, Z, in either case, or of a lone Y three times.
  std::optional<ChannelTriple> triple(const std::string& prefix) const;
  std::optional<std::string> alpha(const std::string& prefix) const;
  // Returns the names of the prefix's X, Y, its U, V or its R, G, in either case.
  std::optional<std::array<std::string, 2>> pair(const std::string& prefix) const;
  // Returns the name of the prefix's Z or V, in either case, unless there is an X or a U.
  std::optional<std::string> depth(const std::string& prefix) const;
  // Returns whether the prefix has Y with RY or BY, which is not a grey picture.
  bool is_luminance_chroma(const std::string& prefix) const;

 private:
  std::optional<std::string> find(const std::string& prefix, const std::string& channel) const;

  std::vector<std::string> prefixes_;
  std::map<std::string, std::map<std::string, std::string>> names_;  // prefix, channel -> full name
};

}  // namespace raymeld
