#include "engine/brdf/tabulated_brdf.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>
#include <stdexcept>

namespace patina {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kNotMeasured = -1;

Eigen::Array3d unknown() {
  return Eigen::Array3d::Constant(std::numeric_limits<double>::quiet_NaN());
}

/// The two cells around a coordinate and the weight of the second one.
struct Neighbours {
  int first = 0, second = 0;
  double weight = 0;
};

/// Beyond the outermost centres the outermost cell holds.
Neighbours clamped(double coordinate, int cells) {
  const double inside = std::clamp(coordinate, 0.0, cells - 1.0);
  const int first = std::min(static_cast<int>(inside), cells - 1);
  return {first, std::min(first + 1, cells - 1), inside - first};
}

/// phiD has no ends: after its last cell comes the first again, half a turn on.
Neighbours periodic(double coordinate, int cells) {
  double wrapped = std::fmod(coordinate, cells);
  if (wrapped < 0) wrapped += cells;
  const int first = std::min(static_cast<int>(wrapped), cells - 1);
  return {first, (first + 1) % cells, wrapped - first};
}

/// One row of the table, all phiD of one (thetaH, thetaD), averaged over `azimuths` half-vectors.
void tabulateRow(const Brdf& brdf, int thetaH, int thetaD, int azimuths, TabulatedBrdf::Planes& planes) {
  std::array<HalfDiffAngles, MerlGrid::kPhiD> angles;
  std::array<Eigen::Array3f, MerlGrid::kPhiD> values;
  for (int k = 0; k < MerlGrid::kPhiD; ++k) angles[k] = MerlGrid::centre(thetaH, thetaD, k);
  if (azimuths == 1) {
    brdf.evaluateMany(angles, values);
  } else {
    for (int k = 0; k < MerlGrid::kPhiD; ++k) {
      Eigen::Array3d sum = Eigen::Array3d::Zero();
      int known = 0;
      for (int a = 0; a < azimuths; ++a) {
        const DirectionPair pair = directionsFromHalfDiff(angles[k], 2 * kPi * a / azimuths);
        const Eigen::Array3d value = brdf.evaluate(pair.toLight, pair.toView);
        if (!value.allFinite()) continue;
        sum += value;
        ++known;
      }
      values[k] = (known > 0 ? Eigen::Array3d(sum / known) : unknown()).cast<float>();
    }
  }
  const std::size_t start = MerlGrid::cell(thetaH, thetaD, 0);
  for (int k = 0; k < MerlGrid::kPhiD; ++k) {
    const DirectionPair pair = directionsFromHalfDiff(angles[k]);
    const bool above = pair.toLight.z() >= 0 && pair.toView.z() >= 0;
    const bool known = above && values[k].allFinite() && (values[k] >= 0).all();
    for (int channel = 0; channel < 3; ++channel) {
      planes[channel][start + k] = known ? static_cast<double>(values[k][channel]) : kNotMeasured;
    }
  }
}

}  // namespace

TabulatedBrdf::TabulatedBrdf(Planes planes, BrdfOrigin origin)
    : Brdf(std::move(origin)), planes_(std::move(planes)) {
  for (const std::vector<double>& plane : planes_) {
    if (plane.size() != MerlGrid::kCells) {
      throw std::invalid_argument("a tabulated BRDF needs planes of 90 x 90 x 180 values");
    }
  }
}

Eigen::Array3d TabulatedBrdf::evaluate(const Eigen::Vector3d& toLight, const Eigen::Vector3d& toView) const {
  if (toLight.z() < 0 || toView.z() < 0) return unknown();
  return evaluate(halfDiffFromDirections(toLight, toView));
}

