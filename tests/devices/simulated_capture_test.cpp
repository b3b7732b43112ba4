#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <fstream>
#include <numbers>
#include <thread>

#include "devices/simulated/simulated_rig.h"
#include "engine/image/exr.h"
#include "tests/test_data.h"

namespace patina {
namespace {

namespace fs = std::filesystem;

class Folder {
 public:
  Folder() {
    std::string name = (fs::temp_directory_path() / "patina-sim-XXXXXX").string();
    path_ = mkdtemp(name.data());
  }
  ~Folder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  fs::path operator/(const std::string& name) const { return path_ / name; }
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

SimulatedCaptureOptions quick() {
  SimulatedCaptureOptions options;
  options.fitted = {{1, 0}, {0, 4}, {10, -10}};
  options.heldOut = {{5, 0}};
  options.samplesPerPixelSide = 1;
  return options;
}

double largest(const Image& image) {
  double most = 0;
  for (float v : image.samples()) most = std::max<double>(most, v);
  return most;
}

TEST(SimulatedRig, DeskShowsTheWholeSheetAndLittleElse) {
  for (const auto& [w, h] : {std::pair{120.0, 120.0}, {200.0, 80.0}}) {
    const SimulatedRig rig = SimulatedRig::desk(64, w, h);
    EXPECT_TRUE(rig.validate().empty());
    EXPECT_NEAR(
        (rig.screen.worldFromScreen.transpose() * rig.screen.worldFromScreen - Eigen::Matrix3d::Identity())
            .norm(),
        0, 1e-12);
    EXPECT_NEAR(rig.screen.worldFromScreen.determinant(), 1, 1e-12);
    EXPECT_NEAR(rig.camera.cameraFromWorld.determinant(), 1, 1e-12);
    EXPECT_LT(rig.screen.worldFromScreen.col(2).dot(rig.screen.originMm), 0);  // emits towards the sheet
    double reach = 0;
    for (double x : {-0.5, 0.5})
      for (double y : {-0.5, 0.5}) {
        const auto at = rig.camera.pixelFromWorld({x * w, y * h, 0});
        ASSERT_TRUE(at);
        reach = std::max(reach, (*at - Eigen::Vector2d::Constant(31.5)).cwiseAbs().maxCoeff());
      }
    EXPECT_LT(reach, 31.5);
    EXPECT_GT(reach, 27);
  }
}

TEST(ExposeSheet, ConvergedAtTheDefaults) {
  // Twice the cells, the nodes and the reach: less than a thousandth of the brightest photograph anywhere, in
  // any scene.
  for (const std::string& name : simulatedSceneNames()) {
    const SimulatedSheet sheet = simulatedScene(name);
    const SimulatedRig rig = SimulatedRig::desk(8, sheet.widthMm, sheet.heightMm);
    SimulatedCaptureOptions options;
    options.samplesPerPixelSide = 1;
    options.fitted = {{1, 0}, {0, 3}, {6, 6}, {20, 0}, {40, -40}};
    const auto coarse = exposeSheet(rig, sheet, options, {});
    options.quality.cellsAcross *= 2;
    options.quality.nodesPerSigma *= 2;
    options.quality.nodesPerDistance *= 2;
    options.quality.lobeReach *= 1.5;
    const auto fine = exposeSheet(rig, sheet, options, {});
    ASSERT_TRUE(coarse.ok() && fine.ok()) << name;
    const double full = largest(fine->photo(0));
    double worst = 0;
    for (int p = 0; p < fine->photos(); ++p) {
      const Image a = coarse->photo(p), b = fine->photo(p);
      for (std::size_t i = 0; i < a.samples().size(); ++i)
        worst = std::max(worst, std::abs(static_cast<double>(a.samples()[i]) - b.samples()[i]));
    }
    EXPECT_LT(worst / full, 1e-3) << name;
    RecordProperty("worst_" + name, std::to_string(worst / full));
    std::printf("%s: doubling changes at most %.2e of full scale\n", name.c_str(), worst / full);
  }
}

TEST(ExposeSheet, AgreesWithAnotherSimulator) {
  // The clean bundle's photographs were made by a program that shares nothing with ours; its materials at the
  // camera's pixels are in truth/.
  PATINA_NEEDS_SHARED("fourier/clean_laminate/capture.json");
  for (const char* bundle : {"clean_laminate", "clean_cardstock"}) {
    const fs::path folder = test::sharedData() / "fourier" / bundle;
    const auto capture = readFourierCapture(folder);
    ASSERT_TRUE(capture.ok()) << capture.error().sentence();
    const auto map = [&](const char* name, const std::vector<std::string>& channels) {
      return readExr(folder / "truth" / (std::string("camera_") + name + ".exr"), channels).value();
    };
    const std::vector<std::string> rgb{"R", "G", "B"};
    const Image diffuse = map("diffuse", rgb), specular = map("specular", rgb), normal = map("normal", rgb);
    const Image sigma = map("roughness", {"Y"}), kurtosis = map("kurtosis", {"Y"});
    std::ifstream file(folder / "truth" / "truth.json");
    const std::string text(std::istreambuf_iterator<char>(file), {});
    const double full = std::stod(text.substr(text.find("camera_full_scale") + 20));

    std::vector<Eigen::Vector2i> frequencies;
    std::vector<const FourierPhoto*> photos;
    for (const FourierPhoto& photo : capture->photos)
      if (photo.role == PhotoRole::Pattern) {
        if (photo.phase == 0) frequencies.push_back(photo.frequency);
        photos.push_back(&photo);
      }
    ScreenIntegrator integrator(capture->screen, frequencies, IntegrationQuality{});
    ASSERT_TRUE(integrator.prepare(4, {}));
    double black = 0;  // their room is not quite dark
    const Image dark = readPhoto(*capture, capture->photos[1]).value();
    for (float sample : dark.samples()) black += sample / static_cast<double>(dark.samples().size());
    std::vector<Image> taken;
    for (const FourierPhoto* photo : photos) taken.push_back(readPhoto(*capture, *photo).value());

    const Eigen::Vector3d eye = capture->camera.positionMm();
    double chiSquare = 0;
    std::size_t count = 0;
    for (int y = 4; y < capture->camera.height; y += 6)
      for (int x = 4; x < capture->camera.width; x += 6) {
        const auto point = capture->camera.samplePlaneFromPixel({x, y});
        if (!point || point->head<2>().cwiseAbs().maxCoeff() > 58) continue;
        bool alone = true;  // a pixel on a material's edge mixes two
        for (int v = -2; v <= 2; ++v)
          for (int u = -2; u <= 2; ++u)
            if (x + u >= 0 && y + v >= 0 && x + u < sigma.width() && y + v < sigma.height())
              alone = alone && std::abs(kurtosis.at(x + u, y + v) - kurtosis.at(x, y)) < 1e-4;
        if (!alone) continue;
        SheetPoint material;
        for (int c = 0; c < 3; ++c) {
          material.diffuse[c] = diffuse.at(x, y, c);
          material.specular[c] = specular.at(x, y, c);
          material.normal[c] = normal.at(x, y, c);
        }
        material.normal.normalize();
        material.sigma = sigma.at(x, y);
        material.kurtosis = kurtosis.at(x, y);
        const PointResponse response = integrator.respond(*point, (eye - *point).normalized(), material);
        for (std::size_t p = 0; p < photos.size(); ++p)
          for (int c = 0; c < 3; ++c) {
            const auto column = static_cast<Eigen::Index>(p);
            const double expected = black + material.diffuse[c] * response.diffuse[column] +
                                    material.specular[c] * response.specular[column];
            const double deviation = taken[p].at(x, y, c) - expected;
            chiSquare += deviation * deviation / (full * 2e-5 * expected + 4e-8 * full * full);
            ++count;
          }
      }
    ASSERT_GT(count, 20000u);
    std::printf("%s: chi-square per sample %.3f over %zu\n", bundle, chiSquare / static_cast<double>(count),
                count);
    // 1 is the sensor's noise alone; half floats and the pixel's extent add a little.
    EXPECT_GT(chiSquare / static_cast<double>(count), 0.95) << bundle;
    EXPECT_LT(chiSquare / static_cast<double>(count), 1.10) << bundle;
  }
}

TEST(SimulateCapture, BundleReadsBack) {
  const Folder folder;
  const SimulatedSheet sheet = simulatedScene("laminate");
  const SimulatedRig rig = SimulatedRig::desk(16, sheet.widthMm, sheet.heightMm);
  SimulatedCaptureOptions options = quick();
  options.writeTruth = true;
  JobContext job;
  job.seed = 5;
  const auto report = simulateCapture(folder / "capture", rig, sheet, options, job);
  ASSERT_TRUE(report.ok()) << report.error().sentence();
  const auto capture = readFourierCapture(folder / "capture");
  ASSERT_TRUE(capture.ok()) << capture.error().sentence();
  EXPECT_TRUE(capture->ignoredKeys.empty());
  ASSERT_EQ(capture->photos.size(), 2u + 4 * 4);
  EXPECT_EQ(capture->photos[0].role, PhotoRole::Window);
  EXPECT_EQ(capture->photos[1].role, PhotoRole::Black);
  EXPECT_EQ(capture->photos[2].frequency, Eigen::Vector2i(1, 0));
  EXPECT_EQ(capture->photos[5].phase, 3);
  EXPECT_FALSE(capture->photos[2].holdout);
  EXPECT_TRUE(capture->photos.back().holdout);
  EXPECT_EQ(capture->camera.cameraFromWorld, rig.camera.cameraFromWorld);
  EXPECT_EQ(capture->camera.distortion, rig.camera.distortion);
  EXPECT_EQ(capture->screen.worldFromScreen, rig.screen.worldFromScreen);
  ASSERT_TRUE(capture->screen.emission);
  EXPECT_EQ(capture->screen.emission->sigma, rig.screen.emission->sigma);
  const auto exposure = exposeSheet(rig, sheet, options, job);
  const auto window = readPhoto(*capture, capture->photos[0]);
  ASSERT_TRUE(window.ok() && exposure.ok());
  EXPECT_NEAR(window->at(8, 8, 1), exposure->pixel(0, 8, 8)[1] + rig.blackLevel, 0.03 * report->fullScale);
  for (const char* name : {"diffuse", "specular", "normal", "roughness", "kurtosis"})
    EXPECT_TRUE(fs::exists(folder / ("capture/truth/" + std::string(name) + ".exr"))) << name;
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), {}), 1);  // nothing half-written beside it
}

