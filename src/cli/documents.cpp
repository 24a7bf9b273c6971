// Prints the manual and the completion script, which are made from the same texts as --help.
#include "cli/common/commands.h"
#include "cli/common/console.h"
#include "cli/common/help.h"

namespace raymeld::cli {

void add_documents(CLI::App& app) {
  const auto add = [&](const char* name, const char* description, std::string (*text)(const CLI::App&)) {
    CLI::App* command = app.add_subcommand(name, description);
    command->group("");
    command->callback([&app, text] { print(text(app)); });
  };
  add("man", "Prints the manual page", man_page);
  add("completion", "Prints a script that completes commands and options in bash", bash_completion);
}

}  // namespace raymeld::cli
