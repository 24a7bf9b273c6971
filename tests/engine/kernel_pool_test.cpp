#include "engine/kernel_pool.h"

#include <gtest/gtest.h>

#include <chrono>
#include <set>
#include <thread>

#include "engine/pipeline_cache.h"
#include "engine/program.h"
#include "fusion/plan.h"
#include "fusion/tuner.h"
#include "gpu.h"
#include "networks/stock_models.h"

namespace raymeld::test {
namespace {

class KernelPoolTest : public GpuTest {
 protected:
  // Returns the recipes of a stock model as it runs on the device by default.
  std::vector<KernelRecipe> recipes_of(const std::string& name) {
    model_.emplace(find_stock_model(name));
    plan_ =
        plan_fusion(*model_, 32, 32, gpu().info(), {.kernels = kernels_for(gpu(), Storage::kFloat32, "")});
    return kernel_recipes(plan_->graph, gpu().info());
  }

  PipelineCache cache_{gpu(), ""};
  KernelPool pool_;
  std::optional<Model> model_;
  std::optional<FusePlan> plan_;
};

TEST_F(KernelPoolTest, AKernelIsOneForAsLongAsSomebodyHasIt) {
  const std::vector<KernelRecipe> recipes = recipes_of("x4-fast");
  const std::vector<KernelRecipe> some(recipes.begin(), recipes.begin() + 4);
  const size_t distinct = std::set<KernelRecipe>(some.begin(), some.end()).size();
  size_t compiled = 0;
  const auto count = [&](size_t, size_t) { ++compiled; };
  const auto kernels = pool_.get(gpu(), cache_.handle(), some, count);
  EXPECT_EQ(compiled, distinct);
  const auto again = pool_.get(gpu(), cache_.handle(), some, count);
  EXPECT_EQ(compiled, distinct);
  EXPECT_EQ(kernels, again);
}

TEST_F(KernelPoolTest, EachRecipeHasItsKernelAndProgressReachesTheEnd) {
  const std::vector<KernelRecipe> recipes = recipes_of("x4-fast");
  std::vector<std::pair<size_t, size_t>> told;
  const auto kernels = pool_.get(gpu(), cache_.handle(), recipes,
                                 [&](size_t done, size_t count) { told.emplace_back(done, count); });
  ASSERT_EQ(kernels.size(), recipes.size());
  for (size_t i = 0; i < recipes.size(); ++i) {
    for (size_t j = 0; j < i; ++j) {
      const bool same = !(recipes[i] < recipes[j]) && !(recipes[j] < recipes[i]);
      EXPECT_EQ(kernels[i] == kernels[j], same) << recipes[i].name << ", " << recipes[j].name;
    }
  }
  ASSERT_FALSE(told.empty());
  for (size_t i = 0; i < told.size(); ++i) EXPECT_EQ(told[i], std::pair(i + 1, told.size()));
}

TEST_F(KernelPoolTest, ThreadsShareKernels) {
  const std::vector<KernelRecipe> recipes = recipes_of("x4-fast");
  std::vector<std::shared_ptr<const Kernel>> found[2];
  {
    std::jthread other([&] { found[0] = pool_.get(gpu(), cache_.handle(), recipes); });
    found[1] = pool_.get(gpu(), cache_.handle(), recipes);
  }
  for (const auto& kernels : found) {
    for (const auto& kernel : kernels) EXPECT_NE(kernel->pipeline(), VK_NULL_HANDLE);
  }
  EXPECT_EQ(pool_.get(gpu(), cache_.handle(), recipes).size(), recipes.size());
}

// A kernel that takes longer than all others together delays the start, however many threads compile.
TEST_F(KernelPoolTest, NoKernelOfAStockModelTakesLongerToMakeThanAllOthers) {
  size_t combinations = 0;
  for (const char* name : {"x4-fast", "x4-balanced"}) {
    if (!is_tried(combinations++, 2)) continue;
    std::map<std::string, double> times_ms;
    double sum_ms = 0;
    for (const KernelRecipe& recipe : recipes_of(name)) {
      const auto start = std::chrono::steady_clock::now();
      const auto kernel = KernelPool().get(gpu(), cache_.handle(), std::array{recipe});
      const std::chrono::duration<double, std::milli> time = std::chrono::steady_clock::now() - start;
      times_ms[recipe.name] = std::max(times_ms[recipe.name], time.count());
      sum_ms += time.count();
    }
    for (const auto& [kernel, time_ms] : times_ms) EXPECT_LT(time_ms, sum_ms / 2) << name << ": " << kernel;
  }
}

}  // namespace
}  // namespace raymeld::test
