#include "cli/sequence/handover.h"

#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <thread>

namespace raymeld::cli {
namespace {

using Value = std::unique_ptr<int>;  // a type that can only be moved

TEST(Handover, GivesEveryValueInOrderAndNoneBeforeTheLastWasTaken) {
  constexpr int kValues = 1000;
  Handover<Value> handover;
  std::atomic<int> put = 0, taken = 0;
  std::jthread giver([&] {
    const ClosedAtEnd end(handover);
    for (int i = 0; i < kValues; ++i) {
      EXPECT_TRUE(handover.put(std::make_unique<int>(i)));
      EXPECT_GE(taken + 1, ++put);  // the taker may not have counted it yet
    }
  });
  while (auto value = handover.take()) EXPECT_EQ(**value, taken++);
  EXPECT_EQ(taken, kValues);
}

TEST(Handover, ClosingEndsThoseWhoWait) {
  Handover<Value> full, empty;
  std::jthread giver([&] { EXPECT_FALSE(full.put(std::make_unique<int>(1))); });
  std::jthread taker([&] { EXPECT_FALSE(empty.take()); });
  std::this_thread::sleep_for(std::chrono::milliseconds(20));  // both wait by then in most runs
  full.close();
  empty.close();
  giver.join();
  taker.join();
  EXPECT_FALSE(full.put(nullptr));
  EXPECT_FALSE(full.take());
}

}  // namespace
}  // namespace raymeld::cli
