#include <fmt/ranges.h>

#include "cli/common/help.h"

namespace raymeld::cli {
namespace {

std::vector<std::string> names_of(const CLI::Option& option) {
  std::vector<std::string> names;
  for (const std::string& name : option.get_snames()) names.push_back("-" + name);
  for (const std::string& name : option.get_lnames()) names.push_back("--" + name);
  return names;
}

// Returns lines of a case statement: the values that an option can have, by command and option.
std::string value_cases(const CLI::App& command) {
  std::string text;
  for (const CLI::Option* option : named_options(command)) {
    const std::vector<std::string> values = choices(*option);
    for (const std::string& name : names_of(*option)) {
      if (!values.empty())
        text += fmt::format("    {}:{}) words='{}' ;;\n", command.get_name(), name, fmt::join(values, " "));
    }
  }
  return text;
}

// Returns a line of another case statement: the options of a command.
std::string option_case(const CLI::App& command) {
  std::vector<std::string> names;
  for (const CLI::Option* option : named_options(command)) {
    const std::vector<std::string> own = names_of(*option);
    names.insert(names.end(), own.begin(), own.end());
  }
  return fmt::format("      {}) words='{}' ;;\n", command.get_name(), fmt::join(names, " "));
}

}  // namespace

// The script's `-o default` completes file names wherever the script has no words to offer.
std::string bash_completion(const CLI::App& app) {
  std::string values, options;
  std::vector<std::string> commands;
  for (const CLI::App* command : shown_commands(app)) {
    commands.push_back(command->get_name());
    values += value_cases(*command);
    options += option_case(*command);
  }
  return fmt::format(R"(# Completion of raymeld's commands, options and values in bash.
_raymeld() {{
  local current="${{COMP_WORDS[COMP_CWORD]}}" previous="${{COMP_WORDS[COMP_CWORD-1]}}" words=''
  case "${{COMP_WORDS[1]}}:$previous" in
{}  esac
  if [[ $COMP_CWORD == 1 ]]; then
    words='{} --help --help-all --version'
  elif [[ -z $words && $current == -* ]]; then
    case "${{COMP_WORDS[1]}}" in
{}    esac
  fi
  COMPREPLY=($(compgen -W "$words" -- "$current"))
}}
complete -o default -F _raymeld raymeld
)",
                     values, fmt::join(commands, " "), options);
}

}  // namespace raymeld::cli
