// Declares the program's commands. Each adds itself to the command line and runs while that is parsed.
#pragma once

#include <CLI/CLI.hpp>

namespace raymeld::cli {

void add_fuse(CLI::App& app);
void add_denoise(CLI::App& app);
void add_upscale(CLI::App& app);
void add_devices(CLI::App& app);
void add_compare(CLI::App& app);
void add_degrade(CLI::App& app);
void add_graph(CLI::App& app);
void add_compile(CLI::App& app);
void add_tune(CLI::App& app);
void add_trade(CLI::App& app);
void add_conform(CLI::App& app);
// Adds man and completion, which print files that the build installs. No help lists them.
void add_documents(CLI::App& app);

}  // namespace raymeld::cli
