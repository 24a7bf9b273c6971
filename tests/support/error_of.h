#pragma once

#include <gtest/gtest.h>

#include <initializer_list>
#include <string>

#include "error.h"

namespace raymeld::test {

// Returns the message of the raymeld::Error that `work` must throw; any other end fails the test.
template <typename Work>
std::string error_of(Work&& work) {
  try {
    work();
  } catch (const Error& error) {
    return error.what();
  } catch (const std::exception& error) {
    ADD_FAILURE() << "not an Error: " << error.what();
    return {};
  }
  ADD_FAILURE() << "nothing was thrown";
  return {};
}

inline bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

}  // namespace raymeld::test

// Expects `statement` to throw an Error whose message holds every given part.
#define EXPECT_ERROR(statement, ...)                                                        \
  do {                                                                                      \
    const std::string message = raymeld::test::error_of([&] { statement; });                \
    for (const std::string& part : std::initializer_list<std::string>{__VA_ARGS__})         \
      EXPECT_TRUE(raymeld::test::contains(message, part)) << message << "\nlacks " << part; \
  } while (false)
