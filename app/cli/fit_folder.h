#pragma once

#include <filesystem>
#include <string>

#include "app/cli/verbs.h"
#include "engine/base/result.h"

namespace patina::cli {

/// Whether a folder, there already or not, is the bundle's or lies in it.
bool isInside(const std::filesystem::path& folder, const std::filesystem::path& bundle);
/// Says that the bundle is never written to, and names a folder beside it. Returns kWrongUse.
int refuseInside(const std::string& folder, const std::filesystem::path& bundle, Context& context);
/// Fails now rather than after minutes of work where nothing could be written.
Status checkWritable(const std::string& folder);

}  // namespace patina::cli
