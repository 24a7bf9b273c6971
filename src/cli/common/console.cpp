#include "cli/common/console.h"

#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <mutex>

#include "error.h"
#include "platform/terminal.h"

namespace raymeld::cli {
namespace {

std::atomic<bool> printed = false;
std::mutex stderr_mutex;
bool bar_is_drawn = false;  // it is on the terminal's current line

void wipe_bar() {
  if (bar_is_drawn) std::fputs("\r\033[K", stderr);
  bar_is_drawn = false;
}

// Ignores errors: there is no other place to report that stderr cannot be written.
void say(const std::string& text) {
  const std::lock_guard lock(stderr_mutex);
  wipe_bar();
  std::fputs(text.c_str(), stderr);
}

void draw_bar(double share) {
  constexpr int kWidth = 30;
  const int done = static_cast<int>(share * kWidth);
  const std::lock_guard lock(stderr_mutex);
  std::fputs(fmt::format("\r[{:#<{}}{:.<{}}] {:3.0f} %", "", done, "", kWidth - done, 100 * share).c_str(),
             stderr);
  bar_is_drawn = true;
}

}  // namespace

bool has_printed() { return printed; }

void print(const std::string& text) {
  say("");
  if (!text.empty()) printed = true;
  if (std::fwrite(text.data(), 1, text.size(), stdout) != text.size() || std::fflush(stdout) != 0) {
    throw Error("cannot write to standard output: {}", std::strerror(errno));
  }
}

std::string json_text(const nlohmann::ordered_json& json) {
  return json.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

void complain(const std::string& message) { say("raymeld: error: " + message + "\n"); }

void Console::note(const std::string& text) const {
  if (notes_) say(about_ + text + "\n");
}

void Console::warn(const std::string& message, uint64_t count) {
  warnings_.push_back({message, count});
  say("raymeld: warning: " + about_ + message + "\n");
}

nlohmann::ordered_json to_json(const std::vector<Warning>& warnings) {
  auto json = nlohmann::ordered_json::array();
  for (const Warning& warning : warnings)
    json.push_back({{"message", warning.message}, {"count", warning.count}});
  return json;
}

ProgressBar::ProgressBar(const Console& console) : shown_(console.notes()), terminal_(is_stderr_terminal()) {
  update(0);
}

ProgressBar::~ProgressBar() { say(""); }

void ProgressBar::update(double share) {
  constexpr auto kBetweenLines = std::chrono::seconds(5);
  if (!shown_) return;
  if (terminal_) {
    draw_bar(share);
  } else if (Clock::now() - last_line_ >= kBetweenLines) {
    last_line_ = Clock::now();
    say(fmt::format("{:.0f} %\n", 100 * share));
  }
}

}  // namespace raymeld::cli