TEST(SimulateCapture, SameSeedSameBitsOnAnyThreadCount) {
  const Folder folder;
  const SimulatedSheet sheet = simulatedScene("cardstock");
  const SimulatedRig rig = SimulatedRig::desk(8, sheet.widthMm, sheet.heightMm);
  JobContext job;
  job.seed = 9;
  job.threads = 1;
  ASSERT_TRUE(simulateCapture(folder / "a", rig, sheet, quick(), job).ok());
  job.threads = 2;
  ASSERT_TRUE(simulateCapture(folder / "b", rig, sheet, quick(), job).ok());
  job.seed = 10;
  ASSERT_TRUE(simulateCapture(folder / "c", rig, sheet, quick(), job).ok());
  const auto read = [&](const char* name) {
    return readExr(folder / name / "photo_003.exr", {"R", "G", "B"}).value();
  };
  const Image a = read("a"), b = read("b"), c = read("c");
  EXPECT_TRUE(std::ranges::equal(a.samples(), b.samples()));
  EXPECT_FALSE(std::ranges::equal(a.samples(), c.samples()));
}

TEST(SimulateCapture, NoiseHasTheVarianceThatItShould) {
  const Folder folder;
  SimulatedSheet sheet;  // one plain material
  sheet.slopeRms = sheet.albedoVariation = sheet.sigmaVariation = 0;
  const SimulatedRig rig = SimulatedRig::desk(40, sheet.widthMm, sheet.heightMm);
  JobContext job;
  job.seed = 3;
  const SimulatedCaptureOptions options = quick();
  const auto report = simulateCapture(folder / "capture", rig, sheet, options, job);
  ASSERT_TRUE(report.ok());
  const auto exposure = exposeSheet(rig, sheet, options, job);
  const auto capture = readFourierCapture(folder / "capture");
  ASSERT_TRUE(exposure.ok() && capture.ok());
  const double full = report->fullScale;
  double chiSquare = 0, mean = 0, black = 0;
  std::size_t count = 0, blackCount = 0;
  for (std::size_t p = 0; p < capture->photos.size(); ++p) {
    const Image photo = readPhoto(*capture, capture->photos[p]).value();
    const Image clean = exposure->photo(static_cast<int>(p));
    for (std::size_t i = 0; i < photo.samples().size(); ++i) {
      const double expected = clean.samples()[i] + rig.blackLevel;
      const double deviation = photo.samples()[i] - expected;
      if (capture->photos[p].role == PhotoRole::Black) {
        black += deviation * deviation;
        ++blackCount;
      } else {
        const double variance = full * 2e-5 * expected + std::pow(2e-4 * full, 2);
        chiSquare += deviation * deviation / variance;
        mean += deviation / std::sqrt(variance);
        ++count;
      }
    }
  }
  const double n =
      static_cast<double>(count);  // tolerances: five standard deviations; half floats add up to 1 %
  EXPECT_NEAR(chiSquare / n, 1.0, 5 * std::sqrt(2 / n) + 0.01);
  EXPECT_NEAR(mean / n, 0.0, 5 / std::sqrt(n));
  const double darkSigma = std::sqrt(full * 2e-5 * rig.blackLevel + std::pow(2e-4 * full, 2));
  EXPECT_NEAR(std::sqrt(black / static_cast<double>(blackCount)), darkSigma, 0.06 * darkSigma);
  EXPECT_EQ(report->clippedSamples, 0u);
}

