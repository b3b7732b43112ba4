#include "engine/diagnosis/fourier_columns.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>

namespace patina {
namespace {

using quadrature::Want;

constexpr int kDiffuseHorizon = int{quadrature::kDiffuseLight} + int{quadrature::kHorizonAt},
              kSpecularHorizon = int{quadrature::kSpecularLight} + int{quadrature::kHorizonAt};
constexpr double kTurnStepRad = 1e-3, kShiftStepMm = 0.5;

/// Steps of the heights' polynomials over half the sample.
std::array<double, 6> heightBasis(const Eigen::Vector2f& pointMm, double widthMm, double heightMm) {
  const double x = 2 * pointMm.x() / widthMm, y = 2 * pointMm.y() / heightMm;
  return {1, x, y, x * x, x * y, y * y};
}

}  // namespace

double driftCurve(int curve, double time) {
  switch (curve) {
    case 0:
      return -std::exp(-time / 0.12);
    case 1:
      return -std::exp(-time / 0.4);
    default:
      return time - 0.5;
  }
}

bool EffectState::has(std::string_view id) const {
  return std::ranges::find(added, id) != added.end();
}

int EffectColumns::add(std::string_view effect, std::string name, double prior) {
  dense_.push_back({effect, std::move(name), prior});
  return static_cast<int>(dense_.size()) - 1;
}

EffectColumns::EffectColumns(const DiagnosisCapture& capture) : offsetPrior_(0.03 * capture.fullScale) {
  for (const char* name : {"u^2", "v^2", "v", "0.35", "0.55", "0.75"}) add("emission-angular", name, 0.5);
  // Of a paper with a known albedo the emission's level shows too; elsewhere the albedos take it.
  if (capture.knownLambertian) add("emission-angular", "level", 0.2);
  for (const char* name : {"x", "y", "x^2", "x y", "y^2", "(x^2+y^2)^2"}) add("emission-spatial", name, 0.3);
  if (capture.knownLambertian) add("emission-spatial", "level", 0.2);
  for (const char* name : {"1", "2", "3"}) add("self-shadowing", name, 0.5);
  add("screen-response", "gamma", 0.2);
  add("screen-drift", "fast", 0.1);
  add("screen-drift", "slow", 0.1);
  add("screen-drift", "steady", 0.1);
  for (const char* name : {"turn x", "turn y", "turn z"}) add("screen-pose", name, 0.02);
  for (const char* name : {"shift x", "shift y", "shift z"}) add("screen-pose", name, 5);
  for (const char* name : {"x", "y"}) add("sample-tilt", name, 1.5);
  for (const char* name : {"1", "x^2", "x y", "y^2"}) add("sample-height", name, 2);
  add("anisotropy", "stretch 1", 0.5);
  add("anisotropy", "stretch 2", 0.5);
  add("third-lobe", "near", 0.5);
  add("third-lobe", "broad", 0.5);
  add("fresnel", "power", 2);
  add("sheen", "strength", 0.1);
  add("retroreflection", "strength", 0.1);
  add("clearcoat", "strength", 0.02);
  add("iridescence", "red-green", 0.5);
  add("iridescence", "blue", 0.5);
  for (const char* name : {"core", "shoulder", "tail", "in plane"}) add("basis-deviation", name, 0.3);
  add("subsurface", "2 mm", 0.2);
  add("subsurface", "6 mm", 0.2);
  add("glare", "share", 0.1);
  add("defocus", "sigma^2", 0.5);
  add("vignetting", "corner", 0.2);
  add("camera-response", "gamma", 0.1);
  add("camera-response", "compression", 0.2);
  add("black-level", "offset", 0.03 * capture.fullScale);
  for (const char* name : {"RG", "RB", "GR", "GB", "BR", "BG"}) add("channel-crosstalk", name, 0.05);
  add("stray-light", "share", 0.05);
  add("saturation", "0.6", 0.5);
  add("saturation", "0.8", 0.5);
}

EffectColumns::Range EffectColumns::rangeOf(std::string_view effect) const {
  Range range;
  for (int k = 0; k < denseCount(); ++k) {
    if (dense_[static_cast<std::size_t>(k)].effect != effect) continue;
    if (range.first < 0) range.first = k;
    ++range.count;
  }
  return range;
}

int EffectColumns::indexOf(std::string_view effect, std::string_view name) const {
  for (int k = 0; k < denseCount(); ++k)
    if (dense_[static_cast<std::size_t>(k)].effect == effect &&
        dense_[static_cast<std::size_t>(k)].name == name)
      return k;
  return -1;
}

bool EffectColumns::perMaterial(std::string_view effect) {
  for (const std::string_view id : {"anisotropy", "third-lobe", "fresnel", "sheen", "retroreflection",
                                    "clearcoat", "iridescence", "basis-deviation", "subsurface"})
    if (id == effect) return true;
  return false;
}

FourierDiagnosisModel::FourierDiagnosisModel(const DiagnosisCapture& capture, const EffectColumns& columns,
                                             const EffectState& state)
    : capture_(capture),
      columns_(columns),
      state_(state),
      quadrature_(capture.state->frame,
                  {capture.state->capture.sampleWidthMm, capture.state->capture.sampleHeightMm},
                  capture.frequencies, state.screen),
      cameraMm_(capture.state->capture.camera.positionMm()) {
  const ScreenFrame& frame = capture.state->frame;
  const Eigen::Matrix3d worldFromScreen = frame.screenFromWorld.transpose();
  const auto turned = [&](const Eigen::Vector3d& turn) -> Eigen::Matrix3d {
    const double angle = turn.norm();
    const Eigen::Matrix3d rotation =
        angle > 0 ? Eigen::AngleAxisd(angle, turn / angle).toRotationMatrix() : Eigen::Matrix3d::Identity();
    return (rotation * worldFromScreen).transpose();
  };
  const Eigen::Vector3d pose = state.pose.head<3>();
  turned_[0] = turned(pose);
  for (int k = 0; k < 3; ++k)
    turned_[static_cast<std::size_t>(k + 1)] = turned(pose + kTurnStepRad * Eigen::Vector3d::Unit(k));
  meanOfRow_.assign(capture.rowCount(), Eigen::Array3d::Zero());
  // A picture's mean over the sample, as predicted.
  SiteColumns scratch;
  const std::size_t step = std::max<std::size_t>(1, capture.sites.size() / 150);
  double count = 0;
  for (std::size_t i = 0; i < capture.sites.size(); i += step) {
    light(capture.sites[i], Want::kPrediction, scratch);
    for (std::size_t r = 0; r < capture.rowCount(); ++r)
      for (std::size_t c = 0; c < 3; ++c)
        meanOfRow_[r][static_cast<Eigen::Index>(c)] += scratch.light[r * 3 + c];
    ++count;
  }
  for (auto& mean : meanOfRow_) mean /= std::max(count, 1.0);
}

/// Direction of a stretch along the plane of view, in the sample's frame: cosine and sine of twice its
/// azimuth.
std::array<double, 2> FourierDiagnosisModel::planeOfView(const QuadratureSite& site) const {
  const Eigen::Vector3d view =
      (site.cameraMm ? *site.cameraMm : cameraMm_) - Eigen::Vector3d(site.pointMm.x(), site.pointMm.y(), 0);
  const double angle = 2 * std::atan2(view.y(), view.x());
  return {std::cos(angle), std::sin(angle)};
}

QuadratureSite FourierDiagnosisModel::moved(const QuadratureSite& site, int axis, double shiftMm,
                                            double heightMm) const {
  ScreenFrame frame = quadrature_.frame();
  const std::size_t turn = axis >= 0 && axis < 3 ? static_cast<std::size_t>(axis + 1) : 0;
  frame.screenFromWorld = turned_[turn];
  Eigen::Vector3d shift = state_.pose.tail<3>();
  if (axis >= 3) shift[axis - 3] += shiftMm;
  frame.originUnits += shift / frame.unitMm;
  // A raised point lies farther along its pixel's ray.
  const Eigen::Vector3d& camera = site.cameraMm ? *site.cameraMm : cameraMm_;
  Eigen::Vector3d point(site.pointMm.x(), site.pointMm.y(), 0);
  const Eigen::Vector3d ray = camera - point;
  point += ray * (heightMm / ray.z());
  QuadratureSite out = site;
  out.geometry = siteGeometry(frame, point, camera);
  out.screenFromWorld = &turned_[turn];
  return out;
}

QuadratureSite FourierDiagnosisModel::placed(const DiagnosisSite& site) const {
  const EffectState::Material material = static_cast<std::size_t>(site.cluster) < state_.material.size()
                                             ? state_.material[static_cast<std::size_t>(site.cluster)]
                                             : EffectState::Material{};
  QuadratureSite at = site.model;
  if (!state_.pose.isZero() || !state_.height.isZero()) {
    const auto basis = heightBasis(at.pointMm, capture_.state->capture.sampleWidthMm,
                                   capture_.state->capture.sampleHeightMm);
    double height = 0;
    for (int k = 0; k < 6; ++k) height += state_.height[k] * basis[static_cast<std::size_t>(k)];
    at = moved(at, -1, 0, height);
  }
  const std::array<double, 2> inPlane = planeOfView(site.model);
  at.stretch1 += site.stretch[0] + static_cast<float>(material.stretch[0] + material.inPlane * inPlane[0]);
  at.stretch2 += site.stretch[1] + static_cast<float>(material.stretch[1] + material.inPlane * inPlane[1]);
  at.horizonSine = site.horizonSine;
  at.fresnelPower = static_cast<float>(material.fresnelPower);
  for (std::size_t k = 0; k < 3; ++k) at.freeForm[k] = static_cast<float>(material.freeForm[k]);
  return at;
}

void FourierDiagnosisModel::light(const DiagnosisSite& site, Want want, SiteColumns& out) const {
  const std::size_t rows = capture_.rowCount();
  const EffectState::Material material = static_cast<std::size_t>(site.cluster) < state_.material.size()
                                             ? state_.material[static_cast<std::size_t>(site.cluster)]
                                             : EffectState::Material{};
  const bool terms = material.third[0] != 0 || material.third[1] != 0 || material.clearcoat != 0 ||
                     material.sheen != 0 || material.retro != 0 || material.iridescence[0] != 0 ||
                     material.iridescence[1] != 0;
  out.quadrature.resize(static_cast<std::size_t>(quadrature::kColumns) * rows);
  out.light.resize(rows * 3);
  const bool horizon = site.horizonSine > 0 && want != Want::kPrediction;
  out.onScreen =
      quadrature_.evaluate(placed(site), terms || horizon ? Want::kEverything : want, out.quadrature.data());
  const float level = static_cast<float>(std::exp(state_.level));
  const float* d = out.quadrature.data();
  const float* s = d + static_cast<std::size_t>(quadrature::kSpecularStart) * rows;
  const float* t = d + static_cast<std::size_t>(quadrature::kTermStart) * rows;
  const auto specularColumn = [&](int k) { return s + static_cast<std::size_t>(k) * rows; };
  const auto term = [&](int k) { return t + static_cast<std::size_t>(k) * rows; };
  constexpr float kChroma[2][3] = {{1, -1, 0}, {0.5f, 0.5f, -1}};
  for (std::size_t r = 0; r < rows; ++r) {
    for (int c = 0; c < 3; ++c) {
      double value = site.diffuse[c] * d[r] + site.specular[c] * s[r];
      if (terms) {
        value += site.specular[c] * (material.third[0] * (term(quadrature::kThirdLobe)[r] - s[r]) +
                                     material.third[1] * (term(quadrature::kThirdLobeBroad)[r] - s[r]));
        value += material.clearcoat * term(quadrature::kClearcoat)[r] +
                 material.sheen * term(quadrature::kSheen)[r] + material.retro * term(quadrature::kRetro)[r];
        value += site.specular[c] * specularColumn(quadrature::kIridescence)[r] *
                 (material.iridescence[0] * kChroma[0][c] + material.iridescence[1] * kChroma[1][c]);
      }
      out.light[r * 3 + static_cast<std::size_t>(c)] = level * static_cast<float>(value);
    }
  }
}

void FourierDiagnosisModel::geometryColumns(const DiagnosisSite& site, SiteColumns& out) const {
  const std::size_t rows = capture_.rowCount();
  const QuadratureSite base = placed(site);
  const auto basis = heightBasis(base.pointMm, capture_.state->capture.sampleWidthMm,
                                 capture_.state->capture.sampleHeightMm);
  double height = 0;
  for (int k = 0; k < 6; ++k) height += state_.height[k] * basis[static_cast<std::size_t>(k)];
  std::vector<float> probe(static_cast<std::size_t>(quadrature::kColumns) * rows);
  const float* d0 = out.quadrature.data();
  const float* s0 = d0 + static_cast<std::size_t>(quadrature::kSpecularStart) * rows;
  const float* s = probe.data() + static_cast<std::size_t>(quadrature::kSpecularStart) * rows;
  const EffectColumns::Range pose = columns_.rangeOf("screen-pose"), tilt = columns_.rangeOf("sample-tilt"),
                             bent = columns_.rangeOf("sample-height");
  for (int axis = 0; axis < 7; ++axis) {
    QuadratureSite at =
        axis < 6 ? moved(base, axis, kShiftStepMm, height) : moved(base, -1, 0, height + kShiftStepMm);
    quadrature_.evaluate(at, Want::kPrediction, probe.data());
    const double perStep = 1 / (axis < 3 ? kTurnStepRad : kShiftStepMm);
    for (int c = 0; c < 3; ++c) {
      for (std::size_t r = 0; r < rows; ++r) {
        const double change =
            (site.diffuse[c] * (probe[r] - d0[r]) + site.specular[c] * (s[r] - s0[r])) * perStep;
        const Eigen::Index row = static_cast<Eigen::Index>(static_cast<std::size_t>(c) * rows + r);
        if (axis < 6) {
          out.effect(row, pose.first + axis) = change;
        } else {
          out.effect(row, tilt.first) = change * basis[1];
          out.effect(row, tilt.first + 1) = change * basis[2];
          out.effect(row, bent.first) = change;
          for (int k = 0; k < 3; ++k)
            out.effect(row, bent.first + 1 + k) = change * basis[static_cast<std::size_t>(3 + k)];
        }
      }
    }
  }
}

namespace {

/// Mean of the neighbours' light with weights by distance, minus the site's own; empty where too few are
/// there. `at`: [site][row * 3].
void spread(const DiagnosisCapture& capture, const std::vector<float>& pictures, const DiagnosisSite& site,
            double radiusPx, int stepPx,
            const std::function<double(double, double, const Eigen::Vector2f&)>& weight, const float* own,
            std::vector<float>& out) {
  const SiteSet& set = capture.state->measurements.sites;
  const std::size_t width = capture.rowCount() * 3;
  out.assign(width, 0);
  if (set.grouped()) return;
  const int x0 = static_cast<int>(site.pixel.x()), y0 = static_cast<int>(site.pixel.y());
  const int reach = static_cast<int>(std::ceil(radiusPx));
  double total = 0, wanted = 0;
  for (int dy = -reach; dy <= reach; dy += stepPx) {
    for (int dx = -reach; dx <= reach; dx += stepPx) {
      const int x = x0 + dx, y = y0 + dy;
      std::int64_t other = -1;
      if (x >= 0 && y >= 0 && x < set.imageWidth && y < set.imageHeight)
        other = set.siteOfPixel[static_cast<std::size_t>(y) * static_cast<std::size_t>(set.imageWidth) +
                                static_cast<std::size_t>(x)];
      const double w =
          weight(dx, dy, other >= 0 ? set.pointMm[static_cast<std::size_t>(other)] : site.model.pointMm);
      if (w <= 0) continue;
      wanted += w;
      if (other < 0) continue;
      const float* from = pictures.data() + static_cast<std::size_t>(other) * width;
      if (from[0] < 0) continue;  // no prediction there
      total += w;
      const float wf = static_cast<float>(w);
      for (std::size_t i = 0; i < width; ++i) out[i] += wf * from[i];
    }
  }
  constexpr double kEnough = 0.6;
  if (total < kEnough * wanted || total <= 0) {
    std::fill(out.begin(), out.end(), 0.0f);
    return;
  }
  const float scale = static_cast<float>(1 / total);
  for (std::size_t i = 0; i < width; ++i) out[i] = out[i] * scale - own[i];
}

}  // namespace

void FourierDiagnosisModel::spreadColumns(const DiagnosisSite& site, SiteColumns& out, bool all) const {
  const std::size_t rows = capture_.rowCount();
  const auto put = [&](int column, const std::vector<float>& change, double factor) {
    for (int c = 0; c < 3; ++c)
      for (std::size_t r = 0; r < rows; ++r)
        out.effect(static_cast<Eigen::Index>(static_cast<std::size_t>(c) * rows + r), column) =
            factor * change[r * 3 + static_cast<std::size_t>(c)];
  };
  const int glare = columns_.rangeOf("glare").first, defocus = columns_.rangeOf("defocus").first,
            subsurface = columns_.rangeOf("subsurface").first;
  std::vector<float> change(rows * 3, 0);
  if (!pictures_ || !pictures_->available()) {
    for (const int column : {glare, defocus, subsurface, subsurface + 1}) put(column, change, 0);
    return;
  }
  const float* own = pictures_->whole.data() + site.site * rows * 3;
  const auto gaussian = [](double sigma) {
    return [sigma](double dx, double dy, const Eigen::Vector2f&) {
      return std::exp(-(dx * dx + dy * dy) / (2 * sigma * sigma));
    };
  };
  if (all || state_.glare != 0) {
    spread(capture_, pictures_->whole, site, 9, 2, gaussian(4), own, change);
    put(glare, change, 1);
  }
  // A blur of variance s adds s / 2 times the Laplacian: by a blur of variance 0.49, per unit.
  if (all || state_.defocus != 0 || state_.footprint != 0) {
    spread(capture_, pictures_->whole, site, 2, 1, gaussian(0.7), own, change);
    put(defocus, change, 1 / 0.49);
  }
  const float* ownDiffuse = pictures_->diffuse.data() + site.site * rows * 3;
  const double pitch = std::max(capture_.state->measurements.sites.finestPitchMm, 1e-3);
  for (int k = 0; k < 2; ++k) {
    if (!all && state_.subsurface[static_cast<std::size_t>(k)] == 0) continue;
    const double reachMm = k == 0 ? 2 : 6, radius = std::min(3 * reachMm / pitch, 16.0);
    const auto fade = [&](double, double, const Eigen::Vector2f& p) {
      return std::exp(-(p - site.model.pointMm).norm() / reachMm);
    };
    spread(capture_, pictures_->diffuse, site, radius, radius > 8 ? 2 : 1, fade, ownDiffuse, change);
    put(subsurface + k, change, 1);
  }
}

void FourierDiagnosisModel::evaluate(const DiagnosisSite& site, Want want, SiteColumns& out,
                                     const WantedColumns& wanted) const {
  const std::size_t rows = capture_.rowCount();
  light(site, want == Want::kEverything && !wanted.light ? Want::kParameters : want, out);
  const double scale = capture_.fullScale;
  const bool everything = want == Want::kEverything;
  out.predicted.resize(rows * 3);
  const Eigen::Index total = static_cast<Eigen::Index>(3 * rows);
  if (everything) {
    out.effect.setZero(total, columns_.denseCount());
    out.gain.setZero(static_cast<Eigen::Index>(rows), 3);
    out.offset.setZero(static_cast<Eigen::Index>(rows), 3);
    if (wanted.geometry) geometryColumns(site, out);
  }
  const double blur = state_.defocus + state_.footprint;
  const bool lens = state_.glare != 0 || blur != 0 || state_.subsurface[0] != 0 || state_.subsurface[1] != 0;
  if ((everything && wanted.spread) || lens) {
    if (!everything) out.effect.setZero(total, columns_.denseCount());
    spreadColumns(site, out, everything && wanted.spread);
  }
  const int glare = columns_.rangeOf("glare").first, defocus = columns_.rangeOf("defocus").first,
            subsurface = columns_.rangeOf("subsurface").first;
  // Light, time, lens, sensor; slope: d photographed / d light.
  std::vector<double> slope(rows * 3), recorded(rows * 3);
  std::vector<double> lit(rows * 3);
  for (std::size_t r = 0; r < rows; ++r) {
    double gain = 1;
    if (!state_.photoGain.empty()) gain += state_.photoGain[r];
    for (int k = 0; k < kDriftCurves; ++k)
      gain += state_.drift[static_cast<std::size_t>(k)] * driftCurve(k, capture_.rows[r].time);
    for (std::size_t c = 0; c < 3; ++c) {
      double value = out.light[r * 3 + c];
      if (lens) {
        const Eigen::Index row = static_cast<Eigen::Index>(c * rows + r);
        value += state_.glare * out.effect(row, glare) + blur * out.effect(row, defocus) +
                 state_.subsurface[0] * out.effect(row, subsurface) +
                 state_.subsurface[1] * out.effect(row, subsurface + 1);
      }
      value = gain * value + state_.stray * meanOfRow_[r][static_cast<Eigen::Index>(c)] + state_.blackOffset;
      if (!state_.photoOffset.empty()) value += state_.photoOffset[r];
      lit[r * 3 + c] = value;
      slope[r * 3 + c] = gain;
    }
    for (std::size_t c = 0; c < 3; ++c) {
      double value = lit[r * 3 + c];
      for (std::size_t o = 0; o < 3; ++o)
        value += state_.mix(static_cast<Eigen::Index>(c), static_cast<Eigen::Index>(o)) *
                 (lit[r * 3 + o] - lit[r * 3 + c]);
      const double v = std::max(value / scale, 1e-6);
      // S v^(1 + g) / (1 + k v), then the clip's shoulder.
      const double power = std::pow(v, state_.responseGamma),
                   below = 1 / (1 + state_.responseCompression * v);
      double photographed = value > 0 ? scale * v * power * below : value;
      double derivative =
          value > 0 ? power * below * (1 + state_.responseGamma - state_.responseCompression * v * below) : 1;
      for (int k = 0; k < 2; ++k) {
        const double from = k == 0 ? 0.6 : 0.8, over = photographed / scale - from;
        if (over > 0) {
          photographed -= state_.saturation[static_cast<std::size_t>(k)] * over * scale;
          derivative *= 1 - state_.saturation[static_cast<std::size_t>(k)];
        }
      }
      recorded[r * 3 + c] = photographed;
      slope[r * 3 + c] *= derivative;
      out.predicted[r * 3 + c] = static_cast<float>(photographed) + site.black[static_cast<Eigen::Index>(c)];
    }
  }
  if (want == Want::kPrediction) return;

  out.own.setZero(total, kOwnCount);
  const float* d = out.quadrature.data();
  const float* s = d + static_cast<std::size_t>(quadrature::kSpecularStart) * rows;
  const auto specular = [&](int k, std::size_t r) { return s[static_cast<std::size_t>(k) * rows + r]; };
  for (int c = 0; c < 3; ++c) {
    const double ad = site.diffuse[c], as = site.specular[c];
    for (std::size_t r = 0; r < rows; ++r) {
      const Eigen::Index row = static_cast<Eigen::Index>(static_cast<std::size_t>(c) * rows + r);
      const double m = slope[r * 3 + static_cast<std::size_t>(c)];
      out.own(row, kOwnLogSigma) = m * as * specular(quadrature::kSpecularLogSigma, r);
      out.own(row, kOwnKurtosis) = m * as * specular(quadrature::kSpecularKurtosis, r);
      out.own(row, kOwnSlopeX) =
          m * (as * specular(quadrature::kSpecularSlopeX, r) +
               ad * d[static_cast<std::size_t>(quadrature::kDiffuseSlopeX) * rows + r]);
      out.own(row, kOwnSlopeY) =
          m * (as * specular(quadrature::kSpecularSlopeY, r) +
               ad * d[static_cast<std::size_t>(quadrature::kDiffuseSlopeY) * rows + r]);
      out.own(row, kOwnDiffuse + c) = m * d[r];
      out.own(row, kOwnSpecular + c) = m * s[r];
      out.own(row, kOwnBlack + c) = 1;
      if (site.ownHorizon && site.horizonSine > 0)
        out.own(row, kOwnHorizon) = m * (ad * d[static_cast<std::size_t>(kDiffuseHorizon) * rows + r] +
                                         as * specular(kSpecularHorizon, r));
      if (site.ownStretch) {
        out.own(row, kOwnStretch) = m * as * specular(quadrature::kStretch1, r);
        out.own(row, kOwnStretch + 1) = m * as * specular(quadrature::kStretch2, r);
      }
    }
  }
  if (!everything) return;

  const float* t = d + static_cast<std::size_t>(quadrature::kTermStart) * rows;
  const float* shape = d + static_cast<std::size_t>(quadrature::kShapeStart) * rows;
  const auto at = [&](std::string_view effect) { return columns_.rangeOf(effect).first; };
  const int angular = at("emission-angular"), spatial = at("emission-spatial"),
            horizon = at("self-shadowing"), response = at("screen-response"), drift = at("screen-drift"),
            anisotropy = at("anisotropy"), third = at("third-lobe"), fresnel = at("fresnel"),
            sheen = at("sheen"), retro = at("retroreflection"), coat = at("clearcoat"),
            irid = at("iridescence"), freeForm = at("basis-deviation"), vignetting = at("vignetting"),
            camera = at("camera-response"), black = at("black-level"), crosstalk = at("channel-crosstalk"),
            stray = at("stray-light"), saturation = at("saturation"), pose = at("screen-pose"),
            tilt = at("sample-tilt"), bent = at("sample-height");
  const std::array<double, 2> inPlane = planeOfView(site.model);
  const int angularLevel = columns_.indexOf("emission-angular", "level"),
            spatialLevel = columns_.indexOf("emission-spatial", "level");
  constexpr double kChroma[2][3] = {{1, -1, 0}, {0.5, 0.5, -1}};
  const SiteSet& set = capture_.state->measurements.sites;
  const double fromCentre = (Eigen::Vector2d(site.pixel.x(), site.pixel.y()) -
                             0.5 * Eigen::Vector2d(set.imageWidth, set.imageHeight))
                                .squaredNorm() /
                            (0.25 * (static_cast<double>(set.imageWidth) * set.imageWidth +
                                     static_cast<double>(set.imageHeight) * set.imageHeight));
  for (int c = 0; c < 3; ++c) {
    const std::size_t cc = static_cast<std::size_t>(c);
    const double ad = site.diffuse[c], as = site.specular[c];
    for (std::size_t r = 0; r < rows; ++r) {
      const Eigen::Index row = static_cast<Eigen::Index>(cc * rows + r);
      const double m = slope[r * 3 + cc];
      auto e = out.effect.row(row);
      if (angularLevel >= 0) e[angularLevel] = e[spatialLevel] = m * out.light[r * 3 + cc];
      if (wanted.light) {
        const auto lightColumn = [&](int k) {
          return m * (ad * d[static_cast<std::size_t>(quadrature::kDiffuseLight + k) * rows + r] +
                      as * specular(quadrature::kSpecularLight + k, r));
        };
        for (int k = 0; k < QuadratureState::kAngular; ++k)
          e[angular + k] = lightColumn(quadrature::kAngularAt + k);
        for (int k = 0; k < QuadratureState::kSpatial; ++k)
          e[spatial + k] = lightColumn(quadrature::kSpatialAt + k);
        for (int k = 0; k < 3; ++k) e[horizon + k] = lightColumn(quadrature::kHorizonAt + k);
        e[response] = lightColumn(quadrature::kWindowAt) +
                      m * (ad * shape[static_cast<std::size_t>(quadrature::kShapeDiffuse) * rows + r] +
                           as * shape[static_cast<std::size_t>(quadrature::kShapeSpecular) * rows + r]);
      }
      for (int k = 0; k < kDriftCurves; ++k)
        e[drift + k] = m * out.light[r * 3 + cc] * driftCurve(k, capture_.rows[r].time);
      if (wanted.light) {
        e[anisotropy] = m * as * specular(quadrature::kStretch1, r);
        e[anisotropy + 1] = m * as * specular(quadrature::kStretch2, r);
        e[third] = m * as * (t[static_cast<std::size_t>(quadrature::kThirdLobe) * rows + r] - s[r]);
        e[third + 1] = m * as * (t[static_cast<std::size_t>(quadrature::kThirdLobeBroad) * rows + r] - s[r]);
        e[fresnel] = m * as * specular(quadrature::kFresnelPower, r);
        e[sheen] = m * t[static_cast<std::size_t>(quadrature::kSheen) * rows + r];
        e[retro] = m * t[static_cast<std::size_t>(quadrature::kRetro) * rows + r];
        e[coat] = m * t[static_cast<std::size_t>(quadrature::kClearcoat) * rows + r];
        for (int k = 0; k < 2; ++k)
          e[irid + k] = m * as * specular(quadrature::kIridescence, r) * kChroma[k][c];
        for (int k = 0; k < 3; ++k) e[freeForm + k] = m * as * specular(quadrature::kFreeForm + k, r);
        e[freeForm + 3] = m * as *
                          (inPlane[0] * specular(quadrature::kStretch1, r) +
                           inPlane[1] * specular(quadrature::kStretch2, r));
      }
      e[vignetting] = -m * out.light[r * 3 + cc] * fromCentre;
      const double v = std::max(lit[r * 3 + cc] / scale, 1e-6);
      e[camera] = recorded[r * 3 + cc] * std::log(v);
      e[camera + 1] = -recorded[r * 3 + cc] * v / (1 + state_.responseCompression * v);
      e[black] = 1;
      for (int o = 0, k = 0; o < 3; ++o) {
        for (int p = 0; p < 3; ++p) {
          if (o == p) continue;
          if (o == c) e[crosstalk + k] = lit[r * 3 + static_cast<std::size_t>(p)] - lit[r * 3 + cc];
          ++k;
        }
      }
      e[stray] = meanOfRow_[r][c];
      for (int k = 0; k < 2; ++k)
        e[saturation + k] = -std::max(0.0, recorded[r * 3 + cc] - (k == 0 ? 0.6 : 0.8) * scale);
      for (int k = 0; k < 6; ++k) e[pose + k] *= m;
      for (int k = 0; k < 2; ++k) e[tilt + k] *= m;
      for (int k = 0; k < 4; ++k) e[bent + k] *= m;
      out.gain(static_cast<Eigen::Index>(r), c) = m * out.light[r * 3 + cc];
      out.offset(static_cast<Eigen::Index>(r), c) = 1;
    }
  }
}

PredictedPictures FourierDiagnosisModel::pictures(const std::vector<DiagnosisSite>& sampled, std::size_t most,
                                                  const JobContext& job) const {
  PredictedPictures out;
  const FourierFitState& state = *capture_.state;
  const std::size_t count = state.measurements.sites.size(), rows = capture_.rowCount();
  out.rows = rows;
  if (count > most || state.measurements.sites.grouped()) return out;
  (void)sampled;
  out.whole.assign(count * rows * 3, -1);
  out.diffuse.assign(count * rows * 3, -1);
  tbb::parallel_for(std::size_t{0}, (count + 63) / 64, [&](std::size_t chunk) {
    if (job.cancelled()) return;
    SiteColumns scratch;
    for (std::size_t s = chunk * 64; s < std::min(count, chunk * 64 + 64); ++s) {
      const TexelStatus status = state.siteStatus[s];
      if (status == TexelStatus::Failed || status == TexelStatus::Cancelled ||
          status == TexelStatus::NotMeasured)
        continue;
      DiagnosisSite site;
      site.site = s;
      site.cluster = capture_.clusterOfSite[s];
      site.model = quadratureSite(state, s);
      site.diffuse = state.sites[s].diffuse;
      site.specular = state.sites[s].specular;
      light(site, Want::kPrediction, scratch);
      float* whole = out.whole.data() + s * rows * 3;
      float* diffuse = out.diffuse.data() + s * rows * 3;
      for (std::size_t r = 0; r < rows; ++r) {
        for (std::size_t c = 0; c < 3; ++c) {
          whole[r * 3 + c] = std::max(0.0f, scratch.light[r * 3 + c]);
          diffuse[r * 3 + c] =
              std::max(0.0f, site.diffuse[static_cast<Eigen::Index>(c)] * scratch.quadrature[r]);
        }
      }
    }
  });
  return out;
}

}  // namespace patina
