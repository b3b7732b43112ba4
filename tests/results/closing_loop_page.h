#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "engine/diagnosis/explanation.h"

namespace patina::test {

/// Folders in a folder, by name; none where there is no such folder.
std::vector<std::filesystem::path> foldersIn(const std::filesystem::path& folder);

/// What was in a bundle of the test data, for the page; "not known" where nobody wrote it down. Read only to
/// stand beside the answer.
std::string truthOf(const std::filesystem::path& bundle);

/// Photograph, prediction before and after, and both residuals, in a row; the photograph that was predicted
/// worst. False where there is none.
bool writePicture(const Explanation& explanation, const std::filesystem::path& file);

/// "**anisotropy** (ratio 2.18 +- 0.02)", several with semicolons between; "nothing".
std::string whatWasFound(const Explanation& explanation);
/// Why: the verdicts and confidences of what was added, or the candidate that came nearest.
std::string evidence(const Explanation& explanation);
/// "1.59 % (0.843 %)": an error and the noise; "none".
std::string errorText(double rms, double noise);

}  // namespace patina::test
