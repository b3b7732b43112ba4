#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>

#include "engine/brdf/brdf_file.h"
#include "engine/brdf/neural_brdf.h"
#include "engine/brdf/tabulated_brdf.h"
#include "engine/geometry/camera.h"
#include "engine/image/exr.h"
#include "tests/base/temp_folder.h"
#include "tests/test_data.h"

// Measured BRDFs against photographs of them that another program made: it integrated the material under a
// distant light, so that pixel / white pixel is f pi / reflectance of the white tile. A wrong axis, plane,
// scale, cosine or frame shows here, which no test on our own numbers can promise.
namespace patina {
namespace {

using nlohmann::json;

constexpr double kDarkest = 0.02;  // 1/sr; below, the photographs are mostly noise
// Of single pixels: the noise of the simulated sensor, some 0.3 % where bright and several percent in the
// grazing shots. An axis or a cosine that is wrong gives tens of percent.
constexpr double kPixelError = 0.02;
// Of the median ratio: noise averages out over thousands of pixels; a scale or a reflectance that is wrong
// doesn't.
constexpr double kScaleError = 0.002;

Camera cameraFrom(const json& j) {
  Camera camera;
  camera.width = j["width"];
  camera.height = j["height"];
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) {
      camera.intrinsics(r, c) = j["K"][r][c];
      camera.cameraFromWorld(r, c) = j["R"][r][c];
    }
    camera.translationMm[r] = j["t"][r];
  }
  for (int i = 0; i < 5; ++i) camera.distortion[i] = j["distortion"][i];
  return camera;
}

struct Comparison {
  double median = 0;       ///< of |predicted / seen - 1|, all channels
  double ninetieth = 0;    ///< percentile
  double medianRatio = 0;  ///< of predicted / seen
  std::size_t samples = 0, unknown = 0;
};

