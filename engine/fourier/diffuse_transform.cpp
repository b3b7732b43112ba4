#include "engine/fourier/diffuse_transform.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <map>
#include <numbers>

#include "engine/fourier/node_sum.h"

namespace patina {
namespace {

using Complex = std::complex<double>;
constexpr double kHighestFrequency = 48;  // beyond: below 1e-5 of DC for any window that falls off at the rim

/// Gauss-Legendre nodes and weights on [-1, 1] by Newton iteration on the Legendre polynomial.
void gaussLegendre(int count, std::vector<double>& node, std::vector<double>& weight) {
  node.resize(count);
  weight.resize(count);
  for (int i = 0; i < count; ++i) {
    double x = std::cos(std::numbers::pi * (i + 0.75) / (count + 0.5));
    double slope = 1;
    for (int iteration = 0; iteration < 50; ++iteration) {
      double p0 = 1, p1 = x;
      for (int k = 2; k <= count; ++k) {
        const double p2 = ((2 * k - 1) * x * p1 - (k - 1) * p0) / k;
        p0 = p1;
        p1 = p2;
      }
      slope = count * (x * p1 - p0) / (x * x - 1);
      const double step = p1 / slope;
      x -= step;
      if (std::abs(step) < 1e-15) break;
    }
    node[i] = x;
    weight[i] = 2 / ((1 - x * x) * slope * slope);
  }
}

/// App. B: 1 / (r^2 + 1)^2 as a mixture of normalised Gaussians.
constexpr std::array<double, 3> kPaperWeight = {1.0391, 1.5027, 0.4583};
constexpr std::array<double, 3> kPaperSigma = {1.5617, 0.7138, 0.3975};

/// Equation 12 in the screen's frame at one point: sum_k N^(w) (mean - i Sigma w) and sum_k N^(w), frame of
/// `siteGeometry`.
std::array<Complex, 3> paperCoefficients(const SiteGeometry& site, const Eigen::Vector2d& frequency) {
  const double d = site.distance;
  std::array<Complex, 3> v{};
  for (int k = 0; k < 3; ++k) {
    const double lobePrecision = 1 / (d * d * kPaperSigma[k] * kPaperSigma[k]);
    const double light[2] = {site.lightPrecisionX, site.lightPrecisionY};
    const double mean[2] = {site.lightMeanX, site.lightMeanY};
    double mass = kPaperWeight[k] / (d * d) * lobePrecision *
                  site.lightPeak;  // normalised: precision / (2 pi); the 2 pi cancels
    double centre[2], variance[2], decay = 0, phase = 0;
    const double foot[2] = {site.footX, site.footY};
    for (int axis = 0; axis < 2; ++axis) {
      const double precision = lobePrecision + light[axis];
      variance[axis] = 1 / precision;
      centre[axis] = light[axis] * mean[axis] / precision;
      mass *= std::exp(-0.5 * lobePrecision * light[axis] / precision * mean[axis] * mean[axis]) /
              std::sqrt(precision);
      decay += 0.5 * variance[axis] * frequency[axis] * frequency[axis];
      phase += frequency[axis] * (centre[axis] + foot[axis]);
    }
    const Complex value = mass * std::exp(-decay) * std::polar(1.0, -phase) * (d / std::numbers::pi);
    for (int axis = 0; axis < 2; ++axis)
      v[axis] += value * Complex(centre[axis], -variance[axis] * frequency[axis]);
    v[2] -= value * d;
  }
  return v;
}

/// Evaluates the transform at single points; shared tables of quadrature nodes and phases for a set of
/// frequencies.
class PointTransform {
 public:
  PointTransform(const ScreenFrame& frame, const std::vector<Eigen::Vector2d>& frequencies,
                 DiffuseMethod method)
      : frame_(frame), frequencies_(frequencies), method_(method) {
    if (method == DiffuseMethod::PaperMixture) return;
    // Distinct frequencies along each axis, so that the double sum over the screen separates.
    double highest = 0;
    for (const auto& w : frequencies) {
      if (w.cwiseAbs().maxCoeff() > kHighestFrequency) continue;
      highest = std::max(highest, w.cwiseAbs().maxCoeff());
      for (int axis = 0; axis < 2; ++axis) index_[axis].emplace(w[axis], 0);
    }
    // Legendre rules resolve exp(i w x) on [-h, h] with w h / 2 nodes and some for the rest of the integrand.
    for (int axis = 0; axis < 2; ++axis) {
      const double half = frame.halfExtent[axis];
      std::vector<double> weight;
      gaussLegendre(static_cast<int>(std::ceil(highest * half / 2)) + 36, node_[axis], weight);
      phases_[axis].resize(static_cast<Eigen::Index>(index_[axis].size()),
                           static_cast<Eigen::Index>(node_[axis].size()));
      for (auto& x : node_[axis]) x *= half;
      int row = 0;
      for (auto& [w, at] : index_[axis]) {
        at = row;
        for (std::size_t i = 0; i < node_[axis].size(); ++i)
          phases_[axis](row, static_cast<Eigen::Index>(i)) =
              std::polar(weight[i] * half, -w * node_[axis][i]);
        ++row;
      }
    }
  }

