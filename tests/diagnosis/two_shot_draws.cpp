#include "tests/diagnosis/two_shot_draws.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <numbers>
#include <random>

#include "engine/brdf/analytic_brdf.h"
#include "engine/brdf/brdf_file.h"
#include "engine/brdf/neural_brdf.h"
#include "tests/test_data.h"

namespace patina::test {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr int kNpfColumns = 512, kFactor = 90;

/// pi f = rhoD + rhoS D(thetaH) G(light) G(view) F(thetaD) / (cos cos), each factor a table of 90 values a
/// channel; D's are over the square root of the angle. The first values of G and F were not fitted.
class NonParametric : public Brdf {
 public:
  NonParametric(std::string name, const std::vector<float>& row) : Brdf({std::move(name), "npf", "", ""}) {
    const auto at = [&](int column) {
      const auto i = static_cast<std::size_t>(3 * column);
      return Eigen::Array3d(row[i], row[i + 1], row[i + 2]);
    };
    diffuse_ = at(0), specular_ = at(1);
    for (int i = 0; i < kFactor; ++i) {
      const auto k = static_cast<std::size_t>(i);
      d_[k] = at(2 + i), g_[k] = at(92 + std::max(1, i)), f_[k] = at(182 + std::max(1, i));
    }
  }
  Eigen::Array3d evaluate(const Eigen::Vector3d& toLight, const Eigen::Vector3d& toView) const override {
    if (!(toLight.z() > 0 && toView.z() > 0))
      return Eigen::Array3d::Constant(std::numeric_limits<double>::quiet_NaN());
    const HalfDiffAngles a = halfDiffFromDirections(toLight, toView);
    const auto deg = [](double cosine) { return std::acos(std::min(1.0, cosine)) / kDegree; };
    const Eigen::Array3d lobe = specular_ * value(d_, 90 * std::sqrt(a.thetaHRad / (90 * kDegree))) *
                                value(g_, deg(toLight.z())) * value(g_, deg(toView.z())) *
                                value(f_, a.thetaDRad / kDegree);
    return (diffuse_ + lobe / (toLight.z() * toView.z())).max(0.0) / std::numbers::pi;
  }

 private:
  using Table = std::array<Eigen::Array3d, kFactor>;
  static Eigen::Array3d value(const Table& table, double x) {
    const double clamped = std::clamp(x, 0.0, kFactor - 1.0);
    const auto low = std::min(static_cast<std::size_t>(clamped), std::size_t{kFactor - 2});
    const double t = clamped - static_cast<double>(low);
    return (1 - t) * table[low] + t * table[low + 1];
  }
  Eigen::Array3d diffuse_, specular_;
  Table d_, g_, f_;
};

class Random {
 public:
  explicit Random(unsigned seed) : bits_(seed * 7919u + 17u) {}
  double uniform(double low, double high) {
    return low + (high - low) * (static_cast<double>(bits_() >> 11) * 0x1p-53);
  }
  double between(double low, double high) { return std::exp(uniform(std::log(low), std::log(high))); }
  std::size_t below(std::size_t count) { return bits_() % count; }

 private:
  std::mt19937_64 bits_;
};

BrdfPtr measured(Random& random) {
  std::vector<std::filesystem::path> files;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(sharedData() / "measured/rgl", error))
    if (entry.path().extension() == ".bsdf") files.push_back(entry.path());
  if (files.empty()) return nullptr;
  std::sort(files.begin(), files.end());
  const auto read = readBrdf(files[random.below(files.size())]);
  return read ? *read : nullptr;
}

BrdfPtr analytic(Random& random) {
  static const std::array<const char*, 3> kModels{"ggx", "beckmann", "ward"};
  const std::string model = kModels[random.below(kModels.size())];
  AnalyticBrdfParameters p;
  const double albedo = random.between(0.01, 0.7);
  for (int c = 0; c < 3; ++c) p.diffuse[c] = albedo * random.uniform(0.2, 1);
  const double specular = random.uniform(0, 1) < 0.75 ? random.uniform(0.02, 0.08) : random.uniform(0.2, 0.8);
  p.specular.setConstant(specular);
  p.alphaX = p.alphaY = random.between(0.05, 0.5);
  auto made = makeAnalyticBrdf(model, p);
  return made ? *made : nullptr;
}

