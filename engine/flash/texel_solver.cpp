#include "engine/flash/texel_solver.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace patina {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kFreedom = 10;  ///< of Student's t
constexpr double kSlopeStep = 1e-4;
/// Beyond, an albedo or slope is nonsense, and exp() soon infinite.
constexpr double kLargestLog = 8, kSmallestLog = -16, kLargestSlope = 3;
constexpr double kTolerance = 1e-4;

void keepInside(TexelVector& x) {
  for (int i = 0; i < 2; ++i) x[i] = std::clamp(x[i], -kLargestSlope, kLargestSlope);
  for (int i = 2; i < FlashTexel::kParameters; ++i) x[i] = std::clamp(x[i], kSmallestLog, kLargestLog);
}

}  // namespace

SeenPrediction predictSeen(const FlashModel& model, int material, const FlashObservation& seen,
                           const TexelVector& x, bool derivatives) {
  const FlashLobe& lobe = model.materials[static_cast<std::size_t>(material)].lobe;
  const FlashTexel texel{x};
  const Eigen::Array3d diffuse = texel.diffuse(), specular = texel.specular();
  const Eigen::Vector3d normal = texel.normal();
  const auto cosine = [&](const Eigen::Vector3d& n) {
    return n.dot(seen.ray.toView) > 0 ? std::max(0.0, n.dot(seen.ray.toLight)) : 0.0;
  };
  SeenPrediction p;
  p.lobe = flashLobeTimesCos(lobe, seen.ray, normal);
  p.factor = flashRigFactor(model.rig, seen.photo, seen.ray);
  const double nl = cosine(normal);
  const Eigen::Array3d power = seen.irradiance * p.factor;
  p.flashLight = power * (diffuse * (nl / kPi) + specular * p.lobe);
  p.light = p.flashLight + model.rig.ambient * diffuse / kPi;
  for (int c = 0; c < 3; ++c) {
    p.value[c] = model.tone.value(p.light[c]) + model.rig.black[c];
    p.slope[c] = model.tone.slopeAt(p.light[c]);
  }
  if (!derivatives) return p;
  p.byTexel.setZero();
  for (int i = 0; i < 2; ++i) {
    TexelVector moved = x;
    moved[i] += kSlopeStep;
    const Eigen::Vector3d n = FlashTexel{moved}.normal();
    const double lobeBy = (flashLobeTimesCos(lobe, seen.ray, n) - p.lobe) / kSlopeStep;
    const double cosineBy = (cosine(n) - nl) / kSlopeStep;
    p.byTexel.col(i) = (p.slope * power * (diffuse * (cosineBy / kPi) + specular * lobeBy)).matrix();
  }
  for (int c = 0; c < 3; ++c) {
    p.byTexel(c, 2 + c) = p.slope[c] * diffuse[c] / kPi * (power[c] * nl + model.rig.ambient[c]);
    p.byTexel(c, 5 + c) = p.slope[c] * power[c] * specular[c] * p.lobe;
  }
  return p;
}

Misfit misfitOf(double predicted, double seen, double sd, bool clipped) {
  Misfit misfit;
  const double difference = predicted - seen;
  if (clipped && difference >= 0) return misfit;
  misfit.perValue = 1 / sd;
  misfit.residual = difference / sd;
  const double r2 = misfit.residual * misfit.residual;
  misfit.weight = (kFreedom + 1) / (kFreedom + r2);
  misfit.cost = 0.5 * (kFreedom + 1) * std::log1p(r2 / kFreedom);
  return misfit;
}

double scatterOf(const FlashObservation& seen, int channel, double predicted, double discrepancy) {
  double middle = 0.5 * (seen.value[channel] + std::max(predicted, 0.0));
  if ((seen.clipped >> channel) & 1) middle = seen.value[channel];
  const double relative = discrepancy * middle;
  return std::sqrt(seen.variance[channel] + relative * relative);
}

