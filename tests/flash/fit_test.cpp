#include "engine/flash/fit.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <stop_token>

#include "engine/image/exr.h"
#include "tests/base/temp_folder.h"
#include "tests/flash/small_scene.h"
#include "tests/test_data.h"

namespace patina {
namespace {

double median(std::vector<double> values) {
  const auto half = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), half, values.end());
  return *half;
}

/// A bundle and its fit, made once.
struct Fitted {
  test::TempFolder folder;
  FlashScene scene = test::smallFlashScene();
  std::shared_ptr<const FlashFit> fit;
  Fitted() {
    JobContext job;
    job.seed = 3;
    const auto made = simulateFlash(scene, folder / "bundle", job);
    if (!made) return;
    const auto capture = readFlashCapture(folder / "bundle");
    if (!capture) return;
    FlashFitOptions options;
    options.sharedTexels = 1200;
    auto fitted = fitFlash(*capture, options, {});
    if (fitted) fit = *fitted;
  }
};
const Fitted& fitted() {
  static const Fitted one;
  return one;
}

TEST(FlashFit, CleanMapsComeBack) {
  const auto& fit = fitted().fit;
  ASSERT_NE(fit, nullptr);
  const SheetSampler truth(fitted().scene.sheet);
  std::vector<double> normal, diffuse, specular, sigma;
  for (int j = 2; j < fit->grid.height - 2; ++j) {
    for (int i = 2; i < fit->grid.width - 2; ++i) {
      const Eigen::Vector2d at = fit->grid.pointMm(i, j);
      const SheetPoint point = truth.at(at.x(), at.y());
      const Eigen::Vector3d n(fit->maps.normal.at(i, j, 0), fit->maps.normal.at(i, j, 1),
                              fit->maps.normal.at(i, j, 2));
      EXPECT_NEAR(n.norm(), 1, 1e-5);
      normal.push_back(std::acos(std::clamp(n.dot(point.normal), -1.0, 1.0)) * 180 / M_PI);
      for (int c = 0; c < 3; ++c) {
        diffuse.push_back(std::abs(fit->maps.diffuse.at(i, j, c) / point.diffuse[c] - 1));
        specular.push_back(std::abs(fit->maps.specular.at(i, j, c) / point.specular[c] - 1));
      }
      sigma.push_back(std::abs(fit->maps.sigma.at(i, j) / point.sigma - 1));
    }
  }
  // Eight bits, seven photographs, a hundredth of the pixels clipped.
  EXPECT_LT(median(normal), 0.5) << "degrees";
  EXPECT_LT(median(diffuse), 0.04);
  EXPECT_LT(median(specular), 0.10);
  EXPECT_LT(median(sigma), 0.06);
}

TEST(FlashFit, HeldOutPhotographsArePredicted) {
  const auto& fit = fitted().fit;
  ASSERT_NE(fit, nullptr);
  EXPECT_LT(fit->stats.fitRms, 0.03);
  EXPECT_GT(fit->stats.fitRms, 0);
  EXPECT_LT(fit->stats.holdoutRms, 0.06);
  EXPECT_GT(fit->stats.noiseFloorHoldout, 0);
  EXPECT_LT(fit->stats.noiseFloorHoldout, fit->stats.holdoutRms);
  EXPECT_EQ(fit->comparisons.size(), 9u);
  EXPECT_GT(fit->stats.clippedSamples, 0u) << "or clipping isn't tested here";
  EXPECT_FALSE(fit->stats.remarks.empty());
}

TEST(FlashFit, PredictedPhotographsAreTheSimulatedOnes) {
  const auto& fit = fitted().fit;
  ASSERT_NE(fit, nullptr);
  const auto pixels = readFlashPixels(fit->capture, fit->capture.photos[6]);
  ASSERT_TRUE(pixels.ok());
  const Image predicted = predictFlashPhoto(*fit, 6, pixels->linear.width(), pixels->linear.height());
  double squares = 0, values = 0;
  for (std::size_t i = 0; i < predicted.samples().size(); ++i) {
    EXPECT_LE(predicted.samples()[i], 1.0f);
    const double d = predicted.samples()[i] - pixels->linear.samples()[i];
    squares += d * d, values += pixels->linear.samples()[i] * pixels->linear.samples()[i];
  }
  EXPECT_NEAR(std::sqrt(squares / values), fit->comparisons[6].rms, 0.01);
}

