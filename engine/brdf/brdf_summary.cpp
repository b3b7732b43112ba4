#include "engine/brdf/brdf_summary.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "engine/brdf/merl_grid.h"

namespace patina {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kDegree = kPi / 180;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr int kRows = MerlGrid::kThetaH * MerlGrid::kThetaD;
constexpr int kPhis = 72;     // over the whole turn
constexpr int kAzimuths = 8;  // of the half-vector, where a surface is anisotropic

/// phiD number `k`: phi + pi is `k + kPhis / 2`, which swaps light and view.
HalfDiffAngles anglesOf(int row, int k) {
  HalfDiffAngles angles = MerlGrid::centre(row / MerlGrid::kThetaD, row % MerlGrid::kThetaD, 0);
  angles.phiDRad = 2 * kPi * (k + 0.5) / kPhis;
  return angles;
}

/// Values of one row of directions at one azimuth of the half-vector.
struct Row {
  std::array<HalfDiffAngles, kPhis> angles;
  std::array<DirectionPair, kPhis> pair;

  Row(int row, int azimuth) {
    for (int k = 0; k < kPhis; ++k) {
      angles[k] = anglesOf(row, k);
      pair[k] = directionsFromHalfDiff(angles[k], 2 * kPi * azimuth / kAzimuths);
    }
  }
  std::array<Eigen::Array3f, kPhis> values(const Brdf& brdf, bool atZero) const {
    std::array<Eigen::Array3f, kPhis> result;
    if (atZero) {
      brdf.evaluateMany(angles, result);
    } else {
      for (int k = 0; k < kPhis; ++k) {
        result[k] = brdf.evaluate(pair[k].toLight, pair[k].toView).cast<float>();
      }
    }
    return result;
  }
  double leastCosine(int k) const { return std::min(pair[k].toLight.z(), pair[k].toView.z()); }
  double weight(int k) const { return std::max(pair[k].toLight.z(), pair[k].toView.z()); }
  BrdfRegion region(int k) const {
    constexpr double kGrazingDeg = 70, kHighlightDeg = 15;
    if (leastCosine(k) < std::cos(kGrazingDeg * kDegree)) return BrdfRegion::Grazing;
    return angles[k].thetaHRad < kHighlightDeg * kDegree ? BrdfRegion::Highlight : BrdfRegion::Diffuse;
  }
};

Eigen::Array3d logOf(const Eigen::Array3f& value, double weight) {
  return (value.cast<double>() * weight + kLogEpsilon).log();
}

/// Runs `work(row)` for all rows on the job's threads. False where it was cancelled.
template <typename Work>
bool forRows(int rows, const char* stage, const JobContext& job, const Work& work) {
  std::atomic<int> done{0};
  tbb::task_arena arena(job.threads > 0 ? job.threads : tbb::task_arena::automatic);
  arena.execute([&] {
    tbb::parallel_for(0, rows, [&](int row) {
      if (job.cancelled()) return;
      work(row);
      const int finished = ++done;
      if (finished % MerlGrid::kThetaD == 0) job.progress(stage, finished, rows, "rows");
    });
  });
  return !job.cancelled();
}

/// Sums of differences, gathered a row at a time so that the order of additions never changes.
struct Sums {
  double squares = 0, values = 0;
  std::size_t count = 0;
  void add(double difference) {
    squares += difference * difference;
    values += difference;
    ++count;
  }
  void add(const Sums& other) {
    squares += other.squares;
    values += other.values;
    count += other.count;
  }
  double rms() const { return count > 0 ? std::sqrt(squares / count) : kNan; }
  double mean() const { return count > 0 ? values / count : kNan; }
};

struct RowDifference {
  std::array<std::array<Sums, 3>, kBrdfRegions> sums;  // by region and channel
  std::size_t wanted = 0, known = 0;
  double largest = -1;
  int channel = 0;
  HalfDiffAngles at;
  Eigen::Array3f first, second;
};

BrdfComparison::Part partOf(const Sums& sums, std::size_t channels) {
  return {sums.rms(), sums.mean(), sums.count / channels};
}

BrdfSummary::Albedo albedoAt(const Brdf& brdf, double lightDeg, const JobContext& job) {
  constexpr int kThetas = 400, kTurns = 512;
  const double light = lightDeg * kDegree;
  const Eigen::Vector3d toLight(std::sin(light), 0, std::cos(light));
  struct Part {
    Eigen::Array3d value = Eigen::Array3d::Zero();
    double known = 0, all = 0;
  };
  std::vector<Part> parts(kThetas);
  forRows(kThetas, "measure", job, [&](int i) {
    // Half-vectors denser towards the normal, where highlights are.
    const double u = (i + 0.5) / kThetas, theta = u * u * kPi / 2, step = 2 * u / kThetas * kPi / 2;
    for (int k = 0; k < kTurns; ++k) {
      const double phi = 2 * kPi * (k + 0.5) / kTurns;
      const Eigen::Vector3d half(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi),
                                 std::cos(theta));
      const double cosD = half.dot(toLight);
      if (cosD <= 0) continue;
      const Eigen::Vector3d toView = 2 * cosD * half - toLight;
      if (toView.z() <= 0) continue;
      // Solid angle of the view: 4 (light . half) that of the half-vector.
      const double share = toView.z() * 4 * cosD * std::sin(theta) * step * 2 * kPi / kTurns;
      const Eigen::Array3d value = brdf.evaluate(toLight, toView);
      parts[i].all += share;
      if (!value.allFinite()) continue;
      parts[i].known += share;
      parts[i].value += share * value;
    }
  });
  Part sum;
  for (const Part& part : parts) {
    sum.value += part.value;
    sum.known += part.known;
    sum.all += part.all;
  }
  return {lightDeg, sum.value, sum.all > 0 ? sum.known / sum.all : 0};
}

}  // namespace

