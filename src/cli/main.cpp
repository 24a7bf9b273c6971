// The one place where exceptions become messages and exit statuses: 0 success, 1 an internal error, 2 wrong
// usage, bad input or a failing device, 130 stopped by a signal.
#include <cstdio>
#include <new>

#include "cli/commands.h"
#include "cli/interrupt.h"
#include "error.h"

namespace {

constexpr int kInternalError = 1, kError = 2, kInterrupted = 130;

int complain(int status, const char* message) {
  std::fprintf(stderr, "raymeld: error: %s\n", message);
  return status;
}

void describe(CLI::App& app) {
  app.set_version_flag("--version", "raymeld " RAYMELD_VERSION);
  app.require_subcommand(1);
  app.get_formatter()->column_width(34);
  app.footer(
      "Examples:\n"
      "  raymeld fuse --lrhs low.exr --hrls high.exr -o fused.exr\n"
      "  raymeld devices\n"
      "  raymeld COMMAND --help\n\n"
      "Exit status: 0 success, 1 internal error, 2 wrong usage, bad input or failing device, 130 "
      "interrupted.");
  raymeld::cli::add_fuse(app);
  raymeld::cli::add_devices(app);
  raymeld::cli::add_compare(app);
  raymeld::cli::add_degrade(app);
  raymeld::cli::add_graph(app);
  raymeld::cli::add_tune(app);
  raymeld::cli::add_conform(app);
}

int parse_and_run(CLI::App& app, int argc, char** argv) try {
  app.parse(argc, argv);
  return 0;
} catch (const CLI::ParseError& error) {
  if (error.get_exit_code() == 0) return app.exit(error);  // --help, --version
  const std::vector<std::string> unknown = app.remaining();
  const bool has_no_command = app.get_subcommands().empty() && !unknown.empty();
  complain(kError,
           has_no_command ? fmt::format("there is no command '{}'", unknown.front()).c_str() : error.what());
  fmt::print(stderr, "raymeld --help and raymeld COMMAND --help tell more.\n");
  return kError;
}

}  // namespace

int main(int argc, char** argv) try {
  raymeld::cli::catch_signals();
  CLI::App app("raymeld: fuses a small many-sample render (LRHS) with a full-size few-sample one (HRLS)",
               "raymeld");
  describe(app);
  const int status = parse_and_run(app, argc, argv);
  if (std::fflush(stdout) != 0 || std::ferror(stdout))
    return complain(kError, "cannot write to standard output");
  return status;
} catch (const raymeld::Error& error) {
  return complain(kError, error.what());
} catch (const raymeld::Cancelled& cancelled) {
  fmt::print(stderr, "raymeld: {}\n", cancelled.what());
  return kInterrupted;
} catch (const std::bad_alloc&) {
  return complain(kError, "there is not enough memory for images of this size");
} catch (const std::exception& error) {
  fmt::print(stderr, "raymeld: internal error: {}\n", error.what());
  return kInternalError;
}
