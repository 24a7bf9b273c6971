#include "engine/kernel_pool.h"

#include <algorithm>
#include <exception>
#include <thread>

namespace raymeld {
namespace {

using Kernels = std::map<KernelRecipe, std::shared_ptr<const Kernel>>;

// Compiles kernels with several threads. The longest shaders come first, so that none is left at the end.
class Compilation {
 public:
  Compilation(const Device& device, VkPipelineCache cache, Kernels& kernels,
              const KernelPool::Progress& progress)
      : device_(device), cache_(cache), progress_(progress), all_(kernels.size()) {
    for (auto& kernel : kernels)
      if (!kernel.second) missing_.push_back(&kernel);
    std::ranges::stable_sort(missing_, std::ranges::greater(),
                             [](const auto* kernel) { return kernel->first.spirv.size(); });
  }

  void run() {
    const size_t threads = device_.is_own() ? std::max(std::thread::hardware_concurrency(), 1u) : 1;
    {
      std::vector<std::jthread> others;
      for (size_t i = 1; i < std::min(threads, missing_.size()); ++i) others.emplace_back([this] { work(); });
      work();
    }
    if (failure_) std::rethrow_exception(failure_);
  }

 private:
  void work() noexcept {
    for (std::unique_lock lock(mutex_); next_ < missing_.size() && !failure_;) {
      auto& [recipe, kernel] = *missing_[next_++];
      lock.unlock();
      std::shared_ptr<const Kernel> made;
      std::exception_ptr failure;
      try {
        made = std::make_shared<const Kernel>(device_, cache_, recipe);
      } catch (...) {
        failure = std::current_exception();
      }
      lock.lock();
      kernel = std::move(made);
      if (failure) failure_ = failure;
      if (kernel && progress_) progress_(all_ - missing_.size() + ++done_, all_);
    }
  }

  const Device& device_;
  VkPipelineCache cache_;
  const KernelPool::Progress& progress_;
  const size_t all_;
  std::vector<Kernels::value_type*> missing_;
  std::mutex mutex_;
  size_t next_ = 0, done_ = 0;
  std::exception_ptr failure_;
};

}  // namespace

std::vector<std::shared_ptr<const Kernel>> KernelPool::get(const Device& device, VkPipelineCache cache,
                                                           std::span<const KernelRecipe> recipes,
                                                           const Progress& progress) {
  Kernels kernels;
  {
    const std::lock_guard lock(mutex_);
    for (const KernelRecipe& recipe : recipes) {
      const auto known = known_.find(recipe);
      kernels[recipe] = known == known_.end() ? nullptr : known->second.lock();
    }
  }
  Compilation(device, cache, kernels, progress).run();
  {
    const std::lock_guard lock(mutex_);
    std::erase_if(known_, [](const auto& known) { return known.second.expired(); });
    for (const auto& [recipe, kernel] : kernels) known_[recipe] = kernel;
  }
  std::vector<std::shared_ptr<const Kernel>> found;
  for (const KernelRecipe& recipe : recipes) found.push_back(kernels.at(recipe));
  const std::lock_guard lock(mutex_);
  kept_.insert(kept_.end(), found.begin(), found.end());
  kept_.erase(kept_.begin(), kept_.end() - ptrdiff_t(std::min(kept_.size(), most_kept_)));
  return found;
}

void KernelPool::keep(size_t count) {
  const std::lock_guard lock(mutex_);
  most_kept_ = count;
}

}  // namespace raymeld
