#pragma once

#include <chrono>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>

namespace raymeld::test {

// Waits until `file` exists. After a minute it writes FILE.late and goes on.
inline void wait_for_file(const std::string& file) {
  constexpr std::chrono::milliseconds kStep{2}, kMost{60'000};
  for (auto waited = kStep; waited < kMost; waited += kStep) {
    if (std::filesystem::exists(file)) return;
    std::this_thread::sleep_for(kStep);
  }
  std::ofstream(file + ".late");
}

}  // namespace raymeld::test
