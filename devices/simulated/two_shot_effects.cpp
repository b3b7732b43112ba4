#include "devices/simulated/two_shot_effects.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace patina {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

/// The sample's frame when its normal leans: the shortest turn from z to the normal.
Eigen::Matrix3d leaningFrame(const Eigen::Vector2d& leansDeg) {
  const Eigen::Vector3d normal =
      Eigen::Vector3d(std::tan(leansDeg.x() * kDegree), std::tan(leansDeg.y() * kDegree), 1).normalized();
  return Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), normal).toRotationMatrix();
}

/// Unpolarised reflectance of a dielectric with index 1.5.
double dielectric(double cosine) {
  constexpr double kIndex = 1.5;
  const double inside = std::sqrt(1 - (1 - cosine * cosine) / (kIndex * kIndex));
  const double s = (cosine - kIndex * inside) / (cosine + kIndex * inside);
  const double p = (inside - kIndex * cosine) / (inside + kIndex * cosine);
  return 0.5 * (s * s + p * p);
}

class Coated : public Brdf {
 public:
  Coated(BrdfPtr base, double weight, double alpha)
      : Brdf(base->origin()), base_(std::move(base)), weight_(weight), alpha_(alpha) {}
  Eigen::Array3d evaluate(const Eigen::Vector3d& toLight, const Eigen::Vector3d& toView) const override {
    const Eigen::Array3d under = base_->evaluate(toLight, toView);
    if (!(toLight.z() > 0 && toView.z() > 0)) return under;
    const Eigen::Vector3d half = (toLight + toView).normalized();
    const double tangent = half.head<2>().squaredNorm() / (half.z() * half.z());
    const double beckmann =
        std::exp(-tangent / (alpha_ * alpha_)) / (std::numbers::pi * alpha_ * alpha_ * std::pow(half.z(), 4));
    const double dot = toView.dot(half);
    // V-shaped grooves (Torrance and Sparrow).
    const double grooves = std::min({1.0, 2 * half.z() * toView.z() / dot, 2 * half.z() * toLight.z() / dot});
    return under + weight_ * dielectric(dot) * beckmann * grooves / (4 * toLight.z() * toView.z());
  }

 private:
  BrdfPtr base_;
  double weight_, alpha_;
};

class Retroreflecting : public Brdf {
 public:
  Retroreflecting(BrdfPtr base, const Eigen::Array3d& peak, double widthDeg)
      : Brdf(base->origin()), base_(std::move(base)), peak_(peak), width_(widthDeg * kDegree) {}
  Eigen::Array3d evaluate(const Eigen::Vector3d& toLight, const Eigen::Vector3d& toView) const override {
    const double angle = std::atan2(toLight.cross(toView).norm(), toLight.dot(toView));
    return base_->evaluate(toLight, toView) + peak_ * std::exp(-0.5 * angle * angle / (width_ * width_));
  }

 private:
  BrdfPtr base_;
  Eigen::Array3d peak_;
  double width_;
};

class Stretched : public Brdf {
 public:
  Stretched(BrdfPtr base, double ratio, double directionDeg)
      : Brdf(base->origin()), base_(std::move(base)), ratio_(ratio), direction_(directionDeg * kDegree) {}
  bool isotropic() const override { return false; }
  Eigen::Array3d evaluate(const Eigen::Vector3d& toLight, const Eigen::Vector3d& toView) const override {
    // The half-vector's slope along the direction is divided by sqrt(ratio), across it multiplied; light and
    // view keep their angle to the half-vector.
    const Eigen::Vector3d half = (toLight + toView).normalized();
    const Eigen::Vector2d along(std::cos(direction_), std::sin(direction_)), across(-along.y(), along.x());
    const Eigen::Vector2d slope = half.head<2>() / half.z();
    const double root = std::sqrt(ratio_);
    const Eigen::Vector2d scaled = along * (along.dot(slope) / root) + across * (across.dot(slope) * root);
    const Eigen::Vector3d target = Eigen::Vector3d(scaled.x(), scaled.y(), 1).normalized();
    const Eigen::Quaterniond turn = Eigen::Quaterniond::FromTwoVectors(half, target);
    const Eigen::Vector3d light = turn * toLight, view = turn * toView;
    if (!(light.z() > 0 && view.z() > 0)) return base_->evaluate(toLight, toView);
    return base_->evaluate(light, view);
  }

