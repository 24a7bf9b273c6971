// The frame numbers of a sequence, the part of them that one process does, and the file names that hold them.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace raymeld::cli {

// Reads numbers and ranges, each with a step if need be, by commas: "1-240", "1-240x2", "1-10,15,20-30". A
// frame comes once, where it is first named, so that "1-240x10,1-240" begins with every tenth. Throws Error.
std::vector<int> parse_frames(const std::string& text);

// As parse_frames() reads it, with a range wherever numbers follow each other: "1-3,7".
std::string frames_text(std::span<const int> frames);

// One of `count` processes that share a sequence.
struct Shard {
  size_t index = 1, count = 1;  // 1 <= index <= count
};

// Reads "2/8". Throws Error.
Shard parse_shard(const std::string& text);

// Every count-th frame from the index-th on, so that the frames of all shards are all frames, each once.
std::vector<int> frames_of(const Shard& shard, std::span<const int> frames);

// Whether the last part of `path` has a #.
bool is_pattern(const std::string& path);

// `pattern` with the number instead of the last run of # in its last part, padded with zeros to the run's
// length. A path that is no pattern stays as it is.
std::string frame_path(const std::string& pattern, int frame);

}  // namespace raymeld::cli
