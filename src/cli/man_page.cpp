// Writes the manual in the macros of man(7).
#include <fmt/format.h>

#include "cli/common/help.h"

namespace raymeld::cli {
namespace {

// Escapes characters that mean something to roff: backslashes, hyphens, and dots or quotes that start a line.
std::string roff(const std::string& text) {
  std::string result;
  for (const char c : text) {
    const bool starts_line = result.empty() || result.back() == '\n';
    if (starts_line && (c == '.' || c == '\'')) result += "\\&";
    if (c == '\\') {
      result += "\\e";
    } else if (c == '-') {
      result += "\\-";
    } else {
      result += c;
    }
  }
  return result;
}

std::string names_text(const CLI::Option& option) {
  std::string text;
  for (const std::string& name : option.get_snames()) text += fmt::format("\\fB\\-{}\\fR, ", roff(name));
  for (const std::string& name : option.get_lnames()) text += fmt::format("\\fB\\-\\-{}\\fR, ", roff(name));
  text.resize(text.size() - 2);
  const std::string value = value_text(option);
  return value.empty() ? text : fmt::format("{} \\fI{}\\fR", text, roff(value));
}

std::string positional_text(const CLI::Option& option) {
  return fmt::format("\\fI{}\\fR", roff(option.get_name(true)));
}

std::string entry(const std::string& head, const CLI::Option& option) {
  return fmt::format(".TP\n{}\n{}\n", head, roff(option_text(option)));
}

// Returns the examples and other text that follow the options, with their line breaks.
std::string footer_text(const CLI::App& app) {
  return app.get_footer().empty() ? "" : fmt::format(".PP\n.nf\n{}\n.fi\n", roff(app.get_footer()));
}

std::string command_text(const CLI::App& command) {
  std::string synopsis = fmt::format("\\fBraymeld {}\\fR [\\fIOPTIONS\\fR]", command.get_name()), text;
  for (const CLI::Option* option :
       command.get_options([](const CLI::Option* o) { return o->get_positional(); })) {
    synopsis += " " + positional_text(*option);
    text += entry(positional_text(*option), *option);
  }
  for (const std::string& group : command.get_groups()) {
    for (const CLI::Option* option : named_options(command))
      if (option->get_group() == group) text += entry(names_text(*option), *option);
  }
  return fmt::format(".SS {}\n{}\n.PP\n{}.\n{}{}", command.get_name(), synopsis,
                     roff(command.get_description()), text, footer_text(command));
}

}  // namespace

std::string man_page(const CLI::App& app) {
  std::string text = fmt::format(
      ".TH RAYMELD 1 \"\" \"raymeld {}\" \"User Commands\"\n"
      ".SH NAME\nraymeld \\- makes a good render of one or two cheap ones\n"
      ".SH SYNOPSIS\n\\fBraymeld\\fR \\fICOMMAND\\fR [\\fIOPTIONS\\fR]\n"
      ".SH DESCRIPTION\n{}.\n.SH COMMANDS\n",
      RAYMELD_VERSION, roff(app.get_description()));
  for (const CLI::App* command : shown_commands(app)) text += command_text(*command);
  return text + ".SH EXAMPLES\n" + footer_text(app).substr(4);
}

}  // namespace raymeld::cli
