#include <gtest/gtest.h>

#include "support.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);

namespace raymeld::test {
namespace {

TEST(Corpus, EachInputIsReadOrRefused) {
  const std::filesystem::path folder = source_path("tests/fuzz/corpus") / FUZZ_TARGET;
  size_t inputs = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    SCOPED_TRACE(entry.path());
    const std::string content = read_file(entry.path());
    EXPECT_NO_THROW(LLVMFuzzerTestOneInput(reinterpret_cast<const uint8_t*>(content.data()), content.size()));
    ++inputs;
  }
  EXPECT_GT(inputs, 0u);
}

}  // namespace
}  // namespace raymeld::test
