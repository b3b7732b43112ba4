#include "engine/fourier/upsample.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>

#include "engine/fourier/levels_data.h"
#include "engine/fourier/upsample_window.h"

namespace patina {
namespace {

constexpr std::size_t kRun = 4096;  // targets a task: a few rows, short enough to poll for a stop

// The soft constraint counts a tenth of the data themselves: weights that sum to 1.1 cost as much as 3 % of
// the signal unexplained. Softer than a rule, because albedos finer than the grid do leave the range of the
// texels around them; harder than nothing, or a dark speckle of any material would be explained by shade.
constexpr double kSumShare = 0.1;
// A weight may stray from bilinear interpolation by one at the price of one standard deviation of noise.
// Without it, like texels make the problem singular, and noise picks a single one.
constexpr double kPlaceSigma = 1;
// ... or for a little more, as far as single precision's rounding needs it: texels alike within 0.3 % are not
// told apart.
constexpr double kLeastRidge = 1e-5;
// What a further texel must explain: one standard deviation squared, as any parameter does of pure noise.
constexpr float kSignificant = 1;

/// A point that is to be explained: where it lies on the low grid.
struct Target {
  std::uint32_t texel = 0;  ///< of the low grid
  std::uint32_t index = 0;  ///< of the site, or of the finer texel
  float x = 0, y = 0;       ///< low grid coordinates, texel centres at whole numbers
};

Target targetAt(const LevelData& low, const Eigen::Vector2f& pointMm, std::uint32_t index) {
  Target t;
  t.texel = texelOf(low, pointMm);
  t.index = index;
  t.x = static_cast<float>((pointMm.x() / low.widthMm + 0.5) * low.width - 0.5);
  t.y = static_cast<float>((0.5 - pointMm.y() / low.heightMm) * low.height - 0.5);
  return t;
}

/// The 5 x 5 texels about a low texel, and what all targets inside it share.
class Window {
 public:
  Window(const FourierFitState& state, const LevelSolution& low) : state_(state), low_(low) {
    dimensions_ = low.data.zStride() + 3;
    columns_.resize(dimensions_ * kWindowStride);
    gram_.resize(static_cast<std::size_t>(kWindowStride) * kWindowStride);
    scale_.resize(dimensions_);
  }

  /// `sitesPerTarget`: how many sites a target's measurements are the mean of.
  void moveTo(std::uint32_t texel, double sitesPerTarget) {
    const LevelData& data = low_.data;
    texel_ = texel;
    findScale(sitesPerTarget);
    const int x0 = static_cast<int>(texel) % data.width, y0 = static_cast<int>(texel) / data.width;
    std::ranges::fill(columns_, 0.0f);
    for (int k = 0; k < kWindowTexels; ++k) {
      const int x = x0 + k % 5 - 2, y = y0 + k / 5 - 2;
      member_[k] = -1;
      if (x < 0 || y < 0 || x >= data.width || y >= data.height) continue;
      const std::size_t t = data.index(x, y);
      if (data.siteCount[t] == 0 || low_.texels[t].outcome == SolveOutcome::Failed) continue;
      member_[k] = static_cast<std::int64_t>(t);
      const float* z = data.z.data() + t * data.zStride();
      for (std::size_t d = 0; d + 3 < dimensions_; ++d) columns_[d * kWindowStride + k] = z[d] * scale_[d];
      for (std::size_t c = 0; c < 3; ++c)
        columns_[(dimensions_ - 3 + c) * kWindowStride + k] =
            data.dc[t * 3 + c] * scale_[dimensions_ - 3 + c];
    }
    windowGram(columns_.data(), dimensions_, gram_.data());
    double trace = 0;
    int count = 0;
    for (int k = 0; k < kWindowTexels; ++k)
      if (member_[k] >= 0) trace += gram_[k * kWindowStride + k], ++count;
    const double energy = count ? trace / count : 0;
    ridge_ = static_cast<float>(std::max(1 / (kPlaceSigma * kPlaceSigma), kLeastRidge * energy));
    sum_ = static_cast<float>(kSumShare * energy);
    for (int i = 0; i < kWindowTexels; ++i) {
      if (member_[i] < 0) continue;
      for (int j = 0; j < kWindowTexels; ++j)
        if (member_[j] >= 0) gram_[i * kWindowStride + j] += sum_ + (i == j ? ridge_ : 0.0f);
    }
  }

  /// Measurements of the texel itself: what stands for rows that a target dropped.
  const float* own() const { return low_.data.z.data() + texel_ * low_.data.zStride(); }

  /// Weights on the window's texels for a target with the given (turned) measurements. False where no texel
  /// of the window is known.
  bool weights(const Target& target, float* measurements, float (&weight)[kWindowStride]) const {
    if (!bilinear(target, weight)) return false;
    for (std::size_t d = 0; d < dimensions_; ++d) measurements[d] *= scale_[d];
    float b[kWindowStride], place[kWindowStride];
    windowProject(columns_.data(), dimensions_, measurements, b);
    std::copy_n(weight, kWindowStride, place);
    for (int k = 0; k < kWindowTexels; ++k)
      if (member_[k] >= 0) b[k] += sum_ + ridge_ * weight[k];
    nonNegativeWeights(gram_.data(), b, kSignificant, weight);
    double total = 0;
    for (int k = 0; k < kWindowTexels; ++k) total += weight[k];
    // A target that is dark against everything around it has no weights to speak of: its place decides.
    constexpr double kNothing = 1e-3;
    if (!(total > kNothing) || !std::isfinite(total)) std::copy_n(place, kWindowStride, weight);
    return true;
  }

