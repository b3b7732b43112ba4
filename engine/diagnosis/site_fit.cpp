#include "engine/diagnosis/site_fit.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "engine/diagnosis/residual_components.h"

namespace patina {
namespace {

constexpr float kAtBound = 1e-4f;
constexpr double kFrozen = 1e-6;         // standard deviation of what isn't free
constexpr double kStretchScatter = 0.3;  // of a place's stretch about its material's: a third more or less

}  // namespace

OwnPrior ownPrior(const DiagnosisCapture& capture, const DiagnosisSite& site) {
  OwnPrior prior;
  const auto set = [&](int k, double mean, double sd) {
    prior.mean[static_cast<std::size_t>(k)] = mean;
    prior.invSd[static_cast<std::size_t>(k)] = 1 / sd;
  };
  const double square = std::pow(std::log(std::max(1.0f, site.model.kurtosis)), 2);
  set(kOwnLogSigma, -2.5 - std::log(static_cast<double>(site.model.sigma)), 1.5);
  set(kOwnKurtosis, 0.05 - square, 0.3);
  set(kOwnSlopeX, -site.model.slopeX, 0.3);
  set(kOwnSlopeY, -site.model.slopeY, 0.3);
  for (int c = 0; c < 3; ++c) {
    set(kOwnDiffuse + c, -site.diffuse[c], 2);
    set(kOwnSpecular + c, -site.specular[c], 1);
    set(kOwnBlack + c, site.blackMeasured[c] - site.black[c],
        1 / std::sqrt(std::max<double>(site.blackWeight[c], 1e-12)));
  }
  set(kOwnHorizon, 0, site.ownHorizon ? 0.5 : kFrozen);
  for (int k = 0; k < 2; ++k)
    set(kOwnStretch + k, site.ownStretch ? -site.stretch[static_cast<std::size_t>(k)] : 0,
        site.ownStretch ? kStretchScatter : kFrozen);
  if (capture.knownLambertian) {  // a paper whose albedo was entered: nothing but the black level is free
    for (int k = 0; k < kOwnBlack; ++k) set(k, 0, kFrozen);
  }
  return prior;
}

void stepSite(DiagnosisSite& site, const Eigen::VectorXd& delta) {
  const double limit = std::max(0.02, 0.5 * static_cast<double>(site.model.sigma));
  site.model.sigma *= static_cast<float>(std::exp(std::clamp(delta[kOwnLogSigma], -0.4, 0.4)));
  site.model.sigma = std::clamp(site.model.sigma, 0.003f, 1.0f);
  const double square =
      std::pow(std::log(std::max(1.0f, site.model.kurtosis)), 2) + std::clamp(delta[kOwnKurtosis], -0.2, 0.2);
  site.model.kurtosis = static_cast<float>(std::exp(std::sqrt(std::clamp(square, 0.0, 1.5))));
  site.model.slopeX += static_cast<float>(std::clamp(delta[kOwnSlopeX], -limit, limit));
  site.model.slopeY += static_cast<float>(std::clamp(delta[kOwnSlopeY], -limit, limit));
  for (int c = 0; c < 3; ++c) {
    site.diffuse[c] = std::max(0.0f, site.diffuse[c] + static_cast<float>(delta[kOwnDiffuse + c]));
    site.specular[c] = std::max(0.0f, site.specular[c] + static_cast<float>(delta[kOwnSpecular + c]));
    site.black[c] += static_cast<float>(delta[kOwnBlack + c]);
  }
  if (site.ownHorizon)
    site.horizonSine = std::clamp(
        site.horizonSine + static_cast<float>(std::clamp(delta[kOwnHorizon], -0.08, 0.08)), 0.02f, 0.98f);
  for (std::size_t k = 0; k < 2 && site.ownStretch; ++k)
    site.stretch[k] = std::clamp(
        site.stretch[k] +
            static_cast<float>(std::clamp(delta[kOwnStretch + static_cast<Eigen::Index>(k)], -0.3, 0.3)),
        -2.0f, 2.0f);
}

OwnSystem ownSystem(const OwnPrior& prior, const Eigen::MatrixXd& gram, const Eigen::VectorXd& rhs) {
  OwnSystem system;
  Eigen::MatrixXd n = gram;
  system.rhs = rhs;
  for (int k = 0; k < kOwnCount; ++k) {
    const double inv = prior.invSd[static_cast<std::size_t>(k)] * prior.invSd[static_cast<std::size_t>(k)];
    n(k, k) += inv * (1 + 1e-9) + 1e-12;
    system.rhs[k] += inv * prior.mean[static_cast<std::size_t>(k)];
  }
  system.llt.compute(n);
  return system;
}

OwnSystem boundedSystem(const DiagnosisCapture& capture, const DiagnosisSite& site,
                        const Eigen::MatrixXd& gram, const Eigen::VectorXd& rhs) {
  OwnPrior prior = ownPrior(capture, site);
  std::array<bool, kOwnCount> at{};
  at[kOwnKurtosis] = std::log(std::max(1.0f, site.model.kurtosis)) < kAtBound;
  for (std::size_t c = 0; c < 3; ++c) {
    at[kOwnDiffuse + c] = site.diffuse[c] < kAtBound;
    at[kOwnSpecular + c] = site.specular[c] < kAtBound;
  }
  OwnSystem system = ownSystem(prior, gram, rhs);
  for (int round = 0; round < kOwnCount && system.llt.info() == Eigen::Success; ++round) {
    const Eigen::VectorXd step = system.llt.solve(system.rhs);
    bool held = false;
    for (std::size_t k = 0; k < kOwnCount; ++k) {
      if (!at[k] || !(step[static_cast<Eigen::Index>(k)] < 0)) continue;
      at[k] = false;
      prior.mean[k] = 0, prior.invSd[k] = 1 / kFrozen;
      held = true;
    }
    if (!held) break;
    system = ownSystem(prior, gram, rhs);
  }
  return system;
}

void refineSites(DiagnosisCapture& capture, const FourierDiagnosisModel& model, int steps,
                 const JobContext& job, bool mayDrop) {
  tbb::enumerable_thread_specific<SiteColumns> scratch;
  tbb::parallel_for(std::size_t{0}, capture.sites.size(), [&](std::size_t i) {
    if (job.cancelled()) return;
    DiagnosisSite& site = capture.sites[i];
    if (!site.usable) return;
    SiteColumns& at = scratch.local();
    DiagnosisSite best = site;
    double least = -1, damping = 0;
    for (int k = 0; k <= steps; ++k) {
      model.evaluate(site, quadrature::kParameters, at);
      if (mayDrop && !at.onScreen) {
        site.usable = false;
        break;
      }
      const Eigen::VectorXd w = rootWeights(capture, site, false);
      const Eigen::VectorXd r = w.cwiseProduct(residualOf(capture, site, at));
      const OwnPrior prior = ownPrior(capture, site);
      double cost = r.squaredNorm();
      for (std::size_t p = 0; p < kOwnCount; ++p) cost += std::pow(prior.mean[p] * prior.invSd[p], 2);
      if (!std::isfinite(cost)) {
        site = best;
        break;
      }
      if (least >= 0 && cost > least * (1 + 1e-9)) {
        site = best;
        damping = damping == 0 ? 1e-2 : damping * 10;
        if (damping > 1) break;
        model.evaluate(site, quadrature::kParameters, at);
      } else {
        if (least >= 0 && least - cost < 1e-3) {
          break;
        }
        least = cost;
        best = site;
      }
      if (k == steps) break;
      const Eigen::VectorXd rNow = w.cwiseProduct(residualOf(capture, site, at));
      turnToComponents(capture, at.own);
      const Eigen::MatrixXd j = w.asDiagonal() * at.own;
      Eigen::MatrixXd gram = j.transpose() * j;
      gram.diagonal() *= 1 + damping;
      const OwnSystem system = boundedSystem(capture, site, gram, j.transpose() * rNow);
      if (system.llt.info() != Eigen::Success) break;
      const Eigen::VectorXd delta = system.llt.solve(system.rhs);
      if (!delta.allFinite()) break;
      stepSite(site, delta);
    }
    if (least >= 0) {
      const bool usable = site.usable;
      site = best;
      site.usable = usable;
    }
  });
}

}  // namespace patina
