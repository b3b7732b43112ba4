#pragma once

#include <filesystem>
#include <string>

namespace patina::test {

/// docs/results.md has parts, each written by its own program between two comments that name it. Replaces the
/// part, or adds it at the end; everything else stays. False where the file can't be written.
bool replacePagePart(const std::filesystem::path& page, const std::string& part, const std::string& text);

/// The processor's name and the cores used, for the head of a table.
std::string machineDescription(int threads);

}  // namespace patina::test
