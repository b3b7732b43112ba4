#include "engine/diagnosis/score_test.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <tuple>

#include "engine/base/dense.h"
#include "engine/diagnosis/residual_components.h"
#include "engine/diagnosis/site_fit.h"

namespace patina {

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

namespace {

/// Products of the columns that act on one photograph each (a factor, then an offset for every fitted one)
/// with a site's other columns and with each other. Photographs of one frequency share components.
struct SparseProducts {
  Eigen::MatrixXd cross;  ///< columns of `weighted` x sparse
  std::vector<std::tuple<Eigen::Index, Eigen::Index, double>> among;
};

/// `used`: photographs with columns of their own, 0 or all of `fitted`; `sparse`: columns of the result.
SparseProducts sparseProducts(const DiagnosisCapture& capture, const std::vector<std::size_t>& fitted,
                              int used, Eigen::Index sparse, const Eigen::VectorXd& w, const SiteColumns& at,
                              const Eigen::MatrixXd& weighted) {
  const std::size_t rows = capture.rowCount();
  const Eigen::Index offsets = sparse / 2;
  SparseProducts out;
  out.cross = Eigen::MatrixXd::Zero(weighted.cols(), sparse);
  const auto count = static_cast<std::size_t>(used);
  for (std::size_t first = 0; first < count;) {
    std::size_t last = first + 1;  // those of one frequency lie together
    while (last < count && capture.rows[fitted[last]].frequency >= 0 && fitted[last] / 4 == fitted[first] / 4)
      ++last;
    const std::size_t base =
        capture.rows[fitted[first]].frequency < 0 ? fitted[first] : fitted[first] / 4 * 4;
    const std::size_t height = capture.rows[fitted[first]].frequency < 0 ? 1 : 4;
    const Eigen::Index photos = static_cast<Eigen::Index>(last - first);
    Eigen::MatrixXd own = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(3 * height), 2 * photos);
    Eigen::MatrixXd others(static_cast<Eigen::Index>(3 * height), weighted.cols());
    for (std::size_t c = 0; c < 3; ++c)
      others.middleRows(static_cast<Eigen::Index>(c * height), static_cast<Eigen::Index>(height)) =
          weighted.middleRows(static_cast<Eigen::Index>(c * rows + base), static_cast<Eigen::Index>(height));
    for (std::size_t f = first; f < last; ++f) {
      const ComponentShare share = componentsOf(capture, fitted[f]);
      const auto photo = static_cast<Eigen::Index>(f - first);
      const auto r = static_cast<Eigen::Index>(fitted[f]);
      for (Eigen::Index c = 0; c < 3; ++c) {
        for (int k = 0; k < share.count; ++k) {
          const double root =
              w[c * static_cast<Eigen::Index>(rows) + static_cast<Eigen::Index>(share.row[k])];
          const Eigen::Index row =
              c * static_cast<Eigen::Index>(height) + static_cast<Eigen::Index>(share.row[k] - base);
          own(row, photo) = root * share.share[k] * at.gain(r, c);
          own(row, photos + photo) = root * share.share[k] * at.offset(r, c);
        }
      }
    }
    const Eigen::MatrixXd cross = others.transpose() * own, among = own.transpose() * own;
    const auto place = [&](Eigen::Index k) {
      return static_cast<Eigen::Index>(first) + (k < photos ? k : k - photos + offsets);
    };
    for (Eigen::Index k = 0; k < 2 * photos; ++k) {
      out.cross.col(place(k)) = cross.col(k);
      for (Eigen::Index j = 0; j < 2 * photos; ++j)
        if (among(j, k) != 0) out.among.emplace_back(place(j), place(k), among(j, k));
    }
    first = last;
  }
  return out;
}

}  // namespace

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
    turnToComponents(capture, stacked.leftCols(kOwnCount + dense));  // the residual is turned already
    const Eigen::MatrixXd weighted = w.asDiagonal() * stacked;
    const Eigen::MatrixXd gram = gramOfColumns(weighted);
    if (!gram.allFinite()) return;
    const OwnSystem system = boundedSystem(capture, site, gram.topLeftCorner(kOwnCount, kOwnCount),
                                           gram.col(kOwnCount + dense).head(kOwnCount));
    if (system.llt.info() != Eigen::Success) return;
    const SparseProducts photographs = sparseProducts(capture, fitted, sparseRows, sparse, w, at, weighted);
    Eigen::MatrixXd joint(kOwnCount, all);
    joint << gram.block(0, kOwnCount, kOwnCount, dense), photographs.cross.topRows(kOwnCount);
    const Eigen::MatrixXd reduced = system.llt.matrixL().solve(joint);
    const Eigen::VectorXd reducedR = system.llt.matrixL().solve(system.rhs);
    ScoreSums& sums = local.sums[static_cast<std::size_t>(materialOffset + site.cluster)];
    const Eigen::MatrixXd taken = gramOfColumns(reduced);
    sums.a -= taken;
    sums.a.topLeftCorner(dense, dense) += gram.block(kOwnCount, kOwnCount, dense, dense);
    const auto denseSparse = photographs.cross.middleRows(kOwnCount, dense);
    sums.a.topRightCorner(dense, sparse) += denseSparse;
    sums.a.bottomLeftCorner(sparse, dense) += denseSparse.transpose();
    for (const auto& [row, column, value] : photographs.among) sums.a(dense + row, dense + column) += value;
    sums.b.head(dense) += gram.col(kOwnCount + dense).segment(kOwnCount, dense);
    sums.b.tail(sparse) += photographs.cross.row(kOwnCount + dense).transpose();
    sums.b -= reduced.transpose() * reducedR;
    const double used = static_cast<double>((w.array() > 0).count());
    sums.chi2 += gram(kOwnCount + dense, kOwnCount + dense) - reducedR.squaredNorm();
    // Black levels have their own measurement.
    sums.count += used - (kOwnBlack + (site.ownHorizon ? 1 : 0) + (site.ownStretch ? 2 : 0));
    // What the own parameters do with each column, and what that means for the held-out photographs.
    const Eigen::MatrixXd absorbed = system.llt.matrixU().solve(reduced.leftCols(dense));
    const Eigen::VectorXd moved = system.llt.matrixU().solve(reducedR);
    OwnMove& move = moves_[firstMove + i];
    move.material = materialOffset + site.cluster;
    move.absorbed = system.llt.matrixU().solve(reduced).cast<float>();
    local.shifts.push_back(absorbed);
    const Eigen::VectorXd wh = rootWeights(capture, site, true);
    if ((wh.array() > 0).any()) {
      const auto own = stacked.leftCols(kOwnCount), effect = stacked.middleCols(kOwnCount, dense);
      const Eigen::MatrixXd held = wh.asDiagonal() * (effect - own * absorbed);
      const Eigen::VectorXd heldR = wh.cwiseProduct(residual - own * moved);
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

}  // namespace patina
