#include "devices/simulated/light_kernel.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace patina {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kCoatF0 = 0.04;  ///< lacquer, refractive index 1.5

float f(double value) {
  return static_cast<float>(value);
}

/// The two Gaussians' widths. Source: frequency-domain paper, App. C.
std::array<double, 2> lobeSigmas(const SheetPoint& material) {
  const double g2 = material.kurtosis * material.kurtosis;
  const double c = std::sqrt(2.0 / (1.0 / g2 + g2));
  return {c * material.sigma / material.kurtosis, c * material.sigma * material.kurtosis};
}

bool acts(double onlyMaterial, const SheetPoint& point) {
  return onlyMaterial < 0 || static_cast<int>(onlyMaterial) == point.material;
}

float coatReflectance(double weight, double cosine) {
  return f(std::min(1.0, weight * (kCoatF0 + (1 - kCoatF0) * std::pow(1 - cosine, 5))));
}

}  // namespace

PointFrame pointFrame(const Screen& screen, const SimulatedEffects& effects, const Eigen::Vector3d& pointMm,
                      const Eigen::Vector3d& toView, const Eigen::Vector3d& normal) {
  const Eigen::Matrix3d screenFromWorld = screen.worldFromScreen.transpose();
  PointFrame frame;
  frame.point = screenFromWorld * (pointMm - screen.originMm) / screen.unitMm();
  frame.view = screenFromWorld * toView;
  frame.normal = screenFromWorld * normal;
  frame.east = screenFromWorld.col(0);
  frame.north = screenFromWorld.col(1);
  frame.up = screenFromWorld.col(2);
  if (effects.anisotropy.ratio != 1) {
    const double angle = effects.anisotropy.angleDeg * kPi / 180;
    const Eigen::Vector3d along = std::cos(angle) * frame.east + std::sin(angle) * frame.north;
    frame.tangent = (along - along.dot(frame.normal) * frame.normal).normalized();
  } else {
    frame.tangent = frame.normal.unitOrthogonal();
  }
  frame.bitangent = frame.normal.cross(frame.tangent);
  frame.distance = frame.point.z();
  return frame;
}

SurfaceParts surfaceParts(const SheetPoint& material, const SimulatedEffects& effects) {
  using Kind = SurfacePart::Kind;
  SurfaceParts parts;
  const double stretch = effects.anisotropy.ratio != 1 && acts(effects.anisotropy.material, material)
                             ? std::sqrt(effects.anisotropy.ratio)
                             : 1;
  const bool coated = effects.clearcoat.weight > 0 && acts(effects.clearcoat.material, material);
  const auto gaussian = [&](double sigma, double weight) {
    SurfacePart part;
    part.kind = Kind::Gaussian;
    part.weight = weight;
    part.sigmaAlong = sigma * stretch;
    part.sigmaAcross = sigma / stretch;
    part.f0 = effects.fresnel.f0;
    part.fresnelPower = effects.fresnel.power;
    part.coat = coated ? effects.clearcoat.weight : 0;
    return part;
  };
  if ((material.diffuse > 0).any()) {
    parts.lambert.kind = Kind::Lambert;
    parts.lambert.coat = coated ? effects.clearcoat.weight : 0;
  }
  if ((material.specular > 0).any()) {
    const SimulatedEffects::ThirdLobe& third = effects.thirdLobe;
    const bool changed = (third.share > 0 || third.ggx > 0) && acts(third.material, material);
    const double share = changed ? third.share : 0, ggx = changed ? third.ggx : 0;
    const double rest = (1 - share) * (1 - ggx);
    if (rest > 0)
      for (const double sigma : lobeSigmas(material)) parts.specular.push_back(gaussian(sigma, 0.5 * rest));
    if (share > 0) parts.specular.push_back(gaussian(third.sigma, share));
    if (ggx > 0) {
      constexpr double kStep = 0.8, kSharpest = 1.6;
      constexpr int kCount = 12;
      double total = 0;
      for (int k = 0; k < kCount; ++k) {
        const double precision = std::exp(kSharpest - kStep * k);
        total += precision * std::exp(-precision);
      }
      for (int k = 0; k < kCount; ++k) {
        const double precision = std::exp(kSharpest - kStep * k);
        parts.specular.push_back(gaussian(material.sigma / std::sqrt(precision),
                                          (1 - share) * ggx * precision * std::exp(-precision) / total));
      }
    }
  }
  if (coated) {
    SurfacePart coat;
    coat.kind = Kind::Gaussian;
    coat.weight = kCoatF0 * effects.clearcoat.weight;
    coat.sigmaAlong = coat.sigmaAcross = effects.clearcoat.sigma;
    coat.f0 = kCoatF0;
    parts.white.push_back(coat);
  }
  if (effects.sheen.albedo > 0 && acts(effects.sheen.material, material)) {
    SurfacePart sheen;
    sheen.kind = Kind::Sheen;
    sheen.weight = effects.sheen.albedo;
    sheen.width = effects.sheen.width;
    parts.white.push_back(sheen);
  }
  if (effects.sheen.grazing > 0 && acts(effects.sheen.material, material)) {
    SurfacePart grazing;
    grazing.kind = Kind::Grazing;
    grazing.weight = effects.sheen.grazing;
    parts.white.push_back(grazing);
  }
  if (effects.retroreflection.albedo > 0 && acts(effects.retroreflection.material, material)) {
    SurfacePart retro;
    retro.kind = Kind::Retro;
    retro.weight = effects.retroreflection.albedo;
    retro.width = effects.retroreflection.widthDeg * kPi / 180;
    parts.white.push_back(retro);
  }
  return parts;
}

