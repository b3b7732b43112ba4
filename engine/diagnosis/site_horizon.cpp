#include "engine/diagnosis/site_horizon.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>

#include "engine/diagnosis/residual_components.h"
#include "engine/diagnosis/site_fit.h"

namespace patina {
namespace {

constexpr double kWellPredicted = 1.15, kNotWell = 1.2;
constexpr double kHorizonShare = 0.65;  ///< of a site's chi-square above noise, that a horizon must take off

/// Chi-square of a site's fitted photographs in units of noise: no robust factor, no scatter of components
/// (`plain` has none), which where every site stands in a shadow is the shadow itself.
double chi2Of(const DiagnosisCapture& plain, const FourierDiagnosisModel& model, const DiagnosisSite& site,
              double& count, SiteColumns& scratch) {
  model.evaluate(site, quadrature::kPrediction, scratch);
  DiagnosisSite whole = site;
  whole.robust = 1;
  const Eigen::VectorXd w = rootWeights(plain, whole, false);
  count = static_cast<double>((w.array() > 0).count());
  return w.cwiseProduct(residualOf(plain, site, scratch)).squaredNorm();
}

/// The capture with one site, without the scatter of components.
DiagnosisCapture alone(const DiagnosisCapture& capture, const DiagnosisSite& site) {
  DiagnosisCapture one;
  one.fit = capture.fit, one.state = capture.state;
  one.frequencies = capture.frequencies, one.rows = capture.rows;
  one.clusterCount = capture.clusterCount, one.fullScale = capture.fullScale;
  one.knownLambertian = capture.knownLambertian;
  one.sites = {site};
  one.sites[0].robust = 1;
  return one;
}

}  // namespace

std::size_t findHorizons(DiagnosisCapture& capture, const FourierDiagnosisModel& model, const JobContext& job,
                         const std::vector<DiagnosisSite>* seeds) {
  const std::size_t count = capture.sites.size();
  if (count == 0) return 0;
  const DiagnosisCapture plain = alone(capture, capture.sites.front());
  std::vector<double> chi2(count, -1), numbers(count, 1);
  tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
    SiteColumns scratch;
    if (capture.sites[i].usable && !job.cancelled())
      chi2[i] = chi2Of(plain, model, capture.sites[i], numbers[i], scratch);
  });
  const std::vector<DiagnosisSite> before = capture.sites;
  std::atomic<std::size_t> found{0};
  tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
    DiagnosisSite& site = capture.sites[i];
    if (!site.usable || job.cancelled()) return;
    if (site.ownHorizon) {
      ++found;
      return;
    }
    if (chi2[i] < kNotWell * numbers[i]) return;
    std::size_t near = count;
    double least = std::numeric_limits<double>::max();
    for (std::size_t j = 0; j < count; ++j) {
      if (j == i || chi2[j] < 0 || chi2[j] > kWellPredicted * numbers[j]) continue;
      if (before[j].cluster != site.cluster) continue;
      const double distance = (before[j].pixel - site.pixel).squaredNorm();
      if (distance < least) least = distance, near = j;
    }
    // What the lobe can't do isn't a shadow: most of what is wrong must go with it.
    double best = chi2[i] - std::max(kHorizonGain, kHorizonShare * (chi2[i] - numbers[i]));
    DiagnosisSite chosen = site;
    SiteColumns scratch;
    struct Tried {
      double chi2 = 0;
      DiagnosisSite site;
    };
    const auto started = [&](float sine, const DiagnosisSite* other) {
      DiagnosisSite trial = site;
      if (other) {
        trial.model.slopeX = other->model.slopeX, trial.model.slopeY = other->model.slopeY;
        trial.model.sigma = other->model.sigma, trial.model.kurtosis = other->model.kurtosis;
        trial.diffuse = other->diffuse, trial.specular = other->specular;
      }
      trial.horizonSine = sine;
      trial.ownHorizon = true;
      return trial;
    };
    const auto refined = [&](const DiagnosisSite& from, int steps) {
      DiagnosisCapture one = alone(capture, from);
      refineSites(one, model, steps, job, false);
      double n = 0;
      return Tried{chi2Of(plain, model, one.sites[0], n, scratch), one.sites[0]};
    };
    const auto take = [&](const Tried& tried) {
      if (!(tried.chi2 < best)) return;
      best = tried.chi2;
      chosen = tried.site;
      chosen.robust = site.robust;
    };
    if (seeds) {
      const DiagnosisSite* seed = nullptr;
      double closest = std::numeric_limits<double>::max();
      for (const DiagnosisSite& other : *seeds) {
        if (!other.usable || !other.ownHorizon || other.cluster != site.cluster) continue;
        const double distance = (other.pixel - site.pixel).squaredNorm();
        if (distance < closest) closest = distance, seed = &other;
      }
      if (seed) {
        take(refined(started(seed->horizonSine, seed), 6));
        if (best > kNotWell * numbers[i]) take(refined(started(seed->horizonSine, nullptr), 6));
      }
    } else {
      // All starts a little way, the best three to the end.
      constexpr double kRadians = 0.017453292519943295;
      std::vector<const DiagnosisSite*> starts;
      if (near < count) starts.push_back(&before[near]);
      starts.push_back(nullptr);
      for (const DiagnosisSite* other : starts) {
        if (best <= kWellPredicted * numbers[i]) break;
        std::vector<Tried> all;
        for (const double degrees : {48.0, 34.0, 56.0, 41.0, 27.0, 20.0, 64.0})
          if (!job.cancelled())
            all.push_back(refined(started(static_cast<float>(std::sin(degrees * kRadians)), other), 2));
        std::ranges::sort(all, {}, &Tried::chi2);
        for (std::size_t k = 0; k < std::min<std::size_t>(all.size(), 3) && !job.cancelled(); ++k)
          if (best > kWellPredicted * numbers[i]) take(refined(all[k].site, 5));
      }
    }
    if (!chosen.ownHorizon) return;
    DiagnosisCapture one = alone(capture, chosen);
    refineSites(one, model, 12, job, false);
    const float robust = site.robust;
    site = one.sites[0];
    site.robust = robust;
    ++found;
  });
  return found;
}

}  // namespace patina
