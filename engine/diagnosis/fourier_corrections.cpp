#include "engine/diagnosis/fourier_corrections.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <atomic>
#include <cmath>

#include "engine/diagnosis/site_horizon.h"

namespace patina {
namespace {

bool bendsLight(const EffectState& state) {
  for (const char* id :
       {"self-shadowing", "screen-response", "anisotropy", "third-lobe", "fresnel", "sheen",
        "retroreflection", "clearcoat", "iridescence", "basis-deviation", "glare", "defocus", "subsurface"})
    if (state.has(id)) return true;
  return false;
}

/// The state without what the corrections carry otherwise: what is left is to be predicted.
EffectState plainState(const EffectState& state) {
  EffectState plain;
  plain.screen.angular = state.screen.angular;
  plain.screen.spatial = state.screen.spatial;
  plain.level = state.level;
  plain.pose = state.pose;
  plain.height = state.height;
  plain.material.resize(state.material.size());
  return plain;
}

EffectState lightState(const EffectState& state) {
  EffectState light = state;
  light.responseGamma = light.responseCompression = light.blackOffset = light.stray = 0;
  light.mix.setZero();
  light.photoGain.clear();
  light.photoOffset.clear();
  light.drift = {};
  light.saturation = {};
  return light;
}

}  // namespace

Result<CorrectedCapture> correctCapture(const DiagnosisSession& session, std::size_t index,
                                        const JobContext& job) {
  const DiagnosisCapture& capture = session.captures[index];
  const EffectState& state = session.states[index];
  const FourierFitState& fit = *capture.state;
  CorrectedCapture out{fit.capture, nullptr, {}, {}};
  auto corrections = std::make_shared<FourierCorrections>();
  const double scale = capture.fullScale;

  if (!state.pose.isZero()) {
    const Eigen::Vector3d turn = state.pose.head<3>();
    if (turn.norm() > 0)
      out.capture.screen.worldFromScreen =
          Eigen::AngleAxisd(turn.norm(), turn.normalized()).toRotationMatrix() *
          out.capture.screen.worldFromScreen;
    out.capture.screen.originMm += state.pose.tail<3>();
  }
  if (!state.height.isZero()) {
    const double width = fit.capture.sampleWidthMm, height = fit.capture.sampleHeightMm;
    const Eigen::Matrix<double, 6, 1> h = state.height;
    corrections->heightMm = [h, width, height](const Eigen::Vector2d& p) {
      const double x = 2 * p.x() / width, y = 2 * p.y() / height;
      return h[0] + h[1] * x + h[2] * y + h[3] * x * x + h[4] * x * y + h[5] * y * y;
    };
  }
  const bool emission = std::ranges::any_of(state.screen.angular, [](float a) { return a != 0; }) ||
                        std::ranges::any_of(state.screen.spatial, [](float a) { return a != 0; }) ||
                        state.level != 0;
  if (emission) {
    const QuadratureState screen = state.screen;
    const Eigen::Vector2d half = fit.frame.halfExtent;
    const double level = state.level;
    corrections->logEmission = [screen, half, level](const Eigen::Vector2d& x, const Eigen::Vector2d& foot,
                                                     double distance) {
      const Eigen::Vector2d local = x - foot;
      const double length = std::sqrt(local.squaredNorm() + distance * distance);
      return level + quadrature::logEmission(screen, local.x() / length, local.y() / length, x.x() / half.x(),
                                             x.y() / half.y());
    };
  }
  if (state.responseGamma != 0 || state.responseCompression != 0 || state.saturation[0] != 0 ||
      state.saturation[1] != 0) {
    // The sensor's curve, inverted by bisection: it increases over the range that photographs have.
    const double gamma = state.responseGamma, compression = state.responseCompression;
    const std::array<double, 2> lost = state.saturation;
    const auto recorded = [=](double v) {
      double y = v * std::pow(std::max(v, 1e-6), gamma) / (1 + compression * std::max(v, 0.0));
      for (int k = 0; k < 2; ++k)
        y -= std::clamp(lost[static_cast<std::size_t>(k)], -0.5, 0.95) *
             std::max(0.0, y - (k == 0 ? 0.6 : 0.8));
      return y;
    };
    corrections->linearFromPhoto = [=](float photo) {
      const double wanted = photo / scale;
      if (wanted <= 1e-5) return photo;
      double low = 0, high = 4;
      if (recorded(high) < wanted) return static_cast<float>(high * scale);
      for (int step = 0; step < 60; ++step) {
        const double middle = 0.5 * (low + high);
        (recorded(middle) < wanted ? low : high) = middle;
      }
      return static_cast<float>(0.5 * (low + high) * scale);
    };
  }
  if (!state.mix.isZero()) {
    Eigen::Matrix3d mix = Eigen::Matrix3d::Identity() + state.mix;
    for (int c = 0; c < 3; ++c) mix(c, c) = 1 - (state.mix.row(c).sum() - state.mix(c, c));
    corrections->unmix = mix.inverse().cast<float>();
  }
  // Photographs, one by one.
  const std::size_t photos = fit.capture.photos.size(), rows = capture.rowCount();
  const bool drift = state.drift[0] != 0 || state.drift[1] != 0 || state.drift[2] != 0;
  if (!state.photoGain.empty() || drift) {
    corrections->photoGain.assign(photos, 1.0f);
    for (std::size_t r = 0; r < rows; ++r) {
      if (capture.rows[r].photo < 0) continue;
      double gain = 1 + (state.photoGain.empty() ? 0 : state.photoGain[r]);
      for (int k = 0; k < kDriftCurves; ++k)
        gain += state.drift[static_cast<std::size_t>(k)] * driftCurve(k, capture.rows[r].time);
      corrections->photoGain[static_cast<std::size_t>(capture.rows[r].photo)] =
          static_cast<float>(std::max(gain, 0.05));
    }
  }
  if (!state.photoOffset.empty() || state.blackOffset != 0 || state.stray != 0) {
    corrections->photoOffset.assign(photos, Eigen::Array3f::Zero());
    const FourierDiagnosisModel model = modelOf(session, index);
    for (std::size_t r = 0; r < rows; ++r) {
      if (capture.rows[r].photo < 0) continue;
      Eigen::Array3d offset = Eigen::Array3d::Constant(
          state.blackOffset + (state.photoOffset.empty() ? 0 : state.photoOffset[r]));
      offset += state.stray * model.meanOfRow(r);
      corrections->photoOffset[static_cast<std::size_t>(capture.rows[r].photo)] = offset.cast<float>();
    }
  }
  // Every site's parameters under the state; then what the effects add there.
  const std::size_t sites = fit.measurements.sites.size();
  auto parameters = std::make_shared<std::vector<SvbrdfParameters>>(fit.sites);
  if (bendsLight(state)) {
    const std::size_t fitted = fit.measurements.plan.fitted.size(),
                      heldOut = capture.frequencies.size() - fitted;
    const std::size_t width = capture.frequencies.size() * 12 + 3;
    auto extra = std::make_shared<std::vector<float>>(sites * width, 0.0f);
    DiagnosisSession light = session;
    light.states[index] = lightState(state);
    DiagnosisSession plain = session;
    plain.states[index] = plainState(state);
    const FourierDiagnosisModel full = modelOf(session, index), with = modelOf(light, index),
                                without = modelOf(plain, index);
    std::atomic<std::int64_t> done{0};
    out.horizonSine.assign(sites, 0);
    out.stretch.assign(sites, {0, 0});
    constexpr std::size_t kChunk = 64;
    tbb::parallel_for(std::size_t{0}, (sites + kChunk - 1) / kChunk, [&](std::size_t chunk) {
      if (job.cancelled()) return;
      DiagnosisCapture part;  // the sites of this chunk alone
      part.fit = capture.fit;
      part.state = capture.state;
      part.frequencies = capture.frequencies;
      part.rows = capture.rows;
      part.clusterCount = capture.clusterCount;
      part.fullScale = capture.fullScale;
      part.knownLambertian = capture.knownLambertian;
      const std::size_t first = chunk * kChunk, end = std::min(sites, first + kChunk);
      for (std::size_t s = first; s < end; ++s) {
        const TexelStatus status = fit.siteStatus[s];
        if (status == TexelStatus::Failed || status == TexelStatus::Cancelled ||
            status == TexelStatus::NotMeasured || status == TexelStatus::Clipped)
          continue;
        DiagnosisSite site;
        site.site = s;
        site.cluster = capture.clusterOfSite[s];
        loadSite(part, site);
        part.sites.push_back(std::move(site));
      }
      if (state.has("anisotropy"))
        for (DiagnosisSite& site : part.sites) site.ownStretch = true;
      refineSites(part, full, state.has("anisotropy") ? 7 : 4, job, false);
      if (state.has("self-shadowing")) findHorizons(part, full, job, &capture.sites);
      SiteColumns a, b;
      for (const DiagnosisSite& site : part.sites) {
        if (job.cancelled()) return;
        with.evaluate(site, quadrature::kPrediction, a);
        DiagnosisSite bare = site;
        bare.horizonSine = 0, bare.stretch = {0, 0};
        without.evaluate(bare, quadrature::kPrediction, b);
        out.horizonSine[site.site] = site.horizonSine;
        out.stretch[site.site] = site.stretch;
        SvbrdfParameters& p = (*parameters)[site.site];
        p.diffuse = site.diffuse;
        p.specular = site.specular;
        p.normal = Eigen::Vector3f(site.model.slopeX, site.model.slopeY, 1).normalized();
        p.sigma = site.model.sigma;
        p.kurtosis = site.model.kurtosis;
        float* to = extra->data() + site.site * width;
        for (std::size_t f = 0; f < capture.frequencies.size(); ++f) {
          for (std::size_t c = 0; c < 3; ++c) {
            float gap[4];
            for (std::size_t k = 0; k < 4; ++k)
              gap[k] = a.predicted[(4 * f + k) * 3 + c] - b.predicted[(4 * f + k) * 3 + c];
            to[f * 12 + c] = gap[1] - gap[3];
            to[f * 12 + 3 + c] = -(gap[0] - gap[2]);
            to[f * 12 + 6 + c] = gap[0] + gap[2];
            to[f * 12 + 9 + c] = gap[1] + gap[3];
          }
        }
        for (std::size_t c = 0; c < 3; ++c)
          to[width - 3 + c] = a.predicted[(rows - 1) * 3 + c] - b.predicted[(rows - 1) * 3 + c];
      }
      done += static_cast<std::int64_t>(end - first);
      job.progress("correct", done, static_cast<std::int64_t>(sites), "texels");
    });
    if (job.cancelled()) return Error{ErrorCode::Cancelled, "cancelled while predicting the effects", "", ""};
    corrections->extra = [extra, fitted, heldOut, width](std::size_t site, bool held, float* z, float* even,
                                                         float* window) {
      const float* from = extra->data() + site * width;
      const std::size_t first = held ? fitted : 0, count = held ? heldOut : fitted;
      for (std::size_t f = 0; f < count; ++f) {
        for (std::size_t k = 0; k < 6; ++k) {
          if (z) z[f * 6 + k] += from[(first + f) * 12 + k];
          if (even) even[f * 6 + k] += from[(first + f) * 12 + 6 + k];
        }
      }
      if (window && !held)
        for (std::size_t c = 0; c < 3; ++c) window[c] += from[width - 3 + c];
    };
  }
  corrections->sites = parameters;
  out.corrections = corrections;
  return out;
}

}  // namespace patina
