// Parses the frame numbers of a sequence, shares them among processes and puts them into file names.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace raymeld::cli {

// Parses numbers and ranges, which may have a step, separated by commas: "1-240", "1-240x2", "1-10,15,20-30".
// Lists each frame once, at its first place, so that "1-240x10,1-240" begins with every tenth. Throws Error.
std::vector<int> parse_frames(const std::string& text);

// Writes frames as parse_frames() reads them, with ranges for consecutive numbers: "1-3,7".
std::string frames_text(std::span<const int> frames);

// Identifies one of `count` processes that share a sequence.
struct Shard {
  size_t index = 1, count = 1;  // 1 <= index <= count
};

// Parses "2/8". Throws Error.
Shard parse_shard(const std::string& text);

// Returns every count-th frame from the index-th on. All shards together have every frame once.
std::vector<int> frames_of(const Shard& shard, std::span<const int> frames);

// Holds the indices of frames that follow each other; `end` is one beyond the last.
struct FrameRange {
  size_t begin = 0, end = 0;
};

// Returns the shard's part of so many frames that follow each other. Parts differ by one frame at most.
FrameRange range_of(const Shard& shard, size_t frames);

// Returns whether the last component of `path` has a #.
bool is_pattern(const std::string& path);

// Replaces the last run of # in the last component of `pattern` by the number, padded with zeros to the run's
// length. Returns a path that is no pattern unchanged.
std::string frame_path(const std::string& pattern, int frame);

}  // namespace raymeld::cli
