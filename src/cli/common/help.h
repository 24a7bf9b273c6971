// The texts of --help and what else is made of the tree of commands and options.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace raymeld::cli {

// The group of the options that --help leaves to --help-all.
inline constexpr const char* kMoreOptions = "More options";

// Groups options as they were added, wraps their texts and leaves kMoreOptions to --help-all.
class HelpFormatter : public CLI::Formatter {
 public:
  HelpFormatter() { column_width(34); }
  std::string make_help(const CLI::App* app, std::string name, CLI::AppFormatMode mode) const override;
  std::string make_option_opts(const CLI::Option* option) const override;
  std::string make_option_desc(const CLI::Option* option) const override;
};

// A check for options that name a file to write: its name must end in this, such as ".exr", in either case.
// The hint says what else the user may have wanted.
CLI::Validator ends_in(const std::string& extension, const std::string& hint = "");

// The names that the value of an option can have, such as auto, fp32 and fp16; empty where it can be
// anything.
std::vector<std::string> choices(const CLI::Option& option);

// Stands for the value of an option, such as "auto|fp32|fp16" or "FILE"; empty for a flag.
std::string value_text(const CLI::Option& option);

// What an option does, and its default where it has one.
std::string option_text(const CLI::Option& option);

// The options of a command that have names, in the order in which they were added.
std::vector<const CLI::Option*> named_options(const CLI::App& command);

// The commands that the help of the program lists.
std::vector<const CLI::App*> shown_commands(const CLI::App& app);

// A page for man, of all commands.
std::string man_page(const CLI::App& app);

// A script that completes commands, options and their values in bash.
std::string bash_completion(const CLI::App& app);

}  // namespace raymeld::cli
