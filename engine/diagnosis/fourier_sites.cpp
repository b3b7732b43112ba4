#include "engine/diagnosis/fourier_sites.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

namespace patina {
namespace {

using Feature = Eigen::Array<double, 8, 1>;

/// What makes two places look like one material: log albedos and log width. Differences of a third count as
/// one.
Feature featureOf(const SvbrdfParameters& p) {
  Feature f;
  constexpr double kFloor = 0.01, kScale = 3;
  for (int c = 0; c < 3; ++c) {
    f[c] = kScale * std::log(std::max<double>(p.diffuse[c], 0) + kFloor);
    f[3 + c] = 0.7 * kScale * std::log(std::max<double>(p.specular[c], 0) + 0.3 * kFloor);
  }
  f[6] = 2 * kScale * std::log(std::max<double>(p.sigma, 0.01));
  f[7] = 0;
  return f;
}

struct Clusters {
  std::vector<Feature> centre;
  double spread = 0;
  int nearest(const Feature& f) const {
    int best = 0;
    double least = std::numeric_limits<double>::max();
    for (std::size_t k = 0; k < centre.size(); ++k) {
      const double d = (f - centre[k]).square().sum();
      if (d < least) least = d, best = static_cast<int>(k);
    }
    return best;
  }
};

Clusters kMeans(const std::vector<Feature>& features, int count, std::uint64_t seed) {
  Clusters clusters;
  std::mt19937_64 random(seed);
  clusters.centre.push_back(features[random() % features.size()]);
  const auto distance = [&](const Feature& f) {
    return (f - clusters.centre[static_cast<std::size_t>(clusters.nearest(f))]).square().sum();
  };
  while (static_cast<int>(clusters.centre.size()) < count) {  // k-means++
    std::vector<double> weight(features.size());
    for (std::size_t i = 0; i < features.size(); ++i) weight[i] = distance(features[i]) + 1e-12;
    std::discrete_distribution<std::size_t> pick(weight.begin(), weight.end());
    clusters.centre.push_back(features[pick(random)]);
  }
  for (int step = 0; step < 25; ++step) {
    std::vector<Feature> sum(clusters.centre.size(), Feature::Zero());
    std::vector<double> n(clusters.centre.size(), 0);
    for (const auto& f : features) {
      const auto k = static_cast<std::size_t>(clusters.nearest(f));
      sum[k] += f;
      n[k] += 1;
    }
    for (std::size_t k = 0; k < n.size(); ++k)
      if (n[k] > 0) clusters.centre[k] = sum[k] / n[k];
  }
  for (const auto& f : features) clusters.spread += distance(f);
  clusters.spread /= static_cast<double>(features.size());
  return clusters;
}

bool fitted(const FourierFitState& state, std::size_t site) {
  const TexelStatus status = state.siteStatus[site];
  return status == TexelStatus::Converged || status == TexelStatus::IterationLimit;
}

/// Whether a site's pixel and its neighbours belong to one material.
bool awayFromBorders(const FourierFitState& state, const std::vector<std::uint8_t>& cluster,
                     std::size_t site) {
  const SiteSet& set = state.measurements.sites;
  if (set.grouped()) return true;
  const int x = static_cast<int>(set.pixel[site].x()), y = static_cast<int>(set.pixel[site].y());
  for (int dy = -1; dy <= 1; ++dy) {
    for (int dx = -1; dx <= 1; ++dx) {
      if (x + dx < 0 || y + dy < 0 || x + dx >= set.imageWidth || y + dy >= set.imageHeight) return false;
      const auto other =
          set.siteOfPixel[static_cast<std::size_t>(y + dy) * static_cast<std::size_t>(set.imageWidth) +
                          static_cast<std::size_t>(x + dx)];
      if (other < 0) return false;
      if (cluster[static_cast<std::size_t>(other)] != cluster[site]) return false;
    }
  }
  return true;
}

/// Whether another material lies within some pixels.
bool besideBorder(const FourierFitState& state, const std::vector<std::uint8_t>& cluster, std::size_t site) {
  const SiteSet& set = state.measurements.sites;
  if (set.grouped()) return false;
  constexpr int kReach = 4;
  const int x = static_cast<int>(set.pixel[site].x()), y = static_cast<int>(set.pixel[site].y());
  for (int dy = -kReach; dy <= kReach; ++dy) {
    for (int dx = -kReach; dx <= kReach; ++dx) {
      if (x + dx < 0 || y + dy < 0 || x + dx >= set.imageWidth || y + dy >= set.imageHeight) continue;
      const auto other =
          set.siteOfPixel[static_cast<std::size_t>(y + dy) * static_cast<std::size_t>(set.imageWidth) +
                          static_cast<std::size_t>(x + dx)];
      if (other >= 0 && cluster[static_cast<std::size_t>(other)] != cluster[site]) return true;
    }
  }
  return false;
}

}  // namespace

QuadratureSite quadratureSite(const FourierFitState& state, std::size_t site) {
  const SvbrdfParameters& p = state.sites[site];
  QuadratureSite out;
  out.geometry = state.geometry(site);
  out.pointMm = state.measurements.sites.pointMm[site];
  const float nz = std::max(p.normal.z(), 0.05f);
  out.slopeX = p.normal.x() / nz;
  out.slopeY = p.normal.y() / nz;
  out.sigma = std::clamp(p.sigma, 0.003f, 1.0f);
  out.kurtosis = std::max(p.kurtosis, 1.0f);
  return out;
}

void loadSite(const DiagnosisCapture& capture, DiagnosisSite& at) {
  const FourierMeasurements& m = capture.state->measurements;
  const std::size_t s = at.site, rows = capture.rowCount(), fittedCount = m.plan.fitted.size();
  at.measured.assign(rows * 3, 0);
  at.weight.assign(rows * 3, 0);
  at.model = quadratureSite(*capture.state, s);
  at.diffuse = capture.state->sites[s].diffuse;
  at.specular = capture.state->sites[s].specular;
  if (capture.knownLambertian) {
    at.diffuse = capture.state->capture.known->albedo.cast<float>().array();
    at.specular.setZero();
    at.model.slopeX = at.model.slopeY = 0;
    at.model.sigma = 0.3f;
  }
  at.pixel = m.sites.pixel[s];
  const float pixels = static_cast<float>(m.sites.pixelCount[s]);
  const auto weight = [&](double radiance) {
    return static_cast<float>(pixels / m.noise.variance(radiance));
  };
  for (int c = 0; c < 3; ++c) {
    at.blackMeasured[c] = at.black[c] = m.black[s * 3 + static_cast<std::size_t>(c)];
    at.blackWeight[c] =
        static_cast<float>(pixels / std::max(m.blackVarianceShare * m.noise.variance(at.black[c]), 1e-20));
  }
  const auto part = [&](const MeasurementStore& store, std::size_t firstFrequency, std::size_t count) {
    const SiteBlock block = store.block(s, 1);
    const float *z = block.z(s), *even = block.even(s);
    for (std::size_t f = 0; f < count; ++f) {
      for (std::size_t c = 0; c < 3; ++c) {
        const float re = z[f * 6 + c], im = z[f * 6 + 3 + c], sum0 = even[f * 6 + c],
                    sum1 = even[f * 6 + 3 + c];
        const float value[4] = {(sum0 - im) / 2, (sum1 + re) / 2, (sum0 + im) / 2, (sum1 - re) / 2};
        for (std::size_t k = 0; k < 4; ++k) {
          const std::size_t row = 4 * (firstFrequency + f) + k;
          at.measured[row * 3 + c] = value[k];
          // The pair's mean stands for both photographs, so that weights don't follow the noise.
          at.weight[row * 3 + c] = weight(k % 2 == 0 ? sum0 / 2 : sum1 / 2);
        }
      }
    }
    for (const auto dropped : store.droppedRows(s)) {
      const std::size_t f = firstFrequency + dropped / 2, k = dropped % 2 == 0 ? 1 : 0;
      for (std::size_t c = 0; c < 3; ++c)
        at.weight[(4 * f + k) * 3 + c] = at.weight[(4 * f + k + 2) * 3 + c] = 0;
    }
  };
  part(m.store, 0, fittedCount);
  if (!m.heldOut.empty()) part(m.heldOut, fittedCount, m.plan.heldOut.size());
  if (!m.windowClipped(s)) {
    for (std::size_t c = 0; c < 3; ++c) {
      at.measured[(rows - 1) * 3 + c] = m.window[s * 3 + c];
      at.weight[(rows - 1) * 3 + c] = weight(m.window[s * 3 + c]);
    }
  }
}

Result<DiagnosisCapture> diagnosisCapture(std::shared_ptr<const FourierFit> fit, int count,
                                          const JobContext& job) {
  DiagnosisCapture out;
  out.fit = std::move(fit);
  out.state = &fitState(*out.fit);
  const FourierFitState& state = *out.state;
  const FourierMeasurements& m = state.measurements;
  out.knownLambertian = state.capture.known.has_value();
  const double last = std::max<double>(1, static_cast<double>(state.capture.photos.size()) - 1);
  for (const bool holdout : {false, true}) {
    for (const auto& group : holdout ? m.plan.heldOut : m.plan.fitted) {
      if (holdout && m.heldOut.empty()) break;
      for (int k = 0; k < 4; ++k) {
        const int photo = group.photo[static_cast<std::size_t>(k)];
        out.rows.push_back({photo, static_cast<int>(out.frequencies.size()), k, holdout, photo / last});
      }
      out.frequencies.push_back(group.frequency);
    }
  }
  if (m.heldOut.empty()) {
    // None declared: every sixth frequency is kept from the sites' and effects' fits and judges them.
    for (auto& row : out.rows) row.holdout = row.frequency % 6 == 3;
  }
  out.rows.push_back({m.plan.window, -1, 0, false, m.plan.window / last});

  std::vector<std::size_t> good;
  std::vector<Feature> features;
  for (std::size_t s = 0; s < m.sites.size(); ++s) {
    if (!fitted(state, s) || m.clipped[s]) continue;
    good.push_back(s);
    features.push_back(featureOf(state.sites[s]));
  }
  constexpr std::size_t kLeast = 60;
  if (good.size() < kLeast)
    return Error{ErrorCode::Invalid,
                 "only " + std::to_string(good.size()) + " points were fitted, too few to look for causes",
                 state.capture.folder.string(), "see the status map of the fit for what went wrong"};
  std::vector<Feature> some;
  const std::size_t step = std::max<std::size_t>(1, features.size() / 1500);
  for (std::size_t i = 0; i < features.size(); i += step) some.push_back(features[i]);
  Clusters clusters = kMeans(some, 1, job.seed + 1);
  for (int k = 2; k <= 4; ++k) {
    const Clusters more = kMeans(some, k, job.seed + 1);
    if (more.spread > 0.5 * clusters.spread || clusters.spread < 0.5) break;
    clusters = more;
  }
  out.clusterCount = static_cast<int>(clusters.centre.size());
  out.clusterOfSite.resize(m.sites.size(), 0);
  for (std::size_t s = 0; s < m.sites.size(); ++s)
    out.clusterOfSite[s] = static_cast<std::uint8_t>(clusters.nearest(featureOf(state.sites[s])));

  std::vector<std::size_t> inside;
  for (const std::size_t s : good)
    if (awayFromBorders(state, out.clusterOfSite, s)) inside.push_back(s);
  if (inside.size() < std::max<std::size_t>(kLeast, good.size() / 10)) inside = good;
  // What spreads light shows beside borders, a third of the sites; the others evenly: every so-many-th in the
  // image's order, from an odd stride so that columns don't line up.
  std::vector<std::size_t> beside, chosen;
  for (const std::size_t s : inside)
    if (besideBorder(state, out.clusterOfSite, s)) beside.push_back(s);
  const auto choose = [&](const std::vector<std::size_t>& from, double wanted) {
    const double stride = std::max(1.0, static_cast<double>(from.size()) / std::max(wanted, 1.0));
    for (double at = 0; at < static_cast<double>(from.size()); at += stride)
      chosen.push_back(from[static_cast<std::size_t>(at)]);
  };
  const double wanted = std::max(count, 100);
  choose(beside, wanted / 3);
  choose(inside, wanted - static_cast<double>(chosen.size()));
  std::ranges::sort(chosen);
  chosen.erase(std::unique(chosen.begin(), chosen.end()), chosen.end());
  for (const std::size_t s : chosen) {
    DiagnosisSite site;
    site.site = s;
    site.cluster = out.clusterOfSite[site.site];
    loadSite(out, site);
    out.sites.push_back(std::move(site));
    if (job.cancelled()) return Error{ErrorCode::Cancelled, "cancelled while choosing texels", "", ""};
  }
  for (const auto& site : out.sites)
    for (const float value : site.measured)
      out.fullScale = std::max<double>(out.fullScale == 1 ? 0 : out.fullScale, value);
  return out;
}

}  // namespace patina
