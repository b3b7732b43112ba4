#include "engine/twoshot/remarks.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "engine/base/dense.h"
#include "engine/brdf/merl_grid.h"

namespace patina {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;
constexpr std::size_t kNeighbours = 10;
constexpr double kWorthwhile = 0.85, kGoodEnough = 0.15;
/// A part of the hemisphere with a smaller share of the rows' weight has not been measured.
constexpr double kMeasuredShare = 0.01;
/// Every this many cells of the grid are looked at: the means don't need all 1,458,000.
constexpr std::size_t kCellStep = 37;

/// Directions (thetaH, thetaD, phiD; degrees) of plans for two and three pictures, and a few between them. A
/// handful, because the suggestion is a hint and not a plan.
constexpr std::array<std::array<double, 3>, 8> kCandidates = {{{6, 15, 37.5},
                                                               {16, 67, 89},
                                                               {42, 25, 60},
                                                               {6, 38, 90},
                                                               {10, 51.5, 89},
                                                               {30, 15, 90},
                                                               {30, 40, 60},
                                                               {50, 15, 60}}};

std::string degrees(double radians) {
  char text[32];
  std::snprintf(text, sizeof text, "%.0f", radians * kDegrees);
  return text;
}

struct Zone {
  const char* name;
  bool (*holds)(const HalfDiffAngles&);
};

double deg(double radians) {
  return radians * kDegrees;
}

constexpr std::array<Zone, 4> kZones = {{
    {"in and around the highlight",
     [](const HalfDiffAngles& a) { return deg(a.thetaHRad) < 15 && deg(a.thetaDRad) < 65; }},
    {"towards grazing light and view", [](const HalfDiffAngles& a) { return deg(a.thetaDRad) >= 65; }},
    {"back towards the light",
     [](const HalfDiffAngles& a) { return deg(a.thetaHRad) >= 15 && deg(a.thetaDRad) < 15; }},
    {"away from the highlight",
     [](const HalfDiffAngles& a) {
       return deg(a.thetaHRad) >= 15 && deg(a.thetaDRad) >= 15 && deg(a.thetaDRad) < 65;
     }},
}};

std::string joined(const std::vector<std::string>& parts) {
  std::string text;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    text += i == 0 ? "" : i + 1 == parts.size() ? " and " : ", ";
    text += parts[i];
  }
  return text;
}

}  // namespace

std::string logErrorInWords(double natural) {
  char text[48];
  const double factor = std::exp(natural);
  if (factor < 1.75) {
    std::snprintf(text, sizeof text, factor < 1.095 ? "about %.1f %%" : "about %.0f %%", 100 * (factor - 1));
  } else {
    std::snprintf(text, sizeof text, "a factor of %.1f", factor);
  }
  return text;
}

NextShot suggestNextShot(const Basis& basis, const Eigen::MatrixXd& coefficients, const RowFactor& rows,
                         double rowWeight, double eta, const NearFieldDisc& disc, const JobContext& job) {
  NextShot next;
  const Eigen::MatrixXd& root = basis.gramRoot(BasisRegion::Trusted);
  const Eigen::MatrixXd& columns = basis.columnCoefficients();
  const Eigen::Index materials = columns.cols() / 3;
  const Eigen::MatrixXd all = product(root, false, columns, false),
                        own = product(root, false, coefficients, false);
  std::vector<std::pair<double, int>> near;
  for (Eigen::Index j = 0; j < materials; ++j) {
    near.emplace_back((all.middleCols(3 * j, 3) - own).squaredNorm(), static_cast<int>(j));
  }
  std::sort(near.begin(), near.end());
  for (std::size_t i = 0; i < std::min(kNeighbours, near.size()); ++i)
    next.neighbours.push_back(near[i].second);
  const auto errorOf = [&](const RowFactor& factor, double weight) {
    const LeaveOneOut left =
        leaveOneOut(basis, factor, weight, eta, BasisRegion::Trusted, next.neighbours, job);
    double sum = 0;
    if (left.rms.empty()) return 0.0;
    for (const int j : next.neighbours)
      for (int c = 0; c < 3; ++c) sum += left.rms[3 * j + c] * left.rms[3 * j + c];
    return std::sqrt(sum / (3.0 * static_cast<double>(next.neighbours.size())));
  };
  next.before = next.after = errorOf(rows, rowWeight);
  for (const auto& [thetaH, thetaD, phiD] : kCandidates) {
    if (job.cancelled()) return next;
    const ShotDirections shot = shotFromHalfDiff({thetaH / kDegrees, thetaD / kDegrees, phiD / kDegrees});
    if (shot.toLight.z() < std::cos(80 / kDegrees) || shot.toCamera.z() < std::cos(80 / kDegrees)) continue;
    const RowFactor more = rowsOfShot(basis, shot, disc, kSearchTolerance);
    const double error = errorOf(stack({&rows, &more}), rowWeight + kEtaRows);
    if (error < next.after) next.after = error, next.directions = shot;
  }
  next.useful = next.before >= kGoodEnough && next.after < kWorthwhile * next.before;
  return next;
}