  /// Parameters combined with the weights.
  void combine(const float (&weight)[kWindowStride], SiteSolution& out) const {
    double lobeTotal = 0, total = 0, logSigma = 0, logKurtosis = 0, slopeX = 0, slopeY = 0;
    double albedo[6] = {}, deviation[6] = {}, covariance[10] = {};
    int heaviest = -1;
    for (int k = 0; k < kWindowTexels; ++k) {
      if (member_[k] < 0 || !(weight[k] > 0)) continue;
      const SiteSolution& s = low_.texels[member_[k]];
      const double w = weight[k];
      // Specular energy decides about the lobe: a texel without a lobe has nothing to say about its width.
      const double lobe = w * (s.specular[0] + s.specular[1] + s.specular[2] + 1e-4);
      lobeTotal += lobe;
      total += w;
      logSigma += lobe * s.lobe.logSigma;
      logKurtosis += lobe * s.lobe.logKurtosis;
      slopeX += w * s.lobe.slopeX;
      slopeY += w * s.lobe.slopeY;
      for (int c = 0; c < 3; ++c) {
        albedo[c] += w * s.diffuse[c];
        albedo[3 + c] += w * s.specular[c];
        deviation[c] += w * s.diffuseSd[c];
        deviation[3 + c] += w * s.specularSd[c];
      }
      for (int i = 0; i < 10; ++i) covariance[i] += w * s.lobeCovariance[i];
      if (heaviest < 0 || weight[k] > weight[heaviest]) heaviest = k;
    }
    if (heaviest < 0) return;
    out = SiteSolution{};
    out.lobe = {static_cast<float>(logSigma / lobeTotal), static_cast<float>(logKurtosis / lobeTotal),
                static_cast<float>(slopeX / total), static_cast<float>(slopeY / total)};
    for (int c = 0; c < 3; ++c) {
      out.diffuse[c] = static_cast<float>(albedo[c]);
      out.specular[c] = static_cast<float>(albedo[3 + c]);
      out.diffuseSd[c] = static_cast<float>(deviation[c]);
      out.specularSd[c] = static_cast<float>(deviation[3 + c]);
    }
    for (int i = 0; i < 10; ++i) out.lobeCovariance[i] = static_cast<float>(covariance[i] / total);
    out.outcome = low_.texels[member_[heaviest]].outcome;
  }

 private:
  /// Roots of the measurements' weights: a target's noise, and the 160th of the brightness that no
  /// explanation can be expected to do better than (App. E).
  void findScale(double sitesPerTarget) {
    constexpr double kPaperWeight = 160;
    const LevelData& data = low_.data;
    const FourierMeasurements& m = state_.measurements;
    const float* dc = data.dc.data() + std::size_t{texel_} * 3;
    const bool byNoise = state_.options.weights == MeasurementWeights::Noise;
    const double brightness = byNoise ? std::max({dc[0], dc[1], dc[2], 0.0f}) : m.fullScale;
    const double error = std::pow(brightness / kPaperWeight, 2), least = std::pow(1e-6 * m.fullScale, 2);
    float ac[3], zero[3];
    for (int c = 0; c < 3; ++c) {
      const std::size_t at = std::size_t{texel_} * 3 + c;
      const double noise = byNoise ? data.siteVariance[at] / sitesPerTarget : 0,
                   zeroNoise = byNoise ? data.siteDcVariance[at] / sitesPerTarget : 0;
      ac[c] = static_cast<float>(1 / std::sqrt(std::max(error + noise, least)));
      zero[c] = static_cast<float>(1 / std::sqrt(std::max(error + zeroNoise, least)));
    }
    for (std::size_t d = 0; d + 3 < dimensions_; ++d) scale_[d] = ac[d % 3];
    for (std::size_t c = 0; c < 3; ++c) scale_[dimensions_ - 3 + c] = zero[c];
  }

  /// Bilinear interpolation over the texels that are known; the nearest known one where none of the four is.
  bool bilinear(const Target& target, float (&weight)[kWindowStride]) const {
    std::fill_n(weight, kWindowStride, 0.0f);
    const int x0 = static_cast<int>(texel_) % low_.data.width,
              y0 = static_cast<int>(texel_) / low_.data.width;
    const float dx = std::clamp(target.x - static_cast<float>(x0), -0.5f, 0.5f),
                dy = std::clamp(target.y - static_cast<float>(y0), -0.5f, 0.5f);
    float total = 0;
    int nearest = -1;
    float nearestDistance = 0;
    for (int k = 0; k < kWindowTexels; ++k) {
      if (member_[k] < 0) continue;
      const float gapX = std::abs(static_cast<float>(k % 5 - 2) - dx),
                  gapY = std::abs(static_cast<float>(k / 5 - 2) - dy);
      weight[k] = std::max(0.0f, 1 - gapX) * std::max(0.0f, 1 - gapY);
      total += weight[k];
      const float distance = gapX * gapX + gapY * gapY;
      if (nearest < 0 || distance < nearestDistance) nearest = k, nearestDistance = distance;
    }
    if (nearest < 0) return false;
    if (total < 1e-3f) {
      std::fill_n(weight, kWindowStride, 0.0f);
      weight[nearest] = total = 1;
    }
    for (auto& w : weight) w /= total;
    return true;
  }

