#include "engine/arena.h"

#include <algorithm>
#include <limits>
#include <numeric>

#include "error.h"

namespace raymeld {
namespace {

constexpr uint64_t kMax = std::numeric_limits<uint64_t>::max();
constexpr int kRounds = 200;

bool meet(const ArenaRequest& a, const ArenaRequest& b) {
  return a.first_use <= b.last_use && b.first_use <= a.last_use;
}

// Returns the requests with their sizes rounded up. Their sum fits 64 bits, so no later sum can overflow.
std::vector<ArenaRequest> rounded(std::span<const ArenaRequest> requests, uint64_t alignment_bytes) {
  if (alignment_bytes == 0) throw Error("planning the arena: the alignment is 0 bytes");
  std::vector<ArenaRequest> result(requests.begin(), requests.end());
  uint64_t total_bytes = 0;
  for (size_t i = 0; i < result.size(); ++i) {
    ArenaRequest& r = result[i];
    if (r.first_use > r.last_use) {
      throw Error("planning the arena: buffer {} is last used at dispatch {}, before its first use at {}", i,
                  r.last_use, r.first_use);
    }
    const uint64_t pad_bytes = (alignment_bytes - r.size_bytes % alignment_bytes) % alignment_bytes;
    if (r.size_bytes > kMax - pad_bytes || r.size_bytes + pad_bytes > kMax - total_bytes) {
      throw Error("planning the arena: the buffers' sizes overflow 64 bits at buffer {} of {} bytes", i,
                  r.size_bytes);
    }
    r.size_bytes += pad_bytes;
    total_bytes += r.size_bytes;
  }
  return result;
}

// Places the requests one by one in `order`, each at the lowest offset where it meets nothing placed before.
ArenaPlan place(const std::vector<ArenaRequest>& requests, const std::vector<size_t>& order) {
  ArenaPlan plan{std::vector<uint64_t>(requests.size(), 0), 0};
  std::vector<size_t> placed;  // sorted by offset
  for (const size_t i : order) {
    const ArenaRequest& r = requests[i];
    if (r.size_bytes == 0) continue;
    uint64_t offset = 0;
    for (const size_t other : placed) {
      if (!meet(r, requests[other])) continue;
      if (offset + r.size_bytes <= plan.offset_bytes[other]) break;
      offset = std::max(offset, plan.offset_bytes[other] + requests[other].size_bytes);
    }
    plan.offset_bytes[i] = offset;
    plan.size_bytes = std::max(plan.size_bytes, offset + r.size_bytes);
    const auto by_offset = [&](size_t a, size_t b) { return plan.offset_bytes[a] < plan.offset_bytes[b]; };
    placed.insert(std::upper_bound(placed.begin(), placed.end(), i, by_offset), i);
  }
  return plan;
}

}  // namespace

// Places the largest first. While the plan is larger than the peak of live bytes, the buffer that ends last
// goes first and all are placed again (squeaky wheel optimisation: Joslin and Clements, 1999). The smallest
// plan wins.
ArenaPlan plan_arena(std::span<const ArenaRequest> requests, uint64_t alignment_bytes) {
  const std::vector<ArenaRequest> all = rounded(requests, alignment_bytes);
  const uint64_t peak_bytes = peak_live_bytes(all, 1);
  std::vector<size_t> order(all.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](size_t a, size_t b) { return all[a].size_bytes > all[b].size_bytes; });
  ArenaPlan best = place(all, order), plan = best;
  for (int round = 0; round < kRounds && best.size_bytes > peak_bytes; ++round) {
    const auto sticks_out = [&](size_t i) {
      return all[i].size_bytes > 0 && plan.offset_bytes[i] + all[i].size_bytes == plan.size_bytes;
    };
    const auto squeaky = std::find_if(order.begin(), order.end(), sticks_out);
    std::rotate(order.begin(), squeaky, squeaky + 1);
    plan = place(all, order);
    if (plan.size_bytes < best.size_bytes) best = plan;
  }
  return best;
}

uint64_t peak_live_bytes(std::span<const ArenaRequest> requests, uint64_t alignment_bytes) {
  const std::vector<ArenaRequest> all = rounded(requests, alignment_bytes);
  uint64_t peak_bytes = 0;
  for (const ArenaRequest& at : all) {  // the peak is reached where some buffer's life begins
    uint64_t live_bytes = 0;
    for (const ArenaRequest& r : all) {
      if (r.first_use <= at.first_use && at.first_use <= r.last_use) live_bytes += r.size_bytes;
    }
    peak_bytes = std::max(peak_bytes, live_bytes);
  }
  return peak_bytes;
}

}  // namespace raymeld
