#pragma once

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>

#include "engine/kernel.h"

namespace raymeld {

// Shares the kernels of one device among all Programs that have the same ones. Any threads may use it.
class KernelPool {
 public:
  // Is called with how many of how many kernels are compiled, by any thread but one at a time.
  using Progress = std::function<void(size_t done, size_t count)>;

  // Returns a kernel for each recipe: one that somebody still has, or a new one. As many threads as the host
  // has compile new ones; on the caller's device only the calling thread does, since the caller's allocator
  // may not expect more. Throws Error.
  std::vector<std::shared_ptr<const Kernel>> get(const Device& device, VkPipelineCache cache,
                                                 std::span<const KernelRecipe> recipes,
                                                 const Progress& progress = {});

  // Keeps the last `count` kernels that get() returned, even if nobody else has them any more. This helps
  // callers that make many Programs of the same kernels, one after another. By default none is kept.
  void keep(size_t count);

 private:
  std::mutex mutex_;
  size_t most_kept_ = 0;
  std::deque<std::shared_ptr<const Kernel>> kept_;
  std::map<KernelRecipe, std::weak_ptr<const Kernel>> known_;
};

}  // namespace raymeld
