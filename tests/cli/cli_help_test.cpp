// Tests that help, manual and completion have all options, as they are made of the same texts.
#include <fmt/format.h>

#include <regex>

#include "cli_fixture.h"

namespace raymeld::test {
namespace {

const std::vector<std::string> kCommands = {"fuse",  "denoise", "upscale", "devices", "compare", "degrade",
                                            "graph", "compile", "tune",    "trade",   "conform"};

class CliHelp : public Cli {
 protected:
  std::string text(const std::vector<std::string>& arguments) const {
    const ProcessResult result = run(arguments);
    EXPECT_EQ(result.exit_status, 0) << result.err;
    return result.out;
  }
  // Returns the options that a help lists, each at the start of a line.
  std::set<std::string> options(const std::vector<std::string>& arguments) const {
    const std::string help = text(arguments);
    const std::regex option("\n  (?:-[a-z],)?(--[a-z-]+)");
    std::set<std::string> names;
    for (std::sregex_iterator at(help.begin(), help.end(), option), end; at != end; ++at)
      names.insert((*at)[1]);
    return names;
  }
  // Returns the completions that bash offers for the last of these words.
  std::set<std::string> completions(const std::vector<std::string>& words) const {
    write_file(folder_ / "completion", text({"completion"}));
    std::string script = "source ./completion; COMP_WORDS=(";
    for (const std::string& word : words) script += fmt::format("'{}' ", word);
    script +=
        fmt::format("); COMP_CWORD={}; _raymeld; printf '%s\n' \"${{COMPREPLY[@]}}\"", words.size() - 1);
    const ProcessResult result = run_process({"bash", "-c", script}, {.directory = folder_.path()});
    EXPECT_EQ(result.exit_status, 0) << result.err;
    std::istringstream lines(result.out);
    std::set<std::string> found;
    for (std::string line; std::getline(lines, line);)
      if (!line.empty()) found.insert(line);
    return found;
  }
};

TEST_F(CliHelp, ShowsTheUsualOptionsAndOnRequestAll) {
  const std::set<std::string> usual = options({"fuse", "--help"}), all = options({"fuse", "--help-all"});
  EXPECT_EQ(usual, (std::set<std::string>{"--help", "--help-all", "--lrhs", "--hrls", "--output", "--preview",
                                          "--map", "--model", "--quality", "--frames", "--dry-run", "--quiet",
                                          "--verbose", "--json"}));
  EXPECT_TRUE(std::ranges::includes(all, usual));
  for (const char* name : {"--budget", "--resume", "--window", "--precision", "--profile", "--lrhs-sampling"})
    EXPECT_TRUE(all.contains(name)) << name;
  const std::string more =
      fmt::format("There are {} more options; raymeld fuse --help-all", all.size() - usual.size());
  EXPECT_NE(text({"fuse", "--help"}).find(more), std::string::npos) << more;
}

TEST_F(CliHelp, FitsTheLine) {
  for (const std::string& command : kCommands) {
    std::istringstream lines(text({command, "--help-all"}));
    for (std::string line; std::getline(lines, line);) EXPECT_LE(line.size(), 110u) << line;
  }
}

TEST_F(CliHelp, ExamplesAreOfTheCommand) {
  for (const std::string& command : kCommands) {
    const std::string help = text({command, "--help"});
    const size_t examples = help.find("Example");
    ASSERT_NE(examples, std::string::npos) << command;
    EXPECT_NE(help.find("\n  raymeld " + command, examples), std::string::npos) << help;
  }
  EXPECT_EQ(text({"devices", "--help"}).find("--lrhs"), std::string::npos);
}

TEST_F(CliHelp, ManualAndCompletionHaveEveryOption) {
  std::string manual = text({"man"});
  manual = std::regex_replace(manual, std::regex(R"(\\-)"), "-");
  for (const std::string& command : kCommands) {
    const size_t begin = manual.find(".SS " + command + "\n");
    ASSERT_NE(begin, std::string::npos) << command;
    const std::string section = manual.substr(begin, manual.find("\n.S", begin + 4) - begin);
    const std::set<std::string> all = options({command, "--help-all"});
    EXPECT_FALSE(all.empty()) << command;
    for (const std::string& option : all)
      EXPECT_NE(section.find("\\fB" + option + "\\fR"), std::string::npos) << command << " " << option;
    const std::set<std::string> offered = completions({"raymeld", command, "--"});
    EXPECT_EQ(offered, all) << command;
  }
}

TEST_F(CliHelp, CompletionOffersCommandsAndValues) {
  EXPECT_EQ(completions({"raymeld", "de"}), (std::set<std::string>{"degrade", "denoise", "devices"}));
  EXPECT_EQ(completions({"raymeld", "fuse", "--precision", ""}),
            (std::set<std::string>{"auto", "fp16", "fp32"}));
  EXPECT_EQ(completions({"raymeld", "fuse", "--quality", "b"}), (std::set<std::string>{"balanced"}));
  EXPECT_EQ(completions({"raymeld", "degrade", "--scale", ""}), (std::set<std::string>{"2", "4", "8"}));
  EXPECT_EQ(completions({"raymeld", "fuse", "--lrhs", "lo"}),
            std::set<std::string>{});  // bash itself then completes files
}

TEST_F(CliHelp, ManualIsFormattedWithoutComplaints) {
  if (run_process({"sh", "-c", "command -v groff"}, {}).exit_status != 0) GTEST_SKIP() << "no groff";
  write_file(folder_ / "raymeld.1", text({"man"}));
  const ProcessResult page =
      run_process({"groff", "-man", "-Tutf8", "-ww", "-z", "raymeld.1"}, {.directory = folder_.path()});
  EXPECT_EQ(page.exit_status, 0);
  EXPECT_EQ(page.err, "");
}

}  // namespace
}  // namespace raymeld::test
