#include "cli/console.h"

#include <unistd.h>

#include <cstdio>

namespace raymeld::cli {

void Console::note(const std::string& text) const {
  if (notes_) fmt::print(stderr, "{}\n", text);
}

void Console::warn(const std::string& message, uint64_t count) {
  warnings_.push_back({message, count});
  fmt::print(stderr, "raymeld: warning: {}\n", message);
}

ProgressBar::ProgressBar(const Console& console)
    : shown_(console.notes()), terminal_(isatty(STDERR_FILENO) != 0) {
  update(0);
}

ProgressBar::~ProgressBar() {
  if (shown_ && terminal_) fmt::print(stderr, "\r\033[K");
}

void ProgressBar::update(double share) {
  constexpr int kBarWidth = 30;
  constexpr auto kBetweenLines = std::chrono::seconds(5);
  if (!shown_) return;
  if (terminal_) {
    const int done = static_cast<int>(share * kBarWidth);
    fmt::print(stderr, "\r[{:#<{}}{:.<{}}] {:3.0f} %", "", done, "", kBarWidth - done, 100 * share);
  } else if (Clock::now() - last_line_ >= kBetweenLines) {
    last_line_ = Clock::now();
    fmt::print(stderr, "{:.0f} %\n", 100 * share);
  }
}

}  // namespace raymeld::cli
