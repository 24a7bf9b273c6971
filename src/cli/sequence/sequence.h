// Many frames with one command: while one is fused, the next is read and the last one is written.
#pragma once

#include "cli/sequence/frames.h"
#include "cli/fuse/fuse.h"

namespace raymeld::cli {

struct SequenceArguments {
  std::vector<int> frames;  // empty: no sequence
  Shard shard;
  bool resume = false;  // leaves out the frames that is_done() says are done
};

// `patterns`: the paths of a frame, with # for its number. A frame that fails is reported and the others go
// on; an interrupt or a lost device ends all. The outputs of frames that were fused stay. Throws Error, also
// at the end if a frame failed, and Cancelled.
void run_sequence(const SequenceArguments& sequence, const FuseArguments& patterns);

// `patterns` with the frame's number in all paths.
FuseArguments of_frame(const FuseArguments& patterns, int frame);

// Throws Error, naming the option, when a path has a # for the number of a frame.
void check_no_patterns(const FuseArguments& arguments);

// Throws Error unless all frames differ in what they read, and write each file once and none that is read.
void check_patterns(const FuseArguments& patterns, std::span<const int> frames);

// Whether all outputs of a frame are there, none older than an input or than `model` (empty: a stock model
// that nobody named).
bool is_done(const FuseArguments& frame, const std::filesystem::path& model);

}  // namespace raymeld::cli
