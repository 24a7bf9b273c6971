#include "cli/common/help.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <sstream>

namespace raymeld::cli {
namespace {

constexpr size_t kTextWidth = 72;

std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  std::istringstream stream(text);
  for (std::string part; std::getline(stream, part, separator);) parts.push_back(part);
  return parts;
}

// Breaks lines at spaces.
std::string wrapped(const std::string& text, size_t width) {
  std::string result;
  size_t line = 0;
  for (const std::string& word : split(text, ' ')) {
    if (line > 0 && line + 1 + word.size() > width) {
      result += '\n';
      line = 0;
    }
    if (line > 0) result += ' ';
    result += word;
    line += word.size() + (line > 0);
  }
  return result;
}

// CLI11 describes a set of names as "TEXT:{auto,fp32,fp16}".
std::string names_of_set(const std::string& type) {
  const size_t open = type.find('{'), close = type.rfind('}');
  if (open == std::string::npos || close == std::string::npos) return "";
  std::string names = type.substr(open + 1, close - open - 1);
  std::ranges::replace(names, ',', '|');
  return names;
}

bool is_literal(const std::string& name) {
  return !name.empty() && std::ranges::none_of(name, [](unsigned char c) { return std::isupper(c) != 0; });
}

}  // namespace

CLI::Validator ends_in(const std::string& extension, const std::string& hint) {
  const auto check = [extension, hint](const std::string& path) {
    const std::string own = CLI::detail::to_lower(std::filesystem::path(path).extension().string());
    return own == extension ? "" : fmt::format("'{}' does not end in {}{}", path, extension, hint);
  };
  return CLI::Validator(check, "");
}

std::string value_text(const CLI::Option& option) {
  if (option.get_type_size() == 0) return "";
  const std::string type = option.get_type_name(), names = names_of_set(type);
  if (type.find("...") != std::string::npos) return type.substr(0, type.find(':'));
  return names.empty() ? type.substr(0, type.find(':')) : names;
}

std::vector<std::string> choices(const CLI::Option& option) {
  if (option.get_type_size() == 0) return {};
  const std::string names = names_of_set(option.get_type_name());
  std::vector<std::string> found = split(names.empty() ? value_text(option) : names, '|');
  std::erase_if(found, [](const std::string& name) { return !is_literal(name); });
  return found;
}

std::string option_text(const CLI::Option& option) {
  std::string text = option.get_description();
  if (!option.get_default_str().empty()) text += fmt::format(" (default: {})", option.get_default_str());
  if (option.get_required()) text += " (required)";
  return text;
}

std::vector<const CLI::Option*> named_options(const CLI::App& command) {
  return command.get_options(
      [](const CLI::Option* option) { return option->nonpositional() && !option->get_group().empty(); });
}

std::vector<const CLI::App*> shown_commands(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App* command) { return !command->get_group().empty(); });
}

std::string HelpFormatter::make_help(const CLI::App* app, std::string name, CLI::AppFormatMode mode) const {
  if (mode == CLI::AppFormatMode::Sub) return make_expanded(app);
  std::string text = make_description(app) + make_usage(app, name) + make_positionals(app);
  size_t left_out = 0;
  for (const std::string& group : app->get_groups()) {
    std::vector<const CLI::Option*> options = named_options(*app);
    std::erase_if(options, [&](const CLI::Option* option) { return option->get_group() != group; });
    if (mode == CLI::AppFormatMode::Normal && group == kMoreOptions) {
      left_out = options.size();
    } else if (!options.empty()) {
      text += make_group(group, false, options);
    }
  }
  if (left_out > 0)
    text += fmt::format("\nThere are {} more options; raymeld {} --help-all shows them.\n", left_out,
                        app->get_name());
  return text + make_subcommands(app, mode) + "\n" + make_footer(app);
}

std::string HelpFormatter::make_option_opts(const CLI::Option* option) const {
  const std::string value = value_text(*option);
  return value.empty() ? "" : " " + value;
}

std::string HelpFormatter::make_option_desc(const CLI::Option* option) const {
  return wrapped(option_text(*option), kTextWidth);
}

}  // namespace raymeld::cli