TexelSolution solveTexel(const FlashModel& model, const FlashSite& site, const TexelPrior& prior,
                         const TexelVector& start, int maxIterations, std::span<const char> use) {
  const double discrepancy = model.materials[static_cast<std::size_t>(site.material)].discrepancy;
  TexelSolution best;
  best.x = start;
  keepInside(best.x);
  constexpr std::size_t kMost = 64;
  std::array<Eigen::Array3d, kMost> sd;
  const std::size_t count = std::min(site.seen.size(), kMost);  // more photographs of one texel add little
  const auto used = [&](std::size_t k) {
    return use.empty() || use[static_cast<std::size_t>(site.seen[k].photo)];
  };
  double damping = 1e-3;
  bool refresh = true;
  for (int iteration = 0; iteration < maxIterations; ++iteration) {
    TexelVector gradient = prior.precision * (best.x - prior.mean);
    TexelMatrix hessian = prior.precision;
    double cost = 0.5 * (best.x - prior.mean).dot(gradient);
    for (std::size_t k = 0; k < count; ++k) {
      if (!used(k)) continue;
      const FlashObservation& seen = site.seen[k];
      const SeenPrediction p = predictSeen(model, site.material, seen, best.x, true);
      for (int c = 0; c < 3; ++c) {
        if (refresh) sd[k][c] = scatterOf(seen, c, p.value[c], discrepancy);
        const Misfit m = misfitOf(p.value[c], seen.value[c], sd[k][c], (seen.clipped >> c) & 1);
        cost += m.cost;
        if (m.perValue == 0) continue;
        // Row c of byTexel has four numbers that aren't zero: two slopes, one diffuse, one specular.
        const std::array<int, 4> at = {0, 1, 2 + c, 5 + c};
        std::array<double, 4> row;
        for (int a = 0; a < 4; ++a) row[a] = p.byTexel(c, at[a]) * m.perValue;
        for (int a = 0; a < 4; ++a) {
          gradient[at[a]] += m.weight * m.residual * row[a];
          for (int b = 0; b < 4; ++b) hessian(at[a], at[b]) += m.weight * row[a] * row[b];
        }
      }
    }
    best.cost = cost, best.information = hessian, best.iterations = iteration + 1;
    if (!std::isfinite(cost)) {
      best.finite = false;
      return best;
    }
    bool moved = false;
    for (int attempt = 0; attempt < 6; ++attempt) {
      TexelMatrix damped = hessian;
      damped.diagonal() *= 1 + damping;
      TexelVector next = best.x - damped.llt().solve(gradient);
      if (!next.allFinite()) {
        damping = std::max(damping, 1e-6) * 10;
        continue;
      }
      keepInside(next);
      double nextCost = 0.5 * (next - prior.mean).dot(prior.precision * (next - prior.mean));
      for (std::size_t k = 0; k < count && nextCost < cost; ++k) {
        if (!used(k)) continue;
        const SeenPrediction p = predictSeen(model, site.material, site.seen[k], next, false);
        for (int c = 0; c < 3; ++c)
          nextCost +=
              misfitOf(p.value[c], site.seen[k].value[c], sd[k][c], (site.seen[k].clipped >> c) & 1).cost;
      }
      if (nextCost < cost) {
        best.x = next, moved = true;
        damping = std::max(damping * 0.2, 1e-7);
        if (cost - nextCost < kTolerance * (1 + cost)) best.converged = true;
        best.cost = nextCost;
        break;
      }
      damping = std::max(damping, 1e-6) * 8;
    }
    if (!moved) best.converged = true;  // no smaller step helps: a minimum to rounding
    if (best.converged) break;
    // Weights follow the prediction while it still moves, and stand still to let it settle.
    refresh = iteration < 4;
  }
  return best;
}

Eigen::Array3d darkColour(const FlashSite& site) {
  std::vector<std::pair<double, Eigen::Array3d>> albedos;
  for (const FlashObservation& seen : site.seen) {
    const Eigen::Array3d albedo =
        (seen.value.max(1e-6) * kPi / (seen.irradiance * std::max(seen.ray.toLight.z(), 0.05))).max(1e-7);
    albedos.emplace_back(albedo.sum(), albedo);
  }
  if (albedos.empty()) return Eigen::Array3d::Constant(std::log(0.1));
  std::sort(albedos.begin(), albedos.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  Eigen::Array3d sum = Eigen::Array3d::Zero();
  const std::size_t half = (albedos.size() + 1) / 2;
  for (std::size_t k = 0; k < half; ++k) sum += albedos[k].second.log();
  return sum / static_cast<double>(half);
}

std::vector<TexelVector> startsOf(const FlashSite& site, const TexelPrior& prior) {
  std::vector<TexelVector> starts{prior.mean};
  double brightest = 0;
  TexelVector turned = prior.mean;
  for (const FlashObservation& seen : site.seen) {
    const double relative = (seen.value / seen.irradiance).sum();
    if (!(relative > brightest)) continue;
    brightest = relative;
    const Eigen::Vector3d half = (seen.ray.toLight + seen.ray.toView).normalized();
    if (half.z() < 0.2) continue;
    turned.head<2>() = half.head<2>() / half.z();
  }
  if ((turned - prior.mean).norm() > 1e-3) starts.push_back(turned);
  return starts;
}

}  // namespace patina