Result<BrdfComparison> compareBrdfs(const Brdf& first, const Brdf& second, const JobContext& job) {
  const int azimuths = first.isotropic() && second.isotropic() ? 1 : kAzimuths;
  std::vector<RowDifference> rows(kRows);
  const bool finished = forRows(kRows, "compare", job, [&](int index) {
    RowDifference& out = rows[index];
    for (int azimuth = 0; azimuth < azimuths; ++azimuth) {
      const Row row(index, azimuth);
      const auto a = row.values(first, azimuth == 0), b = row.values(second, azimuth == 0);
      for (int k = 0; k < kPhis; ++k) {
        if (row.leastCosine(k) <= kLeastComparedCosine) continue;
        ++out.wanted;
        if (!a[k].allFinite() || !b[k].allFinite()) continue;
        ++out.known;
        const Eigen::Array3d difference = logOf(b[k], row.weight(k)) - logOf(a[k], row.weight(k));
        for (int channel = 0; channel < 3; ++channel) {
          out.sums[static_cast<int>(row.region(k))][channel].add(difference[channel]);
          if (std::abs(difference[channel]) <= out.largest) continue;
          out.largest = std::abs(difference[channel]);
          out.channel = channel;
          out.at = row.angles[k];
          out.first = a[k];
          out.second = b[k];
        }
      }
    }
  });
  if (!finished) return Error{ErrorCode::Cancelled, "the comparison was not finished", "", ""};

  std::array<Sums, kBrdfRegions> region;
  std::array<Sums, 3> channel;
  Sums all;
  std::size_t wanted = 0, known = 0;
  BrdfComparison result;
  result.largest = -1;
  for (const RowDifference& row : rows) {
    wanted += row.wanted;
    known += row.known;
    for (int r = 0; r < kBrdfRegions; ++r) {
      for (int c = 0; c < 3; ++c) {
        region[r].add(row.sums[r][c]);
        channel[c].add(row.sums[r][c]);
        all.add(row.sums[r][c]);
      }
    }
    if (row.largest <= result.largest) continue;
    result.largest = row.largest;
    result.largestChannel = row.channel;
    result.largestAt = row.at;
    result.firstThere = row.first.cast<double>();
    result.secondThere = row.second.cast<double>();
  }
  if (known == 0) {
    return Error{ErrorCode::Invalid, "there is no direction that both BRDFs know", "",
                 "BRDFs that were measured in the same directions"};
  }
  result.all = partOf(all, 3);
  for (int c = 0; c < 3; ++c) result.channel[c] = partOf(channel[c], 1);
  for (int r = 0; r < kBrdfRegions; ++r) result.region[r] = partOf(region[r], 3);
  result.comparedShare = static_cast<double>(known) / wanted;
  return result;
}

