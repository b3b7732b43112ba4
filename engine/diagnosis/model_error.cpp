#include "engine/diagnosis/model_error.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "engine/diagnosis/residual_components.h"

namespace patina {

void setRobustWeights(DiagnosisCapture& capture, const FourierDiagnosisModel& model, const JobContext& job) {
  std::vector<double> ratio(capture.sites.size(), -1);
  tbb::enumerable_thread_specific<SiteColumns> scratch;
  tbb::parallel_for(std::size_t{0}, capture.sites.size(), [&](std::size_t i) {
    DiagnosisSite& site = capture.sites[i];
    if (!site.usable || job.cancelled()) return;
    site.robust = 1;
    SiteColumns& at = scratch.local();
    model.evaluate(site, quadrature::kPrediction, at);
    const Eigen::VectorXd w = rootWeights(capture, site, false);
    ratio[i] = w.cwiseProduct(residualOf(capture, site, at)).squaredNorm() /
               std::max<double>(1, static_cast<double>((w.array() > 0).count()));
  });
  std::vector<double> sorted;
  for (const double r : ratio)
    if (r >= 0) sorted.push_back(r);
  if (sorted.empty()) return;
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2),
                   sorted.end());
  const double most = 3 * std::max(sorted[sorted.size() / 2], 1.0);
  for (std::size_t i = 0; i < ratio.size(); ++i)
    if (ratio[i] > most) capture.sites[i].robust = static_cast<float>(most / ratio[i]);
}

double correctNoise(DiagnosisCapture& capture, const FourierDiagnosisModel& model, const JobContext& job) {
  const std::size_t rows = capture.rowCount(), step = std::max<std::size_t>(1, capture.sites.size() / 300);
  SiteColumns at;
  std::vector<double> ratios;
  for (std::size_t i = 0; i + 1 < capture.sites.size() && !job.cancelled(); i += step) {
    Eigen::VectorXd pair[2];
    bool good = true;
    for (std::size_t k = 0; k < 2 && good; ++k) {
      const DiagnosisSite& site = capture.sites[i + k];
      good = site.usable && site.cluster == capture.sites[i].cluster &&
             (site.pixel - capture.sites[i].pixel).norm() < 6;
      if (!good) break;
      model.evaluate(site, quadrature::kPrediction, at);
      pair[k] = rootWeights(capture, site, false).cwiseProduct(residualOf(capture, site, at));
    }
    if (!good) continue;
    for (Eigen::Index r = 0; r < pair[0].size(); ++r)
      if (pair[0][r] != 0 && pair[1][r] != 0)
        ratios.push_back(std::abs(pair[0][r] - pair[1][r]) / std::sqrt(2.0));
  }
  constexpr std::size_t kEnough = 3000;
  if (ratios.size() < kEnough) return 1;
  std::nth_element(ratios.begin(), ratios.begin() + static_cast<std::ptrdiff_t>(ratios.size() / 2),
                   ratios.end());
  const double sd = ratios[ratios.size() / 2] / 0.6745, variance = sd * sd;
  if (variance > 0.85) return 1;
  for (auto& site : capture.sites)
    for (std::size_t k = 0; k < rows * 3; ++k) site.weight[k] = static_cast<float>(site.weight[k] / variance);
  return variance;
}