LightKernel::LightKernel(const Screen& screen, const SimulatedEffects& effects, double lobeReach,
                         const PointFrame& frame, const SurfacePart& part, int x0, int x1, double spacing)
    : screen_(screen),
      effects_(effects),
      lobeReach_(lobeReach),
      frame_(frame),
      part_(part),
      spacing_(spacing),
      ownEmission_(effects.has("emission-angular")),
      hasHorizon_(effects.selfShadowing.horizonDeg > 0) {
  const int count = x1 - x0 + 1;
  lx_ = Eigen::ArrayXf::LinSpaced(count, f(x0 * spacing), f(x1 * spacing)) - f(frame.point.x());
  if (screen.emission && !ownEmission_) {
    const ScreenEmission& e = *screen.emission;
    const float d = f(frame.distance);
    emission_ = f(e.gain) * (-0.5f * ((lx_ / d - f(e.mean.x())) / f(e.sigma.x())).square()).exp();
  }
}

void LightKernel::evaluate(int ky, Eigen::ArrayXf& kernel, int& first, int& last) {
  using Kind = SurfacePart::Kind;
  const Eigen::Vector3f o = frame_.view.cast<float>(), n = frame_.normal.cast<float>();
  const float d = f(frame_.distance), nv = n.dot(o), lz = -d;
  const float ly = f(ky * spacing_ - frame_.point.y());
  invD_ = (lx_.square() + (ly * ly + lz * lz)).rsqrt();
  nl_ = ((lx_ * n.x() + (ly * n.y() + lz * n.z())) * invD_).max(0.0f);
  first = 0, last = static_cast<int>(lx_.size());
  switch (part_.kind) {
    case Kind::Nothing:
      last = 0;
      return;
    case Kind::Lambert:
      kernel = nl_ * invD_.cube() * (d / f(kPi));  // n.l / pi, times cosine at the screen d / D, over D^2
      break;
    case Kind::Gaussian:
      gaussian(ly, kernel, first, last);
      if (first == last) return;
      break;
    case Kind::Sheen: {
      // Charlie's distribution of microfacet normals with Ashikhmin's visibility.
      a_ = (2 + 2 * (lx_ * o.x() + (ly * o.y() + lz * o.z())) * invD_).max(1e-6f);  // |s|^2
      b_ = (1 - (nl_ + nv).square() / a_).max(0.0f).sqrt();  // sine of the half-vector's angle
      kernel = b_.pow(f(1 / part_.width)) * f(part_.weight * (2 + 1 / part_.width) / (2 * kPi)) /
               (4 * (nl_ + nv - nl_ * nv)).max(1e-4f) * nl_ * invD_.cube() * d;
      break;
    }
    case Kind::Grazing: {
      a_ = (2 + 2 * (lx_ * o.x() + (ly * o.y() + lz * o.z())) * invD_).max(0.0f);  // |s|^2
      b_ = (1 - 0.5f * a_.sqrt()).max(0.0f);                                       // 1 - l.h
      kernel = b_.square().square() * b_ * f(part_.weight) * nl_ * invD_.cube() * d;
      break;
    }
    case Kind::Retro: {
      const double w2 = part_.width * part_.width;
      a_ = 1 - (lx_ * o.x() + (ly * o.y() + lz * o.z())) * invD_;  // 1 - l.v
      kernel =
          (a_ * f(-1 / w2)).max(-40.0f).exp() * f(part_.weight / (2 * kPi * w2)) * nl_ * invD_.cube() * d;
      break;
    }
  }
  if (part_.coat > 0) {
    auto k = kernel.segment(first, last - first);
    c_ = 1 - nl_.segment(first, last - first);
    k *= 1 - (f(part_.coat) * (f(kCoatF0) + f(1 - kCoatF0) * c_.square().square() * c_)).min(1.0f);
    k *= 1 - coatReflectance(part_.coat, std::max(0.0f, nv));
  }
  if (ownEmission_) {
    emissionByAngle(ly, first, last, kernel);
  } else if (screen_.emission) {
    const ScreenEmission& e = *screen_.emission;
    const float qy = (ly / d - f(e.mean.y())) / f(e.sigma.y());
    kernel.segment(first, last - first) *= emission_.segment(first, last - first) * std::exp(-0.5f * qy * qy);
  }
  if (hasHorizon_) horizon(ly, first, last, kernel);
}

