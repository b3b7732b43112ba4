#include "engine/flash/joint.h"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/flash/joint_system.h"

namespace patina {
namespace {

constexpr double kTolerance = 2e-5;
/// Texels that the priors of a material are worth before its own texels speak.
constexpr double kPriorTexels = 15;
constexpr double kLeastDiscrepancy = 1e-3, kLargestDiscrepancy = 0.6;
constexpr double kKeptLean = 0.9;
constexpr double kMedianOfChi2 = 0.4549;  ///< one degree of freedom

TexelMatrix firstCovariance() {
  TexelVector sd;
  sd << 0.08, 0.08, 0.3, 0.3, 0.3, 0.6, 0.6, 0.6;
  TexelMatrix covariance = sd.array().square().matrix().asDiagonal();
  // Channels go up and down together.
  for (const int first : {2, 5}) {
    for (int a = 0; a < 3; ++a) {
      for (int b = 0; b < 3; ++b)
        if (a != b) covariance(first + a, first + b) = 0.8 * sd[first + a] * sd[first + b];
    }
  }
  return covariance;
}

/// A share, and slopes that stay away from nonsense.
void keepInside(FlashModel& model) {
  for (FlashMaterial& material : model.materials) {
    FlashLobe& lobe = material.lobe;
    lobe.logSigma = std::clamp(lobe.logSigma, std::log(0.005), std::log(2.0));
    // Beyond, the narrow Gaussian is a spike between the photographs' few directions: no evidence for it, and
    // absurd predictions where one more photograph hits it.
    lobe.logKurtosis = std::clamp(lobe.logKurtosis, -0.7, 0.7);
    lobe.thirdShare = std::clamp(lobe.thirdShare, 0.0, 0.9);
    lobe.logThirdRatio = std::clamp(lobe.logThirdRatio, std::log(1.3), std::log(12.0));
    for (double& d : lobe.deviation) d = std::clamp(d, -3.0, 3.0);
  }
  for (double& h : model.rig.toneLogSlope) h = std::clamp(h, -1.5, 1.5);
  model.tone = ToneCurve(model.rig.toneLogSlope);
}

void learnMaterials(JointState& state, const FlashSample& sample, std::span<const char> photos) {
  const std::size_t count = state.model.materials.size();
  for (std::size_t m = 0; m < count; ++m) {
    FlashMaterial& material = state.model.materials[m];
    TexelVector sum = TexelVector::Zero();
    double texels = 0;
    for (std::size_t s = 0; s < sample.sites.size(); ++s) {
      if (sample.sites[s].material != static_cast<int>(m)) continue;
      sum += state.x[s], texels += 1;
    }
    if (texels < 2) continue;
    material.mean = sum / texels;
    // The sheet is declared flat: a lean that the texels don't hold by themselves fades, instead of prior and
    // texels following each other away.
    material.mean.head<2>() *= kKeptLean;
    TexelMatrix spread = kPriorTexels * firstCovariance();
    TexelMatrix uncertain = TexelMatrix::Zero();
    for (std::size_t s = 0; s < sample.sites.size(); ++s) {
      if (sample.sites[s].material != static_cast<int>(m)) continue;
      const TexelVector d = state.x[s] - material.mean;
      uncertain += state.information[s].llt().solve(TexelMatrix::Identity());
      spread += d * d.transpose();
    }
    spread += uncertain;
    material.covariance = spread / (texels + kPriorTexels);
    const TexelMatrix precision = material.covariance.llt().solve(TexelMatrix::Identity());
    // What the texels' own parameters took of the observations.
    const double taken = FlashTexel::kParameters - (precision * uncertain).trace() / texels;
    std::vector<std::array<double, 3>> misfits;  // difference^2, sensor variance, middle^2
    double observations = 0;
    for (std::size_t s = 0; s < sample.sites.size(); ++s) {
      const FlashSite& site = sample.sites[s];
      if (site.material != static_cast<int>(m)) continue;
      for (const FlashObservation& seen : site.seen) {
        if (!photos[static_cast<std::size_t>(seen.photo)]) continue;
        const SeenPrediction p = predictSeen(state.model, site.material, seen, state.x[s], false);
        for (int c = 0; c < 3; ++c) {
          if ((seen.clipped >> c) & 1) continue;
          const double middle = 0.5 * (seen.value[c] + std::max(p.value[c], 0.0));
          misfits.push_back({(p.value[c] - seen.value[c]) * (p.value[c] - seen.value[c]), seen.variance[c],
                             middle * middle});
          observations += 1;
        }
      }
    }
    if (misfits.size() < 30) continue;
    const double share = std::clamp(1 - taken * texels / observations, 0.15, 1.0);
    // Half the way each time: the texels must follow before it is measured again.
    material.discrepancy = std::sqrt(material.discrepancy * discrepancyOf(misfits, share));
  }
}

}  // namespace

double discrepancyOf(const std::vector<std::array<double, 3>>& misfits, double share) {
  double low = kLeastDiscrepancy, high = kLargestDiscrepancy;
  std::vector<double> scaled(misfits.size());
  for (int step = 0; step < 20; ++step) {
    const double middle = std::sqrt(low * high);
    for (std::size_t i = 0; i < misfits.size(); ++i)
      scaled[i] = misfits[i][0] / (misfits[i][1] + middle * middle * misfits[i][2] + 1e-20);
    const auto half = scaled.begin() + static_cast<std::ptrdiff_t>(scaled.size() / 2);
    std::nth_element(scaled.begin(), half, scaled.end());
    (*half > kMedianOfChi2 * share ? low : high) = middle;
  }
  return std::sqrt(low * high);
}

namespace {

/// Photographs that were not fitted had the others' power, for all that is known.
void guessGains(FlashRig& rig, std::span<const char> photos) {
  double sum = 0, count = 0;
  for (std::size_t k = 0; k < rig.logGain.size(); ++k)
    if (photos[k]) sum += rig.logGain[k], count += 1;
  for (std::size_t k = 0; k < rig.logGain.size(); ++k)
    if (!photos[k]) rig.logGain[k] = count > 0 ? sum / count : 0;
}

/// Unknowns of the lobes and of all active effects.
std::vector<FlashUnknown> allUnknowns(const FlashModel& model, const FlashCapture& capture,
                                      const std::vector<FlashEffect>& effects, std::span<const char> photos) {
  std::vector<FlashUnknown> unknowns = lobeUnknowns(model);
  for (const FlashEffect effect : effects) {
    const auto more = effectUnknowns(effect, model, capture, photos);
    unknowns.insert(unknowns.end(), more.begin(), more.end());
  }
  return unknowns;
}

}  // namespace

void solveJoint(JointState& state, const FlashSample& sample, const FlashCapture& capture,
                const JointOptions& options, const JobContext& job) {
  std::vector<FlashUnknown> unknowns = allUnknowns(state.model, capture, options.effects, options.photos);
  const auto count = static_cast<Eigen::Index>(unknowns.size());
  double damping = 1e-3;
  keepInside(state.model);
  for (int iteration = 0; iteration < options.iterations; ++iteration) {
    if (job.cancelled()) return;
    JointSystem system(state, sample, unknowns, options.photos);
    state.information = system.information();
    const double cost = system.cost();
    bool moved = false, settled = false;
    for (int attempt = 0; attempt < 6 && !moved; ++attempt) {
      const Eigen::VectorXd step = system.step(damping);
      JointState next = state;
      if (step.allFinite()) {
        for (Eigen::Index g = 0; g < count; ++g)
          slotOf(next.model, unknowns[static_cast<std::size_t>(g)]) += step[g];
        keepInside(next.model);
        system.moveTexels(step, damping, next.x);
        const double nextCost = system.costOf(next);
        if (nextCost < cost) {
          settled = cost - nextCost < kTolerance * (1 + cost);
          next.cost = nextCost;
          state = std::move(next);
          moved = true;
          damping = std::max(0.25 * damping, 1e-6);
          break;
        }
      }
      damping = std::max(damping, 1e-5) * 8;
    }
    ++state.iterations;
    if (options.learnPriors && (iteration >= 2 || !moved)) learnMaterials(state, sample, options.photos);
    if ((!moved || settled) && (!options.learnPriors || iteration > 8)) break;
  }
  guessGains(state.model.rig, options.photos);
}

void restartTexels(JointState& state, const FlashSample& sample, std::span<const char> photos,
                   const JobContext& job, bool otherStarts) {
  std::vector<TexelPrior> priors;
  for (const FlashMaterial& material : state.model.materials)
    priors.push_back({material.mean, material.covariance.llt().solve(TexelMatrix::Identity())});
  tbb::parallel_for(std::size_t{0}, sample.sites.size(), [&](std::size_t s) {
    if (job.cancelled()) return;
    const FlashSite& site = sample.sites[s];
    const TexelPrior& prior = priors[static_cast<std::size_t>(site.material)];
    std::vector<TexelVector> starts;
    if (otherStarts) starts = startsOf(site, prior);
    starts.push_back(state.x[s]);
    double best = 0;
    bool any = false;
    for (const TexelVector& start : starts) {
      const TexelSolution solution = solveTexel(state.model, site, prior, start, 12, photos);
      if (!solution.finite || (any && solution.cost >= best)) continue;
      any = true, best = solution.cost;
      state.x[s] = solution.x, state.information[s] = solution.information;
    }
  });
}

namespace {

/// Projects the other unknowns out of a block of the system; scatter over the sample's blocks.
struct Projected {
  Eigen::MatrixXd information;  ///< of the effect, everything else free
  Eigen::MatrixXd scatter;      ///< covariance of the gradient, from blocks
  Eigen::VectorXd gradient;
};

Projected projected(const JointState& state, const FlashSample& sample,
                    const std::vector<FlashUnknown>& others, const std::vector<FlashUnknown>& own,
                    std::span<const char> photos) {
  std::vector<FlashUnknown> unknowns = others;
  unknowns.insert(unknowns.end(), own.begin(), own.end());
  const JointSystem system(state, sample, unknowns, photos);
  const auto n = static_cast<Eigen::Index>(others.size()), m = static_cast<Eigen::Index>(own.size());
  const Eigen::MatrixXd& h = system.shared();
  Projected p;
  const Eigen::MatrixXd part =
      n > 0 ? Eigen::MatrixXd(h.topLeftCorner(n, n).ldlt().solve(h.topRightCorner(n, m)))
            : Eigen::MatrixXd(0, m);
  p.information = h.bottomRightCorner(m, m) - h.bottomLeftCorner(m, n) * part;
  const Eigen::MatrixXd& blocks = system.blockGradients();  // unknowns x blocks
  const Eigen::MatrixXd own_ = blocks.bottomRows(m) - part.transpose() * blocks.topRows(n);
  p.gradient = own_.rowwise().sum();
  const Eigen::VectorXd mean = p.gradient / static_cast<double>(own_.cols());
  const Eigen::MatrixXd centred = own_.colwise() - mean;
  const auto count = static_cast<double>(own_.cols());
  p.scatter = centred * centred.transpose() * (count / std::max(count - 1, 1.0));
  return p;
}

}  // namespace

EffectScore scoreEffect(const JointState& state, const FlashSample& sample, const FlashCapture& capture,
                        const std::vector<FlashEffect>& active, FlashEffect candidate,
                        std::span<const char> photos) {
  EffectScore score;
  const std::vector<FlashUnknown> own = effectUnknowns(candidate, state.model, capture, photos);
  if (own.empty()) return score;
  const Projected p =
      projected(state, sample, allUnknowns(state.model, capture, active, photos), own, photos);
  Eigen::MatrixXd prior = Eigen::MatrixXd::Zero(p.information.rows(), p.information.rows());
  for (std::size_t i = 0; i < own.size(); ++i)
    prior(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(i)) = 1 / (own[i].priorSd * own[i].priorSd);
  // The prior is part of the system's matrix already; without it only what was measured counts.
  score.step = -p.information.ldlt().solve(p.gradient);
  score.sd = p.information.ldlt()
                 .solve(Eigen::MatrixXd::Identity(prior.rows(), prior.rows()))
                 .diagonal()
                 .cwiseMax(0)
                 .cwiseSqrt();
  // Directions that the photographs hardly determine are left out: their scatter is rounding. In units of the
  // prior, so that unknowns can be compared.
  const Eigen::VectorXd scale = prior.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd scatter = scale.asDiagonal() * p.scatter * scale.asDiagonal();
  const Eigen::VectorXd gradient = scale.asDiagonal() * p.gradient;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scatter);
  const double largest = eigen.eigenvalues().maxCoeff();
  const auto blocks = static_cast<double>(sample.blocks);
  // A covariance from so many blocks has about a third as many trustworthy directions.
  const int most = std::max(1, sample.blocks / 4);
  for (Eigen::Index i = eigen.eigenvalues().size() - 1; i >= 0; --i) {
    const double value = eigen.eigenvalues()[i];
    if (!(value > 1e-9 * largest) || score.freedom >= most) break;
    const double along = eigen.eigenvectors().col(i).dot(gradient);
    score.chi2 += along * along / value;
    ++score.freedom;
  }
  // Hotelling: the scatter was measured too.
  if (blocks > score.freedom + 1) score.chi2 *= (blocks - score.freedom) / (blocks - 1);
  score.probability = chiSquareTail(score.chi2, std::max(score.freedom, 1));
  score.sigmas = sigmasOf(score.probability);
  return score;
}