std::vector<std::string> remarksOn(const TwoShotMaterial& material, const Basis& basis,
                                   const Posterior& posterior, const std::vector<HalfDiffAngles>& rowAngles,
                                   const std::vector<double>& rowWeight, double residual,
                                   const NextShot& next, const std::string& name) {
  std::vector<std::string> remarks;
  const auto say = [&](std::string sentence) { remarks.push_back(name + std::move(sentence)); };

  std::string expected = "Expected error over all directions, of materials that the basis doesn't hold: " +
                         logErrorInWords(material.expected.unseen) +
                         " (RMS, mean over the basis' materials, each left out).";
  if (next.before > 0 && !next.neighbours.empty()) {
    std::vector<std::string> names;
    for (std::size_t i = 0; i < std::min<std::size_t>(3, next.neighbours.size()); ++i) {
      const std::size_t at = next.neighbours[i];
      if (at < basis.materials().size()) names.push_back(basis.materials()[at].name);
    }
    expected += " Of those most like this sample (" + joined(names) +
                " and so on), within 81 degrees of the normal: " + logErrorInWords(next.before) + ".";
  }
  say(expected);

  if (residual > posterior.largestResidual) {
    say("The basis doesn't follow this sample: even in the directions that were photographed, the "
        "reflectance "
        "that it finds is off by " +
        logErrorInWords(residual) +
        " (RMS). Of its own materials, each left out in turn, 95 in 100 stay below " +
        logErrorInWords(posterior.largestResidual) +
        ". Directions that were not photographed are then worth less than expected; a basis with materials "
        "like "
        "this one, or photographs of more directions, would help.");
  }

  std::array<double, kZones.size()> variance{}, cells{}, measured{};
  double allWeight = 0;
  if (material.posteriorSd) {
    for (std::size_t cell = 0; cell < material.posteriorSd->size(); cell += kCellStep) {
      const double sd = (*material.posteriorSd)[cell];
      if (sd < 0) continue;
      const HalfDiffAngles angles = MerlGrid::centre(cell);
      const DirectionPair pair = directionsFromHalfDiff(angles);
      if (std::min(pair.toLight.z(), pair.toView.z()) < std::cos(kTrustedAngleDeg / kDegrees)) continue;
      for (std::size_t z = 0; z < kZones.size(); ++z) {
        if (kZones[z].holds(angles)) variance[z] += sd * sd, cells[z] += 1;
      }
    }
    for (std::size_t i = 0; i < rowAngles.size(); ++i) {
      allWeight += rowWeight[i];
      for (std::size_t z = 0; z < kZones.size(); ++z)
        if (kZones[z].holds(rowAngles[i])) measured[z] += rowWeight[i];
    }
    std::vector<std::string> seen, guessed;
    for (std::size_t z = 0; z < kZones.size(); ++z) {
      if (cells[z] == 0) continue;
      const std::string zone =
          std::string(kZones[z].name) + " (" + logErrorInWords(std::sqrt(variance[z] / cells[z])) + ")";
      (measured[z] >= kMeasuredShare * allWeight ? seen : guessed).push_back(zone);
    }
    std::string sentence =
        "Photographed, with one standard deviation (light and view within 81 degrees of the normal): " +
        (seen.empty() ? std::string("nothing of the hemisphere's main parts") : joined(seen)) + ".";
    if (!guessed.empty()) sentence += " Extrapolated from what the basis knows: " + joined(guessed) + ".";
    say(sentence);
  }

  if (next.useful) {
    const Eigen::Vector3d &light = next.directions.toLight, &camera = next.directions.toCamera;
    const double azimuth = std::abs(std::atan2(light.x() * camera.y() - light.y() * camera.x(),
                                               light.x() * camera.x() + light.y() * camera.y()));
    say("One more photograph would help: with the light " + degrees(std::acos(light.z())) +
        " and the camera " + degrees(std::acos(camera.z())) + " degrees from the normal, their azimuths " +
        degrees(azimuth) +
        " degrees apart, the error expected of the materials most like this one falls from " +
        logErrorInWords(next.before) + " to " + logErrorInWords(next.after) + ".");
  }
  return remarks;
}

}  // namespace patina