void LightKernel::gaussian(float ly, Eigen::ArrayXf& kernel, int& first, int& last) {
  const Eigen::Vector3f o = frame_.view.cast<float>(), n = frame_.normal.cast<float>();
  const Eigen::Vector3f t1 = frame_.tangent.cast<float>(), t2 = frame_.bitangent.cast<float>();
  const float d = f(frame_.distance), nv = n.dot(o), lz = -d;
  const bool isotropic = part_.sigmaAlong == part_.sigmaAcross;
  const float peak = f(part_.weight / (2 * kPi * part_.sigmaAlong * part_.sigmaAcross));
  const float exponent = f(-0.5 / (part_.sigmaAlong * part_.sigmaAlong));
  const float exponentAcross = f(-0.5 / (part_.sigmaAcross * part_.sigmaAcross));
  const float cut = f(-0.5 * lobeReach_ * lobeReach_);
  c_ = (nl_ + nv).inverse();                                                     // 1 / s.n
  a_ = ((lx_ * t1.x() + (ly * t1.y() + lz * t1.z())) * invD_ + t1.dot(o)) * c_;  // slope of the half-vector
  b_ = ((lx_ * t2.x() + (ly * t2.y() + lz * t2.z())) * invD_ + t2.dot(o)) * c_;
  if (isotropic)
    kernel = (a_.square() + b_.square()) * exponent;
  else
    kernel = a_.square() * exponent + b_.square() * exponentAcross;
  // Only the part of the row that the lobe reaches. Beyond, numbers soon become denormal, which would
  // cost far more time than all the rest.
  while (first < last && !(kernel[first] > cut)) ++first;
  while (last > first && !(kernel[last - 1] > cut)) --last;
  if (first == last) return;
  const int length = last - first;
  const auto lx = lx_.segment(first, length), invD = invD_.segment(first, length),
             nl = nl_.segment(first, length), c = c_.segment(first, length);
  auto k = kernel.segment(first, length);
  auto a = a_.segment(first, length), b = b_.segment(first, length);
  k = k.max(cut).exp() * peak;
  a = (2 + 2 * (lx * o.x() + (ly * o.y() + lz * o.z())) * invD).max(0.0f);  // |s|^2
  k *= (a * c.square()).square();                                           // (n.h)^-4
  b = (1 - 0.5f * a.sqrt()).max(0.0f);                                      // 1 - l.h
  if (part_.fresnelPower == 5)
    k *= 1 + f((1 - part_.f0) / part_.f0) * b.square().square() * b;
  else
    k *= 1 + f((1 - part_.f0) / part_.f0) * b.pow(f(part_.fresnelPower));
  k *= invD.cube() * (d * 0.25f / nv);  // n.l / (4 n.l n.v), d / D^3
  k = (nl > 0).select(k, 0.0f);
}

