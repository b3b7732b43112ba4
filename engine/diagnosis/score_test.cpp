#include "engine/diagnosis/score_test.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <mutex>

#include "engine/base/dense.h"

namespace patina {
namespace {

/// Weak knowledge about a site's own parameters: keeps what the photographs can't see from running away.
struct OwnPrior {
  std::array<double, kOwnCount> mean{}, invSd{};
};

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
  if (capture.knownLambertian) {  // a paper whose albedo was entered: nothing but the black level is free
    for (int k = 0; k < kOwnBlack; ++k) set(k, 0, 1e-6);
  }
  return prior;
}

}  // namespace

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
}

namespace {

/// Square roots of a site's weights: fitted rows, or held-out ones.
Eigen::VectorXd rootWeights(const DiagnosisCapture& capture, const DiagnosisSite& site, bool holdout) {
  const std::size_t rows = capture.rowCount();
  Eigen::VectorXd w = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(3 * rows));
  for (std::size_t r = 0; r < rows; ++r)
    if (capture.rows[r].holdout == holdout)
      for (std::size_t c = 0; c < 3; ++c)
        w[static_cast<Eigen::Index>(c * rows + r)] =
            std::sqrt(static_cast<double>(site.robust * site.weight[r * 3 + c]));
  return w;
}

Eigen::VectorXd residualOf(const DiagnosisCapture& capture, const DiagnosisSite& site,
                           const SiteColumns& at) {
  const std::size_t rows = capture.rowCount();
  Eigen::VectorXd r(static_cast<Eigen::Index>(3 * rows));
  for (std::size_t c = 0; c < 3; ++c)
    for (std::size_t i = 0; i < rows; ++i)
      r[static_cast<Eigen::Index>(c * rows + i)] =
          static_cast<double>(site.measured[i * 3 + c]) - at.predicted[i * 3 + c];
  return r;
}

/// Normal matrix of the own parameters with their priors, factored; and the step.
struct OwnSystem {
  Eigen::LLT<Eigen::MatrixXd> llt;
  Eigen::VectorXd rhs;
};

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

}  // namespace