TEST(SimulateCapture, ClipsAtTheGivenFullScale) {
  const Folder folder;
  const SimulatedSheet sheet = simulatedScene("laminate");
  SimulatedRig rig = SimulatedRig::desk(8, sheet.widthMm, sheet.heightMm);
  const SimulatedCaptureOptions options = quick();
  const auto exposure = exposeSheet(rig, sheet, options, {});
  ASSERT_TRUE(exposure.ok());
  rig.fullScale = 0.5 * largest(exposure->photo(0));
  const auto report = simulateCapture(folder / "capture", rig, sheet, options, {});
  ASSERT_TRUE(report.ok());
  EXPECT_GT(report->clippedSamples, 0u);
  const auto capture = readFourierCapture(folder / "capture");
  ASSERT_TRUE(capture.ok());
  EXPECT_LE(largest(*readPhoto(*capture, capture->photos[0])), rig.fullScale * 1.0005);  // half float
}

TEST(SimulateCapture, LeavesAStrangersFolderAlone) {
  const Folder folder;
  std::ofstream(folder / "thesis.txt") << "irreplaceable";
  const SimulatedSheet sheet = simulatedScene("laminate");
  const auto report = simulateCapture(folder.path(), SimulatedRig::desk(8, 120, 120), sheet, quick(), {});
  ASSERT_FALSE(report.ok());
  EXPECT_EQ(report.error().code, ErrorCode::Refused);
  EXPECT_TRUE(fs::exists(folder / "thesis.txt"));
}

