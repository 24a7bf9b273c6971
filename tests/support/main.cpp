// Runs the tests of a unit. RAYMELD_ALLOWED_SKIPS may name a file of tests that may skip, a name and a reason
// on each line. The run then fails if any other test skips.
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <iostream>
#include <set>
#include <string>

namespace {

std::set<std::string> allowed_skips(const char* path) {
  std::ifstream file(path);
  if (!file) {
    std::cerr << "RAYMELD_ALLOWED_SKIPS: cannot read '" << path << "'\n";
    std::exit(2);
  }
  std::set<std::string> names;
  for (std::string line; std::getline(file, line);) names.insert(line.substr(0, line.find(' ')));
  return names;
}

class SkipListener : public testing::EmptyTestEventListener {
 public:
  explicit SkipListener(const char* path) : allowed_(allowed_skips(path)) {}

  void OnTestEnd(const testing::TestInfo& test) override {
    const std::string name = std::string(test.test_suite_name()) + "." + test.name();
    if (!test.result()->Skipped() || allowed_.contains(name)) return;
    std::cout << name << " was skipped, which tests/allowed-skips.txt does not allow\n";
    any_ = true;
  }
  bool any() const { return any_; }

 private:
  std::set<std::string> allowed_;
  bool any_ = false;
};

}  // namespace

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  const bool any_is_wanted = !GTEST_FLAG_GET(list_tests);
  const auto run = [&] {
    const int status = RUN_ALL_TESTS();
    if (!any_is_wanted || testing::UnitTest::GetInstance()->test_to_run_count() > 0) return status;
    std::cerr << "no test is named so\n";
    return 1;
  };
  const char* path = std::getenv("RAYMELD_ALLOWED_SKIPS");
  if (!path) return run();
  auto* skips = new SkipListener(path);  // GoogleTest deletes it
  testing::UnitTest::GetInstance()->listeners().Append(skips);
  const int status = run();
  return skips->any() ? 1 : status;
}