 private:
  BrdfPtr base_;
  double ratio_, direction_;
};

class Fibrous : public Brdf {
 public:
  Fibrous(BrdfPtr base, double weight, double width)
      : Brdf(base->origin()), base_(std::move(base)), weight_(weight), width_(width) {}
  Eigen::Array3d evaluate(const Eigen::Vector3d& toLight, const Eigen::Vector3d& toView) const override {
    const Eigen::Array3d under = base_->evaluate(toLight, toView);
    if (!(toLight.z() > 0 && toView.z() > 0)) return under;
    const Eigen::Vector3d half = (toLight + toView).normalized();
    const double sine = half.head<2>().norm();
    const double distribution = (2 + 1 / width_) * std::pow(sine, 1 / width_) / (2 * std::numbers::pi);
    // Ashikhmin and Premoze's denominator: fibres don't shadow each other as facets do.
    const double denominator = 4 * (toLight.z() + toView.z() - toLight.z() * toView.z());
    return under + weight_ * distribution / denominator;
  }

 private:
  BrdfPtr base_;
  double weight_, width_;
};

class Filmed : public Brdf {
 public:
  Filmed(BrdfPtr base, double contrast, double opticalNm)
      : Brdf(base->origin()), base_(std::move(base)), contrast_(contrast), optical_(opticalNm) {
    constexpr int kAngles = 90;
    for (int i = 0; i < kAngles; ++i) mean_ += waves((i + 0.5) * kDegree) / kAngles;
  }
  Eigen::Array3d evaluate(const Eigen::Vector3d& toLight, const Eigen::Vector3d& toView) const override {
    const Eigen::Array3d under = base_->evaluate(toLight, toView);
    const double thetaD = 0.5 * std::atan2(toLight.cross(toView).norm(), toLight.dot(toView));
    return under * (1 + contrast_ * (waves(thetaD) - mean_)).max(0.05);
  }

 private:
  Eigen::Array3d waves(double thetaD) const {
    constexpr double kIndex = 1.5;
    const double inside = std::sqrt(1 - std::pow(std::sin(thetaD) / kIndex, 2));
    const Eigen::Array3d wavelengthNm(610, 540, 460);
    return (4 * std::numbers::pi * optical_ * inside / wavelengthNm).cos();
  }
  BrdfPtr base_;
  double contrast_, optical_;
  Eigen::Array3d mean_ = Eigen::Array3d::Zero();
};

/// A photograph convolved with a kernel that depends on the distance alone, edges repeated.
template <typename Kernel>
Image convolved(const Image& photo, int reach, Kernel&& kernel) {
  std::vector<double> weights;
  double total = 0;
  for (int j = -reach; j <= reach; ++j) {
    for (int i = -reach; i <= reach; ++i) {
      weights.push_back(kernel(std::hypot(i, j)));
      total += weights.back();
    }
  }
  Image out = photo;
  for (int y = 0; y < photo.height(); ++y) {
    for (int x = 0; x < photo.width(); ++x) {
      Eigen::Array3d sum = Eigen::Array3d::Zero();
      std::size_t k = 0;
      for (int j = -reach; j <= reach; ++j) {
        for (int i = -reach; i <= reach; ++i) {
          const auto at =
              photo.pixel(std::clamp(x + i, 0, photo.width() - 1), std::clamp(y + j, 0, photo.height() - 1));
          sum += weights[k++] * Eigen::Array3d(at[0], at[1], at[2]);
        }
      }
      for (int c = 0; c < 3; ++c) out.at(x, y, c) = static_cast<float>(sum[c] / total);
    }
  }
  return out;
}

}  // namespace

