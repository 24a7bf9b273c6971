#pragma once

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>

#include "engine/kernel.h"

namespace raymeld {

// The kernels of one device, one for all Programs that have the same. Any threads may use it.
class KernelPool {
 public:
  // Told how many of how many kernels are compiled; by any thread, but one at a time.
  using Progress = std::function<void(size_t done, size_t count)>;

  // Returns a kernel for each recipe: one that somebody still has, or a new one. New ones are compiled by as
  // many threads as the host has, or by the caller's alone on a device of somebody else's, whose allocator
  // may not expect more. Throws Error.
  std::vector<std::shared_ptr<const Kernel>> get(const Device& device, VkPipelineCache cache,
                                                 std::span<const KernelRecipe> recipes,
                                                 const Progress& progress = {});

  // Keeps the last `count` kernels that get() gave, even if nobody else has them any more: for those who make
  // many Programs, one after another, of the same kernels. By default none is kept.
  void keep(size_t count);

 private:
  std::mutex mutex_;
  size_t most_kept_ = 0;
  std::deque<std::shared_ptr<const Kernel>> kept_;
  std::map<KernelRecipe, std::weak_ptr<const Kernel>> known_;
};

}  // namespace raymeld