void LightKernel::emissionByAngle(float ly, int first, int last, Eigen::ArrayXf& kernel) const {
  const SimulatedEffects::EmissionAngular& effect = effects_.emissionAngular;
  const float d = f(frame_.distance), ty = ly / d;
  const Eigen::ArrayXf tx = lx_.segment(first, last - first) / d;
  const Eigen::ArrayXf r2 = tx.square() + ty * ty;
  Eigen::ArrayXf emitted = Eigen::ArrayXf::Zero(tx.size());
  const double gain = screen_.emission ? screen_.emission->gain : 1.0;
  const auto add = [&](double share, double wider) {
    if (!(share > 0)) return;
    if (!screen_.emission) {
      emitted += f(share * gain);
      return;
    }
    const ScreenEmission& e = *screen_.emission;
    const float qy = (ty - f(e.mean.y() + effect.tiltY)) / f(wider * e.sigma.y());
    emitted += f(share * gain) * std::exp(-0.5f * qy * qy) *
               (-0.5f * ((tx - f(e.mean.x() + effect.tiltX)) / f(wider * e.sigma.x())).square()).exp();
  };
  add(1 - effect.skirt - effect.cosine, 1);
  add(effect.skirt, effect.skirtWidth);
  if (effect.cosine > 0) emitted += f(effect.cosine * gain) * (1 + r2).pow(f(-0.5 * effect.cosinePower));
  if (effect.beyond != 0) {
    const float r04 = f(std::pow(effect.beyondTan, 4));
    emitted *= 1 + f(effect.beyond) * r2.square() / (r2.square() + r04);
  }
  kernel.segment(first, last - first) *= emitted;
}

void LightKernel::horizon(float ly, int first, int last, Eigen::ArrayXf& kernel) const {
  const SimulatedEffects::SelfShadowing& effect = effects_.selfShadowing;
  const Eigen::Vector3f up = frame_.up.cast<float>(), east = frame_.east.cast<float>(),
                        north = frame_.north.cast<float>();
  const float lz = -f(frame_.distance);
  const double degree = kPi / 180;
  const auto rise = [](double u) {  // smooth step from 0 to 1
    const double t = std::clamp(u, 0.0, 1.0);
    return t * t * (3 - 2 * t);
  };
  for (int i = first; i < last; ++i) {
    const Eigen::Vector3f toLight = Eigen::Vector3f(lx_[i], ly, lz) * invD_[i];
    const double elevationDeg =
        std::asin(std::clamp(static_cast<double>(toLight.dot(up)), -1.0, 1.0)) / degree;
    double hidden = 1 - rise((elevationDeg - effect.horizonDeg) / effect.softDeg + 0.5);
    if (hidden > 0 && effect.sectorDeg < 360) {
      double aside = std::atan2(toLight.dot(north), toLight.dot(east)) / degree - effect.azimuthDeg;
      aside = std::abs(std::remainder(aside, 360.0));
      hidden *= rise((0.5 * effect.sectorDeg - aside) / effect.softDeg + 0.5);
    }
    kernel[i] *= f(1 - hidden);
  }
}

}  // namespace patina
