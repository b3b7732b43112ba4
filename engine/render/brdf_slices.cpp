#include "engine/render/brdf_slices.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>
#include <stdexcept>

#include "engine/base/atomic_file.h"
#include "engine/brdf/merl_grid.h"

namespace patina {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

HalfDiffAngles degrees(double thetaHDeg, double thetaDDeg, double phiDDeg) {
  return {thetaHDeg * kDegree, thetaDDeg * kDegree, phiDDeg * kDegree};
}

/// Whether both directions are above the surface: the table's edge cells answer a little beyond.
bool above(const HalfDiffAngles& angles) {
  const DirectionPair pair = directionsFromHalfDiff(angles);
  return pair.toLight.z() >= 0 && pair.toView.z() >= 0;
}

std::string number(double value) {
  if (!std::isfinite(value)) return "";
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.6g", value);
  return text.data();
}

std::string oneLine(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20; }, ' ');
  return text;
}

}  // namespace

double thetaHDegAt(double part, ThetaHAxis axis) {
  const double inside = std::clamp(part, 0.0, 1.0);
  return 90 * (axis == ThetaHAxis::Root ? inside * inside : inside);
}

double partOfThetaH(double thetaHDeg, ThetaHAxis axis) {
  const double part = std::clamp(thetaHDeg / 90, 0.0, 1.0);
  return axis == ThetaHAxis::Root ? std::sqrt(part) : part;
}

double posteriorSdAt(const std::vector<float>& posteriorSd, const HalfDiffAngles& angles) {
  if (posteriorSd.size() != MerlGrid::kCells)
    throw std::invalid_argument("a standard deviation for every cell of the MERL grid is needed");
  const Eigen::Vector3d at = MerlGrid::coordinates(angles);
  if (!at.allFinite()) return -1;
  const double h = std::clamp(at.x(), 0.0, MerlGrid::kThetaH - 1.0),
               d = std::clamp(at.y(), 0.0, MerlGrid::kThetaD - 1.0);
  double p = std::fmod(at.z(), MerlGrid::kPhiD);
  if (p < 0) p += MerlGrid::kPhiD;
  const int h0 = static_cast<int>(h), d0 = static_cast<int>(d), p0 = static_cast<int>(p) % MerlGrid::kPhiD;
  double sum = 0, weights = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const int ih = std::min(h0 + (corner & 1), MerlGrid::kThetaH - 1),
              id = std::min(d0 + (corner >> 1 & 1), MerlGrid::kThetaD - 1),
              ip = (p0 + (corner >> 2 & 1)) % MerlGrid::kPhiD;
    const double weight = (corner & 1 ? h - h0 : 1 - h + h0) * (corner & 2 ? d - d0 : 1 - d + d0) *
                          (corner & 4 ? p - std::floor(p) : 1 - p + std::floor(p));
    const float sd = posteriorSd[MerlGrid::cell(ih, id, ip)];
    if (sd < 0 || weight <= 0) continue;
    sum += weight * sd;
    weights += weight;
  }
  return weights > 0 ? sum / weights : -1;
}

std::vector<SlicePoint> sliceCurve(const TabulatedBrdf& brdf, const std::vector<float>* posteriorSd,
                                   double thetaDDeg, double phiDDeg) {
  std::vector<SlicePoint> curve(MerlGrid::kThetaH);
  for (int i = 0; i < MerlGrid::kThetaH; ++i) {
    SlicePoint& point = curve[static_cast<std::size_t>(i)];
    point.thetaHDeg = MerlGrid::centre(i, 0, 0).thetaHRad / kDegree;
    const HalfDiffAngles angles = degrees(point.thetaHDeg, thetaDDeg, phiDDeg);
    const bool reached = above(angles);
    point.brdf =
        reached ? brdf.evaluate(angles) : Eigen::Array3d::Constant(std::numeric_limits<double>::quiet_NaN());
    if (reached && posteriorSd) point.sd = posteriorSdAt(*posteriorSd, angles);
  }
  return curve;
}

Image brdfSlice(const TabulatedBrdf& brdf, int width, int height, ThetaHAxis axis, double phiDDeg) {
  Image picture(width, height, 3, std::numeric_limits<float>::quiet_NaN());
  tbb::parallel_for(0, height, [&](int y) {
    for (int x = 0; x < width; ++x) {
      const HalfDiffAngles angles =
          degrees(thetaHDegAt((x + 0.5) / width, axis), 90 * (1 - (y + 0.5) / height), phiDDeg);
      if (!above(angles)) continue;
      const Eigen::Array3d value = brdf.evaluate(angles);
      for (int c = 0; c < 3; ++c) picture.at(x, y, c) = static_cast<float>(value[c]);
    }
  });
  return picture;
}

Image sdSlice(const std::vector<float>& posteriorSd, int width, int height, ThetaHAxis axis, double phiDDeg) {
  Image picture(width, height, 1, -1.0f);
  tbb::parallel_for(0, height, [&](int y) {
    for (int x = 0; x < width; ++x) {
      const HalfDiffAngles angles =
          degrees(thetaHDegAt((x + 0.5) / width, axis), 90 * (1 - (y + 0.5) / height), phiDDeg);
      if (above(angles)) picture.at(x, y) = static_cast<float>(posteriorSdAt(posteriorSd, angles));
    }
  });
  return picture;
}

std::string slicesCsv(const TabulatedBrdf& brdf, const std::vector<float>* posteriorSd,
                      const std::vector<double>& thetaDDegs, double phiDDeg) {
  std::string text = "# BRDF in 1/sr of " +
                     oneLine(brdf.origin().name.empty() ? "a material" : brdf.origin().name) +
                     "; angles in degrees, half-angle coordinates";
  if (posteriorSd) text += "; sd_ln: standard deviation of its natural logarithm";
  text += posteriorSd ? "\ntheta_d_deg,theta_h_deg,phi_d_deg,R,G,B,sd_ln\n"
                      : "\ntheta_d_deg,theta_h_deg,phi_d_deg,R,G,B\n";
  for (const double thetaD : thetaDDegs)
    for (const SlicePoint& point : sliceCurve(brdf, posteriorSd, thetaD, phiDDeg)) {
      text += number(thetaD) + ',' + number(point.thetaHDeg) + ',' + number(phiDDeg);
      for (int c = 0; c < 3; ++c) text += ',' + number(point.brdf[c]);
      if (posteriorSd) text += ',' + (point.sd < 0 ? std::string() : number(point.sd));
      text += '\n';
    }
  return text;
}

Status writeSlicesCsv(const std::filesystem::path& file, const TabulatedBrdf& brdf,
                      const std::vector<float>* posteriorSd, const std::vector<double>& thetaDDegs,
                      double phiDDeg) {
  return writeFileAtomically(file, slicesCsv(brdf, posteriorSd, thetaDDegs, phiDDeg));
}

}  // namespace patina