double percentile(std::vector<double>& values, double share) {
  if (values.empty()) return std::nan("");
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(share * (values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// Every second pixel of some of a bundle's photographs, well inside the sample's rim.
Comparison compare(const std::string& bundle, const Brdf& brdf, const std::vector<int>& shots) {
  const std::filesystem::path folder = test::sharedData() / "two-shot" / bundle;
  const json capture = json::parse(std::ifstream(folder / "capture.json"));
  const json& white = capture["white_reference"];
  const double radius = capture["sample"]["radius_mm"];
  std::vector<double> errors, ratios;
  Comparison result;
  for (const int index : shots) {
    const json& shot = capture["shots"][index];
    const json& tile = white["shots"][index];
    const Result<Image> photo = readExr(folder / shot["file"].get<std::string>(), {"R", "G", "B"});
    const Result<Image> reference = readExr(folder / tile["file"].get<std::string>(), {"R", "G", "B"});
    EXPECT_TRUE(photo && reference);
    if (!photo || !reference) return result;
    const Camera camera = cameraFrom(shot["camera"]);
    const json& d = shot["light"]["direction"];
    const Eigen::Vector3d toLight(d[0], d[1], d[2]);
    for (int y = 0; y < camera.height; y += 2) {
      for (int x = 0; x < camera.width; x += 2) {
        const auto point = camera.samplePlaneFromPixel({x, y});
        if (!point || point->head<2>().norm() > 0.97 * radius) continue;  // the rim is cut by the pixel
        const Eigen::Vector3d toView = (camera.positionMm() - *point).normalized();
        const Eigen::Array3d value = brdf.evaluate(toLight, toView);
        if (!value.allFinite()) {
          ++result.unknown;
          continue;
        }
        for (int channel = 0; channel < 3; ++channel) {
          const double seen = photo->at(x, y, channel) / shot["exposure_s"].get<double>() /
                              (reference->at(x, y, channel) / tile["exposure_s"].get<double>()) *
                              white["reflectance"][channel].get<double>() / std::numbers::pi;
          if (!(seen > kDarkest)) continue;
          ratios.push_back(value[channel] / seen);
          errors.push_back(std::abs(value[channel] / seen - 1));
        }
      }
    }
  }
  result.samples = errors.size();
  result.median = percentile(errors, 0.5);
  result.ninetieth = percentile(errors, 0.9);
  result.medianRatio = percentile(ratios, 0.5);
  return result;
}

std::vector<int> shotsOf(const std::string& bundle) {
  const json capture = json::parse(std::ifstream(test::sharedData() / "two-shot" / bundle / "capture.json"));
  std::vector<int> shots(capture["shots"].size());
  for (std::size_t i = 0; i < shots.size(); ++i) shots[i] = static_cast<int>(i);
  return shots;
}

BrdfPtr network(const std::string& name) {
  for (const BrdfPtr& brdf : builtInNeuralBrdfs()) {
    if (brdf->origin().name == name) return brdf;
  }
  return nullptr;
}

void expectSeen(const std::string& bundle, const Brdf& brdf) {
  const Comparison c = compare(bundle, brdf, shotsOf(bundle));
  EXPECT_GT(c.samples, 10000u) << bundle;
  EXPECT_EQ(c.unknown, 0u) << bundle;
  EXPECT_LT(c.median, kPixelError) << bundle;
  EXPECT_NEAR(c.medianRatio, 1, kScaleError) << bundle;
}

TEST(Photographs, ShowWhatRglFilesSay) {
  PATINA_NEEDS_SHARED("two-shot");
  for (const auto& [bundle, file] : {std::pair{"measured_satin_purple", "satin_purple_rgb.bsdf"},
                                     std::pair{"measured_colodur_azure", "colodur_azure_4e_rgb.bsdf"},
                                     std::pair{"measured_felt_pink", "acrylic_felt_pink_rgb.bsdf"},
                                     std::pair{"measured_cc_ibiza", "cc_ibiza_sunset_rgb.bsdf"}}) {
    const Result<BrdfPtr> brdf = readBrdf(test::sharedData() / "measured/rgl" / file);
    ASSERT_TRUE(brdf) << brdf.error().sentence();
    expectSeen(bundle, **brdf);
  }
}

TEST(Photographs, TellLightFromView) {
  PATINA_NEEDS_SHARED("two-shot/measured_satin_purple");
  // The measurement isn't exactly reciprocal, so swapping the two directions must fit worse.
  class Swapped : public Brdf {
   public:
    explicit Swapped(BrdfPtr brdf) : Brdf(brdf->origin()), brdf_(std::move(brdf)) {}
    Eigen::Array3d evaluate(const Eigen::Vector3d& toLight, const Eigen::Vector3d& toView) const override {
      return brdf_->evaluate(toView, toLight);
    }

   private:
    BrdfPtr brdf_;
  };
  const Result<BrdfPtr> brdf = readBrdf(test::sharedData() / "measured/rgl/satin_purple_rgb.bsdf");
  ASSERT_TRUE(brdf) << brdf.error().sentence();
  const std::string bundle = "measured_satin_purple";
  const Comparison right = compare(bundle, **brdf, shotsOf(bundle));
  const Comparison wrong = compare(bundle, Swapped(*brdf), shotsOf(bundle));
  EXPECT_GT(wrong.median, 3 * right.median);
}

TEST(Photographs, ShowWhatTheNetworksSay) {
  PATINA_NEEDS_SHARED("two-shot");
  expectSeen("clean_pink_jasper", *network("pink-jasper"));
  expectSeen("clean_alum_bronze", *network("alum-bronze"));
}

TEST(Photographs, ShowWhatAMerlTableSays) {
  PATINA_NEEDS_SHARED("two-shot/clean_pink_jasper");
  // Through the file: order of axes and planes, scales. Interpolation between cells errs by less than noise.
  const test::TempFolder folder;
  const auto table = tabulate(*network("pink-jasper"));
  ASSERT_TRUE(table);
  ASSERT_TRUE(writeMerl(folder.path() / "a.binary", **table));
  const Result<BrdfPtr> brdf = readBrdf(folder.path() / "a.binary");
  ASSERT_TRUE(brdf) << brdf.error().sentence();
  expectSeen("clean_pink_jasper", **brdf);
}

TEST(Photographs, ShowWhatAnAltaTableSays) {
  PATINA_NEEDS_SHARED("two-shot/measured_3m_tape");
  const Result<BrdfPtr> brdf = readBrdf(test::sharedData() / "measured/retro/retro-3M-jaune-dense.dat");
  ASSERT_TRUE(brdf) << brdf.error().sentence();
  // Shot 2 has its light at 30.1 degrees, where there is a measurement: only the interpolation between the
  // table's points differs, which the narrow peaks make visible. The cosine in the file is half of the value
  // in places.
  const Comparison measured = compare("measured_3m_tape", **brdf, {2});
  EXPECT_GT(measured.samples, 10000u);
  EXPECT_LT(measured.median, 0.035);
  EXPECT_NEAR(measured.medianRatio, 1, 0.01);
  // Between the measured lights (15, 30, 60 degrees) nobody knows, and the other program has its own way of
  // interpolating; ours may differ by what lies between two neighbours.
  for (const int shot : {0, 4, 5, 6}) {
    const Comparison between = compare("measured_3m_tape", **brdf, {shot});
    EXPECT_GT(between.samples, 3000u) << shot;
    EXPECT_LT(between.median, 0.2) << shot;
  }
}

}  // namespace
}  // namespace patina