Eigen::VectorXd unknownSd(const JointState& state, const FlashSample& sample, const FlashCapture& capture,
                          const std::vector<FlashEffect>& active, FlashEffect effect,
                          std::span<const char> photos) {
  std::vector<FlashEffect> rest;
  for (const FlashEffect other : active)
    if (other != effect) rest.push_back(other);
  const std::vector<FlashUnknown> own = effectUnknowns(effect, state.model, capture, photos);
  const Projected p = projected(state, sample, allUnknowns(state.model, capture, rest, photos), own, photos);
  const auto solver = p.information.ldlt();
  // Sandwich: information^-1 scatter information^-1.
  const Eigen::MatrixXd half = solver.solve(p.scatter);
  return solver.solve(half.transpose()).diagonal().cwiseMax(0).cwiseSqrt();
}

MapShift shiftOf(const JointState& state, const FlashSample& sample, const FlashCapture& capture,
                 const std::vector<FlashEffect>& active, FlashEffect effect, const Eigen::VectorXd& amount,
                 std::span<const char> photos) {
  std::vector<FlashUnknown> unknowns = allUnknowns(state.model, capture, active, photos);
  const auto n = static_cast<Eigen::Index>(unknowns.size());
  const std::vector<FlashUnknown> own = effectUnknowns(effect, state.model, capture, photos);
  unknowns.insert(unknowns.end(), own.begin(), own.end());
  const JointSystem system(state, sample, unknowns, photos);
  const Eigen::MatrixXd& h = system.shared();
  Eigen::VectorXd change(n + amount.size());
  change.tail(amount.size()) = amount;
  change.head(n) = -h.topLeftCorner(n, n).ldlt().solve(h.topRightCorner(n, amount.size()) * amount);
  std::vector<double> normal, diffuse, specular;
  for (const TexelVector& x : system.answers(change)) {
    normal.push_back(x.head<2>().norm() * 180 / std::numbers::pi);
    diffuse.push_back(x.segment<3>(2).cwiseAbs().mean());
    specular.push_back(x.segment<3>(5).cwiseAbs().mean());
  }
  const auto median = [](std::vector<double>& values) {
    if (values.empty()) return 0.0;
    const auto half = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), half, values.end());
    return *half;
  };
  MapShift shift;
  shift.normalDeg = median(normal), shift.diffuse = median(diffuse), shift.specular = median(specular);
  for (Eigen::Index i = 0; i < n; ++i)
    if (unknowns[static_cast<std::size_t>(i)].kind == FlashUnknown::Kind::Sigma)
      shift.sigma = std::max(shift.sigma, std::abs(change[i]));
  return shift;
}

