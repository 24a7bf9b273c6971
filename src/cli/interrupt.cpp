#include "cli/interrupt.h"

#include <csignal>

#include "error.h"

namespace raymeld::cli {
namespace {

volatile std::sig_atomic_t got_signal = 0;

}  // namespace

void catch_signals() {
  struct sigaction action {};
  action.sa_handler = [](int) { got_signal = 1; };
  action.sa_flags = static_cast<int>(SA_RESETHAND | SA_RESTART);
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  std::signal(SIGXFSZ, SIG_IGN);
  std::signal(SIGPIPE, SIG_IGN);
}

bool interrupted() { return got_signal != 0; }

void check_interrupted() {
  if (interrupted()) throw Cancelled();
}

}  // namespace raymeld::cli
