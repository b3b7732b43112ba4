#include "engine/diagnosis/two_shot_search.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "engine/base/dense.h"

namespace patina {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kNever = -std::numeric_limits<double>::infinity();
constexpr int kSteps = 12, kRounds = 5;
/// What the surroundings of a photograph count at most, in independent measurements.
constexpr double kIndependentBlocks = 30;
/// ln odds below which a held-out photograph's own factor is none.
constexpr double kHeldFactorGain = 4;
/// Of the places where a candidate's search may begin, so many are followed.
constexpr std::size_t kStartsFollowed = 2;
/// A search that begins at so many places has several ends near its best one, and so many are looked at.
constexpr std::size_t kManyStarts = 50, kPlacesAround = 4;
/// First step of the search for the deviations' sizes when held-out photographs join.
constexpr double kHeldStep = 0.6;
/// Step of the numerical derivatives, in prior standard deviations.
constexpr double kDifference = 0.02;

/// K^-1 d for the brightness' and the colours' columns of d, n x 3.
MatrixXd whitened(const ConditionedRows& conditioned, const MatrixXd& d) {
  MatrixXd brightness = d.leftCols(1), colour = d.rightCols(2);
  solveLowerInPlace(conditioned.factorBrightness, false, brightness);
  solveLowerInPlace(conditioned.factorColour, false, colour);
  MatrixXd out(d.rows(), 3);
  out.leftCols(1) = brightness, out.rightCols(2) = colour;
  return out;
}

double lnPrior(const TwoShotCandidate& candidate, const VectorXd& at) {
  double sum = 0;
  for (Index i = 0; i < at.size(); ++i) {
    const TwoShotCandidate::Parameter& p = candidate.parameters[i];
    const double z = (at[i] - p.middle) / p.sd;
    sum -= 0.5 * z * z + std::log(p.sd) + 0.5 * std::log(2 * std::numbers::pi);
  }
  return sum;
}

}  // namespace

TwoShotSearch::TwoShotSearch(const TwoShotModel& model, const DiagnosisData& data, const JobContext& job)
    : model_(model), data_(data), job_(job) {
  fitted_ = model.usable(data.fitted);
  held_ = model.usable(data.held);
  all_ = fitted_;
  // Every other row of the held-out photographs says nearly as much, at a third of the cost.
  for (std::size_t i = 0; i < held_.size(); i += 2) all_.push_back(held_[i]);
  accept({});
}

void TwoShotSearch::accept(const TwoShotDeviation& deviation, const BasisDeviation* start) {
  deviation_ = deviation;
  mapped_ = model_.map(fitted_, deviation);
  basis_ = model_.fitDeviation(mapped_, start ? *start : BasisDeviation{}, job_);
  conditioned_ = model_.condition(mapped_, basis_);
  lnAround_ = aroundLn(deviation, nullptr);
  const double ln = conditioned_.lnLikelihood + TwoShotModel::lnPrior(basis_);
  lnHere_ = ln + lnAround_;
  lnHeld_ = heldLn(deviation, basis_, ln);
}

double TwoShotSearch::aroundLn(const TwoShotDeviation& deviation, VectorXd* residuals) const {
  // Only what acts on a photograph as such acts here: not the sample's own pose and surface.
  TwoShotDeviation photographic = deviation;
  photographic.tiltDeg.setZero();
  photographic.heightMm = 0, photographic.lightPerM = 0;
  photographic.retro.reset(), photographic.coat.reset();
  photographic.sheen = photographic.fresnel = 0;
  photographic.tint.setZero(), photographic.stretch.setZero();
  photographic.correction.reset();
  const auto count = static_cast<Index>(data_.surroundings.size());
  VectorXd all(3 * count);
  std::size_t blur = 0;
  for (std::size_t b = 1; b < kBlurPx.size(); ++b)
    if (std::abs(std::log(kBlurPx[b] / deviation.glarePx)) <
        std::abs(std::log(kBlurPx[blur] / deviation.glarePx)))
      blur = b;
  for (Index i = 0; i < count; ++i) {
    const SurroundingBlock& block = data_.surroundings[i];
    PhotoPoint point;
    point.shot = block.shot, point.cornerShare = block.cornerShare, point.exposureS = block.exposureS;
    const Eigen::Array3d expected =
        photographic.seenFromBase(block.white, point, {}) + deviation.glare * block.blurred[blur];
    all.segment<3>(3 * i) = ((block.beside - expected) / block.variance.sqrt()).matrix();
  }
  // Neighbouring blocks share what differs between two photographs of a background.
  std::vector<double> share(data_.shots.size(), 0.0);
  for (const SurroundingBlock& block : data_.surroundings) ++share[block.shot];
  for (double& s : share) s = std::min(1.0, kIndependentBlocks / std::max(s, 1.0));
  double ln = 0;
  // Student's t with 4 degrees of freedom, as weights: a thing that was moved in the background is no effect.
  for (Index i = 0; i < all.size(); ++i) {
    const double square = all[i] * all[i];
    const double counts = share[data_.surroundings[static_cast<std::size_t>(i / 3)].shot] / 3;
    ln -= counts * 2.5 * std::log1p(square / 4);
    all[i] *= std::sqrt(counts * 1.25 / (1 + square / 4));
  }
  if (residuals) *residuals = std::move(all);
  return ln;
}