void material(Random& random, TwoShotDraw& draw, BrdfPtr& brdf) {
  const double which = random.uniform(0, 1);
  if (which < 0.25) {
    draw.family = "rgl", brdf = measured(random);
  } else if (which < 0.4) {
    draw.family = "npf";
    if (auto made = nonParametricBrdf(static_cast<int>(random.below(100)))) brdf = *made;
  } else if (which < 0.5) {
    draw.family = "analytic", brdf = analytic(random);
  }
  if (!brdf) {
    const std::size_t index = random.below(builtInNeuralBrdfs().size());
    brdf = builtInNeuralBrdfs()[index];
    draw.family = which < 0.7 ? "basis" : "left out";
    if (draw.family == "left out") draw.leftOut = static_cast<int>(index);
  }
  draw.material = brdf->origin().name;
}

}  // namespace

Result<BrdfPtr> nonParametricBrdf(int index) {
  const std::filesystem::path folder = sharedData() / "merl_fits";
  std::ifstream names(folder / "npf.names.txt"), file(folder / "npf.f32", std::ios::binary);
  if (!names || !file) return Error{ErrorCode::NotFound, "no non-parametric fits", folder.string(), ""};
  std::string name;
  for (int i = 0; i <= index; ++i) std::getline(names, name);
  std::vector<float> row(std::size_t{3} * kNpfColumns);
  const auto bytes = static_cast<std::streamsize>(row.size() * sizeof(float));
  file.seekg(static_cast<std::streamoff>(index) * bytes);
  if (name.empty() || !file.read(reinterpret_cast<char*>(row.data()), bytes))
    return Error{ErrorCode::Malformed, "the file of non-parametric fits ends early", folder.string(), ""};
  return BrdfPtr(std::make_shared<NonParametric>(name, row));
}

TwoShotDraw drawTwoShot(unsigned seed, const std::vector<std::string>& effects, double scale) {
  Random random(seed);
  TwoShotDraw draw;
  draw.effects = effects;
  BrdfPtr brdf;
  material(random, draw, brdf);
  const auto pose = [&](double h, double d, double p, bool holdout) {
    const auto jitter = [&](double deg, double by) { return deg + random.uniform(-by, by); };
    TwoShotPose made;
    made.directions =
        shotFromHalfDiff({std::abs(jitter(h, 3)) * kDegree, jitter(d, 3) * kDegree, jitter(p, 8) * kDegree});
    // Each at its own azimuth, as a person would turn the sample.
    const Eigen::Matrix3d about =
        Eigen::AngleAxisd(random.uniform(0, 2 * std::numbers::pi), Eigen::Vector3d::UnitZ())
            .toRotationMatrix();
    made.directions.toLight = about * made.directions.toLight;
    made.directions.toCamera = about * made.directions.toCamera;
    made.holdout = holdout;
    return made;
  };
  TwoShotScene& scene = draw.scene;
  scene.name = "drawn";
  scene.pixels = 100;
  scene.samplesPerPixelSide = 2;
  scene.fovDeg = random.uniform(20, 28);
  scene.distanceMm = random.uniform(250, 400);
  scene.poses = {pose(6, 20, 40, false), pose(16, 63, 89, false)};
  const TwoShotPose third = pose(42, 25, 60, false), towardsLight = pose(28, 3.5, 60, false);
  if (random.uniform(0, 1) < 0.7) scene.poses.push_back(third);
  const bool retro = std::find(effects.begin(), effects.end(), "retroreflection") != effects.end();
  if (random.uniform(0, 1) < 0.25 || retro) scene.poses.push_back(towardsLight);
  for (const std::array<double, 3>& angles :
       {std::array<double, 3>{4, 45, 90}, {25, 30, 20}, {35, 45, 50}, {12, 15, 60}})
    if (random.uniform(0, 1) < 0.75) scene.poses.push_back(pose(angles[0], angles[1], angles[2], true));
  if (!scene.poses.back().holdout) scene.poses.push_back(pose(20, 40, 70, true));
  scene.noise.shot = random.between(5e-6, 1e-4);
  scene.noise.read = random.between(2e-5, 4e-4);
  scene.effects.surroundings = random.uniform(0, 1) < 0.7 ? random.between(5e-4, 2e-2) : 0;
  scene.tileExcess = random.uniform(0, 1) < 0.5 ? 1 : 1.5;
  scene.brdfs = {brdf};
  draw.clean = scene;
  std::mt19937_64 strengths(seed * 104729u + 5u);
  for (const std::string& effect : effects)
    drawEffect(effect, scale, strengths, scene.poses.size(), scene.effects, brdf);
  scene.brdfs = {brdf};
  return draw;
}

}  // namespace patina::test