ScoreSums& ScoreSums::operator+=(const ScoreSums& other) {
  if (other.b.size() == 0) return *this;
  if (b.size() == 0) {
    *this = other;
    return *this;
  }
  a += other.a;
  b += other.b;
  held += other.held;
  heldB += other.heldB;
  chi2 += other.chi2;
  heldChi2 += other.heldChi2;
  count += other.count;
  heldCount += other.heldCount;
  return *this;
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
      const Eigen::MatrixXd j = w.asDiagonal() * at.own;
      Eigen::MatrixXd gram = j.transpose() * j;
      gram.diagonal() *= 1 + damping;
      const OwnSystem system = ownSystem(ownPrior(capture, site), gram, j.transpose() * rNow);
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

void ScoreTest::add(DiagnosisCapture& capture, const FourierDiagnosisModel& model,
                    const EffectColumns& columns, const JobContext& job, const WantedColumns& wanted,
                    int materialOffset) {
  columns_ = &columns;
  const int dense = columns.denseCount();
  const std::size_t rows = capture.rowCount();
  std::vector<std::size_t> fitted;
  for (std::size_t r = 0; r < rows; ++r)
    if (!capture.rows[r].holdout) fitted.push_back(r);
  if (materialOffset == 0) fittedRows_ = static_cast<int>(fitted.size());
  const int sparseRows = materialOffset == 0 && wanted.photographs ? fittedRows_ : 0;
  const EffectColumns::Range driftColumns = columns.rangeOf("screen-drift");
  const Eigen::Index sparse = wanted.photographs ? 2 * fittedRows_ : 0, all = dense + sparse;
  perMaterial_.resize(
      std::max(perMaterial_.size(), static_cast<std::size_t>(materialOffset + capture.clusterCount)));

  const std::size_t firstMove = moves_.size();
  moves_.resize(firstMove + capture.sites.size());
  struct Local {
    SiteColumns at;
    std::vector<ScoreSums> sums;
    std::vector<Eigen::MatrixXd> shifts;
  };
  tbb::enumerable_thread_specific<Local> locals;
  tbb::parallel_for(std::size_t{0}, capture.sites.size(), [&](std::size_t i) {
    if (job.cancelled()) return;
    DiagnosisSite& site = capture.sites[i];
    if (!site.usable) return;
    Local& local = locals.local();
    if (local.sums.empty()) {
      local.sums.resize(perMaterial_.size());
      for (auto& s : local.sums) {
        s.a.setZero(all, all);
        s.b.setZero(all);
        s.held.setZero(dense, dense);
        s.heldB.setZero(dense);
      }
    }
    SiteColumns& at = local.at;
    model.evaluate(site, quadrature::kEverything, at, wanted);
    if (materialOffset > 0) at.effect.middleCols(driftColumns.first, driftColumns.count).setZero();
    const Eigen::VectorXd w = rootWeights(capture, site, false), residual = residualOf(capture, site, at);
    Eigen::MatrixXd stacked(static_cast<Eigen::Index>(3 * rows), kOwnCount + dense + 1);
    stacked << at.own, at.effect, residual;
    const Eigen::MatrixXd weighted = w.asDiagonal() * stacked;
    const Eigen::MatrixXd gram = gramOfColumns(weighted);
    if (!gram.allFinite()) return;
    const OwnSystem system = ownSystem(ownPrior(capture, site), gram.topLeftCorner(kOwnCount, kOwnCount),
                                       gram.col(kOwnCount + dense).head(kOwnCount));
    if (system.llt.info() != Eigen::Success) return;
    // The sparse columns: three entries each.
    Eigen::MatrixXd ownSparse = Eigen::MatrixXd::Zero(kOwnCount, sparse),
                    denseSparse = Eigen::MatrixXd::Zero(dense, sparse);
    Eigen::VectorXd sparseR = Eigen::VectorXd::Zero(sparse), gg = Eigen::VectorXd::Zero(sparseRows), oo = gg,
                    go = gg;
    for (int f = 0; f < sparseRows; ++f) {
      const std::size_t r = fitted[static_cast<std::size_t>(f)];
      for (std::size_t c = 0; c < 3; ++c) {
        const Eigen::Index row = static_cast<Eigen::Index>(c * rows + r);
        const double g = w[row] * at.gain(static_cast<Eigen::Index>(r), static_cast<Eigen::Index>(c)),
                     o = w[row] * at.offset(static_cast<Eigen::Index>(r), static_cast<Eigen::Index>(c));
        if (w[row] == 0) continue;
        ownSparse.col(f) += g * weighted.row(row).head(kOwnCount).transpose();
        ownSparse.col(fittedRows_ + f) += o * weighted.row(row).head(kOwnCount).transpose();
        denseSparse.col(f) += g * weighted.row(row).segment(kOwnCount, dense).transpose();
        denseSparse.col(fittedRows_ + f) += o * weighted.row(row).segment(kOwnCount, dense).transpose();
        sparseR[f] += g * weighted(row, kOwnCount + dense);
        sparseR[fittedRows_ + f] += o * weighted(row, kOwnCount + dense);
        gg[f] += g * g;
        oo[f] += o * o;
        go[f] += g * o;
      }
    }
    Eigen::MatrixXd joint(kOwnCount, all);
    joint << gram.block(0, kOwnCount, kOwnCount, dense), ownSparse;
    const Eigen::MatrixXd reduced = system.llt.matrixL().solve(joint);
    const Eigen::VectorXd reducedR = system.llt.matrixL().solve(system.rhs);
    ScoreSums& sums = local.sums[static_cast<std::size_t>(materialOffset + site.cluster)];
    const Eigen::MatrixXd taken = gramOfColumns(reduced);
    sums.a -= taken;
    sums.a.topLeftCorner(dense, dense) += gram.block(kOwnCount, kOwnCount, dense, dense);
    sums.a.topRightCorner(dense, sparse) += denseSparse;
    sums.a.bottomLeftCorner(sparse, dense) += denseSparse.transpose();
    for (int f = 0; f < sparseRows; ++f) {
      sums.a(dense + f, dense + f) += gg[f];
      sums.a(dense + fittedRows_ + f, dense + fittedRows_ + f) += oo[f];
      sums.a(dense + f, dense + fittedRows_ + f) += go[f];
      sums.a(dense + fittedRows_ + f, dense + f) += go[f];
    }
    sums.b.head(dense) += gram.col(kOwnCount + dense).segment(kOwnCount, dense);
    sums.b.tail(sparse) += sparseR;
    sums.b -= reduced.transpose() * reducedR;
    const double used = static_cast<double>((w.array() > 0).count());
    sums.chi2 += gram(kOwnCount + dense, kOwnCount + dense) - reducedR.squaredNorm();
    sums.count += used - static_cast<double>(kOwnCount - 3);
    // What the own parameters do with each column, and what that means for the held-out photographs.
    const Eigen::MatrixXd absorbed = system.llt.matrixU().solve(reduced.leftCols(dense));
    const Eigen::VectorXd moved = system.llt.matrixU().solve(reducedR);
    OwnMove& move = moves_[firstMove + i];
    move.material = materialOffset + site.cluster;
    move.absorbed = system.llt.matrixU().solve(reduced).cast<float>();
    local.shifts.push_back(absorbed);
    const Eigen::VectorXd wh = rootWeights(capture, site, true);
    if ((wh.array() > 0).any()) {
      const Eigen::MatrixXd held = wh.asDiagonal() * (at.effect - at.own * absorbed);
      const Eigen::VectorXd heldR = wh.cwiseProduct(residual - at.own * moved);
      addGramOfColumns(held, sums.held);
      sums.heldB += held.transpose() * heldR;
      sums.heldChi2 += heldR.squaredNorm();
      sums.heldCount += static_cast<double>((wh.array() > 0).count());
    }
  });
  std::vector<Eigen::MatrixXd> shifts;
  for (auto& local : locals) {
    for (std::size_t k = 0; k < local.sums.size(); ++k) {
      local.sums[k].held = local.sums[k].held.selfadjointView<Eigen::Lower>();
      perMaterial_[k] += local.sums[k];
    }
    for (auto& s : local.shifts) shifts.push_back(std::move(s));
  }
  for (auto& sums : perMaterial_) {
    if (sums.b.size() > 0) continue;
    sums.a.setZero(all, all);
    sums.b.setZero(all);
    sums.held.setZero(dense, dense);
    sums.heldB.setZero(dense);
  }
  if (shifts_.size() == 0 && !shifts.empty()) {
    shifts_.resize(kOwnCount, dense);
    std::vector<double> values(shifts.size());
    for (int p = 0; p < kOwnCount; ++p) {
      for (int e = 0; e < dense; ++e) {
        for (std::size_t i = 0; i < shifts.size(); ++i) values[i] = std::abs(shifts[i](p, e));
        std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                         values.end());
        shifts_(p, e) = values[values.size() / 2];
      }
    }
  }
}

