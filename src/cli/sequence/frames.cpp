#include "cli/sequence/frames.h"

#include <charconv>
#include <unordered_set>

#include "error.h"

namespace raymeld::cli {
namespace {

constexpr int kLastFrame = 999'999'999;
constexpr size_t kMostFrames = 1'000'000;

// Takes a number off the front of `text`, if there is one.
bool take_number(std::string_view& text, int& number) {
  if (text.empty() || text.front() == '-') return false;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || number > kLastFrame) return false;
  text.remove_prefix(size_t(end - text.data()));
  return true;
}

bool take(std::string_view& text, char wanted) {
  if (!text.starts_with(wanted)) return false;
  text.remove_prefix(1);
  return true;
}

struct Range {
  int first = 0, last = 0, step = 1;
};

Range parse_range(std::string_view text) {
  const std::string_view whole = text;
  Range range;
  bool valid = take_number(text, range.first);
  range.last = range.first;
  if (valid && take(text, '-')) {
    valid = take_number(text, range.last) && (!take(text, 'x') || take_number(text, range.step));
  }
  if (!valid || !text.empty()) {
    throw Error(
        "'{}' is neither a frame nor a range of frames; expected such as 7, 1-240 or 1-240x2, from 0 to {}",
        whole, kLastFrame);
  }
  if (range.first > range.last) throw Error("'{}' ends before it begins", whole);
  if (range.step == 0) throw Error("'{}' has a step of 0", whole);
  return range;
}

struct Run {
  size_t begin = std::string::npos, size = 0;
};

Run find_run(std::string_view path) {
  const size_t last = path.find_last_not_of('/');  // a folder's name may end with slashes
  if (last == std::string::npos) return {};
  const size_t name = path.find_last_of('/', last) + 1;  // npos + 1 is 0
  const size_t end = path.find_last_of('#', last);
  if (end == std::string::npos || end < name) return {};
  const size_t begin = path.find_last_not_of('#', end) + 1;
  return {begin, end + 1 - begin};
}

}  // namespace

std::vector<int> parse_frames(const std::string& text) {
  std::vector<int> frames;
  std::unordered_set<int> seen;
  for (std::string_view rest = text; true;) {
    const size_t comma = rest.find(',');
    const Range range = parse_range(rest.substr(0, comma));
    for (int64_t frame = range.first; frame <= range.last; frame += range.step) {
      if (seen.insert(int(frame)).second) frames.push_back(int(frame));
      if (frames.size() > kMostFrames) throw Error("'{}' is more than {} frames", text, kMostFrames);
    }
    if (comma == std::string_view::npos) return frames;
    rest.remove_prefix(comma + 1);
  }
}

std::string frames_text(std::span<const int> frames) {
  std::string text;
  for (size_t first = 0; first < frames.size();) {
    size_t last = first;
    while (last + 1 < frames.size() && frames[last + 1] == frames[last] + 1) ++last;
    if (!text.empty()) text += ',';
    text += fmt::to_string(frames[first]);
    if (last > first) text += fmt::format("-{}", frames[last]);
    first = last + 1;
  }
  return text;
}

Shard parse_shard(const std::string& text) {
  std::string_view rest = text;
  int index = 0, count = 0;
  if (!take_number(rest, index) || !take(rest, '/') || !take_number(rest, count) || !rest.empty() ||
      index < 1 || index > count) {
    throw Error("expected a shard such as 2/8, from 1/8 to 8/8");
  }
  return {size_t(index), size_t(count)};
}

std::vector<int> frames_of(const Shard& shard, std::span<const int> frames) {
  std::vector<int> part;
  for (size_t i = shard.index - 1; i < frames.size(); i += shard.count) part.push_back(frames[i]);
  return part;
}

FrameRange range_of(const Shard& shard, size_t frames) {
  return {(shard.index - 1) * frames / shard.count, shard.index * frames / shard.count};
}

bool is_pattern(const std::string& path) { return find_run(path).size > 0; }

std::string frame_path(const std::string& pattern, int frame) {
  const Run run = find_run(pattern);
  if (run.size == 0) return pattern;
  return std::string(pattern).replace(run.begin, run.size, fmt::format("{:0{}}", frame, run.size));
}

}  // namespace raymeld::cli
