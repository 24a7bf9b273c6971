// Decides which passes of a frame need a memory barrier before them.
#pragma once

#include <cstdint>
#include <vector>

namespace raymeld {

struct ByteRange {
  uint64_t begin, end;  // the last excluded
};

// Holds the memory that a pass reads and writes.
struct MemoryUse {
  std::vector<ByteRange> reads, writes;
};

// Says for each pass, in the order of execution, whether a barrier precedes it. One does if the pass reads
// what a pass since the last barrier wrote, or writes what such a pass read or wrote.
std::vector<bool> plan_barriers(const std::vector<MemoryUse>& passes);

}  // namespace raymeld