Result<BrdfSummary> summariseBrdf(const Brdf& brdf, const JobContext& job) {
  struct RowSummary {
    Sums reciprocity, azimuth;
    std::size_t above = 0, known = 0;
    Eigen::Array3d least = Eigen::Array3d::Constant(std::numeric_limits<double>::infinity());
    Eigen::Array3d largest = Eigen::Array3d::Constant(-1);
  };
  const int azimuths = brdf.isotropic() ? 1 : kAzimuths;
  std::vector<RowSummary> rows(kRows);
  const bool finished = forRows(kRows, "measure", job, [&](int index) {
    RowSummary& out = rows[index];
    std::array<std::array<Sums, 3>, kPhis> byAzimuth;
    for (int azimuth = 0; azimuth < azimuths; ++azimuth) {
      const Row row(index, azimuth);
      const auto values = row.values(brdf, azimuth == 0);
      for (int k = 0; k < kPhis; ++k) {
        if (row.leastCosine(k) < 0) continue;
        ++out.above;
        if (!values[k].allFinite()) continue;
        ++out.known;
        if (row.leastCosine(k) <= kLeastComparedCosine) continue;
        out.least = out.least.min(values[k].cast<double>());
        out.largest = out.largest.max(values[k].cast<double>());
        const Eigen::Array3d mapped = logOf(values[k], row.weight(k));
        for (int c = 0; c < 3; ++c) byAzimuth[k][c].add(mapped[c]);
        const int swapped = k + kPhis / 2;
        if (swapped >= kPhis || !values[swapped].allFinite()) continue;
        const Eigen::Array3d difference = mapped - logOf(values[swapped], row.weight(k));
        for (int c = 0; c < 3; ++c) out.reciprocity.add(difference[c]);
      }
    }
    for (const auto& channels : byAzimuth) {
      for (const Sums& sums : channels) {
        if (sums.count == 0) continue;
        out.azimuth.squares += std::max(sums.squares - sums.count * sums.mean() * sums.mean(), 0.0);
        out.azimuth.count += sums.count;
      }
    }
  });
  if (!finished) return Error{ErrorCode::Cancelled, "the measurement was not finished", "", ""};

  BrdfSummary summary;
  RowSummary sum;
  for (const RowSummary& row : rows) {
    sum.reciprocity.add(row.reciprocity);
    sum.azimuth.add(row.azimuth);
    sum.above += row.above;
    sum.known += row.known;
    sum.least = sum.least.min(row.least);
    sum.largest = sum.largest.max(row.largest);
  }
  summary.knownShare = static_cast<double>(sum.known) / sum.above;
  summary.reciprocityLogRms = sum.reciprocity.rms();
  summary.azimuthLogRms = azimuths > 1 ? sum.azimuth.rms() : 0;
  const bool any = (sum.largest >= 0).all();
  summary.least = any ? sum.least : Eigen::Array3d::Constant(kNan);
  summary.largest = any ? sum.largest : Eigen::Array3d::Constant(kNan);
  constexpr double kLightsDeg[] = {0, 45, 75};
  JobContext quiet = job;  // a fraction of a second, and the stage above has told it all
  quiet.progressSink = nullptr;
  for (int i = 0; i < 3; ++i) summary.albedo[i] = albedoAt(brdf, kLightsDeg[i], quiet);
  if (job.cancelled()) return Error{ErrorCode::Cancelled, "the measurement was not finished", "", ""};
  return summary;
}

}  // namespace patina