double TwoShotSearch::heldLn(const TwoShotDeviation& deviation, const BasisDeviation& basis,
                             double fittedLn) const {
  if (held_.empty()) return 0;
  // How far from the basis the material is, by all photographs: bounds that the fitted ones alone give are
  // too tight wherever a held-out photograph looks at what they did not see.
  const MappedRows rows = model_.map(all_, deviation);
  const BasisDeviation found = model_.fitDeviation(rows, basis, job_, kHeldStep);
  return model_.condition(rows, found).lnLikelihood + TwoShotModel::lnPrior(found) - fittedLn;
}

std::vector<MatrixXd> TwoShotSearch::derivatives(const TwoShotCandidate& candidate,
                                                 const VectorXd& at) const {
  TwoShotDeviation here = deviation_;
  candidate.apply(at, here);
  const MappedRows rows = model_.map(fitted_, here, &mapped_);
  MatrixXd own;
  std::vector<MatrixXd> out;
  for (Index p = 0; p < at.size(); ++p) {
    const double step = kDifference * candidate.parameters[static_cast<std::size_t>(p)].sd;
    VectorXd moved = at;
    moved[p] += step;
    TwoShotDeviation there = deviation_;
    candidate.apply(moved, there);
    const MappedRows other = model_.map(fitted_, there, &rows);
    MatrixXd change = other.value - rows.value;
    if (!other.anglesTakenOver) {
      if (own.size() == 0) own = model_.predict(mapped_, conditioned_, rows, basis_);
      change -= model_.predict(mapped_, conditioned_, other, basis_) - own;
    }
    out.push_back(-change / step);
  }
  return out;
}

TwoShotSearch::Score TwoShotSearch::score(const TwoShotCandidate& candidate) const {
  Score out;
  const VectorXd& zero = candidate.starts.front();
  const Index count = zero.size();
  const std::vector<MatrixXd> columns = derivatives(candidate, zero);
  VectorXd gradient(count), around;
  aroundLn(deviation_, &around);
  MatrixXd white(3 * mapped_.size(), count), aroundChange(around.size(), count);
  out.absorbed = VectorXd::Zero(count);
  for (Index p = 0; p < count; ++p) {
    const MatrixXd& column = columns[static_cast<std::size_t>(p)];
    gradient[p] = (column.array() * conditioned_.solved.array()).sum();
    const MatrixXd half = whitened(conditioned_, column);
    white.col(p) = half.reshaped();
    // What is no noise is material: K_m K^-1 d = d - N K^-1 d.
    MatrixXd brightness = half.leftCols(1), colour = half.rightCols(2);
    solveLowerInPlace(conditioned_.factorBrightness, true, brightness);
    solveLowerInPlace(conditioned_.factorColour, true, colour);
    MatrixXd taken = column;
    const auto grain = [&](Index part, double size) {
      return (size * mapped_.unlike.col(part).array()).square();
    };
    taken.leftCols(1) -=
        ((mapped_.noise.col(0).array() + grain(0, basis_.brightness.grain)) * brightness.col(0).array())
            .matrix();
    for (int c = 0; c < 2; ++c)
      taken.col(c + 1) -=
          ((mapped_.noise.col(c + 1).array() + grain(1, basis_.colour.grain)) * colour.col(c).array())
              .matrix();
    out.absorbed[p] =
        std::sqrt(taken.squaredNorm() / static_cast<double>(std::max<Index>(1, 3 * taken.rows())));
    VectorXd moved = zero, aroundThere;
    const double step = kDifference * candidate.parameters[static_cast<std::size_t>(p)].sd;
    moved[p] += step;
    TwoShotDeviation there = deviation_;
    candidate.apply(moved, there);
    aroundLn(there, &aroundThere);
    aroundChange.col(p) = (around - aroundThere) / step;
  }
  gradient += aroundChange.transpose() * around;
  MatrixXd information = white.transpose() * white + aroundChange.transpose() * aroundChange;
  // A parameter that nothing sees is known by its prior a hundred times over: finite, and plainly unseen.
  for (Index p = 0; p < count; ++p) {
    const double sd = 100 * candidate.parameters[static_cast<std::size_t>(p)].sd;
    information(p, p) += 1 / (sd * sd);
  }
  const MatrixXd covariance = information.ldlt().solve(MatrixXd::Identity(count, count));
  out.sd = covariance.diagonal().cwiseMax(0).cwiseSqrt();
  out.chiSquared = std::max(gradient.dot(covariance * gradient), 0.0);
  out.correctedP = chiSquaredTail(out.chiSquared, static_cast<int>(count));
  return out;
}

