// What a finished fit answers: parameters, spectra and lobes of single texels.
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "engine/fourier/fit_access.h"

namespace patina {
namespace {

using Complex = std::complex<float>;

class FinishedFit final : public FourierFit {
 public:
  explicit FinishedFit(std::unique_ptr<FourierFitState> state) : state_(std::move(state)) {}

  const SvbrdfMaps& maps() const override { return state_->maps; }
  const FourierFitStats& stats() const override { return state_->stats; }
  const FourierCapture& capture() const override { return state_->capture; }
  const FourierFitOptions& options() const override { return state_->options; }
  const FourierFitState& state() const { return *state_; }

  SvbrdfParameters parametersAt(int texelX, int texelY) const override {
    const auto site = state_->siteOfTexel(texelX, texelY);
    return site < 0 ? SvbrdfParameters{} : state_->sites[static_cast<std::size_t>(site)];
  }

  std::vector<SpectrumSample> spectrumAt(int texelX, int texelY) const override {
    const auto found = state_->siteOfTexel(texelX, texelY);
    if (found < 0) return {};
    const auto site = static_cast<std::size_t>(found);
    const FourierMeasurements& m = state_->measurements;
    std::vector<SpectrumSample> samples;
    auto add = [&](const Eigen::Vector2i& frequency, bool holdout, const std::array<Complex, 3>& measured,
                   bool dc) {
      SpectrumSample sample{.frequency = frequency,
                            .holdout = holdout,
                            .measured = measured,
                            .diffuse = {},
                            .specular = {},
                            .noiseSigma = {}};
      for (int c = 0; c < 3; ++c)
        sample.noiseSigma[c] =
            static_cast<float>(std::sqrt(dc ? m.dcVariance(site, c) : m.variance(site, c)));
      samples.push_back(sample);
    };
    auto addGroups = [&](const std::vector<FrequencyGroup>& groups, const MeasurementStore& store,
                         bool holdout) {
      if (store.empty()) return;  // held-out photographs not read: a cancelled fit
      const SiteBlock block = store.block(site, 1, MeasurementStore::kZ);
      for (std::size_t f = 0; f < groups.size(); ++f) {
        const float* at = block.z(site) + f * 6;
        add(groups[f].frequency, holdout,
            {Complex(at[0], at[3]), Complex(at[1], at[4]), Complex(at[2], at[5])}, false);
      }
    };
    add(Eigen::Vector2i::Zero(), false,
        {Complex(m.dc[site * 3]), Complex(m.dc[site * 3 + 1]), Complex(m.dc[site * 3 + 2])}, true);
    addGroups(m.plan.fitted, m.store, false);
    addGroups(m.plan.heldOut, m.heldOut, true);
    std::vector<Eigen::Vector2d> frequencies;
    for (const auto& sample : samples) frequencies.push_back(sample.frequency.cast<double>());
    parts(site, frequencies, [&](int i, Complex diffuse, Complex lobe) {
      for (int c = 0; c < 3; ++c) {
        samples[i].diffuse[c] = state_->sites[site].diffuse[c] * diffuse;
        samples[i].specular[c] = state_->sites[site].specular[c] * lobe;
      }
    });
    return samples;
  }

  std::vector<SpectrumCurvePoint> modelSpectrumAt(int texelX, int texelY, Eigen::Vector2d direction,
                                                  double maxFrequency, int count) const override {
    const auto found = state_->siteOfTexel(texelX, texelY);
    if (found < 0 || count < 2) return {};
    const auto site = static_cast<std::size_t>(found);
    std::vector<Eigen::Vector2d> frequencies;
    for (int i = 0; i < count; ++i) frequencies.push_back(direction * (maxFrequency * i / (count - 1)));
    std::vector<SpectrumCurvePoint> curve(count);
    parts(site, frequencies, [&](int i, Complex diffuse, Complex lobe) {
      curve[i].frequency = maxFrequency * i / (count - 1);
      for (int c = 0; c < 3; ++c) {
        curve[i].diffuse[c] = state_->sites[site].diffuse[c] * diffuse;
        curve[i].specular[c] = state_->sites[site].specular[c] * lobe;
      }
    });
    return curve;
  }