Eigen::VectorXd ScoreTest::ownStep(std::size_t site, const std::vector<Number>& numbers,
                                   const Eigen::VectorXd& estimate) const {
  const OwnMove& move = moves_[site];
  if (move.material < 0) return {};
  Eigen::VectorXd out = Eigen::VectorXd::Zero(kOwnCount);
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    const Number& number = numbers[i];
    if (number.material >= 0 && number.material != move.material) continue;
    out -= estimate[static_cast<Eigen::Index>(i)] * move.absorbed.col(number.column).cast<double>();
  }
  return out;
}

ScoreSums ScoreTest::total() const {
  ScoreSums sum;
  for (const auto& part : perMaterial_) sum += part;
  return sum;
}

double ScoreTest::chi2PerCount() const {
  const ScoreSums sum = total();
  return sum.count > 0 ? sum.chi2 / sum.count : 0;
}

std::vector<ScoreTest::Number> ScoreTest::numbers(const std::vector<std::string>& effects) const {
  std::vector<Number> out;
  for (const std::string& effect : effects) {
    if (effect == "flicker" || effect == "ambient-drift") {
      const int first = columns_->denseCount() + (effect == "flicker" ? 0 : fittedRows_);
      for (int f = 0; f < fittedRows_; ++f)
        out.push_back({first + f, -1, effect == "flicker" ? 0.05 : columns_->offsetPrior()});
      continue;
    }
    const EffectColumns::Range range = columns_->rangeOf(effect);
    const int copies = EffectColumns::perMaterial(effect) ? static_cast<int>(perMaterial_.size()) : 1;
    for (int k = 0; k < range.count; ++k)
      for (int m = 0; m < copies; ++m)
        out.push_back({range.first + k, copies > 1 || EffectColumns::perMaterial(effect) ? m : -1,
                       columns_->dense()[static_cast<std::size_t>(range.first + k)].prior});
  }
  return out;
}

void ScoreTest::assemble(const std::vector<Number>& numbers, Eigen::MatrixXd& a, Eigen::VectorXd& b) const {
  const Eigen::Index n = static_cast<Eigen::Index>(numbers.size());
  a.setZero(n, n);
  b.setZero(n);
  for (std::size_t m = 0; m < perMaterial_.size(); ++m) {
    const ScoreSums& sums = perMaterial_[m];
    const auto in = [&](const Number& x) { return x.material < 0 || x.material == static_cast<int>(m); };
    for (Eigen::Index i = 0; i < n; ++i) {
      const Number& x = numbers[static_cast<std::size_t>(i)];
      if (!in(x)) continue;
      b[i] += sums.b[x.column];
      for (Eigen::Index j = 0; j < n; ++j) {
        const Number& y = numbers[static_cast<std::size_t>(j)];
        if (in(y)) a(i, j) += sums.a(x.column, y.column);
      }
    }
  }
}

