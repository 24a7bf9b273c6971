// Fuses many frames with one command: while one is fused, the next is read and the last one is written.
#pragma once

#include <filesystem>
#include <optional>

#include "cli/fuse/fuse.h"
#include "cli/sequence/frames.h"

namespace raymeld::cli {

struct SequenceArguments {
  std::vector<int> frames;  // empty: no sequence
  Shard shard;
  bool resume = false;        // skips frames that are done since their newest input
  std::vector<int> reset_at;  // frames that begin a shot, with FuseArguments::temporal
};

// Fuses a sequence; the paths in `patterns` have # for the frame's number. A frame that fails is reported and
// the others go on, but an interrupt or a lost device ends the run. The outputs of fused frames stay. Throws
// Error, also at the end if a frame failed, and Cancelled.
void run_sequence(const SequenceArguments& sequence, const FuseArguments& patterns);

// Returns `patterns` with the frame's number in all paths.
FuseArguments of_frame(const FuseArguments& patterns, int frame);

// Throws Error, naming the option, when a path has a # for the number of a frame.
void check_no_patterns(const FuseArguments& arguments);

// Throws Error unless frames differ in their inputs, no file is written twice and no input is written.
void check_patterns(const FuseArguments& patterns, std::span<const int> frames);

using FileTime = std::filesystem::file_time_type;

// Returns when the newest input of a frame was written; none if one does not exist.
std::optional<FileTime> newest_input(const FuseArguments& frame);

// Returns whether all outputs of a frame exist and none is older than `since`.
bool is_done(const FuseArguments& frame, FileTime since);

}  // namespace raymeld::cli
