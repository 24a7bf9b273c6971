// Makes the texts of --help, the manual and the completion script from the tree of commands and options.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace raymeld::cli {

// Names the group of options that only --help-all shows.
inline constexpr const char* kMoreOptions = "More options";

// Groups options as they were added, wraps their texts and leaves kMoreOptions to --help-all.
class HelpFormatter : public CLI::Formatter {
 public:
  HelpFormatter() { column_width(34); }
  std::string make_help(const CLI::App* app, std::string name, CLI::AppFormatMode mode) const override;
  std::string make_option_opts(const CLI::Option* option) const override;
  std::string make_option_desc(const CLI::Option* option) const override;
};

// Returns a check that a file's name ends in `extension`, such as ".exr", in either case. The check's error
// ends with `hint`, which says what else the user may have wanted.
CLI::Validator ends_in(const std::string& extension, const std::string& hint = "");

// Returns the names that an option's value can be, such as auto, fp32 and fp16; empty if it can be any text.
std::vector<std::string> choices(const CLI::Option& option);

// Returns the placeholder of an option's value, such as "auto|fp32|fp16" or "FILE"; empty for a flag.
std::string value_text(const CLI::Option& option);

// Returns an option's description with its default, if it has one, and a mark if it is required.
std::string option_text(const CLI::Option& option);

// Returns the options of a command that have names, in the order in which they were added.
std::vector<const CLI::Option*> named_options(const CLI::App& command);

// Returns the commands that the help of the program lists.
std::vector<const CLI::App*> shown_commands(const CLI::App& app);

// Returns the manual page, with all commands.
std::string man_page(const CLI::App& app);

// Returns a script that completes commands, options and their values in bash.
std::string bash_completion(const CLI::App& app);

}  // namespace raymeld::cli
