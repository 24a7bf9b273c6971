#include "cli/console.h"

#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>

#include "error.h"

namespace raymeld::cli {
namespace {

// Where stderr takes nothing any more there is nobody left to tell.
void say(const std::string& text) { std::fputs(text.c_str(), stderr); }

}  // namespace

void print(const std::string& text) {
  if (std::fwrite(text.data(), 1, text.size(), stdout) != text.size() || std::fflush(stdout) != 0) {
    throw Error("cannot write to standard output: {}", std::strerror(errno));
  }
}

void Console::note(const std::string& text) const {
  if (notes_) say(text + "\n");
}

void Console::warn(const std::string& message, uint64_t count) {
  warnings_.push_back({message, count});
  say("raymeld: warning: " + message + "\n");
}

nlohmann::ordered_json to_json(const std::vector<Warning>& warnings) {
  auto json = nlohmann::ordered_json::array();
  for (const Warning& warning : warnings)
    json.push_back({{"message", warning.message}, {"count", warning.count}});
  return json;
}

ProgressBar::ProgressBar(const Console& console)
    : shown_(console.notes()), terminal_(isatty(STDERR_FILENO) != 0) {
  update(0);
}

ProgressBar::~ProgressBar() {
  if (shown_ && terminal_) say("\r\033[K");
}

void ProgressBar::update(double share) {
  constexpr int kBarWidth = 30;
  constexpr auto kBetweenLines = std::chrono::seconds(5);
  if (!shown_) return;
  if (terminal_) {
    const int done = static_cast<int>(share * kBarWidth);
    say(fmt::format("\r[{:#<{}}{:.<{}}] {:3.0f} %", "", done, "", kBarWidth - done, 100 * share));
  } else if (Clock::now() - last_line_ >= kBetweenLines) {
    last_line_ = Clock::now();
    say(fmt::format("{:.0f} %\n", 100 * share));
  }
}

}  // namespace raymeld::cli