ModelError modelError(const DiagnosisCapture& capture, const FourierDiagnosisModel& model,
                      const JobContext& job) {
  const std::size_t rows = capture.rowCount();
  constexpr std::size_t kPatches = 24;
  struct Local {
    SiteColumns at;
    ModelError e;
    std::vector<double> rowSignal;
    double signal = 0, heldSignal = 0, error = 0, heldError = 0, noise = 0, heldNoise = 0;
  };
  tbb::enumerable_thread_specific<Local> locals([&] {
    Local l;
    l.e.heldPatch.assign(kPatches, 0);
    l.e.rowChi2.assign(rows, 0);
    l.e.rowCount.assign(rows, 0);
    l.rowSignal.assign(rows, 0);
    l.e.rowNoise.assign(rows, 0);
    return l;
  });
  tbb::parallel_for(std::size_t{0}, capture.sites.size(), [&](std::size_t i) {
    const DiagnosisSite& site = capture.sites[i];
    if (!site.usable || job.cancelled()) return;
    Local& l = locals.local();
    model.evaluate(site, quadrature::kPrediction, l.at);
    const std::size_t patch = i * kPatches / capture.sites.size();
    for (std::size_t r = 0; r < rows; ++r) {
      for (std::size_t c = 0; c < 3; ++c) {
        const double weight = site.weight[r * 3 + c];
        if (weight <= 0) continue;
        const double measured = site.measured[r * 3 + c], gap = measured - l.at.predicted[r * 3 + c];
        l.e.rowChi2[r] += site.robust * weight * gap * gap;
        l.e.rowCount[r] += 1;
        l.rowSignal[r] += measured * measured;
        l.e.rowNoise[r] += 1 / weight;
        if (capture.rows[r].holdout) {
          l.heldError += gap * gap;
          l.heldSignal += measured * measured;
          l.heldNoise += 1 / weight;
        } else {
          l.error += gap * gap;
          l.signal += measured * measured;
          l.noise += 1 / weight;
        }
      }
    }
    const Eigen::VectorXd residual = residualOf(capture, site, l.at);
    const Eigen::VectorXd fitted = rootWeights(capture, site, false), held = rootWeights(capture, site, true);
    l.e.chi2 += fitted.cwiseProduct(residual).squaredNorm();
    l.e.count += static_cast<double>((fitted.array() > 0).count());
    const double heldChi2 = held.cwiseProduct(residual).squaredNorm();
    l.e.heldChi2 += heldChi2;
    l.e.heldPatch[patch] += heldChi2;
    l.e.heldCount += static_cast<double>((held.array() > 0).count());
  });
  Local sum;
  sum.e.heldPatch.assign(kPatches, 0);
  sum.e.rowChi2.assign(rows, 0);
  sum.e.rowCount.assign(rows, 0);
  sum.e.rowNoise.assign(rows, 0);
  sum.rowSignal.assign(rows, 0);
  for (const Local& l : locals) {
    sum.e.chi2 += l.e.chi2, sum.e.count += l.e.count, sum.e.heldChi2 += l.e.heldChi2,
        sum.e.heldCount += l.e.heldCount;
    sum.signal += l.signal, sum.heldSignal += l.heldSignal, sum.error += l.error,
        sum.heldError += l.heldError;
    sum.noise += l.noise, sum.heldNoise += l.heldNoise;
    for (std::size_t k = 0; k < kPatches; ++k) sum.e.heldPatch[k] += l.e.heldPatch[k];
    for (std::size_t r = 0; r < rows; ++r)
      sum.e.rowChi2[r] += l.e.rowChi2[r], sum.e.rowCount[r] += l.e.rowCount[r];
    for (std::size_t r = 0; r < rows; ++r)
      sum.e.rowNoise[r] += l.e.rowNoise[r], sum.rowSignal[r] += l.rowSignal[r];
  }
  for (std::size_t r = 0; r < rows; ++r)
    sum.e.rowNoise[r] = sum.rowSignal[r] > 0 ? std::sqrt(sum.e.rowNoise[r] / sum.rowSignal[r]) : 0;
  ModelError out = std::move(sum.e);
  for (std::size_t r = 0; r < rows; ++r) {
    if (capture.rows[r].holdout) continue;
    out.noiseChi2 += out.rowChi2[r];
    out.noiseCount += out.rowCount[r];
  }
  const auto rms = [](double a, double b) { return b > 0 ? std::sqrt(a / b) : -1; };
  out.rms = rms(sum.error, sum.signal);
  out.heldRms = rms(sum.heldError, sum.heldSignal);
  out.floor = rms(sum.noise, sum.signal);
  out.heldFloor = rms(sum.heldNoise, sum.heldSignal);
  return out;
}

}  // namespace patina
