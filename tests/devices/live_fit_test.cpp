#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "devices/simulated/simulated_rig.h"
#include "engine/fourier/fit.h"
#include "tests/acquire/live_session.h"
#include "tests/base/temp_folder.h"

namespace patina {
namespace {

using test::LiveSession;
using test::TempFolder;

struct Medians {
  double diffuse = 0, normalDeg = 0, sigma = 0, holdoutOverNoise = 0;
};

Medians fitOf(const std::filesystem::path& bundle, const SimulatedSheet& sheet) {
  const Result<FourierCapture> capture = readFourierCapture(bundle);
  EXPECT_TRUE(capture.ok()) << capture.error().sentence();
  const auto fit = fitFourier(*capture, {}, {});
  EXPECT_TRUE(fit.ok()) << fit.error().sentence();
  const SvbrdfMaps& maps = (*fit)->maps();
  const SheetTruth truth = sheetTruth(sheet, maps.width, maps.height, 2);
  std::vector<double> diffuse, normal, sigma;
  for (int y = 0; y < maps.height; ++y)
    for (int x = 0; x < maps.width; ++x) {
      const auto status = static_cast<TexelStatus>(static_cast<int>(maps.status.at(x, y)));
      if (status != TexelStatus::Converged || truth.material.at(x, y) < 0) continue;
      double cosine = 0;
      for (int c = 0; c < 3; ++c)
        cosine += static_cast<double>(maps.normal.at(x, y, c)) * truth.normal.at(x, y, c);
      normal.push_back(std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / std::numbers::pi);
      diffuse.push_back(std::abs(maps.diffuse.at(x, y, 1) / truth.diffuse.at(x, y, 1) - 1));
      sigma.push_back(std::abs(maps.sigma.at(x, y) / truth.sigma.at(x, y) - 1));
    }
  EXPECT_GT(normal.size(), 300u);
  const auto median = [](std::vector<double>& values) {
    std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                     values.end());
    return values[values.size() / 2];
  };
  const FourierFitStats& stats = (*fit)->stats();
  return {median(diffuse), median(normal), median(sigma), stats.holdoutRms / stats.noiseFloorHoldout};
}

TEST(LiveFit, MapsOfALedCaptureAreAsGoodAsThoseOfTheSimulatorsOwn) {
  constexpr int kPixels = 40;
  const TempFolder folder;
  const LiveRigSetup setup = LiveRig::desk("laminate", kPixels, 1280);
  LiveSession live(setup);
  auto session = CaptureSession::open(folder / "live", live.rig->description(), {}, false).value();
  const auto outcome = session->run(*live.camera, *live.display, {});
  ASSERT_TRUE(outcome.ok()) << outcome.error().sentence();
  EXPECT_EQ(outcome->flawed, 0);
  const Medians led = fitOf(folder / "live", setup.sheet);
  const SimulatedRig rig = SimulatedRig::desk(kPixels, setup.sheet.widthMm, setup.sheet.heightMm);
  SimulatedCaptureOptions options;
  options.samplesPerPixelSide = 1;
  ASSERT_TRUE(simulateCapture(folder / "own", rig, setup.sheet, options, {}).ok());
  const Medians own = fitOf(folder / "own", setup.sheet);
  RecordProperty("diffuse", std::to_string(led.diffuse) + " / " + std::to_string(own.diffuse));
  RecordProperty("normalDeg", std::to_string(led.normalDeg) + " / " + std::to_string(own.normalDeg));
  // The same sheet and about the same noise (full scale differs a little); medians of some thousand texels.
  EXPECT_LT(led.diffuse, 1.25 * own.diffuse + 5e-4) << own.diffuse;
  EXPECT_LT(led.normalDeg, 1.25 * own.normalDeg) << own.normalDeg;
  EXPECT_LT(led.sigma, 1.25 * own.sigma) << own.sigma;
  EXPECT_LT(led.holdoutOverNoise, 1.035);  // the bound of the project's own test captures
}

}  // namespace
}  // namespace patina