// A measured bundle has the same file names: only the mark in capture.json tells the two apart.
TEST(SimulateCapture, ReplacesOnlyWhatASimulatedRigMade) {
  const Folder folder;
  const SimulatedSheet sheet = simulatedScene("laminate");
  const SimulatedRig rig = SimulatedRig::desk(8, 120, 120);
  const fs::path bundle = folder / "capture";
  ASSERT_TRUE(simulateCapture(bundle, rig, sheet, quick(), {}).ok());
  std::ofstream(bundle / "photo_999.exr") << "of the earlier capture";
  const auto again = simulateCapture(bundle, rig, sheet, quick(), {});
  ASSERT_TRUE(again.ok()) << again.error().sentence();
  EXPECT_FALSE(fs::exists(bundle / "photo_999.exr")) << "nothing of the earlier one stays";
  EXPECT_TRUE(readFourierCapture(bundle).ok());
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), {}), 1) << "nothing is left beside it";

  FourierCapture measured = readFourierCapture(bundle).value();
  measured.madeBy.clear();
  ASSERT_TRUE(writeFourierCapture(measured).ok());
  const auto refused = simulateCapture(bundle, rig, sheet, quick(), {});
  ASSERT_FALSE(refused.ok());
  EXPECT_EQ(refused.error().code, ErrorCode::Refused);
  EXPECT_TRUE(readFourierCapture(bundle).ok()) << "all of its photographs are still there";

  measured.madeBy = "patina simulated rig";
  ASSERT_TRUE(writeFourierCapture(measured).ok());
  std::ofstream(bundle / "notes.txt") << "mine";
  EXPECT_FALSE(simulateCapture(bundle, rig, sheet, quick(), {}).ok());
  EXPECT_TRUE(fs::exists(bundle / "notes.txt"));
}