  /// out[(f * 3 + axis) * 2 + {re, im}].
  void at(const Eigen::Vector3d& pointMm, float* out) const {
    const SiteGeometry site = siteGeometry(frame_, pointMm, pointMm + Eigen::Vector3d::UnitZ());
    auto put = [&](std::size_t f, int axis, Complex v) {
      out[(f * 3 + axis) * 2] = static_cast<float>(v.real());
      out[(f * 3 + axis) * 2 + 1] = static_cast<float>(v.imag());
    };
    if (method_ == DiffuseMethod::PaperMixture) {
      for (std::size_t f = 0; f < frequencies_.size(); ++f) {
        const auto v = paperCoefficients(site, frequencies_[f]);
        for (int axis = 0; axis < 3; ++axis) put(f, axis, v[axis]);
      }
      return;
    }
    const auto nx = static_cast<Eigen::Index>(node_[0].size()),
               ny = static_cast<Eigen::Index>(node_[1].size());
    Eigen::MatrixXd field[3];
    for (auto& m : field) m.resize(nx, ny);
    const double d = site.distance;
    for (Eigen::Index b = 0; b < ny; ++b) {
      for (Eigen::Index a = 0; a < nx; ++a) {
        const double x = node_[0][a] - site.footX, y = node_[1][b] - site.footY;
        const double lx = x - site.lightMeanX, ly = y - site.lightMeanY;
        const double distance2 = x * x + y * y + d * d;
        double value = d / (std::numbers::pi * distance2 * distance2) * site.lightPeak *
                       std::exp(-0.5 * (site.lightPrecisionX * lx * lx + site.lightPrecisionY * ly * ly));
        if (frame_.logEmission)
          value *= std::exp(frame_.logEmission({node_[0][a], node_[1][b]}, {site.footX, site.footY}, d));
        field[0](a, b) = value * x;
        field[1](a, b) = value * y;
        field[2](a, b) = -value * d;
      }
    }
    for (int axis = 0; axis < 3; ++axis) {
      const Eigen::MatrixXcd spectrum = (phases_[0] * field[axis].cast<Complex>()) * phases_[1].transpose();
      for (std::size_t f = 0; f < frequencies_.size(); ++f) {
        const auto& w = frequencies_[f];
        put(f, axis,
            w.cwiseAbs().maxCoeff() > kHighestFrequency ? Complex(0)
                                                        : spectrum(index_[0].at(w.x()), index_[1].at(w.y())));
      }
    }
  }

