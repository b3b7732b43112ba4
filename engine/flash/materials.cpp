#include "engine/flash/materials.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numeric>

namespace patina {
namespace {

constexpr int kMostMaterials = 6;
/// One more material must explain this share of what is left of the colours' spread.
constexpr double kWorthwhile = 0.35;
/// And colours closer than this belong together anyway: RMS in natural logarithms, paper's own texture.
constexpr double kTexture = 0.08;
constexpr double kSmallestShare = 0.015;
constexpr int kBlocksASide = 8;
constexpr std::size_t kWidestSample = 256;

/// Two numbers of hue, one of brightness.
Eigen::Vector3d featureOf(const Eigen::Array3d& logColour) {
  constexpr double kHue = 1.4, kBrightness = 0.6;
  return {kHue * (logColour[0] - logColour[1]), kHue * (logColour[2] - logColour[1]),
          kBrightness * logColour.mean()};
}

struct Clusters {
  std::vector<Eigen::Vector3d> centre;
  std::vector<int> label;
  double spread = 0;  ///< mean square distance
};

Clusters cluster(const std::vector<Eigen::Vector3d>& points, int count) {
  Clusters result;
  // Farthest points first, from the mean on: no random numbers. Outliers don't get a seat: the farthest of a
  // hundredth is skipped.
  const Eigen::Vector3d mean = std::accumulate(points.begin(), points.end(), Eigen::Vector3d(0, 0, 0)) /
                               static_cast<double>(points.size());
  result.centre.push_back(mean);
  std::vector<double> distance(points.size());
  while (static_cast<int>(result.centre.size()) < count) {
    for (std::size_t i = 0; i < points.size(); ++i) {
      distance[i] = 1e300;
      for (const auto& centre : result.centre)
        distance[i] = std::min(distance[i], (points[i] - centre).squaredNorm());
    }
    std::vector<std::size_t> order(points.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    const auto seat =
        order.begin() + static_cast<std::ptrdiff_t>(0.97 * static_cast<double>(order.size() - 1));
    std::nth_element(order.begin(), seat, order.end(),
                     [&](std::size_t a, std::size_t b) { return distance[a] < distance[b]; });
    result.centre.push_back(points[*seat]);
  }
  result.label.assign(points.size(), 0);
  for (int iteration = 0; iteration < 40; ++iteration) {
    bool changed = false;
    result.spread = 0;
    std::vector<Eigen::Vector3d> sum(result.centre.size(), Eigen::Vector3d::Zero());
    std::vector<double> share(result.centre.size(), 0.0);
    for (std::size_t i = 0; i < points.size(); ++i) {
      int best = 0;
      double least = 1e300;
      for (std::size_t m = 0; m < result.centre.size(); ++m) {
        const double d = (points[i] - result.centre[m]).squaredNorm();
        if (d < least) least = d, best = static_cast<int>(m);
      }
      changed |= best != result.label[i];
      result.label[i] = best;
      result.spread += least;
      sum[static_cast<std::size_t>(best)] += points[i], share[static_cast<std::size_t>(best)] += 1;
    }
    result.spread /= static_cast<double>(points.size());
    for (std::size_t m = 0; m < sum.size(); ++m)
      if (share[m] > 0) result.centre[m] = sum[m] / share[m];
    if (!changed && iteration > 0) break;
  }
  return result;
}

/// Minus the logarithm of the evidence for a material's shared numbers, texels integrated out (Laplace). A
/// lobe so narrow that every texel must turn its normal to the photographs' directions fits as well as the
/// right one; the turning is what counts against it.
double surpriseOf(const JointState& state, const FlashSample& sample, int m,
                  const std::vector<char>& photos) {
  const FlashMaterial& material = state.model.materials[static_cast<std::size_t>(m)];
  const auto prior = material.covariance.llt();
  const double spread = prior.matrixLLT().diagonal().array().log().sum();
  double sum = 0;
  for (std::size_t s = 0; s < sample.sites.size(); ++s) {
    const FlashSite& site = sample.sites[s];
    if (site.material != m) continue;
    const TexelVector d = state.x[s] - material.mean;
    sum += 0.5 * d.dot(prior.solve(d)) + spread +
           state.information[s].llt().matrixLLT().diagonal().array().log().sum();
    for (const FlashObservation& seen : site.seen) {
      if (!photos[static_cast<std::size_t>(seen.photo)]) continue;
      const SeenPrediction p = predictSeen(state.model, m, seen, state.x[s], false);
      for (int c = 0; c < 3; ++c) {
        const double sd = scatterOf(seen, c, p.value[c], material.discrepancy);
        const bool clipped = (seen.clipped >> c) & 1;
        sum += misfitOf(p.value[c], seen.value[c], sd, clipped).cost + (clipped ? 0 : std::log(sd));
      }
    }
  }
  return sum;
}

}  // namespace

int FlashPalette::nearest(const Eigen::Array3d& colour) const {
  const Eigen::Vector3d feature = featureOf(colour);
  int best = 0;
  double least = 1e300;
  for (std::size_t m = 0; m < logColour.size(); ++m) {
    const double d = (feature - featureOf(logColour[m])).squaredNorm();
    if (d < least) least = d, best = static_cast<int>(m);
  }
  return best;
}

FlashPalette findMaterials(const std::vector<Eigen::Array3d>& logColours, int count) {
  std::vector<Eigen::Vector3d> points;
  for (const auto& colour : logColours) points.push_back(featureOf(colour));
  FlashPalette palette;
  if (points.empty()) {
    palette.logColour.push_back(Eigen::Array3d::Constant(std::log(0.1)));
    return palette;
  }
  Clusters best = cluster(points, count > 0 ? count : 1);
  for (int more = 2; count <= 0 && more <= kMostMaterials; ++more) {
    if (best.spread < kTexture * kTexture) break;
    Clusters next = cluster(points, more);
    if (next.spread > (1 - kWorthwhile) * best.spread) {
      // One further look: two materials may only come apart together.
      if (more == kMostMaterials) break;
      Clusters after = cluster(points, more + 1);
      if (after.spread > (1 - kWorthwhile) * (1 - kWorthwhile) * best.spread) break;
      best = std::move(after);
      ++more;
      continue;
    }
    best = std::move(next);
  }
  std::vector<std::pair<double, Eigen::Array3d>> found;
  for (std::size_t m = 0; m < best.centre.size(); ++m) {
    Eigen::Array3d sum = Eigen::Array3d::Zero();
    double share = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (best.label[i] != static_cast<int>(m)) continue;
      sum += logColours[i], share += 1;
    }
    if (share > 0 && (share >= kSmallestShare * static_cast<double>(points.size()) || count > 0))
      found.emplace_back(share, sum / share);
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  for (auto& [share, colour] : found) palette.logColour.push_back(colour);
  return palette;
}

std::size_t sampleLevel(const FlashData& data) {
  std::size_t level = 0;
  while (level + 1 < data.levels.size() &&
         static_cast<std::size_t>(std::max(data.levels[level].grid.width, data.levels[level].grid.height)) >
             kWidestSample)
    ++level;
  return level;
}

FlashSample drawSample(const FlashData& data, const FlashLevel& level, int texels) {
  FlashSample sample;
  sample.blocks = kBlocksASide * kBlocksASide;
  const double every = std::sqrt(static_cast<double>(level.grid.size()) / std::max(texels, 1));
  const double stride = std::max(1.0, every);
  for (double y = 0.5 * stride; y < level.grid.height; y += stride) {
    // Rows are staggered: a regular sample would miss what is as regular.
    const double shift = std::fmod(y * 0.618034, stride);
    for (double x = shift; x < level.grid.width; x += stride) {
      const int i = std::min(static_cast<int>(x), level.grid.width - 1),
                j = std::min(static_cast<int>(y), level.grid.height - 1);
      FlashSite site = siteOf(data, level, i, j);
      if (site.seen.empty()) continue;
      site.block =
          kBlocksASide * (j * kBlocksASide / level.grid.height) + i * kBlocksASide / level.grid.width;
      sample.sites.push_back(std::move(site));
    }
  }
  return sample;
}

JointState firstState(const FlashData& data, FlashSample& sample, const FlashPalette& palette) {
  JointState state;
  state.model.rig.logGain.assign(data.capture.photos.size(), 0.0);
  state.model.rig.photoAim.assign(data.capture.photos.size(), Eigen::Vector2d::Zero());
  for (const Eigen::Array3d& colour : palette.logColour) {
    FlashMaterial material;
    // Half of the dark colour is the lobe's wide skirt, as often as not.
    material.mean.segment<3>(2) = (colour - 0.3).matrix();
    material.mean.segment<3>(5) = (0.5 * (colour + colour.mean()) - 0.7).matrix();
    TexelVector sd;
    sd << 0.1, 0.1, 0.5, 0.5, 0.5, 1, 1, 1;
    material.covariance = sd.array().square().matrix().asDiagonal();
    material.discrepancy = 0.1;
    state.model.materials.push_back(material);
  }
  for (FlashSite& site : sample.sites) {
    const Eigen::Array3d colour = darkColour(site);
    site.material = palette.nearest(colour);
    TexelVector x = state.model.materials[static_cast<std::size_t>(site.material)].mean;
    x.segment<3>(2) = (colour - 0.3).matrix();
    state.x.push_back(x);
    state.information.push_back(TexelMatrix::Identity());
  }
  return state;
}

JointState fitShared(const FlashData& data, FlashSample& sample, const FlashPalette& palette,
                     const std::vector<FlashEffect>& effects, const std::vector<char>& photos,
                     const JobContext& job) {
  const JointState first = firstState(data, sample, palette);
  JointOptions options;
  options.photos = photos;
  std::vector<JointState> tries;
  int done = 0;
  for (const double sigma : {0.07, 0.16, 0.35}) {
    JointState state = first;
    for (FlashMaterial& material : state.model.materials) material.lobe.logSigma = std::log(sigma);
    restartTexels(state, sample, photos, job);
    options.iterations = 10;
    solveJoint(state, sample, data.capture, options, job);
    tries.push_back(std::move(state));
    job.progress("solve", ++done, 5, "starts");
    if (job.cancelled()) return tries.front();
  }
  // Materials don't share anything but the rig yet: each takes its own best start.
  JointState best = tries.front();
  for (std::size_t m = 0; m < best.model.materials.size(); ++m) {
    double least = 1e300;
    for (const JointState& state : tries) {
      const double surprise = surpriseOf(state, sample, static_cast<int>(m), photos);
      if (!(surprise < least)) continue;
      least = surprise;
      best.model.materials[m] = state.model.materials[m];
      for (std::size_t s = 0; s < sample.sites.size(); ++s) {
        if (sample.sites[s].material != static_cast<int>(m)) continue;
        best.x[s] = state.x[s], best.information[s] = state.information[s];
      }
    }
  }
  options.effects = effects;
  if (std::find(effects.begin(), effects.end(), FlashEffect::ThirdLobe) != effects.end()) {
    // From zero the third lobe's width has no derivative.
    for (FlashMaterial& material : best.model.materials) material.lobe.thirdShare = 0.1;
  }
  for (int round = 0; round < 2; ++round) {
    restartTexels(best, sample, photos, job);
    options.iterations = 25;
    solveJoint(best, sample, data.capture, options, job);
    job.progress("solve", ++done, 5, "starts");
  }
  return best;
}

}  // namespace patina
