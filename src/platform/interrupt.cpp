#include "platform/interrupt.h"

#include <atomic>
#include <csignal>

#include "error.h"

namespace raymeld {
namespace {

std::atomic<bool> got_signal = false;
static_assert(std::atomic<bool>::is_always_lock_free);  // a signal handler needs this

void note_signal(int signal) {
  std::signal(signal, SIG_DFL);
  got_signal = true;
}

}  // namespace

void catch_signals() {
  std::signal(SIGINT, note_signal);
  std::signal(SIGTERM, note_signal);
  // Windows has neither of these.
#ifdef SIGXFSZ
  std::signal(SIGXFSZ, SIG_IGN);
#endif
#ifdef SIGPIPE
  std::signal(SIGPIPE, SIG_IGN);
#endif
}

bool interrupted() { return got_signal; }

void check_interrupted() {
  if (interrupted()) throw Cancelled();
}

}  // namespace raymeld