 private:
  const ScreenFrame& frame_;
  const std::vector<Eigen::Vector2d>& frequencies_;
  DiffuseMethod method_;
  std::map<double, int> index_[2];
  std::vector<double> node_[2];
  Eigen::MatrixXcd phases_[2];
};

/// Chebyshev's nodes of the first kind, and their weights in barycentric interpolation, for a few counts.
struct ChebyshevNodes {
  static constexpr int kMost = 9;
  double node[kMost + 1][kMost], weight[kMost + 1][kMost];
  ChebyshevNodes() {
    for (int count = 1; count <= kMost; ++count) {
      for (int k = 0; k < count; ++k) {
        const double angle = std::numbers::pi * (k + 0.5) / count;
        node[count][k] = std::cos(angle);
        weight[count][k] = (k % 2 ? -1.0 : 1.0) * std::sin(angle);
      }
    }
  }
};
/// Nodes for a part of the sheet, by its share of the sheet along an axis: fewer where the table's polynomial
/// is all but straight.
int enoughNodes(double share) {
  constexpr struct {
    double share;
    int nodes;
  } kEnough[] = {{0.002, 2}, {0.02, 3}, {0.05, 4}, {0.1, 5}};
  const auto* found = std::ranges::find_if(kEnough, [&](const auto& e) { return share <= e.share; });
  return found == std::end(kEnough) ? ChebyshevNodes::kMost : found->nodes;
}

const ChebyshevNodes& chebyshevNodes() {
  static const ChebyshevNodes nodes;
  return nodes;
}

}  // namespace

DiffuseTransform::DiffuseTransform(const ScreenFrame& frame, Eigen::Vector2d sampleSizeMm,
                                   const std::vector<Eigen::Vector2d>& frequencies, DiffuseMethod method,
                                   const SheetShape& shape)
    : frequencyCount_(static_cast<int>(frequencies.size())), halfSizeMm_(sampleSizeMm / 2) {
  const std::size_t stride = static_cast<std::size_t>(frequencyCount_) * 6;
  std::vector<float> full(static_cast<std::size_t>(kNodes) * kNodes * stride);
  const PointTransform point(frame, frequencies, method);
  const auto node = [&](int i) { return nodeMm(static_cast<std::size_t>(i)); };
  tbb::parallel_for(0, kNodes * kNodes, [&](int i) {
    point.at(shape.pointMm(node(i)), full.data() + static_cast<std::size_t>(i) * stride);
  });
  findKept(full);
  table_ = compacted(full);
  if (!shape.heightMm) return;

  // How far the sheet is from the surface through the nodes' heights.
  heightMm_ = shape.heightMm;
  for (int i = 0; i < kNodes * kNodes; ++i) nodeHeight_.push_back(heightMm_(node(i)));
  constexpr int kProbes = 64;
  double furthest = 0;
  for (int j = 0; j <= kProbes; ++j)
    for (int i = 0; i <= kProbes; ++i)
      furthest = std::max(furthest, std::abs(restMm({(2.0 * i / kProbes - 1) * halfSizeMm_.x(),
                                                     (2.0 * j / kProbes - 1) * halfSizeMm_.y()})));
  // The transform's relative change with height is about one over the distance.
  constexpr double kNegligible = 1e-5;
  const double distanceMm = frame.unitMm * siteGeometry(frame, {0, 0, 0}, shape.cameraMm).distance;
  if (furthest < kNegligible * distanceMm) {
    heightMm_ = {};
    nodeHeight_.clear();
    return;
  }
  const double stepMm = std::max(0.25, furthest);
  std::vector<float> above(full.size()), below(full.size());
  tbb::parallel_for(0, 2 * kNodes * kNodes, [&](int task) {
    const int i = task / 2;
    SheetShape moved = shape;
    moved.heightMm = [&, i](const Eigen::Vector2d&) {
      return nodeHeight_[static_cast<std::size_t>(i)] + (task % 2 == 0 ? stepMm : -stepMm);
    };
    point.at(moved.pointMm(node(i)),
             (task % 2 == 0 ? above : below).data() + static_cast<std::size_t>(i) * stride);
  });
  for (std::size_t i = 0; i < above.size(); ++i)
    above[i] = (above[i] - below[i]) / static_cast<float>(2 * stepMm);
  rest_ = compacted(above);
}

void DiffuseTransform::findKept(const std::vector<float>& full) {
  // A millionth of the largest value there is: a thousandth of one photograph's noise.
  constexpr float kNegligible = 1e-6f;
  const std::size_t stride = static_cast<std::size_t>(frequencyCount_) * 6;
  std::vector<float> largest(static_cast<std::size_t>(frequencyCount_), 0.0f);
  for (std::size_t i = 0; i < full.size(); ++i) {
    float& most = largest[i % stride / 6];
    most = std::max(most, std::abs(full[i]));
  }
  const float scale = largest.empty() ? 0 : *std::max_element(largest.begin(), largest.end());
  for (int f = 0; f < frequencyCount_; ++f)
    if (largest[static_cast<std::size_t>(f)] > kNegligible * scale) kept_.push_back(f);
}

std::vector<float> DiffuseTransform::compacted(const std::vector<float>& full) const {
  const std::size_t stride = static_cast<std::size_t>(frequencyCount_) * 6;
  std::vector<float> out(nodeCount() * this->stride(), 0.0f);
  for (std::size_t node = 0; node < nodeCount(); ++node) {
    float* to = out.data() + node * this->stride();
    for (const int f : kept_)
      to = std::copy_n(full.data() + node * stride + static_cast<std::size_t>(f) * 6, 6, to);
  }
  return out;
}

std::vector<char> DiffuseTransform::counts() const {
  std::vector<char> out(static_cast<std::size_t>(frequencyCount_), 0);
  for (const int f : kept_) out[static_cast<std::size_t>(f)] = 1;
  return out;
}

DiffuseTransform DiffuseTransform::select(const std::vector<int>& indices) const {
  DiffuseTransform out;
  out.frequencyCount_ = static_cast<int>(indices.size());
  std::ranges::copy(nodes_, out.nodes_);
  out.centreMm_ = centreMm_;
  out.halfSizeMm_ = halfSizeMm_;
  std::vector<std::size_t> from;
  for (std::size_t i = 0; i < indices.size(); ++i) {
    const auto at = std::lower_bound(kept_.begin(), kept_.end(), indices[i]);
    if (at == kept_.end() || *at != indices[i]) continue;
    out.kept_.push_back(static_cast<int>(i));
    from.push_back(static_cast<std::size_t>(at - kept_.begin()));
  }
  out.heightMm_ = heightMm_;
  out.nodeHeight_ = nodeHeight_;
  const auto pick = [&](const std::vector<float>& all, std::vector<float>& some) {
    if (all.empty()) return;
    some.assign(nodeCount() * out.stride(), 0.0f);
    for (std::size_t node = 0; node < nodeCount(); ++node) {
      float* to = some.data() + node * out.stride();
      for (const std::size_t f : from) to = std::copy_n(all.data() + node * stride() + f * 6, 6, to);
    }
  };
  pick(table_, out.table_);
  pick(rest_, out.rest_);
  return out;
}

std::vector<float> DiffuseTransform::atPoint(const ScreenFrame& frame, const Eigen::Vector2d& pointMm,
                                             const std::vector<Eigen::Vector2d>& frequencies,
                                             DiffuseMethod method, const SheetShape& shape) {
  std::vector<float> out(frequencies.size() * 6);
  PointTransform(frame, frequencies, method).at(shape.pointMm(pointMm), out.data());
  return out;
}

DiffuseTransform DiffuseTransform::part(const Eigen::Vector2d& lowMm, const Eigen::Vector2d& highMm) const {
  DiffuseTransform out;
  out.frequencyCount_ = frequencyCount_;
  out.kept_ = kept_;
  out.heightMm_ = heightMm_;
  out.centreMm_ = 0.5 * (lowMm + highMm);
  // a single point or line has a size too
  constexpr double kSmallest = 1e-4;
  out.halfSizeMm_ = (0.5 * (highMm - lowMm)).cwiseMax(kSmallest * halfSizeMm_);
  for (int axis = 0; axis < 2; ++axis)
    out.nodes_[axis] = std::min(nodes_[axis], enoughNodes(out.halfSizeMm_[axis] / halfSizeMm_[axis]));
  out.table_.resize(out.nodeCount() * stride());
  out.rest_.resize(rest_.empty() ? 0 : out.table_.size());
  for (std::size_t node = 0; node < out.nodeCount(); ++node) {
    const Eigen::Vector2d at = out.nodeMm(node);
    float product[kNodes * kNodes];
    nodeWeights(at, product);
    weightedNodeSum(table_.data(), product, nodeCount(), stride(), out.table_.data() + node * stride());
    if (rest_.empty()) continue;
    weightedNodeSum(rest_.data(), product, nodeCount(), stride(), out.rest_.data() + node * stride());
    out.nodeHeight_.push_back(smoothHeightMm(at));
  }
  return out;
}

bool DiffuseTransform::partPays(const Eigen::Vector2d& lowMm, const Eigen::Vector2d& highMm,
                                std::size_t points) const {
  const Eigen::Array2d share = (0.5 * (highMm - lowMm)).array() / halfSizeMm_.array();
  const auto nodes = static_cast<std::size_t>(std::min(nodes_[0], enoughNodes(share.x()))) *
                     static_cast<std::size_t>(std::min(nodes_[1], enoughNodes(share.y())));
  return nodes * (nodeCount() + points) < nodeCount() * points;
}

Eigen::Vector2d DiffuseTransform::nodeMm(std::size_t node) const {
  const int i = static_cast<int>(node);
  return {centreMm_.x() + chebyshevNodes().node[nodes_[0]][i % nodes_[0]] * halfSizeMm_.x(),
          centreMm_.y() + chebyshevNodes().node[nodes_[1]][i / nodes_[0]] * halfSizeMm_.y()};
}

void DiffuseTransform::nodeWeights(const Eigen::Vector2d& pointMm, float (&product)[kNodes * kNodes]) const {
  // Barycentric interpolation at Chebyshev points of the first kind.
  float weight[2][kNodes];
  for (int axis = 0; axis < 2; ++axis) {
    const double u = (pointMm[axis] - centreMm_[axis]) / halfSizeMm_[axis];
    const int count = nodes_[axis];
    double sum = 0, raw[kNodes];
    int exact = -1;
    for (int k = 0; k < count; ++k) {
      const double gap = u - chebyshevNodes().node[count][k];
      if (std::abs(gap) < 1e-12) exact = k;
      raw[k] = chebyshevNodes().weight[count][k] / gap;
      sum += raw[k];
    }
    const double scale = 1 / sum;
    for (int k = 0; k < count; ++k)
      weight[axis][k] = static_cast<float>(exact >= 0 ? (k == exact ? 1.0 : 0.0) : raw[k] * scale);
  }
  for (int j = 0; j < nodes_[1]; ++j)
    for (int i = 0; i < nodes_[0]; ++i) product[j * nodes_[0] + i] = weight[0][i] * weight[1][j];
}

double DiffuseTransform::smoothHeightMm(const Eigen::Vector2d& pointMm) const {
  float product[kNodes * kNodes];
  nodeWeights(pointMm, product);
  double smooth = 0;
  for (std::size_t i = 0; i < nodeHeight_.size(); ++i)
    smooth += static_cast<double>(product[i]) * nodeHeight_[i];
  return smooth;
}

double DiffuseTransform::restMm(const Eigen::Vector2d& pointMm) const {
  return heightMm_ ? heightMm_(pointMm) - smoothHeightMm(pointMm) : 0;
}

void DiffuseTransform::at(const Eigen::Vector2d& pointMm, float* out) const {
  at(pointMm, restMm(pointMm), out);
}

void DiffuseTransform::at(const Eigen::Vector2d& pointMm, double restMm, float* out) const {
  float product[kNodes * kNodes];
  nodeWeights(pointMm, product);
  thread_local std::vector<float> sums, rest;
  sums.resize(stride());
  weightedNodeSum(table_.data(), product, nodeCount(), stride(), sums.data());
  if (!rest_.empty() && restMm != 0) {
    rest.resize(stride());
    weightedNodeSum(rest_.data(), product, nodeCount(), stride(), rest.data());
    for (std::size_t i = 0; i < stride(); ++i) sums[i] += static_cast<float>(restMm) * rest[i];
  }
  std::fill_n(out, static_cast<std::size_t>(frequencyCount_) * 6, 0.0f);
  for (std::size_t k = 0; k < kept_.size(); ++k)
    std::copy_n(sums.data() + k * 6, 6, out + static_cast<std::size_t>(kept_[k]) * 6);
}

}  // namespace patina
