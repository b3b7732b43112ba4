#pragma once

#include <filesystem>
#include <string>

#include "engine/base/result.h"
#include "engine/diagnosis/explanation.h"

namespace patina {

/// explain.json as the command-line contract says, with "budget", "residual" and "remarks" added.
std::string explanationJson(const Explanation& explanation);
/// report.html: one file that needs no network; pictures inside.
Result<std::string> explanationReport(const Explanation& explanation);
/// Writes explain.json, report.html and the final fit (maps/, fit.json, maps of added effects) into `folder`,
/// all at once or not at all: an earlier result stays as it was when something fails. Errors: WriteFailed,
/// Refused (the folder holds something else).
Status writeExplanation(const std::filesystem::path& folder, const Explanation& explanation);
/// The final fit alone, with maps of added effects; explain.json and report.html aren't written.
Status writeExplainedFit(const std::filesystem::path& folder, const Explanation& explanation);

}  // namespace patina