bool TwoShotEffects::any() const {
  return !normalLeansDeg.isZero(0) || heightMm != 0 || lightDistanceMm != 0 || vignetting != 0 ||
         strayShare != 0 || !exposureFactors.empty() || gamma != 1 || blackShare != 0 || crosstalk != 0 ||
         glareShare != 0 || defocusPx != 0 || clipShare != 0 || surroundings != 0;
}

LampAtPoint lampAt(const TwoShotEffects& effects, const Eigen::Vector3d& toDistantLight,
                   const Eigen::Vector3d& eyeMm, const Eigen::Vector3d& pointMm, bool tile) {
  LampAtPoint found;
  const bool lamp = effects.lightDistanceMm > 0 && (!tile || effects.tileUnderSameLamp);
  Eigen::Vector3d point = pointMm;
  if (!tile) point.z() += effects.heightMm;
  found.toLight = toDistantLight;
  double strength = 1;
  if (lamp) {
    const Eigen::Vector3d way = toDistantLight * effects.lightDistanceMm - point;
    found.toLight = way.normalized();
    strength = effects.lightDistanceMm * effects.lightDistanceMm / way.squaredNorm();
  }
  found.toView = (eyeMm - point).normalized();
  if (!tile && !effects.normalLeansDeg.isZero(0)) {
    const Eigen::Matrix3d sampleFromWorld = leaningFrame(effects.normalLeansDeg).transpose();
    found.toLight = sampleFromWorld * found.toLight;
    found.toView = sampleFromWorld * found.toView;
  }
  found.cosineGain = std::max(found.toLight.z(), 0.0) * strength;
  return found;
}

void distortPhoto(const TwoShotEffects& effects, std::size_t pose, const std::vector<char>& onSample,
                  double meanLevel, double fullScale, Image& photo) {
  if (effects.defocusPx > 0) {
    const double radius = effects.defocusPx;
    photo = convolved(photo, static_cast<int>(std::ceil(radius)),
                      [&](double r) { return std::clamp(radius + 0.5 - r, 0.0, 1.0); });
  }
  if (effects.glareShare > 0) {
    const Image wide = convolved(photo, static_cast<int>(3 * effects.glarePx),
                                 [&](double r) { return std::exp(-r / effects.glarePx); });
    for (std::size_t i = 0; i < photo.samples().size(); ++i)
      photo.samples()[i] += static_cast<float>(effects.glareShare * (wide.samples()[i] - photo.samples()[i]));
  }
  std::vector<float> inside;
  for (std::size_t i = 0; i < onSample.size(); ++i)
    for (std::size_t c = 0; c < 3 && onSample[i]; ++c) inside.push_back(photo.samples()[3 * i + c]);
  double median = 0;
  if (!inside.empty()) {
    std::nth_element(inside.begin(), inside.begin() + static_cast<std::ptrdiff_t>(inside.size() / 2),
                     inside.end());
    median = inside[inside.size() / 2];
  }
  const double factor = effects.exposureFactors.empty() ? 1 : effects.exposureFactors[pose];
  const double middleX = 0.5 * (photo.width() - 1), middleY = 0.5 * (photo.height() - 1);
  for (int y = 0; y < photo.height(); ++y) {
    for (int x = 0; x < photo.width(); ++x) {
      const double dx = (x - middleX) / middleX, dy = (y - middleY) / middleY;
      const double lens = 1 - effects.vignetting * (dx * dx + dy * dy);
      Eigen::Array3d value;
      for (int c = 0; c < 3; ++c) value[c] = photo.at(x, y, c) * lens + effects.strayShare * median;
      if (effects.crosstalk != 0) {
        const double sum = value.sum();
        value = value * (1 - 3 * effects.crosstalk) + effects.crosstalk * sum;
      }
      value *= factor;
      value += effects.blackShare * meanLevel;
      if (effects.gamma != 1) value = fullScale * (value / fullScale).max(0.0).pow(effects.gamma);
      for (int c = 0; c < 3; ++c) photo.at(x, y, c) = static_cast<float>(value[c]);
    }
  }
}