double chiSquaredTail(double value, int degrees) {
  // Q(n / 2, x / 2) by its recursion from erfc or exp.
  const double x = std::max(value, 0.0) / 2;
  double q = degrees % 2 == 1 ? std::erfc(std::sqrt(x)) : std::exp(-x);
  double a = degrees % 2 == 1 ? 0.5 : 1.0;
  for (; a + 0.5 < degrees / 2.0; ++a)
    q += std::exp(a * std::log(std::max(x, 1e-300)) - x - std::lgamma(a + 1));
  return std::clamp(q, 0.0, 1.0);
}

MatrixXd TwoShotSearch::residual() const {
  return mapped_.value - model_.predict(mapped_, conditioned_, mapped_, basis_);
}

TrialOutcome TwoShotSearch::from(const TwoShotCandidate& candidate, const VectorXd& start,
                                 BasisDeviation basis, int rounds) const {
  TrialOutcome outcome;
  VectorXd at = start;
  const Index count = at.size();
  struct Here {
    TwoShotDeviation deviation;
    MappedRows rows;
    ConditionedRows conditioned;
    double around = 0, value = kNever;
  };
  const auto look = [&](const VectorXd& where, const MappedRows* like) {
    Here here;
    here.deviation = deviation_;
    candidate.apply(where, here.deviation);
    here.rows = model_.map(fitted_, here.deviation, like);
    here.conditioned = model_.condition(here.rows, basis);
    here.around = aroundLn(here.deviation, nullptr);
    here.value = here.conditioned.lnLikelihood + here.around + lnPrior(candidate, where);
    if (!std::isfinite(here.value)) here.value = kNever;
    return here;
  };
  Here here = look(at, &mapped_);
  if (here.value == kNever) return outcome;
  MatrixXd information(count, count);
  const auto newton = [&](int steps, bool first) {
    for (int step = 0; step < steps && !job_.cancelled(); ++step) {
      MatrixXd own;
      VectorXd gradient(count), around;
      aroundLn(here.deviation, &around);
      MatrixXd white(3 * here.rows.size(), count), aroundChange(around.size(), count);
      for (Index p = 0; p < count; ++p) {
        const double size = kDifference * candidate.parameters[p].sd;
        VectorXd moved = at;
        moved[p] += size;
        TwoShotDeviation there = deviation_;
        candidate.apply(moved, there);
        const MappedRows other = model_.map(fitted_, there, &here.rows);
        MatrixXd change = other.value - here.rows.value;
        if (!other.anglesTakenOver) {
          if (own.size() == 0) own = model_.predict(here.rows, here.conditioned, here.rows, basis);
          change -= model_.predict(here.rows, here.conditioned, other, basis) - own;
        }
        change /= -size;
        // A lobe's own uncertainty grows with it: what that does to the likelihood is no part of the
        // residual.
        gradient[p] =
            candidate.linear
                ? (change.array() * here.conditioned.solved.array()).sum() +
                      (other.lnJacobian - here.rows.lnJacobian) / size
                : (model_.condition(other, basis).lnLikelihood - here.conditioned.lnLikelihood) / size;
        white.col(p) = whitened(here.conditioned, change).reshaped();
        VectorXd aroundThere;
        aroundLn(there, &aroundThere);
        aroundChange.col(p) = (around - aroundThere) / size;
      }
      gradient += aroundChange.transpose() * around;
      information = white.transpose() * white + aroundChange.transpose() * aroundChange;
      if (first && step == 0 && candidate.linear && at == candidate.starts.front()) {
        MatrixXd stable = information;
        for (Index p = 0; p < count; ++p)
          stable(p, p) += 1e-6 / (candidate.parameters[p].sd * candidate.parameters[p].sd);
        outcome.score = gradient.dot(stable.ldlt().solve(gradient));
      }
      for (Index p = 0; p < count; ++p) {
        const double precision = 1 / (candidate.parameters[p].sd * candidate.parameters[p].sd);
        information(p, p) += precision;
        gradient[p] -= precision * (at[p] - candidate.parameters[p].middle);
      }
      VectorXd move = information.ldlt().solve(gradient);
      for (Index p = 0; p < count; ++p)  // a step beyond the prior's own width is a guess
        move[p] = std::clamp(move[p], -1.5 * candidate.parameters[p].sd, 1.5 * candidate.parameters[p].sd);
      bool better = false;
      for (double share = 1; share > 0.05 && !better; share /= 3) {
        Here there = look(at + share * move, &here.rows);
        if (there.value > here.value) {
          better = there.value > here.value + 0.02;
          at += share * move;
          here = std::move(there);
          if (!better) return;
        }
      }
      if (!better) return;
    }
  };
  newton(kSteps, true);
  // The better the effect is met, the nearer the material seems to the basis, and the sharper the next round
  // looks.
  for (int round = 0; round < rounds && !job_.cancelled(); ++round) {
    const double before = here.value + TwoShotModel::lnPrior(basis);
    basis = model_.fitDeviation(here.rows, basis, job_);
    here = look(at, &here.rows);
    newton(kSteps, false);
    if (here.value + TwoShotModel::lnPrior(basis) < before + 0.5) break;
  }
  if (here.value == kNever) return outcome;

  outcome.tried = true;
  outcome.value = at;
  outcome.deviation = here.deviation;
  outcome.basis = basis;
  const MatrixXd covariance = information.ldlt().solve(MatrixXd::Identity(count, count));
  outcome.sd = covariance.diagonal().cwiseMax(0).cwiseSqrt();
  const VectorXd pivots = information.ldlt().vectorD().cwiseMax(1e-12);
  // Laplace: the parameters' own uncertainty counts, so that a way with more of them has to earn them.
  outcome.lnEvidence = here.value + TwoShotModel::lnPrior(basis) - 0.5 * pivots.array().log().sum() +
                       0.5 * static_cast<double>(count) * std::log(2 * std::numbers::pi) - lnHere_;
  outcome.lnAround = here.around - lnAround_;
  if (rounds > 0)
    outcome.lnHeld =
        heldLn(here.deviation, basis, here.conditioned.lnLikelihood + TwoShotModel::lnPrior(basis)) - lnHeld_;
  // A factorisation that failed says nothing for the effect.
  if (!std::isfinite(outcome.lnHeld)) outcome.lnHeld = -1e6;
  if (!std::isfinite(outcome.lnEvidence)) outcome.lnEvidence = -1e6;
  outcome.reach = std::sqrt((here.rows.value - mapped_.value).squaredNorm() /
                            static_cast<double>(std::max<Index>(1, 3 * here.rows.size())));
  return outcome;
}