  LobeSlice lobeAt(int texelX, int texelY, bool horizontal, int count) const override {
    LobeSlice slice;
    slice.horizontal = horizontal;
    const auto found = state_->siteOfTexel(texelX, texelY);
    if (found < 0 || count < 2) return slice;
    const auto site = static_cast<std::size_t>(found);
    const int axis = horizontal ? 0 : 1;
    const double half = state_->frame.halfExtent[axis];
    const Eigen::Vector2d direction = horizontal ? Eigen::Vector2d(1, 0) : Eigen::Vector2d(0, 1);
    const SvbrdfParameters& p = state_->sites[site];
    const SiteLobe lobe = siteLobe(state_->frame, state_->geometry(site), p, state_->options.lobe);

    // The diffuse part's profile has no energy beyond frequency 12 under a window that falls off at the rim.
    constexpr int kDiffuseTerms = 192;
    constexpr double kDiffuseHighest = 12;
    std::vector<Eigen::Vector2d> frequencies;
    for (int i = 0; i < kDiffuseTerms; ++i)
      frequencies.push_back(direction * (kDiffuseHighest * i / (kDiffuseTerms - 1)));
    std::vector<Complex> diffuse(kDiffuseTerms);
    parts(site, frequencies, [&](int i, Complex d, Complex) { diffuse[i] = d; });

    // Measurements on this axis, by frequency.
    std::vector<std::pair<double, std::array<Complex, 3>>> measured;
    const FourierMeasurements& m = state_->measurements;
    measured.push_back(
        {0.0, {Complex(m.dc[site * 3]), Complex(m.dc[site * 3 + 1]), Complex(m.dc[site * 3 + 2])}});
    const SiteBlock block = m.store.block(site, 1, MeasurementStore::kZ);
    for (int f = 0; f < m.frequencyCount(); ++f) {
      const auto& w = m.plan.fitted[f].frequency;
      if (w[1 - axis] != 0 || w[axis] <= 0) continue;
      const float* z = block.z(site) + f * 6;
      measured.push_back(
          {static_cast<double>(w[axis]), {Complex(z[0], z[3]), Complex(z[1], z[4]), Complex(z[2], z[5])}});
    }
    std::ranges::sort(measured, {}, [](const auto& entry) { return entry.first; });

    for (int i = 0; i < count; ++i) {
      const double x = half * (2.0 * i / (count - 1) - 1);
      slice.position.push_back(x);
      double specular = 0;
      for (const auto& g : lobe.gaussian) {
        const double mean = horizontal ? g.meanX : g.meanY, variance = horizontal ? g.xx : g.yy;
        specular += g.mass / std::sqrt(2 * std::numbers::pi * variance) *
                    std::exp(-0.5 * (x - mean) * (x - mean) / variance);
      }
      double smooth = 0;
      const double step = kDiffuseHighest / (kDiffuseTerms - 1);
      for (int k = 0; k < kDiffuseTerms; ++k) {
        const double w = step * k;
        smooth += (k == 0 ? 0.5 : 1.0) * step / std::numbers::pi *
                  (diffuse[k].real() * std::cos(w * x) - diffuse[k].imag() * std::sin(w * x));
      }
      std::array<float, 3> model{}, sum{};
      for (int c = 0; c < 3; ++c)
        model[c] = static_cast<float>(p.diffuse[c] * smooth + p.specular[c] * specular);
      // Inverse transform of the few samples, trapezoid rule between them, nothing beyond the last: the
      // ringing is the point (section 4.4).
      for (std::size_t k = 0; k < measured.size(); ++k) {
        const double before = k > 0 ? measured[k].first - measured[k - 1].first : 0;
        const double after = k + 1 < measured.size() ? measured[k + 1].first - measured[k].first : 0;
        const double w = measured[k].first, share = (before + after) / 2 / std::numbers::pi;
        for (int c = 0; c < 3; ++c)
          sum[c] += static_cast<float>(share * (measured[k].second[c].real() * std::cos(w * x) -
                                                measured[k].second[c].imag() * std::sin(w * x)));
      }
      slice.model.push_back(model);
      slice.measured.push_back(sum);
    }
    return slice;
  }

 private:
  /// Calls `take(i, diffuse, lobe)` with the two transforms for unit albedo at every frequency.
  template <typename Take>
  void parts(std::size_t site, const std::vector<Eigen::Vector2d>& frequencies, Take take) const {
    const SvbrdfParameters& p = state_->sites[site];
    const SiteLobe lobe = siteLobe(state_->frame, state_->geometry(site), p, state_->options.lobe);
    const Eigen::Vector3f n = normalOnScreen(state_->frame, p.normal);
    const std::vector<float> v =
        DiffuseTransform::atPoint(state_->frame, state_->measurements.sites.pointMm[site].cast<double>(),
                                  frequencies, state_->diffuseMethod(), state_->shape);
    for (std::size_t i = 0; i < frequencies.size(); ++i) {
      const float* at = v.data() + i * 6;
      take(static_cast<int>(i),
           Complex(n.x() * at[0] + n.y() * at[2] + n.z() * at[4],
                   n.x() * at[1] + n.y() * at[3] + n.z() * at[5]),
           lobe.transform(frequencies[i].cast<float>()));
    }
  }

  std::unique_ptr<FourierFitState> state_;
};

}  // namespace

const FourierFitState& fitState(const FourierFit& fit) {
  const auto* finished = dynamic_cast<const FinishedFit*>(&fit);
  if (!finished) throw std::invalid_argument("fitState: not a fit of fitFourier or loadFourierFit");
  return finished->state();
}

std::shared_ptr<const FourierFit> makeFourierFit(std::unique_ptr<FourierFitState> state) {
  return std::make_shared<FinishedFit>(std::move(state));
}

}  // namespace patina
