#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace raymeld {

// Asks for a buffer that keeps its contents from dispatch first_use to dispatch last_use, both inclusive.
struct ArenaRequest {
  uint64_t size_bytes;
  int first_use;
  int last_use;
};

// Says where each request lies in one shared block of size_bytes; offset_bytes[i] belongs to request i.
struct ArenaPlan {
  std::vector<uint64_t> offset_bytes;
  uint64_t size_bytes;
};

// Lets buffers whose lifetimes do not meet share memory. Offsets are multiples of alignment_bytes and every
// request takes a multiple of it; a request of no bytes takes no room. The same requests give the same plan.
// Chains such as the network's take peak_live_bytes; random lifetimes take up to a quarter more. Throws Error
// when a lifetime ends before it starts, alignment_bytes is 0, or the sizes overflow 64 bits.
ArenaPlan plan_arena(std::span<const ArenaRequest> requests, uint64_t alignment_bytes);

// Returns the most bytes that are alive at any one dispatch, each request rounded up to alignment_bytes. No
// plan with this alignment can be smaller. Throws as plan_arena does.
uint64_t peak_live_bytes(std::span<const ArenaRequest> requests, uint64_t alignment_bytes);

}  // namespace raymeld