TrialOutcome TwoShotSearch::look(const TwoShotCandidate& candidate) const {
  // The material may seem far from the basis only because the effect was not in the model: so also as near as
  // materials mostly are.
  TrialOutcome best;
  for (const bool near : {false, true}) {
    const BasisDeviation basis = near ? BasisDeviation{} : basis_;
    std::vector<std::pair<double, std::size_t>> order;
    for (std::size_t i = 0; i < candidate.starts.size(); ++i) {
      if (job_.cancelled() || candidate.starts.size() == 1) break;
      TwoShotDeviation there = deviation_;
      candidate.apply(candidate.starts[i], there);
      const double value = model_.condition(model_.map(fitted_, there, &mapped_), basis).lnLikelihood +
                           aroundLn(there, nullptr) + lnPrior(candidate, candidate.starts[i]);
      if (std::isfinite(value)) order.emplace_back(-value, i);
    }
    if (near && candidate.starts.size() == 1) break;
    std::sort(order.begin(), order.end());
    if (order.empty()) order.emplace_back(0, 0);
    for (std::size_t k = 0; k < std::min(order.size(), kStartsFollowed); ++k) {
      TrialOutcome outcome = from(candidate, candidate.starts[order[k].second], basis, 0);
      const double score = std::max(best.score, outcome.score);
      if (outcome.tried && (!best.tried || outcome.lnEvidence > best.lnEvidence)) best = std::move(outcome);
      best.score = score;
    }
  }
  return best;
}