Eigen::Array3d TabulatedBrdf::evaluate(const HalfDiffAngles& angles) const {
  const Eigen::Vector3d at = MerlGrid::coordinates(angles);
  if (!at.allFinite()) return unknown();
  const Neighbours h = clamped(at.x(), MerlGrid::kThetaH);
  const Neighbours d = clamped(at.y(), MerlGrid::kThetaD);
  const Neighbours p = periodic(at.z(), MerlGrid::kPhiD);
  Eigen::Array3d sum = Eigen::Array3d::Zero();
  double weights = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const double weight = (corner & 1 ? h.weight : 1 - h.weight) * (corner & 2 ? d.weight : 1 - d.weight) *
                          (corner & 4 ? p.weight : 1 - p.weight);
    if (weight <= 0) continue;
    const std::size_t cell = MerlGrid::cell(corner & 1 ? h.second : h.first, corner & 2 ? d.second : d.first,
                                            corner & 4 ? p.second : p.first);
    if (!valid(cell)) continue;
    sum += weight * Eigen::Array3d(planes_[0][cell], planes_[1][cell], planes_[2][cell]);
    weights += weight;
  }
  return weights > 0 ? Eigen::Array3d(sum / weights) : unknown();
}

std::size_t TabulatedBrdf::validCells() const {
  std::size_t count = 0;
  for (std::size_t cell = 0; cell < MerlGrid::kCells; ++cell) count += valid(cell);
  return count;
}

Result<std::shared_ptr<const TabulatedBrdf>> tabulate(const Brdf& brdf, const JobContext& job, int azimuths) {
  TabulatedBrdf::Planes planes;
  for (std::vector<double>& plane : planes) plane.assign(MerlGrid::kCells, kNotMeasured);
  const int positions = brdf.isotropic() ? 1 : std::max(azimuths, 1);

  constexpr int kRows = MerlGrid::kThetaH * MerlGrid::kThetaD;
  std::atomic<int> done{0};
  tbb::task_arena arena(job.threads > 0 ? job.threads : tbb::task_arena::automatic);
  arena.execute([&] {
    tbb::parallel_for(0, kRows, [&](int row) {
      if (job.cancelled()) return;
      tabulateRow(brdf, row / MerlGrid::kThetaD, row % MerlGrid::kThetaD, positions, planes);
      const int finished = ++done;
      if (finished % MerlGrid::kThetaD == 0) job.progress("tabulate", finished, kRows, "rows");
    });
  });
  if (job.cancelled()) return Error{ErrorCode::Cancelled, "the table was not finished", "", ""};

  BrdfOrigin origin = brdf.origin();
  if (positions > 1) {
    origin.note += (origin.note.empty() ? "" : "; ") + std::string("anisotropic: averaged over ") +
                   std::to_string(positions) + " azimuths of the half-vector";
  }
  return std::shared_ptr<const TabulatedBrdf>(
      std::make_shared<TabulatedBrdf>(std::move(planes), std::move(origin)));
}

std::shared_ptr<const TabulatedBrdf> madeReciprocal(const TabulatedBrdf& table) {
  TabulatedBrdf::Planes planes = table.planes();
  double squares = 0;
  std::size_t compared = 0;
  for (std::size_t cell = 0; cell < MerlGrid::kCells; ++cell) {
    const std::size_t phiD = cell % MerlGrid::kPhiD;
    const std::size_t other = cell - phiD + (MerlGrid::kPhiD - 1 - phiD);
    if (!table.valid(other)) continue;
    for (int channel = 0; channel < 3; ++channel) {
      const double here = table.planes()[channel][cell], there = table.planes()[channel][other];
      planes[channel][cell] = table.valid(cell) ? (here + there) / 2 : there;
      if (!table.valid(cell)) continue;
      constexpr double kBlack = 1e-3;  // 1/sr; differences of blacker cells don't matter
      const double difference = std::log((here + kBlack) / (there + kBlack));
      squares += difference * difference;
      ++compared;
    }
  }
  BrdfOrigin origin = table.origin();
  const double rms = compared > 0 ? std::sqrt(squares / compared) : 0;
  constexpr double kWorthSaying = 0.005;  // below, rounding and interpolation
  if (rms > kWorthSaying) {
    char text[96];
    std::snprintf(text, sizeof text, "light and view averaged, which differed by %.3f ln (RMS over cells)",
                  rms);
    origin.note += (origin.note.empty() ? "" : "; ") + std::string(text);
  }
  return std::make_shared<TabulatedBrdf>(std::move(planes), std::move(origin));
}

}  // namespace patina
