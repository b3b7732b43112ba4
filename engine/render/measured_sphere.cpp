#include "engine/render/measured_sphere.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <stdexcept>

#include "engine/base/text.h"
#include "engine/render/blue_noise.h"
#include "engine/render/quick_atan.h"

namespace patina {
namespace {

constexpr float kPi = std::numbers::pi_v<float>;
constexpr float kHalfPi = kPi / 2;
/// Of the samples along the highlight, those that go to half-vectors in proportion to their cosine: no
/// density may vanish where a BRDF does not.
constexpr float kBroadPart = 0.1f;
/// The outermost normal of the sphere, as a part of its radius: thetaView 87.4 degrees. Beyond it tables hold
/// little that was measured, and the rim's pixels are narrower than a pixel.
constexpr float kOutermost = 0.999f;

float luminance(const Eigen::Array4f& value) {
  return 0.2126f * value[0] + 0.7152f * value[1] + 0.0722f * value[2];
}

float fraction(float x) {
  return x - std::floor(x);
}

/// Sums of one pixel.
struct Gathered {
  Eigen::Array3f radiance = Eigen::Array3f::Zero();
  float light = 0, weightedSd = 0;

  void add(const Eigen::Array4f& brdf, const Eigen::Array3f& incoming, float factor) {
    const Eigen::Array3f value = brdf.head<3>() * incoming * factor;
    const float bright = 0.2126f * value[0] + 0.7152f * value[1] + 0.0722f * value[2];
    radiance += value;
    light += bright;
    weightedSd += bright * brdf[3];
  }
};

/// Where a pixel looks at the sphere: its normal at an offset from the pixel's centre.
struct PixelOfSphere {
  float x, y, side;  ///< centre and width, in radii

  Eigen::Vector3f normal(float u, float v) const {
    float nx = x + (u - 0.5f) * side, ny = y + (v - 0.5f) * side;
    const float r = std::sqrt(nx * nx + ny * ny);
    if (r > kOutermost) {
      nx *= kOutermost / r;
      ny *= kOutermost / r;
    }
    return {nx, ny, std::sqrt(std::max(1e-6f, 1 - nx * nx - ny * ny))};
  }
};

/// Where a pixel starts in the sequences of samples: neighbours far apart, so that what is left of the noise
/// is fine grain, which the eye averages.
struct PixelShift {
  float u, v, w;

