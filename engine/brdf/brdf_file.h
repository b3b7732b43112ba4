#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/brdf/brdf.h"

namespace patina {

/// Reads a measured BRDF, the format told by the content: MERL `.binary`, RGL `.bsdf` (isotropic and
/// anisotropic, RGB), ALTA's text tables. Errors: NotFound; Unsupported (none of these, or a spectral RGL
/// file); Malformed with what is wrong and where (truncated, sizes that lie, NaN).
Result<BrdfPtr> readBrdf(const std::filesystem::path& file);
/// The same from bytes; `where` names them in errors, and its file name is the material's where the bytes
/// have none.
Result<BrdfPtr> readBrdfBytes(std::string_view bytes, const std::string& where);

/// A BRDF by what a person types: "analytic:MODEL?key=value&..." (`parseAnalyticBrdf`), "built-in:NAME" (one
/// of the built-in networks of the MERL materials), otherwise a file. Errors: as theirs; Unsupported where
/// there is no built-in material of that name (the nearest is named).
Result<BrdfPtr> openBrdf(const std::string& source);

/// The files in `folder` (not below it) that `readBrdf` may be able to read, by their ending (.binary, .bsdf,
/// .dat, .alta), sorted by name. Errors: NotFound.
Result<std::vector<std::filesystem::path>> listBrdfFiles(const std::filesystem::path& folder);

}  // namespace patina