double chiSquareTail(double chi2, int freedom) {
  if (!(chi2 > 0)) return 1;
  // Regularised upper incomplete gamma function. Source: Abramowitz and Stegun 6.5.29 and 6.5.31.
  const double a = 0.5 * freedom, x = 0.5 * chi2;
  const double front = std::exp(-x + a * std::log(x) - std::lgamma(a));
  if (x < a + 1) {
    double term = 1 / a, sum = term;
    for (int n = 1; n < 500 && term > 1e-15 * sum; ++n) sum += term *= x / (a + n);
    return std::clamp(1 - front * sum, 0.0, 1.0);
  }
  double b = x + 1 - a, c = 1e300, d = 1 / b, h = d;
  for (int n = 1; n < 500; ++n) {
    const double an = -n * (n - a);
    b += 2;
    d = 1 / (an * d + b), c = b + an / c;
    const double delta = d * c;
    h *= delta;
    if (std::abs(delta - 1) < 1e-14) break;
  }
  return std::clamp(front * h, 0.0, 1.0);
}

double sigmasOf(double probability) {
  if (probability >= 1) return 0;
  double low = 0, high = 40;
  if (probability < 1e-300) return 37;  // beyond what a double holds
  for (int step = 0; step < 60; ++step) {
    const double middle = 0.5 * (low + high);
    (std::erfc(middle / std::numbers::sqrt2) > probability ? low : high) = middle;
  }
  return low;
}

}  // namespace patina
