#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

#include "engine/base/result.h"
#include "engine/brdf/tabulated_brdf.h"
#include "engine/image/image.h"

namespace patina {

/// How thetaH is laid out along an axis from 0 to 90 degrees.
enum class ThetaHAxis {
  Root,  ///< by its square root, as the MERL grid: a highlight of a few degrees has room
  Even,
};
/// The angle at a part (0 to 1) of the axis, degrees; and back.
double thetaHDegAt(double part, ThetaHAxis axis);
double partOfThetaH(double thetaHDeg, ThetaHAxis axis);

/// The posterior's standard deviation in a direction, natural-log units: trilinear over the known cells
/// around. -1 where none is known. `posteriorSd`: a value for each cell of the MERL grid, -1 where nothing is
/// known (std::invalid_argument for another size).
double posteriorSdAt(const std::vector<float>& posteriorSd, const HalfDiffAngles& angles);

/// One point of a curve over thetaH.
struct SlicePoint {
  double thetaHDeg = 0;
  Eigen::Array3d brdf = Eigen::Array3d::Zero();  ///< 1/sr; NaN where not known
  double sd = -1;                                ///< natural-log units; -1: not known
};
/// The curve at one thetaD and phiD, at the 90 thetaH of the grid's cells. `posteriorSd` may be null.
std::vector<SlicePoint> sliceCurve(const TabulatedBrdf& brdf, const std::vector<float>* posteriorSd,
                                   double thetaDDeg, double phiDDeg = 90);

/// The slice at one phiD as a picture of BRDF values, R G B in 1/sr, NaN where not known: thetaH from 0 at
/// the left to 90 degrees, thetaD from 0 at the bottom to 90 degrees at the top. Source: the image slices of
/// Burley 2012.
Image brdfSlice(const TabulatedBrdf& brdf, int width, int height, ThetaHAxis axis, double phiDDeg = 90);
/// The standard deviation over the same picture, one channel, -1 where not known.
Image sdSlice(const std::vector<float>& posteriorSd, int width, int height, ThetaHAxis axis,
              double phiDDeg = 90);

/// Curves as a table: a comment with origin and units, then one line for each thetaH and thetaD:
/// theta_d_deg, theta_h_deg, phi_d_deg, R, G, B, and sd_ln where there is a posterior. Values that are not
/// known are empty.
std::string slicesCsv(const TabulatedBrdf& brdf, const std::vector<float>* posteriorSd,
                      const std::vector<double>& thetaDDegs, double phiDDeg = 90);
/// Writes it, atomically. Errors: WriteFailed, Refused.
Status writeSlicesCsv(const std::filesystem::path& file, const TabulatedBrdf& brdf,
                      const std::vector<float>* posteriorSd, const std::vector<double>& thetaDDegs,
                      double phiDDeg = 90);

}  // namespace patina
