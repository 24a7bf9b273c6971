#include "engine/arena.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <random>
#include <vector>

#include "error.h"

namespace raymeld {
namespace {

using Requests = std::vector<ArenaRequest>;

bool apart(const ArenaPlan& plan, const Requests& requests, size_t i, size_t j) {
  const ArenaRequest &a = requests[i], &b = requests[j];
  const bool apart_in_time = a.last_use < b.first_use || b.last_use < a.first_use;
  const bool apart_in_space = plan.offset_bytes[i] + a.size_bytes <= plan.offset_bytes[j] ||
                              plan.offset_bytes[j] + b.size_bytes <= plan.offset_bytes[i];
  return a.size_bytes == 0 || b.size_bytes == 0 || apart_in_time || apart_in_space;
}

void expect_sound(const ArenaPlan& plan, const Requests& requests, uint64_t alignment_bytes) {
  ASSERT_EQ(plan.offset_bytes.size(), requests.size());
  for (size_t i = 0; i < requests.size(); ++i) {
    EXPECT_EQ(plan.offset_bytes[i] % alignment_bytes, 0u) << "buffer " << i;
    EXPECT_LE(plan.offset_bytes[i] + requests[i].size_bytes, plan.size_bytes) << "buffer " << i;
    for (size_t j = 0; j < i; ++j)
      EXPECT_TRUE(apart(plan, requests, i, j)) << "buffers " << j << " and " << i;
  }
  EXPECT_GE(plan.size_bytes, peak_live_bytes(requests, alignment_bytes));
}

int uniform(std::mt19937& random, int low, int high) {
  return std::uniform_int_distribution<int>(low, high)(random);
}

Requests random_requests(std::mt19937& random) {
  Requests requests(uniform(random, 0, 40));
  const int dispatches = uniform(random, 1, 60), longest = uniform(random, 0, dispatches);
  const int largest_bytes = uniform(random, 0, 3) == 0 ? 4 : 100000;
  for (ArenaRequest& r : requests) {
    r.first_use = uniform(random, 0, dispatches - 1);
    r.last_use = r.first_use + uniform(random, 0, longest);
    r.size_bytes = uniform(random, 0, largest_bytes);
  }
  return requests;
}

// Returns the buffers of the paper's network with one dispatch per convolution, an LRHS of `pixels` pixels
// and a scale of 2^steps. A block's wide buffer holds its input and all that its dense convolutions append.
Requests network_requests(uint64_t pixels, int steps, int groups, int blocks, int dense_layers,
                          uint64_t features, uint64_t growth) {
  Requests requests;
  int now = 0;
  const auto make = [&](uint64_t floats_per_pixel, int first_use) {
    requests.push_back(
        {.size_bytes = pixels * floats_per_pixel * 4, .first_use = first_use, .last_use = first_use});
    return requests.size() - 1;
  };
  const auto use = [&](size_t i) { requests[i].last_use = now; };
  const size_t fusion_input = make(2 * features, now);  // F_LRHS is its first slice: the long skip
  size_t x = make(features << (2 * steps), ++now);      // HRLS encoder
  for (int i = 1; i <= steps; ++i) {
    ++now;
    use(x);
    if (i == steps) break;  // the last deshuffle writes the second slice of fusion_input
    x = make(features << (2 * (steps - i)), now);
  }
  const uint64_t wide = features + dense_layers * growth;
  x = make(wide, ++now);
  use(fusion_input);
  for (int g = 0; g < groups; ++g) {
    const size_t group_input = x;
    for (int b = 0; b < blocks; ++b) {
      now += dense_layers + 1;
      const size_t merged = make(wide, now);
      use(x);
      x = merged;
    }
    use(group_input);
  }
  use(fusion_input);
  for (int i = 1; i <= steps + 1; ++i) {
    const size_t upscaled = make(i <= steps ? features << (2 * i) : uint64_t{3} << (2 * steps), ++now);
    use(x);
    x = upscaled;
  }
  return requests;
}

TEST(Arena, NothingNeedsNothing) {
  const ArenaPlan plan = plan_arena({}, 256);
  EXPECT_EQ(plan.size_bytes, 0u);
  EXPECT_TRUE(plan.offset_bytes.empty());
  EXPECT_EQ(peak_live_bytes({}, 256), 0u);
}

TEST(Arena, SingleIsRoundedUp) {
  const Requests requests = {{.size_bytes = 1000, .first_use = 3, .last_use = 7}};
  const ArenaPlan plan = plan_arena(requests, 256);
  EXPECT_EQ(plan.offset_bytes[0], 0u);
  EXPECT_EQ(plan.size_bytes, 1024u);
  EXPECT_EQ(peak_live_bytes(requests, 256), 1024u);
}

TEST(Arena, ZeroSizeTakesNoRoom) {
  const Requests requests = {
      {.size_bytes = 0, .first_use = 0, .last_use = 9},
      {.size_bytes = 512, .first_use = 0, .last_use = 9},
      {.size_bytes = 0, .first_use = 4, .last_use = 4},
  };
  const ArenaPlan plan = plan_arena(requests, 256);
  expect_sound(plan, requests, 256);
  EXPECT_EQ(plan.size_bytes, 512u);
}

TEST(Arena, AllOverlappingAddUp) {
  const Requests requests = {
      {.size_bytes = 100, .first_use = 0, .last_use = 5},
      {.size_bytes = 200, .first_use = 5, .last_use = 9},
      {.size_bytes = 300, .first_use = 1, .last_use = 8},
      {.size_bytes = 1, .first_use = 5, .last_use = 5},
  };
  const ArenaPlan plan = plan_arena(requests, 4);
  expect_sound(plan, requests, 4);
  EXPECT_EQ(plan.size_bytes, 100u + 200u + 300u + 4u);
}

TEST(Arena, DisjointShareOnePlace) {
  const Requests requests = {
      {.size_bytes = 100, .first_use = 0, .last_use = 1},
      {.size_bytes = 300, .first_use = 2, .last_use = 3},
      {.size_bytes = 200, .first_use = 4, .last_use = 4},
  };
  const ArenaPlan plan = plan_arena(requests, 4);
  EXPECT_EQ(plan.size_bytes, 300u);
  EXPECT_EQ(plan.offset_bytes, (std::vector<uint64_t>{0, 0, 0}));
}

// A buffer that is written at the dispatch where another is read for the last time must not share its memory.
TEST(Arena, LifetimesAreInclusive) {
  const Requests requests = {
      {.size_bytes = 64, .first_use = 0, .last_use = 1},
      {.size_bytes = 64, .first_use = 1, .last_use = 2},
  };
  EXPECT_EQ(plan_arena(requests, 64).size_bytes, 128u);
}

// Placing the largest first would put 3 above 4 and need 13.
TEST(Arena, ChainThatDefeatsLargestFirst) {
  const Requests requests = {
      {.size_bytes = 6, .first_use = 0, .last_use = 1},
      {.size_bytes = 4, .first_use = 1, .last_use = 2},
      {.size_bytes = 3, .first_use = 2, .last_use = 3},
      {.size_bytes = 5, .first_use = 3, .last_use = 4},
  };
  const ArenaPlan plan = plan_arena(requests, 1);
  expect_sound(plan, requests, 1);
  EXPECT_EQ(plan.size_bytes, 10u);
}

TEST(Arena, RandomPlansAreSoundAndSmall) {
  std::mt19937 random(20211);
  double worst_factor = 1, sum_of_factors = 0;
  const int cases = 4000;
  for (int i = 0; i < cases; ++i) {
    const Requests requests = random_requests(random);
    const uint64_t alignment_bytes = std::vector<uint64_t>{1, 4, 48, 256}[uniform(random, 0, 3)];
    const ArenaPlan plan = plan_arena(requests, alignment_bytes);
    ASSERT_NO_FATAL_FAILURE(expect_sound(plan, requests, alignment_bytes)) << "case " << i;
    ASSERT_FALSE(HasFailure()) << "case " << i;
    const uint64_t peak_bytes = peak_live_bytes(requests, alignment_bytes);
    const double factor = peak_bytes == 0 ? 1 : double(plan.size_bytes) / double(peak_bytes);
    worst_factor = std::max(worst_factor, factor);
    sum_of_factors += factor;
  }
  RecordProperty("worst_factor", std::to_string(worst_factor));
  EXPECT_LE(worst_factor, 1.25);
  EXPECT_LE(sum_of_factors / cases, 1.01);
}

TEST(Arena, RandomChainsReachTheBound) {
  std::mt19937 random(7);
  for (int i = 0; i < 2000; ++i) {
    Requests requests(uniform(random, 1, 30));
    for (size_t t = 0; t < requests.size(); ++t) {
      requests[t] = {
          .size_bytes = uint64_t(uniform(random, 1, 1000)), .first_use = int(t), .last_use = int(t) + 1};
    }
    const ArenaPlan plan = plan_arena(requests, 16);
    expect_sound(plan, requests, 16);
    ASSERT_EQ(plan.size_bytes, peak_live_bytes(requests, 16)) << "case " << i;
  }
}

TEST(Arena, NetworksReachTheBound) {
  for (int steps = 1; steps <= 3; ++steps) {
    for (const int growth : {4, 16, 64}) {
      for (const int groups : {1, 2, 3}) {
        const Requests requests = network_requests(97 * 61, steps, groups, 5, 4, 64, growth);
        const ArenaPlan plan = plan_arena(requests, 256);
        expect_sound(plan, requests, 256);
        EXPECT_EQ(plan.size_bytes, peak_live_bytes(requests, 256))
            << "scale " << (1 << steps) << ", growth " << growth << ", groups " << groups;
      }
    }
  }
}

TEST(Arena, RefusesWhatHasNoPlan) {
  const uint64_t most = std::numeric_limits<uint64_t>::max();
  EXPECT_THROW(plan_arena(Requests{{.size_bytes = 1, .first_use = 0, .last_use = 0}}, 0), Error);
  EXPECT_THROW(plan_arena(Requests{{.size_bytes = 1, .first_use = 2, .last_use = 1}}, 4), Error);
  EXPECT_THROW(plan_arena(Requests{{.size_bytes = most, .first_use = 0, .last_use = 0}}, 256), Error);
  EXPECT_THROW(plan_arena(Requests{{.size_bytes = most / 2 + 1, .first_use = 0, .last_use = 0},
                                   {.size_bytes = most / 2 + 1, .first_use = 0, .last_use = 0}},
                          1),
               Error);
  EXPECT_THROW(peak_live_bytes(Requests{{.size_bytes = most, .first_use = 0, .last_use = 0},
                                        {.size_bytes = 1, .first_use = 0, .last_use = 0}},
                               1),
               Error);
  const Requests largest = {{.size_bytes = most, .first_use = 0, .last_use = 0}};
  expect_sound(plan_arena(largest, 1), largest, 1);
}

}  // namespace
}  // namespace raymeld
