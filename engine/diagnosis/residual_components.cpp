#include "engine/diagnosis/residual_components.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <cmath>
#include <numbers>

namespace patina {
namespace {

constexpr double kHalfRoot = std::numbers::sqrt2 / 2;

/// Weights by component before inflation and robust factor.
void componentWeights(const DiagnosisCapture& capture, const DiagnosisSite& site, std::size_t channel,
                      Eigen::Ref<Eigen::VectorXd> out) {
  const std::size_t rows = capture.rowCount();
  const auto weight = [&](std::size_t r) { return static_cast<double>(site.weight[r * 3 + channel]); };
  std::size_t r = 0;
  for (; r + 4 <= rows; r += 4) {
    // Opposite phases share a weight: the pair was dropped together, or none of it.
    const double w0 = weight(r), w1 = weight(r + 1);
    const double mean = w0 > 0 && w1 > 0 ? 2 * w0 * w1 / (w0 + w1) : 0;
    const auto at = static_cast<Eigen::Index>(r);
    out[at + kOddSine] = w0;
    out[at + kOddCosine] = w1;
    out[at + kEvenSum] = out[at + kEvenDifference] = mean;
  }
  for (; r < rows; ++r) out[static_cast<Eigen::Index>(r)] = weight(r);
}

}  // namespace

void turnToComponents(const DiagnosisCapture& capture, Eigen::Ref<Eigen::MatrixXd> m) {
  const auto rows = static_cast<Eigen::Index>(capture.rowCount());
  for (Eigen::Index column = 0; column < m.cols(); ++column) {
    for (Eigen::Index channel = 0; channel < 3; ++channel) {
      double* at = m.col(column).data() + channel * rows;
      for (Eigen::Index r = 0; r + 4 <= rows; r += 4, at += 4) {
        const double a0 = at[0], a1 = at[1], a2 = at[2], a3 = at[3];
        at[kOddSine] = kHalfRoot * (a0 - a2);
        at[kOddCosine] = kHalfRoot * (a1 - a3);
        at[kEvenSum] = 0.5 * (a0 + a1 + a2 + a3);
        at[kEvenDifference] = 0.5 * (a0 - a1 + a2 - a3);
      }
    }
  }
}

ComponentShare componentsOf(const DiagnosisCapture& capture, std::size_t row) {
  if (capture.rows[row].frequency < 0) return {1, {row}, {1}};
  const std::size_t first = row / 4 * 4, phase = row % 4;
  const std::size_t odd = phase % 2 == 0 ? kOddSine : kOddCosine;
  return {3,
          {first + odd, first + kEvenSum, first + kEvenDifference},
          {phase < 2 ? kHalfRoot : -kHalfRoot, 0.5, phase % 2 == 0 ? 0.5 : -0.5}};
}

Eigen::VectorXd rootWeights(const DiagnosisCapture& capture, const DiagnosisSite& site, bool holdout) {
  const std::size_t rows = capture.rowCount();
  const auto length = static_cast<Eigen::Index>(rows);
  Eigen::VectorXd w(3 * length);
  for (std::size_t c = 0; c < 3; ++c) {
    auto part = w.segment(static_cast<Eigen::Index>(c) * length, length);
    componentWeights(capture, site, c, part);
    for (std::size_t r = 0; r < rows; ++r) {
      double& value = part[static_cast<Eigen::Index>(r)];
      if (capture.rows[r].holdout != holdout) {
        value = 0;
        continue;
      }
      const double inflation = capture.inflation.empty() ? 1 : capture.inflation[r * 3 + c];
      value = std::sqrt(value * site.robust / inflation);
    }
  }
  return w;
}

Eigen::VectorXd residualOf(const DiagnosisCapture& capture, const DiagnosisSite& site,
                           const SiteColumns& at) {
  const std::size_t rows = capture.rowCount();
  Eigen::MatrixXd r(static_cast<Eigen::Index>(3 * rows), 1);
  for (std::size_t c = 0; c < 3; ++c)
    for (std::size_t i = 0; i < rows; ++i)
      r(static_cast<Eigen::Index>(c * rows + i), 0) =
          static_cast<double>(site.measured[i * 3 + c]) - at.predicted[i * 3 + c];
  turnToComponents(capture, r);
  return r.col(0);
}

void inflateScatter(DiagnosisCapture& capture, const FourierDiagnosisModel& model, const JobContext& job) {
  const std::size_t rows = capture.rowCount();
  struct Sums {
    SiteColumns at;
    std::vector<double> square, count;
  };
  tbb::enumerable_thread_specific<Sums> locals([&] {
    return Sums{{}, std::vector<double>(rows * 3, 0), std::vector<double>(rows * 3, 0)};
  });
  capture.inflation.assign(rows * 3, 1.0f);
  tbb::parallel_for(std::size_t{0}, capture.sites.size(), [&](std::size_t i) {
    const DiagnosisSite& site = capture.sites[i];
    if (!site.usable || job.cancelled()) return;
    Sums& local = locals.local();
    model.evaluate(site, quadrature::kPrediction, local.at);
    const Eigen::VectorXd r = residualOf(capture, site, local.at);
    for (const bool holdout : {false, true}) {
      const Eigen::VectorXd w = rootWeights(capture, site, holdout);
      for (std::size_t c = 0; c < 3; ++c) {
        for (std::size_t row = 0; row < rows; ++row) {
          const auto at = static_cast<Eigen::Index>(c * rows + row);
          if (w[at] == 0) continue;
          local.square[row * 3 + c] += w[at] * w[at] * r[at] * r[at];
          local.count[row * 3 + c] += site.robust;
        }
      }
    }
  });
  std::vector<double> square(rows * 3, 0), count(rows * 3, 0);
  for (const Sums& local : locals) {
    for (std::size_t k = 0; k < rows * 3; ++k) square[k] += local.square[k], count[k] += local.count[k];
  }
  for (std::size_t k = 0; k < rows * 3; ++k) {
    if (count[k] < 10) continue;
    // Three standard deviations of a mean square of pure noise, and what the fit's own error may be.
    const double ratio = square[k] / count[k], clear = 1.05 + 3 * std::sqrt(2 / count[k]);
    if (ratio > clear) capture.inflation[k] = static_cast<float>(ratio);
  }
}

}  // namespace patina
