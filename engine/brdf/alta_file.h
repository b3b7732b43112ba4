#pragma once

#include <string>
#include <string_view>

#include "engine/base/result.h"
#include "engine/brdf/brdf.h"

namespace patina {

/// A measured BRDF from an ALTA text table; `where` names it in errors. Read are two kinds, told by the line
/// `#PARAM_IN`, with one value (grey) or three (R, G, B) a row (`#DIM n m`); a negative value means "not
/// measured", and lines that begin with '#' are otherwise kept as the origin's note.
///
/// - `ISOTROPIC_TL_TV_PROJ_DPHI`: thetaL, thetaV cos dphi, thetaV sin dphi in radians, dphi the view's
/// azimuth
///   minus the light's, so that the light's own direction is (thetaL, 0) and the mirror's (-thetaL, 0). For
///   each light the points must lie on a rectangular lattice (points may be missing); scattered points are
///   refused. Between the points of a light: bilinear. Between two measured lights: linear in thetaL, after
///   the view was turned in the plane of incidence by as much as the light was: fully so at the light's and
///   the mirror's direction, hence a peak there stays at its place and keeps its shape instead of appearing
///   twice; less elsewhere, and not at all at the horizon. A light that was not measured but whose view lies
///   among the measured lights is answered by reciprocity. Everything else is NaN (half a degree of slack at
///   the outermost lights).
/// - `COS_TH`: cosine of thetaH alone; linear between rows, NaN more than half a row's distance beyond them.
///   With constant dependence on thetaD this is reciprocal by construction.
///
/// `#PARAM_OUT` `INV_STERADIAN` and `RGB_COLOR` are 1/sr; `INV_STERADIAN_COSINE_FACTOR` holds the outgoing
/// cosine, which is divided out (unknown where it is below 1e-3). Source: the ALTA library's file format.
/// Errors: Malformed (a line that isn't numbers, NaN, too few rows), Unsupported (another parametrisation,
/// other numbers of values, scattered points).
Result<BrdfPtr> readAltaBytes(std::string_view text, const std::string& where);

}  // namespace patina