  PixelShift(int x, int y, std::uint64_t seed) {
    const float turn = static_cast<float>(seed % 65521) / 65521;
    u = fraction(blueNoise(x, y, 0) + turn);
    v = fraction(blueNoise(x, y, 1) + 3 * turn);
    w = fraction(blueNoise(x, y, 2) + 7 * turn);
  }
};

void gatherEnvironment(const SphereMaterial& material, const MeasuredSphereLighting& lighting,
                       const MeasuredSphereOptions& options, const PixelOfSphere& pixel,
                       const PixelShift& shift, Gathered& gathered) {
  const Environment& environment = *lighting.environment;
  const Eigen::Matrix3f& turned = lighting.environmentFromView;
  const Eigen::Matrix3f viewFromEnvironment = turned.transpose();
  const Eigen::Vector3f toView = Eigen::Vector3f::UnitZ();
  const int alongLight = options.samples / 2, other = options.samples - alongLight;
  // A matt material has a lobe too, at grazing: never fewer than two fifths along it.
  const int evenly = std::clamp(
                static_cast<int>(std::lround(material.mattPart() * 0.6f * static_cast<float>(other))), 1,
                other - 1),
            alongHighlight = other - evenly;
  const float each = 1.0f / static_cast<float>(options.samples);
  const float lightPart = static_cast<float>(alongLight) * each,
              highlightPart = static_cast<float>(alongHighlight) * each,
              evenPart = static_cast<float>(evenly) * each;
  // Source: balance heuristic: every sample counts 1 / (samples * mean density), whichever density chose it.
  const auto add = [&](const Eigen::Vector3f& normal, const Eigen::Vector3f& toLight, float cosine,
                       const Eigen::Array3f& radiance, float lightDensity) {
    const SphereMaterial::Seen seen = material.evaluate(normal, toLight, toView);
    const float density = lightPart * lightDensity + highlightPart * seen.halfDensity / (4 * seen.cosThetaD) +
                          evenPart * cosine / kPi;
    gathered.add(seen.value, radiance, cosine * each / density);
  };
  const auto place = [&](float index, float offset) {
    return pixel.normal(fraction(shift.w + offset + 0.8191725134f * index),
                        fraction(shift.v + offset + 0.6710436067f * index));
  };

  const auto lights = environment.samples();
  const int first = options.firstSample / 2;
  std::size_t next =
      (static_cast<std::size_t>(shift.u * Environment::kSamples) + static_cast<std::size_t>(first)) %
      Environment::kSamples;
  for (int s = 0; s < alongLight; ++s) {
    const Environment::Sample& light = lights[next];
    next = next + 1 == Environment::kSamples ? 0 : next + 1;
    const Eigen::Vector3f normal = place(static_cast<float>(first + s), 0);
    const Eigen::Vector3f toLight = viewFromEnvironment * light.direction;
    const float cosine = toLight.dot(normal);
    if (cosine > 0) add(normal, toLight, cosine, light.radiance, light.density);
  }
  for (int s = 0; s < other; ++s) {
    const bool highlight = s < alongHighlight;
    // Each kind continues its own sequence from one part of the picture to the next.
    const int before = highlight ? first * alongHighlight / other : first * evenly / other;
    const float index = static_cast<float>(before + (highlight ? s : s - alongHighlight));
    const Eigen::Vector3f normal = place(index, highlight ? 0.33f : 0.67f);
    const float u = fraction(shift.u + 0.7548776662f * index),
                turn = 2 * kPi * fraction(shift.v + 0.5698402910f * index);
    const Eigen::Vector3f tangent = normal.unitOrthogonal(), bitangent = normal.cross(tangent);
    const float theta = highlight ? material.sampleThetaH(u) : std::asin(std::sqrt(u));
    const Eigen::Vector3f chosen =
        std::cos(theta) * normal + std::sin(theta) * (std::cos(turn) * tangent + std::sin(turn) * bitangent);
    const Eigen::Vector3f toLight =
        highlight ? Eigen::Vector3f(2 * chosen.dot(toView) * chosen - toView) : chosen;
    const float cosine = toLight.dot(normal);
    if (cosine <= 0 || (highlight && chosen.z() <= 0)) continue;
    const Environment::Seen light = environment.look(turned * toLight);
    add(normal, toLight, cosine, light.radiance, light.density);
  }
}

}  // namespace

Image MeasuredSphere::over(float background) const {
  Image picture(radiance.width(), radiance.height(), 3);
  for (int y = 0; y < picture.height(); ++y)
    for (int x = 0; x < picture.width(); ++x) {
      const float covered = coverage.at(x, y);
      for (int c = 0; c < 3; ++c)
        picture.at(x, y, c) = covered * radiance.at(x, y, c) + (1 - covered) * background;
    }
  return picture;
}

SphereMaterial::SphereMaterial(const TabulatedBrdf& brdf, const std::vector<float>* posteriorSd,
                               double priorSd)
    : hasCertainty_(posteriorSd != nullptr), priorSd_(priorSd) {
  if (posteriorSd && posteriorSd->size() != MerlGrid::kCells)
    throw std::invalid_argument("a standard deviation for every cell of the MERL grid is needed");
  fold(brdf, posteriorSd);
  fillNeighbours();
  prepareSampling();
}

void SphereMaterial::fold(const TabulatedBrdf& brdf, const std::vector<float>* posteriorSd) {
  table_.resize(static_cast<std::size_t>(kThetaH) * kThetaD * kPhiD);
  const auto& planes = brdf.planes();
  tbb::parallel_for(0, kThetaH * kThetaD, [&](int row) {
    for (int k = 0; k < kPhiD; ++k) {
      Eigen::Array4f sum = Eigen::Array4f::Zero();
      int known = 0, knownSd = 0;
      for (const int phi : {k, MerlGrid::kPhiD - 1 - k}) {
        const std::size_t cell = static_cast<std::size_t>(row) * MerlGrid::kPhiD + phi;
        if (brdf.valid(cell)) {
          for (int c = 0; c < 3; ++c) sum[c] += static_cast<float>(planes[static_cast<std::size_t>(c)][cell]);
          ++known;
        }
        if (posteriorSd && (*posteriorSd)[cell] >= 0) {
          sum[3] += (*posteriorSd)[cell];
          ++knownSd;
        }
      }
      sum.head<3>() = known ? Eigen::Array3f(sum.head<3>() / known) : Eigen::Array3f::Constant(-1);
      sum[3] = !posteriorSd ? 0 : knownSd ? sum[3] / knownSd : static_cast<float>(priorSd_);
      table_[static_cast<std::size_t>(row) * kPhiD + k] = sum;
    }
  });
}

void SphereMaterial::fillNeighbours() {
  constexpr int kPasses = 2;
  const auto index = [](int i, int j, int k) {
    return (static_cast<std::size_t>(i) * kThetaD + j) * kPhiD + k;
  };
  for (int pass = 0; pass < kPasses; ++pass) {
    const std::vector<Eigen::Array4f> before = table_;
    tbb::parallel_for(0, kThetaH, [&](int i) {
      for (int j = 0; j < kThetaD; ++j)
        for (int k = 0; k < kPhiD; ++k) {
          if (before[index(i, j, k)][0] >= 0) continue;
          Eigen::Array3f sum = Eigen::Array3f::Zero();
          int known = 0;
          const auto look = [&](int ni, int nj, int nk) {
            if (ni < 0 || nj < 0 || nk < 0 || ni >= kThetaH || nj >= kThetaD || nk >= kPhiD) return;
            const Eigen::Array4f& value = before[index(ni, nj, nk)];
            if (value[0] < 0) return;
            sum += value.head<3>();
            ++known;
          };
          look(i - 1, j, k);
          look(i + 1, j, k);
          look(i, j - 1, k);
          look(i, j + 1, k);
          look(i, j, k - 1);
          look(i, j, k + 1);
          if (known) table_[index(i, j, k)].head<3>() = sum / static_cast<float>(known);
        }
    });
  }
  for (Eigen::Array4f& value : table_)
    if (value[0] < 0) value.head<3>().setZero();
}

void SphereMaterial::prepareSampling() {
  // For each thetaH what a microfacet model would call its distribution: the mean of f cos thetaL cos thetaV,
  // about f cos^2 thetaD, over thetaD to 80 degrees and phiD; times the solid angle of the step and the
  // cosine.
  std::array<double, kThetaH> highlight{}, broad{};
  double all = 0, allBroad = 0;
  for (int i = 0; i < kThetaH; ++i) {
    double mean = 0;
    for (int j = 0; j < 80; ++j) {
      const double cosD = std::cos((j + 0.5) * std::numbers::pi / 180), weight = cosD * cosD;
      for (int k = 0; k < kPhiD; k += 3)
        mean += weight * luminance(table_[(static_cast<std::size_t>(i) * kThetaD + j) * kPhiD + k]);
    }
    const double low = std::cos(kHalfPi * i * i / (kThetaH * kThetaH)),
                 high = std::cos(kHalfPi * (i + 1) * (i + 1) / (kThetaH * kThetaH));
    // The integral of cosine times sine over the step: half the difference of squared cosines.
    broad[static_cast<std::size_t>(i)] = (low * low - high * high) / 2;
    highlight[static_cast<std::size_t>(i)] = mean * broad[static_cast<std::size_t>(i)];
    all += highlight[static_cast<std::size_t>(i)];
    allBroad += broad[static_cast<std::size_t>(i)];
  }
  sums_[0] = 0;
  mattPart_ = 0;
  for (std::size_t i = 0; i < kThetaH; ++i) {
    const double own = all > 0 ? highlight[i] / all : broad[i] / allBroad;
    mattPart_ += static_cast<float>(std::min(own, broad[i] / allBroad));
    chance_[i] = static_cast<float>((1 - kBroadPart) * own + kBroadPart * broad[i] / allBroad);
    sums_[i + 1] = sums_[i] + chance_[i];
  }
}

float SphereMaterial::sampleThetaH(float u) const {
  const float wanted = std::clamp(u, 0.0f, 0.9999999f) * sums_.back();
  const auto above = std::upper_bound(sums_.begin() + 1, sums_.end() - 1, wanted);
  const std::size_t step = static_cast<std::size_t>(above - sums_.begin()) - 1;
  const float inside = std::clamp((wanted - sums_[step]) / std::max(chance_[step], 1e-30f), 0.0f, 1.0f);
  const float root = (static_cast<float>(step) + inside) / kThetaH;
  return kHalfPi * root * root;
}

float SphereMaterial::halfDensity(float thetaHRad, float sinThetaH) const {
  const float root = std::sqrt(thetaHRad / kHalfPi);
  const int step = static_cast<int>(root * kThetaH);
  if (step >= kThetaH) return 0;
  // The chance is even over a step of the root: per radian chance * 90 / (2 root pi / 2), per steradian over
  // 2 pi sin thetaH. Root and sine are kept above what a half-vector can be told apart from the normal by.
  return chance_[static_cast<std::size_t>(step)] * kThetaH /
         (2 * std::max(root, 1e-3f) * kHalfPi * 2 * kPi * std::max(sinThetaH, 1e-6f));
}

SphereMaterial::Seen SphereMaterial::evaluate(const Eigen::Vector3f& normal, const Eigen::Vector3f& toLight,
                                              const Eigen::Vector3f& toView) const {
  Seen seen;
  const Eigen::Vector3f sum = toLight + toView;
  const float length = sum.norm();
  if (length < 1e-6f) {  // opposite directions, both at the horizon
    seen.value.setZero();
    return seen;
  }
  const Eigen::Vector3f half = sum / length, across = normal.cross(half);
  const float cosH = half.dot(normal), sinH = across.norm();
  const float thetaH = quickAtan2(sinH, cosH);
  const float thetaD = quickAtan2((toLight - toView).norm(), length);
  // phiD folded into the first quadrant: only the sizes of the light's two components across the half-vector
  // count.
  const float side = std::abs(toLight.dot(across)),
              along = std::abs(0.5f * length * cosH - normal.dot(toLight));
  const float phiD = quickAtan2(side, along);
  seen.cosThetaD = 0.5f * length;
  seen.halfDensity = halfDensity(thetaH, sinH);
  constexpr float kDegrees = 180 / kPi;
  const auto split = [](float coordinate, int cells, int& first, int& second) {
    const float inside = std::clamp(coordinate, 0.0f, static_cast<float>(cells - 1));
    first = std::min(static_cast<int>(inside), cells - 1);
    second = std::min(first + 1, cells - 1);
    return inside - static_cast<float>(first);
  };
  int h0, h1, d0, d1, p0, p1;
  const float h = split(std::sqrt(thetaH * kDegrees * kThetaH) - 0.5f, kThetaH, h0, h1);
  const float d = split(thetaD * kDegrees - 0.5f, kThetaD, d0, d1);
  const float p = split(phiD * kDegrees - 0.5f, kPhiD, p0, p1);
  const auto line = [&](int i, int j) -> Eigen::Array4f {
    const Eigen::Array4f* row = table_.data() + (static_cast<std::size_t>(i) * kThetaD + j) * kPhiD;
    return row[p0] + (row[p1] - row[p0]) * p;
  };
  const Eigen::Array4f near = line(h0, d0) * (1 - d) + line(h0, d1) * d;
  const Eigen::Array4f far = line(h1, d0) * (1 - d) + line(h1, d1) * d;
  seen.value = near + (far - near) * h;
  return seen;
}

Result<MeasuredSphere> measuredSphere(const SphereMaterial& material, const MeasuredSphereLighting& lighting,
                                      const MeasuredSphereOptions& options, const JobContext& job) {
  const int size = options.size;
  if (size < 1 || size > 4096)
    return Error{ErrorCode::Invalid,
                 "A sphere of " + counted(static_cast<std::size_t>(std::max(0, size)), "pixel"), "",
                 "Choose a size from 1 to 4096"};
  if (options.samples < 4 || options.firstSample < 0 || options.lightSamplesAcross < 1)
    return Error{ErrorCode::Invalid, "Too few samples for a picture", "", "Use at least 4 samples a pixel"};
  MeasuredSphere picture{Image(size, size, 3), Image(size, size, 1),
                         material.hasCertainty() ? Image(size, size, 1, -1.0f) : Image()};
  const float radius = kMeasuredSphereRadius * static_cast<float>(size), side = 1 / radius;
  const bool lit = (lighting.lightIrradiance > 0).any() && lighting.toLight.squaredNorm() > 0;
  const Eigen::Vector3f toView = Eigen::Vector3f::UnitZ();
  const Eigen::Vector3f toLight = lit ? lighting.toLight.normalized() : toView;

  const auto renderRow = [&](int py) {
    for (int px = 0; px < size; ++px) {
      const float x = (static_cast<float>(px) + 0.5f - 0.5f * static_cast<float>(size)) * side;
      const float y = (0.5f * static_cast<float>(size) - static_cast<float>(py) - 0.5f) * side;
      const float covered = std::clamp((1 - std::sqrt(x * x + y * y)) * radius + 0.5f, 0.0f, 1.0f);
      if (covered <= 0) continue;
      const PixelOfSphere pixel{x, y, side};
      Gathered gathered;
      if (lighting.environment)
        gatherEnvironment(material, lighting, options, pixel, PixelShift(px, py, job.seed), gathered);
      if (lit) {
        const int across = options.lightSamplesAcross;
        for (int i = 0; i < across * across; ++i) {
          const Eigen::Vector3f normal = pixel.normal((static_cast<float>(i % across) + 0.5f) / across,
                                                      (static_cast<float>(i / across) + 0.5f) / across);
          const float cosine = toLight.dot(normal);
          if (cosine > 0)
            gathered.add(material.evaluate(normal, toLight, toView).value, lighting.lightIrradiance,
                         cosine / static_cast<float>(across * across));
        }
      }
      picture.coverage.at(px, py) = covered;
      for (int c = 0; c < 3; ++c) picture.radiance.at(px, py, c) = gathered.radiance[c];
      if (material.hasCertainty() && gathered.light > 0)
        picture.certainty.at(px, py) = gathered.weightedSd / gathered.light;
    }
  };
  std::atomic<int> done{0};
  tbb::task_arena arena(job.threads > 0 ? job.threads : tbb::task_arena::automatic);
  arena.execute([&] {
    tbb::parallel_for(0, size, [&](int py) {
      if (job.cancelled()) return;  // a row takes some milliseconds
      renderRow(py);
      const int finished = ++done;
      if (finished % 16 == 0 || finished == size) job.progress("sphere", finished, size, "rows");
    });
  });
  if (job.cancelled()) return Error{ErrorCode::Cancelled, "The sphere was not finished", "", ""};
  return picture;
}

void accumulate(MeasuredSphere& sum, const MeasuredSphere& next, int parts) {
  if (sum.radiance.width() != next.radiance.width() || sum.certainty.empty() != next.certainty.empty())
    throw std::invalid_argument("parts of one picture have one size");
  const float share = 1.0f / static_cast<float>(parts + 1);
  const auto into = sum.radiance.samples(),
             from = std::span<float>(const_cast<Image&>(next.radiance).samples());
  // A pixel's certainty is a mean weighted by light.
  for (std::size_t i = 0; i < sum.certainty.samples().size(); ++i) {
    float& mean = sum.certainty.samples()[i];
    const float other = next.certainty.samples()[i];
    const float before = (1 - share) * (into[3 * i] + into[3 * i + 1] + into[3 * i + 2]),
                after = share * (from[3 * i] + from[3 * i + 1] + from[3 * i + 2]);
    if (other < 0 || after <= 0) continue;
    mean = mean < 0 || before <= 0 ? other : (before * mean + after * other) / (before + after);
  }
  for (std::size_t i = 0; i < into.size(); ++i) into[i] += (from[i] - into[i]) * share;
}

}  // namespace patina