BrdfPtr coatedBrdf(BrdfPtr base, double weight, double alpha) {
  return std::make_shared<Coated>(std::move(base), weight, alpha);
}

BrdfPtr retroreflectingBrdf(BrdfPtr base, const Eigen::Array3d& peak, double widthDeg) {
  return std::make_shared<Retroreflecting>(std::move(base), peak, widthDeg);
}

BrdfPtr stretchedBrdf(BrdfPtr base, double ratio, double directionDeg) {
  return std::make_shared<Stretched>(std::move(base), ratio, directionDeg);
}

BrdfPtr fibrousBrdf(BrdfPtr base, double weight, double width) {
  return std::make_shared<Fibrous>(std::move(base), weight, width);
}

BrdfPtr filmedBrdf(BrdfPtr base, double contrast, double opticalNm) {
  return std::make_shared<Filmed>(std::move(base), contrast, opticalNm);
}

std::vector<std::string> drawnEffectIds() {
  return {"sample-tilt", "near-light",      "vignetting",        "stray-light",
          "glare",       "clearcoat",       "exposure-mismatch", "defocus",
          "black-level", "retroreflection", "camera-response",   "channel-crosstalk",
          "saturation",  "anisotropy",      "iridescence",       "sheen"};
}

void drawEffect(const std::string& id, double scale, std::mt19937_64& random, std::size_t poses,
                TwoShotEffects& effects, BrdfPtr& material) {
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * (static_cast<double>(random() >> 11) * 0x1p-53);
  };
  const double sign = uniform(0, 1) < 0.5 ? -1 : 1;
  if (id == "sample-tilt") {
    const double turn = uniform(0, 2 * std::numbers::pi), size = scale * uniform(1, 2.5);
    effects.normalLeansDeg = size * Eigen::Vector2d(std::cos(turn), std::sin(turn));
  } else if (id == "near-light") {
    effects.lightDistanceMm = uniform(500, 1200) / scale;
    effects.tileUnderSameLamp = uniform(0, 1) < 0.5;
  } else if (id == "vignetting") {
    effects.vignetting = scale * uniform(0.1, 0.25);
  } else if (id == "stray-light") {
    effects.strayShare = scale * uniform(0.04, 0.12);
  } else if (id == "glare") {
    effects.glareShare = scale * uniform(0.05, 0.15);
    effects.glarePx = uniform(4, 12);
  } else if (id == "clearcoat") {
    material = coatedBrdf(material, uniform(0.6, 1.4) * scale, uniform(0.06, 0.2));
  } else if (id == "exposure-mismatch") {
    for (std::size_t p = 0; p < poses; ++p) effects.exposureFactors.push_back(1);
    effects.exposureFactors[random() % std::max<std::size_t>(1, poses)] =
        1 + sign * scale * uniform(0.1, 0.3);
  } else if (id == "retroreflection") {
    const double peak = scale * uniform(1, 15);
    material =
        retroreflectingBrdf(material, {peak, peak * uniform(0.6, 1), peak * uniform(0.3, 1)}, uniform(2, 6));
  } else if (id == "defocus") {
    effects.defocusPx = scale * uniform(1, 3);
  } else if (id == "black-level") {
    effects.blackShare = scale * uniform(0.03, 0.1);
  } else if (id == "camera-response") {
    effects.gamma = std::exp(sign * scale * uniform(0.05, 0.15));
  } else if (id == "channel-crosstalk") {
    effects.crosstalk = std::min(0.3, scale * uniform(0.02, 0.06));
  } else if (id == "saturation") {
    effects.clipShare = uniform(0.2, 0.8) / scale;
  } else if (id == "anisotropy") {
    material = stretchedBrdf(material, std::exp(scale * uniform(0.2, 0.6)), uniform(0, 180));
  } else if (id == "iridescence") {
    material = filmedBrdf(material, std::min(0.9, scale * uniform(0.15, 0.35)), uniform(150, 450));
  } else if (id == "sheen") {
    material = fibrousBrdf(material, scale * uniform(0.05, 0.3), uniform(0.2, 0.6));
  }
}

}  // namespace patina
