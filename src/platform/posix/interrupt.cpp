#include "platform/interrupt.h"

#include <atomic>
#include <csignal>

#include "error.h"

namespace raymeld {
namespace {

std::atomic<bool> got_signal = false;
static_assert(std::atomic<bool>::is_always_lock_free);  // a signal handler needs this

}  // namespace

void catch_signals() {
  struct sigaction action {};
  action.sa_handler = [](int) { got_signal = true; };
  action.sa_flags = static_cast<int>(SA_RESETHAND | SA_RESTART);
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  std::signal(SIGXFSZ, SIG_IGN);
  std::signal(SIGPIPE, SIG_IGN);
}

bool interrupted() { return got_signal; }

void check_interrupted() {
  if (interrupted()) throw Cancelled();
}

}  // namespace raymeld