TEST(FlashFit, HeldOutPhotographsAreNotRead) {
  // The same bundle with other held-out photographs gives the same maps.
  test::TempFolder folder;
  JobContext job;
  job.seed = 3;
  ASSERT_TRUE(simulateFlash(fitted().scene, folder / "bundle", job).ok());
  std::filesystem::copy_file(folder / "bundle" / "photo_000.png", folder / "bundle" / "photo_006.png",
                             std::filesystem::copy_options::overwrite_existing);
  const auto capture = readFlashCapture(folder / "bundle");
  ASSERT_TRUE(capture.ok());
  FlashFitOptions options;
  options.sharedTexels = 1200;
  const auto again = fitFlash(*capture, options, {});
  ASSERT_TRUE(again.ok());
  const auto a = fitted().fit->maps.specular.samples(), b = (*again)->maps.specular.samples();
  EXPECT_TRUE(std::equal(a.begin(), a.end(), b.begin(), b.end()));
  EXPECT_NE((*again)->stats.holdoutRms, fitted().fit->stats.holdoutRms);
}

TEST(FlashFit, IsWrittenAsTheContractSays) {
  const auto& fit = fitted().fit;
  ASSERT_NE(fit, nullptr);
  test::TempFolder folder;
  ASSERT_TRUE(writeFlashFit(folder / "out", *fit).ok());
  for (const char* name : {"diffuse", "specular", "normal", "sigma", "kurtosis", "residual", "status"})
    EXPECT_TRUE(std::filesystem::exists(folder / "out" / "maps" / (std::string(name) + ".exr"))) << name;
  const auto maps = readMaps(folder / "out" / "maps");
  ASSERT_TRUE(maps.ok());
  EXPECT_EQ(maps->width, fit->maps.width);
  const auto json = nlohmann::json::parse(test::readText(folder / "out" / "fit.json"));
  EXPECT_EQ(json.at("kind"), "flash");
  EXPECT_NEAR(json.at("holdout_rms").get<double>(), fit->stats.holdoutRms, 1e-12);
  for (const char* key :
       {"seconds", "texels", "iterations", "options", "fit_rms", "noise_floor", "materials"})
    EXPECT_TRUE(json.contains(key)) << key;
}

TEST(FlashFit, StopsWhenAsked) {
  const auto capture = readFlashCapture(fitted().folder / "bundle");
  ASSERT_TRUE(capture.ok());
  std::stop_source stop;
  stop.request_stop();
  JobContext job;
  job.stop = stop.get_token();
  const auto fit = fitFlash(*capture, {}, job);
  ASSERT_FALSE(fit.ok());
  EXPECT_EQ(fit.error().code, ErrorCode::Cancelled);
}

TEST(FlashFit, OptionsOutOfRangeAreNamed) {
  FlashFitOptions options;
  options.size = -1, options.materials = 9;
  EXPECT_EQ(options.validate().size(), 2u);
  const auto capture = readFlashCapture(fitted().folder / "bundle");
  ASSERT_TRUE(capture.ok());
  EXPECT_FALSE(fitFlash(*capture, options, {}).ok());
}

TEST(FlashFit, RealPhotographsArePredicted) {
  PATINA_NEEDS_SHARED("flash/cards_blue");
  const auto capture = readFlashCapture(test::sharedData() / "flash" / "cards_blue");
  ASSERT_TRUE(capture.ok());
  FlashFitOptions options;
  options.size = 128, options.sharedTexels = 1000;
  const auto fit = fitFlash(*capture, options, {});
  ASSERT_TRUE(fit.ok()) << fit.error().sentence();
  EXPECT_GE((*fit)->model.materials.size(), 2u) << "foil in two colours and card";
  EXPECT_LT((*fit)->stats.holdoutRms, 0.50) << "pixels of the full photographs: their sparkle is in it";
}

}  // namespace
}  // namespace patina