  const FourierFitState& state_;
  const LevelSolution& low_;
  std::size_t dimensions_;
  std::uint32_t texel_ = 0;
  std::int64_t member_[kWindowTexels];
  std::vector<float> columns_, gram_, scale_;
  float ridge_ = 0, sum_ = 0;
};

/// Explains a run of targets, low texel by low texel. `fill(index, window, out)` writes a target's turned
/// measurements.
template <typename Fill>
void upsampleRun(Window& window, std::vector<Target>& targets, std::size_t dimensions, double sitesPerTarget,
                 std::span<SiteSolution> out, const JobContext& job, Fill fill) {
  std::ranges::sort(targets, [](const Target& a, const Target& b) {
    return a.texel != b.texel ? a.texel < b.texel : a.index < b.index;
  });
  std::vector<float> measurements(dimensions);
  for (std::size_t i = 0; i < targets.size(); ++i) {
    if (i == 0 || targets[i].texel != targets[i - 1].texel) {
      if (job.cancelled()) return;
      window.moveTo(targets[i].texel, sitesPerTarget);
    }
    fill(targets[i].index, window, measurements.data());
    float weight[kWindowStride];
    if (window.weights(targets[i], measurements.data(), weight))
      window.combine(weight, out[targets[i].index]);
  }
}

}  // namespace

void upsampleToSites(const FourierFitState& state, const LevelSolution& low, std::span<SiteSolution> out,
                     const JobContext& job) {
  const FourierMeasurements& m = state.measurements;
  const std::size_t stride = low.data.zStride(), count = m.sites.size();
  const MirrorPhase phase(state);
  std::atomic<std::int64_t> done{0};
  tbb::parallel_for(std::size_t{0}, (count + kRun - 1) / kRun, [&](std::size_t run) {
    if (job.cancelled()) return;
    const std::size_t first = run * kRun, length = std::min(kRun, count - first);
    const SiteRows sites(m, first, length);
    std::vector<Target> targets(length);
    for (std::size_t i = 0; i < length; ++i)
      targets[i] = targetAt(low.data, m.sites.pointMm[first + i], static_cast<std::uint32_t>(first + i));
    Window window(state, low);
    upsampleRun(window, targets, stride + 3, 1, out, job,
                [&](std::uint32_t site, const Window& about, float* to) {
                  phase.turn(m.sites.pointMm[site], sites.z(site), to);
                  for (const auto row : sites.dropped(site)) {
                    const std::size_t pair = (row & ~std::size_t{1}) * 3;  // a turn mixes the two
                    std::copy_n(about.own() + pair, 6, to + pair);
                  }
                  std::copy_n(m.dc.data() + std::size_t{site} * 3, 3, to + stride);
                });
    job.progress("upsample", done += static_cast<std::int64_t>(length), static_cast<std::int64_t>(count),
                 "texels");
  });
}

void upsampleToLevel(const FourierFitState& state, const LevelSolution& low, const LevelData& high,
                     std::span<SiteSolution> out, const JobContext& job) {
  const std::size_t stride = low.data.zStride(), count = high.size();
  double sites = 0, measured = 0;
  for (const auto n : high.siteCount) sites += n, measured += n > 0;
  const double sitesPerTarget = measured > 0 ? sites / measured : 1;
  constexpr std::size_t kTexelRun = 512;
  tbb::parallel_for(std::size_t{0}, (count + kTexelRun - 1) / kTexelRun, [&](std::size_t run) {
    if (job.cancelled()) return;
    std::vector<Target> targets;
    for (std::size_t t = run * kTexelRun; t < std::min(count, (run + 1) * kTexelRun); ++t)
      if (high.siteCount[t] > 0)
        targets.push_back(targetAt(low.data, high.pointMm[t], static_cast<std::uint32_t>(t)));
    Window window(state, low);
    upsampleRun(window, targets, stride + 3, sitesPerTarget, out, job,
                [&](std::uint32_t texel, const Window& about, float* to) {
                  std::copy_n(high.z.data() + texel * stride, stride, to);
                  for (std::size_t row = 0; row < stride / 3; ++row)
                    if (high.rowCount[texel * (stride / 3) + row] == 0)
                      std::copy_n(about.own() + row * 3, 3, to + row * 3);
                  std::copy_n(high.dc.data() + std::size_t{texel} * 3, 3, to + stride);
                });
  });
}

}  // namespace patina
