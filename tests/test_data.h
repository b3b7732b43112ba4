#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

namespace patina::test {

/// The folder of test data that does not ship with the repository: PATINA_TEST_DATA, else ../shared/data
/// beside it.
inline std::filesystem::path sharedData() {
  const char* set = std::getenv("PATINA_TEST_DATA");
  return set && *set ? std::filesystem::path(set) : std::filesystem::path(PATINA_TEST_DATA_DEFAULT);
}

}  // namespace patina::test

/// Skips the running test, with the reason, where the shared test data is not there.
#define PATINA_NEEDS_SHARED(relative)                                    \
  if (!std::filesystem::exists(patina::test::sharedData() / (relative))) \
  GTEST_SKIP() << "needs " << (patina::test::sharedData() / (relative)).string() << " (set PATINA_TEST_DATA)"
