// The program's commands: each adds itself to the command line; its work is done while that is parsed.
#pragma once

#include <CLI/CLI.hpp>

namespace raymeld::cli {

void add_fuse(CLI::App& app);
void add_devices(CLI::App& app);
void add_compare(CLI::App& app);
void add_degrade(CLI::App& app);
void add_graph(CLI::App& app);
void add_tune(CLI::App& app);
void add_trade(CLI::App& app);
void add_conform(CLI::App& app);
// Commands that no help lists: man and completion print what the build installs.
void add_documents(CLI::App& app);

}  // namespace raymeld::cli
