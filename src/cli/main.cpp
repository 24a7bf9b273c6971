#include <OpenEXR/ImfThreading.h>

#include <algorithm>
#include <cstdio>
#include <string_view>
#include <thread>

#include "cli/common/commands.h"
#include "cli/common/console.h"
#include "cli/common/failure.h"
#include "cli/common/help.h"
#include "error.h"
#include "platform/interrupt.h"

namespace {

using namespace raymeld::cli;

bool wants_json = false;  // --json is among the arguments, valid or not

// Writes the message to stderr and, with --json and nothing printed yet, as a JSON object to stdout.
int fail(const Failure& failure) try {
  complain(failure.message);
  if (wants_json && !has_printed()) print(json_text({{"error", failure.message}}));
  return failure.status;
} catch (...) {  // stdout cannot be written
  return failure.status;
}

void set_up(CLI::App& app) {
  app.set_version_flag("--version", "raymeld " RAYMELD_VERSION);
  app.require_subcommand(1);
  app.formatter(std::make_shared<HelpFormatter>());
  app.set_help_all_flag("--help-all", "Prints all options and exits");
  app.get_help_ptr()->description("Prints the usual options and exits");
  app.footer(
      "Examples:\n"
      "  raymeld fuse --lrhs low.exr --hrls high.exr -o fused.exr\n"
      "  raymeld devices\n"
      "  raymeld COMMAND --help\n\n"
      "Exit status: 0 success, 1 internal error, 2 wrong usage, bad input or failing device, 130 "
      "interrupted.");
  add_fuse(app);
  add_denoise(app);
  add_upscale(app);
  add_devices(app);
  add_compare(app);
  add_degrade(app);
  add_graph(app);
  add_compile(app);
  add_tune(app);
  add_trade(app);
  add_conform(app);
  add_documents(app);
}

int parse_and_run(CLI::App& app, int argc, char** argv) try {
  app.parse(argc, argv);
  return 0;
} catch (const CLI::ParseError& error) {
  if (error.get_exit_code() == 0) return app.exit(error);  // --help, --version
  const std::vector<std::string> unknown = app.remaining();
  const bool has_no_command = app.get_subcommands().empty() && !unknown.empty();
  const int status = fail(
      {kError, has_no_command ? fmt::format("there is no command '{}'", unknown.front()) : error.what()});
  fmt::print(stderr, "See raymeld --help and raymeld COMMAND --help.\n");
  return status;
}

}  // namespace

int main(int argc, char** argv) try {
  raymeld::catch_signals();
  Imf::setGlobalThreadCount(int(std::thread::hardware_concurrency()));
  wants_json = std::find(argv, argv + argc, std::string_view("--json")) != argv + argc;
  CLI::App app(
      "raymeld: fuses a small many-sample render (LRHS) with a full-size few-sample one (HRLS), "
      "upscales the former or denoises the latter",
      "raymeld");
  set_up(app);
  const int status = parse_and_run(app, argc, argv);
  if (std::fflush(stdout) != 0 || std::ferror(stdout))
    return fail({kError, "cannot write to standard output"});
  return status;
} catch (const raymeld::Cancelled& cancelled) {
  fmt::print(stderr, "raymeld: {}\n", cancelled.what());
  return kInterrupted;
} catch (...) {
  return fail(current_failure());
}