TrialOutcome TwoShotSearch::refine(const TwoShotCandidate& candidate, const TrialOutcome& start) const {
  TrialOutcome outcome = from(candidate, start.value, start.basis, kRounds);
  // A highlight that moves over few pictures has several places that fit as well: the held-out photographs
  // tell them apart.
  if (candidate.starts.size() >= kManyStarts) {
    std::vector<VectorXd> around = candidate.starts;
    std::ranges::sort(around, {}, [&](const VectorXd& place) { return (place - start.value).squaredNorm(); });
    around.resize(kPlacesAround);
    for (const VectorXd& place : around) {
      if (job_.cancelled()) break;
      TrialOutcome other = from(candidate, place, outcome.basis, kRounds);
      if (other.tried && other.lnEvidence + other.lnHeld > outcome.lnEvidence + outcome.lnHeld)
        outcome = std::move(other);
    }
  }
  outcome.score = start.score;
  return outcome;
}

TrialOutcome TwoShotSearch::heldFactors(const TwoShotCandidate& candidate) const {
  TrialOutcome outcome;
  const Index count = static_cast<Index>(candidate.parameters.size());
  struct One {
    Index parameter = 0;
    double ln = 0, sd = 0, gain = 0;
  };
  std::vector<One> found;
  std::vector<std::size_t> shots;
  for (std::size_t s = 0; s < data_.shots.size(); ++s)
    if (data_.shots[s].used && data_.shots[s].holdout) shots.push_back(s);
  std::size_t all = 0;
  for (const DiagnosisShot& shot : data_.shots) all += shot.used;
  for (Index p = 0; p < count && !job_.cancelled(); ++p) {
    std::vector<DiagnosisRow> rows;
    for (const DiagnosisRow& row : held_)
      if (row.point.shot == shots[static_cast<std::size_t>(p)]) rows.push_back(row);
    if (rows.size() < 10) continue;
    const MappedRows there = model_.map(rows, deviation_);
    const VectorXd residual =
        there.value.col(0) - model_.predict(mapped_, conditioned_, there, basis_).col(0);
    MatrixXd covariance = model_.predictedCovariance(mapped_, conditioned_, there, basis_);
    if (!choleskyInPlace(covariance)) continue;
    // What a factor does to the logarithm: sqrt 3 (three channels alike) where the material isn't black.
    MatrixXd both(there.size(), 2);
    both.col(0).setConstant(std::sqrt(3.0)), both.col(1) = residual;
    solveLowerInPlace(covariance, false, both);
    const double prior = candidate.parameters[static_cast<std::size_t>(p)].sd;
    const double precision = both.col(0).squaredNorm() + 1 / (prior * prior);
    One one;
    one.parameter = p;
    one.ln = both.col(0).dot(both.col(1)) / precision;
    one.sd = 1 / std::sqrt(precision);
    one.gain = 0.5 * one.ln * one.ln * precision - 0.5 * std::log(precision * prior * prior);
    if (one.gain > kHeldFactorGain && std::abs(one.ln) > candidate.least) found.push_back(one);
  }
  if (found.empty() || 3 * found.size() > all) return outcome;
  outcome.value = VectorXd::Zero(count), outcome.sd = VectorXd::Zero(count);
  for (const One& one : found) {
    outcome.value[one.parameter] = one.ln, outcome.sd[one.parameter] = one.sd;
    outcome.lnHeld += one.gain;
    outcome.reach = std::max(outcome.reach, std::abs(one.ln));
  }
  outcome.tried = true;
  outcome.basis = basis_;
  outcome.deviation = deviation_;
  candidate.apply(outcome.value, outcome.deviation);
  outcome.lnAround = aroundLn(outcome.deviation, nullptr) - lnAround_;
  return outcome;
}

}  // namespace patina
