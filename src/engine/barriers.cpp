#include "engine/barriers.h"

#include <algorithm>

namespace raymeld {
namespace {

bool meet(const std::vector<ByteRange>& some, const std::vector<ByteRange>& others) {
  return std::ranges::any_of(some, [&](const ByteRange& a) {
    return std::ranges::any_of(others,
                               [&](const ByteRange& b) { return a.begin < b.end && b.begin < a.end; });
  });
}

void append(std::vector<ByteRange>& to, const std::vector<ByteRange>& more) {
  to.insert(to.end(), more.begin(), more.end());
}

}  // namespace

std::vector<bool> plan_barriers(const std::vector<MemoryUse>& passes) {
  std::vector<bool> barriers;
  MemoryUse pending;  // It holds what the passes since the last barrier use.
  for (const MemoryUse& pass : passes) {
    const bool needed = meet(pass.reads, pending.writes) || meet(pass.writes, pending.writes) ||
                        meet(pass.writes, pending.reads);
    barriers.push_back(needed);
    if (needed) pending = {};
    append(pending.reads, pass.reads);
    append(pending.writes, pass.writes);
  }
  return barriers;
}

}  // namespace raymeld
