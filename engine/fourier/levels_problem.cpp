#include "engine/fourier/levels_problem.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>

namespace patina {
namespace {

constexpr std::size_t kBatch = 64;  // texels a task: whole SIMD batches

constexpr double kCurlSigma = 0.01;     // App. E
constexpr double kFirstDimension = 32;  // the priors' full strength; see `LevelProblem::LevelProblem`

// Least change of an albedo from texel to texel that its smoothness weight assumes: where the photograph is
// flat, App. E's reciprocal would be infinite. The bound gives albedos the curl prior's weight of 100.
constexpr double kLeastAlbedoStep = 0.005;

const LobeParameters kFirstLobe{std::log(0.03f), std::log(0.03f), 0, 0};  // App. D

std::vector<std::uint32_t> measuredTexels(const LevelData& level) {
  std::vector<std::uint32_t> out;
  for (std::uint32_t t = 0; t < level.size(); ++t)
    if (level.siteCount[t] > 0) out.push_back(t);
  return out;
}

enum Column { kD, kS, kDx, kDy, kSl, kSk, kSx, kSy };  // of `modelColumns`

}  // namespace

LevelProblem::LevelProblem(const FourierFitState& state, const SolverSetup& setup, const LevelData& data)
    : setup_(setup),
      level_(data),
      texels_(measuredTexels(data)),
      tile_(state, MirrorPhase(state), data, texels_),
      rows_(2 * data.frequencyCount + 1) {
  // App. E relaxes the spatial priors "by the factor 32^w where w is the image dimension", which can only
  // grow with w and overflows. Read as 32 / w: full strength at the first level, half of it at the second.
  relaxation_ = kFirstDimension / std::max({data.width, data.height, static_cast<int>(kFirstDimension)});
  curlWeight_ = relaxation_ / kCurlSigma;
  const FourierPriors& p = setup.priors;
  const double mean[kUnknowns] = {p.logSigmaMean, p.logKurtosisMean, 0, 0, 0, 0, 0, 0, 0, 0};
  const double sigma[kUnknowns] = {p.logSigmaSigma, p.logKurtosisSigma, p.normalSigma,  p.normalSigma,
                                   p.diffuseSigma,  p.diffuseSigma,     p.diffuseSigma, p.specularSigma,
                                   p.specularSigma, p.specularSigma};
  for (int k = 0; k < kUnknowns; ++k) priorMean_[k] = mean[k], priorWeight_[k] = 1 / sigma[k];

  scale_.resize(size() * measurementCount());
  tbb::parallel_for(std::size_t{0}, size(), [&](std::size_t i) {
    std::vector<float> weights(measurementCount());
    texelWeights(state, data, texels_[i], weights.data());
    for (int row = 0; row < rows_; ++row)
      for (int c = 0; c < 3; ++c) scale_[(i * 3 + c) * rows_ + row] = std::sqrt(weights[row * 3 + c]);
  });
  buildLinks(state);
}

void LevelProblem::buildLinks(const FourierFitState& state) {
  // Section 7.1, App. E: the zero frequency over what a perfectly diffuse, a perfectly specular texel would
  // give; its differences bound those of the albedos.
  std::vector<std::array<double, 6>> image(size());
  std::vector<std::array<double, 6>> noise(size());
  tbb::parallel_for(std::size_t{0}, (size() + kBatch - 1) / kBatch, [&](std::size_t batch) {
    const std::size_t first = batch * kBatch, count = std::min(kBatch, size() - first);
    const std::vector<LobeParameters> lobe(count, kFirstLobe);
    std::vector<float> columns(count * rows_ * kModelColumns);
    modelColumns(setup_, {sites().data() + first, count}, lobe, columns.data());
    for (std::size_t i = 0; i < count; ++i) {
      const float* last = columns.data() + (i * rows_ + rows_ - 1) * kModelColumns;
      const std::uint32_t t = texels_[first + i];
      for (int k = 0; k < 6; ++k) {
        // Where the mirror point leaves the screen, a mirror would show nothing: the diffuse prediction's
        // hundredth keeps the quotient finite, and the weight small.
        const double prediction = std::max<double>(last[k < 3 ? kD : kS], 0.01 * std::abs(last[kD]) + 1e-12);
        image[first + i][k] = level_.dc[t * 3 + k % 3] / prediction;
        const double variance = level_.siteDcVariance[t * 3 + k % 3] / level_.siteCount[t];
        noise[first + i][k] = std::sqrt(std::max(variance, 0.0)) / prediction;
      }
    }
  });
  std::vector<int> indexOf(level_.size(), -1);
  for (std::size_t i = 0; i < size(); ++i) indexOf[texels_[i]] = static_cast<int>(i);
  links_.resize(size());
  const bool byNoise = state.options.weights == MeasurementWeights::Noise;
  for (std::size_t i = 0; i < size(); ++i) {
    const int x = static_cast<int>(texels_[i]) % level_.width,
              y = static_cast<int>(texels_[i]) / level_.width;
    auto neighbour = [&](int dx, int dy) {
      if (x + dx < 0 || y + dy < 0 || x + dx >= level_.width || y + dy >= level_.height) return -1;
      return indexOf[level_.index(x + dx, y + dy)];
    };
    auto edge = [&](int other) {
      Edge out;
      out.neighbour = other;
      if (other < 0) return out;
      out.weight[0] = out.weight[1] = static_cast<float>(relaxation_);  // unit weight: App. E
      for (int k = 0; k < 6; ++k) {
        double step = std::abs(image[i][k] - image[other][k]);
        // A difference of pure noise is no permission to vary.
        if (byNoise) step = std::max(0.0, step - std::hypot(noise[i][k], noise[other][k]));
        out.weight[4 + k] = static_cast<float>(relaxation_ * 0.5 / std::max(step, kLeastAlbedoStep));
      }
      return out;
    };
    links_[i] = {edge(neighbour(1, 0)), edge(neighbour(0, 1)), neighbour(-1, 0), neighbour(0, -1)};
  }
}

void LevelProblem::columns(std::span<const Vector> x, std::size_t first, std::size_t count,
                           float* out) const {
  std::vector<LobeParameters> lobe(count);
  for (std::size_t i = 0; i < count; ++i) {
    const Vector& v = x[first + i];
    lobe[i] = {static_cast<float>(v[0]), static_cast<float>(v[1]), static_cast<float>(v[2]),
               static_cast<float>(v[3])};
  }
  modelColumns(setup_, {sites().data() + first, count}, lobe, out);
}

void LevelProblem::measurementResiduals(std::size_t texel, const Vector& x, const float* columns,
                                        double* residual, double* jacobian) const {
  const SiteData& site = sites()[texel];
  for (int c = 0; c < 3; ++c) {
    const double diffuse = x[4 + c], specular = x[7 + c];
    const float* scale = scale_.data() + (texel * 3 + c) * rows_;
    for (int row = 0; row < rows_; ++row) {
      const float* m = columns + row * kModelColumns;
      const double measured = row + 1 == rows_ ? site.dc[c] : site.z[(row / 2) * 6 + (row % 2) * 3 + c];
      const int at = c * rows_ + row;
      residual[at] = scale[row] * (diffuse * m[kD] + specular * m[kS] - measured);
      if (!jacobian) continue;
      double* j = jacobian + at * kUnknowns;
      std::fill_n(j, kUnknowns, 0.0);
      j[0] = scale[row] * specular * m[kSl];
      j[1] = scale[row] * specular * m[kSk];
      j[2] = scale[row] * (diffuse * m[kDx] + specular * m[kSx]);
      j[3] = scale[row] * (diffuse * m[kDy] + specular * m[kSy]);
      j[4 + c] = scale[row] * m[kD];
      j[7 + c] = scale[row] * m[kS];
    }
  }
}

std::vector<LevelProblem::Vector> LevelProblem::initialGuess() const {
  int nearest = 0;  // App. D's (6, 6), or what the capture has closest to it
  auto gap = [&](int f) { return (setup_.frequency[f].cwiseAbs() - Eigen::Vector2f(6, 6)).norm(); };
  for (int f = 1; f < level_.frequencyCount; ++f)
    if (gap(f) < gap(nearest)) nearest = f;
  Vector first = Vector::Zero();
  first.head<4>() << kFirstLobe.logSigma, kFirstLobe.logKurtosis, 0, 0;
  std::vector<Vector> x(size(), first);
  tbb::parallel_for(std::size_t{0}, (size() + kBatch - 1) / kBatch, [&](std::size_t batch) {
    const std::size_t begin = batch * kBatch, count = std::min(kBatch, size() - begin);
    std::vector<float> column(count * rows_ * kModelColumns);
    columns(x, begin, count, column.data());
    for (std::size_t i = 0; i < count; ++i) {
      const float* m = column.data() + i * rows_ * kModelColumns;
      const SiteData& site = sites()[begin + i];
      const double mirror =
          std::hypot(m[2 * nearest * kModelColumns + kS], m[(2 * nearest + 1) * kModelColumns + kS]);
      const double matte = m[(rows_ - 1) * kModelColumns + kD];
      for (int c = 0; c < 3; ++c) {
        const double high = std::hypot(site.z[nearest * 6 + c], site.z[nearest * 6 + 3 + c]);
        // No more than a perfect mirror or a perfect diffuser: quotients explode where the prediction
        // vanishes.
        x[begin + i][7 + c] = std::min(1.0, high / std::max(mirror, 1e-12));
        x[begin + i][4 + c] = std::clamp((site.dc[c] - high) / std::max(matte, 1e-12), 0.0, 1.0);
      }
    }
  });
  return x;
}

bool LevelProblem::evaluate(std::span<const Vector> x, std::vector<Local>& out, const JobContext& job) const {
  out.resize(size());
  std::atomic<bool> complete{true};
  tbb::parallel_for(std::size_t{0}, (size() + kBatch - 1) / kBatch, [&](std::size_t batch) {
    if (job.cancelled()) {
      complete = false;
      return;
    }
    const std::size_t first = batch * kBatch, count = std::min(kBatch, size() - first);
    std::vector<float> column(count * rows_ * kModelColumns);
    columns(x, first, count, column.data());
    // One channel's derivatives (six of them don't vanish) and residual, one after the other.
    constexpr int kLocal = 7;
    Eigen::Array<float, Eigen::Dynamic, kLocal> j(rows_, kLocal);
    Eigen::Array<float, Eigen::Dynamic, kModelColumns> model(rows_, kModelColumns);
    for (std::size_t i = 0; i < count; ++i) {
      const Vector& v = x[first + i];
      const SiteData& site = sites()[first + i];
      Local& local = out[first + i];
      local.gradient.setZero();
      local.hessian.setZero();
      local.dataCost = 0;
      model = Eigen::Map<const Eigen::Array<float, Eigen::Dynamic, kModelColumns, Eigen::RowMajor>>(
          column.data() + i * rows_ * kModelColumns, rows_, kModelColumns);
      for (int c = 0; c < 3; ++c) {
        const auto diffuse = static_cast<float>(v[4 + c]), specular = static_cast<float>(v[7 + c]);
        const Eigen::Map<const Eigen::ArrayXf> scale(scale_.data() + ((first + i) * 3 + c) * rows_, rows_);
        j.col(0) = scale * (specular * model.col(kSl));
        j.col(1) = scale * (specular * model.col(kSk));
        j.col(2) = scale * (diffuse * model.col(kDx) + specular * model.col(kSx));
        j.col(3) = scale * (diffuse * model.col(kDy) + specular * model.col(kSy));
        j.col(4) = scale * model.col(kD);
        j.col(5) = scale * model.col(kS);
        j.col(6) = diffuse * model.col(kD) + specular * model.col(kS);
        for (int f = 0; f < level_.frequencyCount; ++f) {
          j(2 * f, 6) -= site.z[f * 6 + c];
          j(2 * f + 1, 6) -= site.z[f * 6 + 3 + c];
        }
        j(rows_ - 1, 6) -= site.dc[c];
        j.col(6) *= scale;
        const int unknown[kLocal] = {0, 1, 2, 3, 4 + c, 7 + c, -1};
        for (int a = 0; a < kLocal; ++a) {
          for (int b = a; b < kLocal; ++b) {
            const double product = j.col(a).matrix().dot(j.col(b).matrix());
            if (a == kLocal - 1) {
              local.dataCost += product;
            } else if (b == kLocal - 1) {
              local.gradient[unknown[a]] += product;
            } else {
              local.hessian(unknown[a], unknown[b]) += product;
            }
          }
        }
      }
      local.cost = local.dataCost;
      for (int k = 0; k < kUnknowns; ++k) {
        const double weight = priorWeight_[k] * priorWeight_[k], gap = v[k] - priorMean_[k];
        local.cost += weight * gap * gap;
        local.gradient[k] += weight * gap;
        local.hessian(k, k) += weight;
      }
      local.hessian.triangularView<Eigen::StrictlyLower>() = local.hessian.transpose();
    }
  });
  return complete;
}

double LevelProblem::curl(std::span<const Vector> x, std::size_t texel) const {
  const Links& l = links_[texel];
  if (!l.curl()) return 0;
  // -Dy nx + Dx ny, with y upwards: the texel below is the one before. Slopes are (-dh/dx, -dh/dy).
  const Vector &here = x[texel], &right = x[l.right.neighbour], &below = x[l.below.neighbour];
  return curlWeight_ * (-(here[2] - below[2]) + (right[3] - here[3]));
}

double LevelProblem::couplingCostAt(std::span<const Vector> x, std::size_t texel, const Vector& own) const {
  const Links& l = links_[texel];
  auto square = [&](const Edge& edge, int other) {
    double sum = 0;
    for (int k = 0; k < kUnknowns; ++k) {
      const double r = edge.weight[k] * (own[k] - x[other][k]);
      sum += r * r;
    }
    return sum;
  };
  // A curl is linear: what it is at x, and how far moving this one texel changes it.
  auto curlSquare = [&](std::size_t at, double slopeX, double slopeY) {
    if (!links_[at].curl()) return 0.0;
    const Vector move = own - x[texel];
    return std::pow(curl(x, at) + curlWeight_ * (slopeX * move[2] + slopeY * move[3]), 2);
  };
  double cost = curlSquare(texel, -1, -1);
  if (l.right.neighbour >= 0) cost += square(l.right, l.right.neighbour);
  if (l.below.neighbour >= 0) cost += square(l.below, l.below.neighbour);
  if (l.left >= 0) cost += square(links_[l.left].right, l.left) + curlSquare(l.left, 0, 1);
  if (l.above >= 0) cost += square(links_[l.above].below, l.above) + curlSquare(l.above, 1, 0);
  return cost;
}

double LevelProblem::couplingCost(std::span<const Vector> x) const {
  double cost = 0;
  for (std::size_t i = 0; i < size(); ++i) {
    for (const Edge* edge : {&links_[i].right, &links_[i].below}) {
      if (edge->neighbour < 0) continue;
      for (int k = 0; k < kUnknowns; ++k) {
        const double r = edge->weight[k] * (x[i][k] - x[edge->neighbour][k]);
        cost += r * r;
      }
    }
    cost += std::pow(curl(x, i), 2);
  }
  return cost;
}

void LevelProblem::applyCoupling(std::span<const Vector> x, std::span<Vector> out) const {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, size(), 512), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      const Links& l = links_[i];
      Vector sum = Vector::Zero();
      auto add = [&](const Edge& edge, int other) {
        for (int k = 0; k < kUnknowns; ++k)
          sum[k] += static_cast<double>(edge.weight[k]) * edge.weight[k] * (x[i][k] - x[other][k]);
      };
      if (l.right.neighbour >= 0) add(l.right, l.right.neighbour);
      if (l.below.neighbour >= 0) add(l.below, l.below.neighbour);
      if (l.left >= 0) add(links_[l.left].right, l.left);
      if (l.above >= 0) add(links_[l.above].below, l.above);
      // Derivatives of a curl: here (-1, -1), the texel to its right (0, 1), the one below (1, 0).
      const double own = curlWeight_ * curl(x, i);
      sum[2] -= own;
      sum[3] -= own;
      if (l.left >= 0) sum[3] += curlWeight_ * curl(x, l.left);
      if (l.above >= 0) sum[2] += curlWeight_ * curl(x, l.above);
      out[i] = sum;
    }
  });
}

LevelProblem::Block LevelProblem::couplingBlock(std::size_t texel) const {
  const Links& l = links_[texel];
  Block block = Block::Zero();
  auto add = [&](const Edge& edge) {
    if (edge.neighbour < 0) return;
    for (int k = 0; k < kUnknowns; ++k) block(k, k) += static_cast<double>(edge.weight[k]) * edge.weight[k];
  };
  add(l.right);
  add(l.below);
  if (l.left >= 0) add(links_[l.left].right);
  if (l.above >= 0) add(links_[l.above].below);
  const double square = curlWeight_ * curlWeight_;
  if (l.curl()) {
    block(2, 2) += square;
    block(3, 3) += square;
    block(2, 3) += square;
    block(3, 2) += square;
  }
  if (l.left >= 0 && links_[l.left].curl()) block(3, 3) += square;
  if (l.above >= 0 && links_[l.above].curl()) block(2, 2) += square;
  return block;
}

}  // namespace patina
