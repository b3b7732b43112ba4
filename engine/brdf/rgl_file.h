#pragma once

#include <string>
#include <string_view>

#include "engine/base/result.h"
#include "engine/brdf/brdf.h"

namespace patina {

/// A measured BRDF of the RGL database from the bytes of its `.bsdf` file (RGB; isotropic or anisotropic);
/// `where` names them in errors. Source: Dupuy and Jakob, "An Adaptive Parameterization for Efficient
/// Material Acquisition and Rendering", 2018, and their published reader, for which this gives the same
/// numbers: value = rgb(warp(u_m)) ndf(u_m) / (4 sigma(u_i)), linear between measured incident directions
/// and clamped beyond them. That value is the BRDF times the outgoing cosine, which is divided out here.
/// Incident is the light. Where the fit of the file's authors went below zero it is 0; NaN where the
/// outgoing cosine is below 1e-4 (nothing left to divide). The file's BRDF is not exactly reciprocal, and is
/// given as it is. Anisotropic files that store half or a quarter of the azimuths by symmetry are unfolded.
/// Errors: Malformed (truncated, lying sizes, NaN, fields that don't fit together), Unsupported (spectral
/// files, which have no `rgb`; another version).
Result<BrdfPtr> readRglBytes(std::string_view bytes, const std::string& where);

}  // namespace patina
