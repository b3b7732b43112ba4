#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "engine/diagnosis/explanation.h"
#include "tests/test_data.h"

namespace patina::test {

/// `explain` on Fourier bundles of the shared test data, by name; the test fails where it does.
inline ExplanationPtr explained(const std::vector<std::string>& bundles) {
  std::vector<std::filesystem::path> folders;
  for (const auto& bundle : bundles) folders.push_back(sharedData() / "fourier" / bundle);
  auto result = explain(folders, {}, {});
  EXPECT_TRUE(result) << (result ? "" : result.error().sentence());
  return result ? *result : std::make_shared<Explanation>();
}

/// The effect that is named first; empty where none is.
inline std::string firstOf(const Explanation& e) {
  return e.effects.empty() ? "" : e.effects.front().id;
}

}  // namespace patina::test