TEST(SimulateCapture, TakesTheFoldersThatItMadeAway) {
  const Folder folder;
  const SimulatedSheet sheet = simulatedScene("laminate");
  SimulatedRig rig = SimulatedRig::desk(8, 120, 120);
  rig.camera.width = 0;
  EXPECT_FALSE(simulateCapture(folder / "a" / "b" / "capture", rig, sheet, quick(), {}).ok());
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

TEST(SimulateCapture, BadValuesAreNamed) {
  const Folder folder;
  SimulatedSheet sheet = simulatedScene("laminate");
  sheet.materials[1].sigma = -1;
  const auto report =
      simulateCapture(folder / "capture", SimulatedRig::desk(8, 120, 120), sheet, quick(), {});
  ASSERT_FALSE(report.ok());
  EXPECT_EQ(report.error().code, ErrorCode::Invalid);
  EXPECT_NE(report.error().sentence().find("material 2"), std::string::npos);
  sheet.materials[1].sigma = 3e-4;
  EXPECT_EQ(
      simulateCapture(folder / "capture", SimulatedRig::desk(8, 120, 120), sheet, quick(), {}).error().code,
      ErrorCode::Invalid);
  EXPECT_FALSE(fs::exists(folder / "capture"));
}

TEST(SimulateCapture, StopsWithin100MsAndLeavesNothing) {
  const Folder folder;
  const SimulatedSheet sheet = simulatedScene("mirror-mix");
  const SimulatedRig rig = SimulatedRig::desk(96, sheet.widthMm, sheet.heightMm);
  for (int delayMs : {0, 150, 600}) {  // before, while preparing, while integrating
    std::stop_source stop;
    JobContext job;
    job.stop = stop.get_token();
    std::chrono::steady_clock::time_point asked;
    std::jthread canceller([&] {
      std::this_thread::sleep_for(std::chrono::milliseconds(delayMs));
      asked = std::chrono::steady_clock::now();
      stop.request_stop();
    });
    const auto report = simulateCapture(folder / "capture", rig, sheet, SimulatedCaptureOptions{}, job);
    const auto answered = std::chrono::steady_clock::now();
    canceller.join();
    ASSERT_FALSE(report.ok());
    EXPECT_EQ(report.error().code, ErrorCode::Cancelled);
    // The engine polls every few milliseconds; the rest is a busy machine's scheduling.
    EXPECT_LT(std::chrono::duration<double>(answered - asked).count(), 0.5)
        << "stopped after " << delayMs << " ms";
    EXPECT_TRUE(fs::is_empty(folder.path()));
  }
}

TEST(SimulatedExposure, BigOnesLiveInAFile) {
  SimulatedExposure exposure(1024, 1024, 44);  // 554 MB: over what is kept in memory
  ASSERT_TRUE(exposure.valid());
  exposure.pixel(43, 1023, 1023)[2] = 7;
  const SimulatedExposure moved = std::move(exposure);
  EXPECT_FALSE(exposure.valid());
  EXPECT_EQ(moved.pixel(43, 1023, 1023)[2], 7);
  EXPECT_EQ(moved.pixel(20, 5, 5)[0], 0);
}

}  // namespace
}  // namespace patina