ScoreResult ScoreTest::solve(const std::vector<std::string>& effects,
                             const std::vector<std::string>& given) const {
  std::vector<std::string> all = given;
  for (const auto& e : effects)
    if (std::ranges::find(all, e) == all.end()) all.push_back(e);
  const auto run = [&](const std::vector<std::string>& which, ScoreResult& out) {
    const std::vector<Number> number = numbers(which);
    out.numbers = static_cast<int>(number.size());
    if (number.empty()) return;
    Eigen::MatrixXd a;
    Eigen::VectorXd b;
    assemble(number, a, b);
    Eigen::MatrixXd withPrior = a;
    double logPrior = 0;
    for (Eigen::Index i = 0; i < b.size(); ++i) {
      const double sd = number[static_cast<std::size_t>(i)].prior;
      withPrior(i, i) += 1 / (sd * sd);
      logPrior += 2 * std::log(sd);
    }
    Eigen::LLT<Eigen::MatrixXd> llt(withPrior);
    if (llt.info() != Eigen::Success) {
      withPrior.diagonal() *= 1 + 1e-6;
      llt.compute(withPrior);
      if (llt.info() != Eigen::Success) return;
    }
    out.estimate = llt.solve(b);
    out.sd = llt.solve(Eigen::MatrixXd::Identity(b.size(), b.size())).diagonal().cwiseMax(0).cwiseSqrt();
    out.gain = 2 * out.estimate.dot(b) - out.estimate.dot(a * out.estimate);
    const double logDet = 2 * llt.matrixLLT().diagonal().array().abs().log().sum();
    out.logEvidence = 0.5 * out.estimate.dot(b) - 0.5 * (logDet + logPrior);
    double heldGain = 0, heldSize = 0;
    for (std::size_t m = 0; m < perMaterial_.size(); ++m) {
      Eigen::VectorXd s = Eigen::VectorXd::Zero(columns_->denseCount());
      for (Eigen::Index i = 0; i < b.size(); ++i) {
        const Number& x = number[static_cast<std::size_t>(i)];
        if (x.column < columns_->denseCount() && (x.material < 0 || x.material == static_cast<int>(m)))
          s[x.column] += out.estimate[i];
      }
      const double size = s.dot(perMaterial_[m].held * s);
      heldGain += 2 * s.dot(perMaterial_[m].heldB) - size;
      heldSize += size;
    }
    out.heldGain = heldGain;
    out.heldSd = 2 * std::sqrt(std::max(heldSize, 0.0));
  };
  ScoreResult whole, base;
  run(all, whole);
  if (given.empty()) return whole;
  run(given, base);
  whole.gain -= base.gain;
  whole.heldGain -= base.heldGain;
  whole.logEvidence -= base.logEvidence;
  whole.numbers -= base.numbers;
  return whole;
}

double ScoreTest::correlation(std::string_view x, std::string_view y) const {
  const std::vector<Number> nx = numbers({std::string(x)}), ny = numbers({std::string(y)});
  std::vector<Number> both = nx;
  both.insert(both.end(), ny.begin(), ny.end());
  Eigen::MatrixXd a;
  Eigen::VectorXd b;
  assemble(both, a, b);
  const Eigen::Index p = static_cast<Eigen::Index>(nx.size()), q = static_cast<Eigen::Index>(ny.size());
  if (p == 0 || q == 0) return 0;
  for (Eigen::Index i = 0; i < p + q; ++i) {
    const double sd = both[static_cast<std::size_t>(i)].prior;
    a(i, i) += 1 / (sd * sd);
  }
  const Eigen::LLT<Eigen::MatrixXd> lx(a.topLeftCorner(p, p)), ly(a.bottomRightCorner(q, q));
  if (lx.info() != Eigen::Success || ly.info() != Eigen::Success) return 0;
  Eigen::MatrixXd c = lx.matrixL().solve(a.topRightCorner(p, q));
  c = ly.matrixL().solve(c.transpose()).transpose();
  return singularValues(c)[0];
}

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
        const double w = site.robust * site.weight[r * 3 + c];
        if (w <= 0) continue;
        const double measured = site.measured[r * 3 + c], gap = measured - l.at.predicted[r * 3 + c],
                     chi2 = w * gap * gap;
        l.e.rowChi2[r] += chi2;
        l.e.rowCount[r] += 1;
        l.rowSignal[r] += measured * measured;
        l.e.rowNoise[r] += 1 / w;
        if (capture.rows[r].holdout) {
          l.e.heldChi2 += chi2;
          l.e.heldCount += 1;
          l.e.heldPatch[patch] += chi2;
          l.heldError += gap * gap;
          l.heldSignal += measured * measured;
          l.heldNoise += 1 / w;
        } else {
          l.e.chi2 += chi2;
          l.e.count += 1;
          l.error += gap * gap;
          l.signal += measured * measured;
          l.noise += 1 / w;
        }
      }
    }
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
  const auto rms = [](double a, double b) { return b > 0 ? std::sqrt(a / b) : -1; };
  out.rms = rms(sum.error, sum.signal);
  out.heldRms = rms(sum.heldError, sum.heldSignal);
  out.floor = rms(sum.noise, sum.signal);
  out.heldFloor = rms(sum.heldNoise, sum.heldSignal);
  return out;
}

}  // namespace patina
