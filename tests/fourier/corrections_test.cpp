// Fits with something else known to act on the photographs, and what lets a diagnosis look into a fit.
#include "engine/fourier/corrections.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <stdexcept>

#include "devices/simulated/simulated_rig.h"
#include "engine/fourier/fit_access.h"
#include "engine/fourier/photo_correction.h"
#include "engine/image/exr.h"
#include "tests/base/temp_folder.h"

namespace patina::test {
namespace {

namespace fs = std::filesystem;

/// One capture for all tests of this program.
class Corrections : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TempFolder();
    const SimulatedSheet sheet = simulatedScene("laminate");
    SimulatedCaptureOptions options;
    options.samplesPerPixelSide = 1;
    const auto report =
        simulateCapture(folder_->path() / "bundle", SimulatedRig::desk(48, sheet.widthMm, sheet.heightMm),
                        sheet, options, {});
    ASSERT_TRUE(report.ok()) << report.error().sentence();
  }
  static void TearDownTestSuite() {
    delete folder_;
    folder_ = nullptr;
  }
  static FourierCapture capture(const char* name = "bundle") {
    auto read = readFourierCapture(folder_->path() / name);
    EXPECT_TRUE(read.ok());
    return *read;
  }
  static std::shared_ptr<const FourierFit> fitted(const FourierFitOptions& options = {},
                                                  const char* name = "bundle") {
    const auto fit = fitFourier(capture(name), options, {});
    EXPECT_TRUE(fit.ok()) << fit.error().sentence();
    return *fit;
  }
  static std::shared_ptr<const FourierFit> corrected(const char* name, FourierCorrections corrections) {
    FourierFitOptions options;
    options.corrections = std::make_shared<const FourierCorrections>(std::move(corrections));
    return fitted(options, name);
  }
  /// The plain fit, made once.
  static const FourierFit& base() {
    static const std::shared_ptr<const FourierFit> fit = fitted();
    return *fit;
  }
  /// The bundle again, `alter` done to every pixel of every photograph: (photo, pixel, R G B).
  template <typename Alter>
  static void makeAltered(const char* name, Alter alter) {
    if (fs::exists(folder_->path() / name)) return;
    fs::copy(folder_->path() / "bundle", folder_->path() / name, fs::copy_options::recursive);
    const FourierCapture bundle = capture();
    for (std::size_t i = 0; i < bundle.photos.size(); ++i) {
      const fs::path file = folder_->path() / name / bundle.photos[i].file;
      auto image = readExr(file, {"R", "G", "B"});
      ASSERT_TRUE(image.ok());
      const auto samples = image->samples();
      for (std::size_t k = 0; k < samples.size() / 3; ++k) {
        Eigen::Array3f rgb(samples[k * 3], samples[k * 3 + 1], samples[k * 3 + 2]);
        alter(static_cast<int>(i), k, rgb);
        for (std::size_t c = 0; c < 3; ++c) samples[k * 3 + c] = rgb[static_cast<Eigen::Index>(c)];
      }
      ASSERT_TRUE(writeExr(file, *image, {"R", "G", "B"}).ok());
    }
  }
  static inline TempFolder* folder_ = nullptr;
};

void expectSameStores(const MeasurementStore& a, const MeasurementStore& b, float tolerance = 0) {
  ASSERT_EQ(a.siteCount(), b.siteCount());
  ASSERT_EQ(a.frequencyCount(), b.frequencyCount());
  ASSERT_FALSE(a.empty());
  const SiteBlock blockA = a.block(0, a.siteCount()), blockB = b.block(0, b.siteCount());
  for (std::size_t s = 0; s < a.siteCount(); ++s) {
    for (int k = 0; k < 6 * a.frequencyCount(); ++k) {
      ASSERT_NEAR(blockA.z(s)[k], blockB.z(s)[k], tolerance) << s << " " << k;
      ASSERT_NEAR(blockA.even(s)[k], blockB.even(s)[k], tolerance) << s << " " << k;
    }
  }
}

TEST_F(Corrections, AFitCanBeLookedInto) {
  const auto fit = fitted();
  const FourierFitState& state = fitState(*fit);
  const FourierMeasurements& m = state.measurements;
  EXPECT_EQ(state.sites.size(), m.sites.size());
  EXPECT_EQ(m.store.siteCount(), m.sites.size());
  EXPECT_EQ(m.heldOut.frequencyCount(), static_cast<int>(m.plan.heldOut.size()));
  ASSERT_TRUE(state.diffuse);
  const SvbrdfParameters here = fit->parametersAt(20, 30);
  EXPECT_EQ(here.sigma, state.sites[static_cast<std::size_t>(state.siteOfTexel(20, 30))].sigma);

  ASSERT_TRUE(writeFourierFit(folder_->path() / "fit", *fit).ok());
  const auto loaded = loadFourierFit(folder_->path() / "fit", {});
  ASSERT_TRUE(loaded.ok()) << loaded.error().sentence();
  const FourierFitState& again = fitState(**loaded);
  expectSameStores(m.store, again.measurements.store);
  expectSameStores(m.heldOut, again.measurements.heldOut);
  ASSERT_TRUE(again.diffuse);
}

TEST_F(Corrections, SomebodyElsesFitIsRefused) {
  class Other final : public FourierFit {
   public:
    const SvbrdfMaps& maps() const override { return maps_; }
    const FourierFitStats& stats() const override { return stats_; }
    const FourierCapture& capture() const override { return capture_; }
    const FourierFitOptions& options() const override { return options_; }
    SvbrdfParameters parametersAt(int, int) const override { return {}; }
    std::vector<SpectrumSample> spectrumAt(int, int) const override { return {}; }
    std::vector<SpectrumCurvePoint> modelSpectrumAt(int, int, Eigen::Vector2d, double, int) const override {
      return {};
    }
    LobeSlice lobeAt(int, int, bool, int) const override { return {}; }

   private:
    SvbrdfMaps maps_;
    FourierFitStats stats_;
    FourierCapture capture_;
    FourierFitOptions options_;
  };
  EXPECT_THROW(static_cast<void>(fitState(Other())), std::invalid_argument);
}

/// Root mean square difference of two images over that of the first.
double difference(const Image& a, const Image& b) {
  double gap = 0, all = 0;
  EXPECT_EQ(a.samples().size(), b.samples().size());
  for (std::size_t i = 0; i < a.samples().size(); ++i) {
    gap += std::pow(static_cast<double>(a.samples()[i]) - b.samples()[i], 2);
    all += std::pow(static_cast<double>(a.samples()[i]), 2);
  }
  return std::sqrt(gap / all);
}

/// The maps of two fits agree but for where their searches ended: a hundredth of what noise does to them.
void expectSameMaps(const FourierFit& a, const FourierFit& b, double tolerance = 2e-3) {
  EXPECT_LT(difference(a.maps().diffuse, b.maps().diffuse), tolerance);
  EXPECT_LT(difference(a.maps().specular, b.maps().specular), tolerance);
  EXPECT_LT(difference(a.maps().normal, b.maps().normal), tolerance);
  EXPECT_LT(difference(a.maps().sigma, b.maps().sigma), tolerance);
}

TEST_F(Corrections, NoneChangeNothing) {
  const auto fit = corrected("bundle", {});
  const FourierFitState &a = fitState(base()), &b = fitState(*fit);
  expectSameStores(a.measurements.store, b.measurements.store);
  expectSameStores(a.measurements.heldOut, b.measurements.heldOut);
  EXPECT_EQ(a.measurements.dc, b.measurements.dc);
  for (std::size_t s = 0; s < a.sites.size(); ++s) {
    ASSERT_EQ(a.sites[s].sigma, b.sites[s].sigma);
    ASSERT_TRUE((a.sites[s].normal.array() == b.sites[s].normal.array()).all());
  }
  EXPECT_EQ(base().stats().fitRms, fit->stats().fitRms);
  EXPECT_EQ(base().stats().holdoutRms, fit->stats().holdoutRms);
}

/// A camera with a curve, channels that bleed, light that changes from photograph to photograph, and more of
/// it from elsewhere.
struct BadCamera {
  static constexpr float kGamma = 0.9f;
  FourierCorrections corrections;
  Eigen::Matrix3f mix;
  std::vector<float> black;  ///< the black photograph
  explicit BadCamera(const FourierCapture& capture) {
    corrections.linearFromPhoto = [](float x) { return std::copysign(std::pow(std::abs(x), 1 / kGamma), x); };
    mix << 0.95f, 0.04f, 0.01f, 0.02f, 0.96f, 0.02f, 0.00f, 0.05f, 0.95f;
    corrections.unmix = mix.inverse();
    for (std::size_t i = 0; i < capture.photos.size(); ++i) {
      const auto k = static_cast<float>(i);
      corrections.photoGain.push_back(1 + 0.03f * std::sin(3 * k));
      corrections.photoOffset.push_back(Eigen::Array3f(0.001f, 0.002f, 0.001f) * (1 + std::cos(2 * k)));
      if (capture.photos[i].role != PhotoRole::Black) continue;
      const auto image = readExr(capture.folder / capture.photos[i].file, {"R", "G", "B"});
      EXPECT_TRUE(image.ok());
      black.assign(image->samples().begin(), image->samples().end());
    }
  }
  void operator()(int photo, std::size_t pixel, Eigen::Array3f& rgb) const {
    const Eigen::Array3f dark(black[pixel * 3], black[pixel * 3 + 1], black[pixel * 3 + 2]);
    record(photo, dark, rgb);
  }
  void record(int photo, const Eigen::Array3f& dark, Eigen::Array3f& rgb) const {
    const auto i = static_cast<std::size_t>(photo);
    rgb = dark + corrections.photoGain[i] * (rgb - dark) + corrections.photoOffset[i];
    rgb = (mix * rgb.matrix()).array().eval();
    for (float& value : rgb) value = std::copysign(std::pow(std::abs(value), kGamma), value);
  }
};

TEST_F(Corrections, ABadCameraIsUndone) {
  const BadCamera camera(capture());
  makeAltered("camera", camera);
  const auto fit = corrected("camera", camera.corrections);
  const FourierMeasurements &a = fitState(base()).measurements, &b = fitState(*fit).measurements;
  const auto scale = static_cast<float>(a.fullScale);
  expectSameStores(a.store, b.store, 1e-5f * scale);
  // Held-out ones know the black level less its noise, of which gain leaves 3 %.
  expectSameStores(a.heldOut, b.heldOut, 1e-3f * scale);
  EXPECT_NEAR(b.noise.variance(0.1 * scale) / a.noise.variance(0.1 * scale), 1, 0.01);
  expectSameMaps(base(), *fit);
  // Not knowing of it is another matter.
  const auto silent = fitted({}, "camera");
  EXPECT_GT(difference(base().maps().specular, silent->maps().specular), 0.05);
  EXPECT_GT(silent->stats().holdoutRms, 1.5 * fit->stats().holdoutRms);
}

/// Relative error over the photographs as they lie in the folder, photograph by photograph and pixel by
/// pixel, with the reference's transforms: nothing of PhotoPrediction.
double errorByPhotographs(const FourierFit& fit, const BadCamera& camera) {
  const FourierFitState& state = fitState(fit);
  const FourierMeasurements& m = state.measurements;
  std::vector<Eigen::Vector2d> frequencies = {Eigen::Vector2d::Zero()};
  for (const auto& group : m.plan.heldOut)
    for (const int h : {1, 2, 4, 6, 8, 10, 12, 14, 16})
      frequencies.push_back((h * group.frequency).cast<double>());
  const DiffuseTransform transform(state.frame, {state.capture.sampleWidthMm, state.capture.sampleHeightMm},
                                   frequencies, DiffuseMethod::Quadrature);
  std::vector<Image> photographs;
  for (const auto& group : m.plan.heldOut) {
    for (const int index : group.photo) {
      auto image = readExr(state.capture.folder / state.capture.photos[static_cast<std::size_t>(index)].file,
                           {"R", "G", "B"});
      EXPECT_TRUE(image.ok());
      photographs.push_back(std::move(*image));
    }
  }
  double error = 0, signal = 0;
  std::vector<float> v(frequencies.size() * 6);
  for (std::size_t s = 0; s < m.sites.size(); ++s) {
    if (state.siteStatus[s] == TexelStatus::Failed || state.siteStatus[s] == TexelStatus::Clipped) continue;
    const SvbrdfParameters& p = state.sites[s];
    const SiteLobe lobe = siteLobe(state.frame, state.geometry(s), p, LobeMapping::ExactMoments);
    const Eigen::Vector3f n = normalOnScreen(state.frame, p.normal);
    transform.at(m.sites.pointMm[s].cast<double>(), v.data());
    std::array<std::complex<float>, 2 + kEvenHarmonics> d, l;
    const auto fill = [&](std::size_t to, std::size_t f) {
      d[to] = {n.x() * v[f * 6] + n.y() * v[f * 6 + 2] + n.z() * v[f * 6 + 4],
               n.x() * v[f * 6 + 1] + n.y() * v[f * 6 + 3] + n.z() * v[f * 6 + 5]};
      l[to] = lobe.transform(frequencies[f].cast<float>());
    };
    fill(0, 0);
    for (std::size_t g = 0; g < m.plan.heldOut.size(); ++g) {
      for (std::size_t h = 0; h < 9; ++h) fill(1 + h, 1 + g * 9 + h);
      for (int k = 0; k < 4; ++k) {
        const Eigen::Array3f dark(m.black[s * 3], m.black[s * 3 + 1], m.black[s * 3 + 2]);
        Eigen::Array3f predicted =
            dark + p.diffuse * patternRadiance(d, k) + p.specular * patternRadiance(l, k);
        camera.record(m.plan.heldOut[g].photo[static_cast<std::size_t>(k)], dark, predicted);
        const Image& image = photographs[g * 4 + static_cast<std::size_t>(k)];
        for (int c = 0; c < 3; ++c) {
          const double taken =
              image.at(static_cast<int>(m.sites.pixel[s].x()), static_cast<int>(m.sites.pixel[s].y()), c);
          error += std::pow(predicted[c] - taken, 2);
          signal += taken * taken;
        }
      }
    }
  }
  return std::sqrt(error / signal);
}

TEST_F(Corrections, ErrorsAreThoseOfThePhotographsAsTaken) {
  const BadCamera camera(capture());
  makeAltered("camera", camera);
  const auto fit = corrected("camera", camera.corrections);
  // the noise that gain leaves of the black photograph
  EXPECT_NEAR(fit->stats().holdoutRms / errorByPhotographs(*fit, camera), 1, 2e-3);
  EXPECT_NEAR(fit->stats().holdoutRms / fit->stats().noiseFloorHoldout,
              base().stats().holdoutRms / base().stats().noiseFloorHoldout, 0.01);
}

/// Light that an effect adds to single photographs, and what `extra` says of it.
Eigen::Array3f added(int photo, std::size_t pixel) {
  const auto p = static_cast<float>(photo), k = static_cast<float>(pixel);
  return Eigen::Array3f(0.004f, 0.006f, 0.005f) * (1 + 0.7f * std::sin(1.3f * p) * std::cos(0.01f * k));
}

TEST_F(Corrections, ExtraLightIsTakenOffAndStaysInThePhotographs) {
  const FourierCapture plain = capture();
  makeAltered("extra", [&](int photo, std::size_t pixel, Eigen::Array3f& rgb) {
    if (plain.photos[static_cast<std::size_t>(photo)].role != PhotoRole::Black) rgb += added(photo, pixel);
  });
  const auto plan = planMeasurements(capture("extra"), {});
  const auto sites = makeSites(capture("extra"), 0);
  ASSERT_TRUE(plan.ok() && sites.ok());
  FourierCorrections corrections;
  corrections.extra = [&](std::size_t site, bool heldOut, float* z, float* even, float* window) {
    const auto pixel =
        static_cast<std::size_t>(sites->pixel[site].y()) * static_cast<std::size_t>(sites->imageWidth) +
        static_cast<std::size_t>(sites->pixel[site].x());
    const auto& groups = heldOut ? plan->heldOut : plan->fitted;
    for (std::size_t f = 0; f < groups.size(); ++f) {
      Eigen::Array3f photo[4];
      for (std::size_t k = 0; k < 4; ++k) photo[k] = added(groups[f].photo[k], pixel);
      for (int c = 0; c < 3; ++c) {
        z[f * 6 + static_cast<std::size_t>(c)] += photo[1][c] - photo[3][c];
        z[f * 6 + 3 + static_cast<std::size_t>(c)] += photo[2][c] - photo[0][c];
        even[f * 6 + static_cast<std::size_t>(c)] += photo[0][c] + photo[2][c];
        even[f * 6 + 3 + static_cast<std::size_t>(c)] += photo[1][c] + photo[3][c];
      }
    }
    const Eigen::Array3f w = added(plan->window, pixel);
    for (int c = 0; c < 3; ++c) window[c] += w[c];
  };
  FourierFitOptions options;
  options.corrections = std::make_shared<const FourierCorrections>(corrections);
  const auto memory = fitted(options, "extra");
  options.memoryLimitBytes = std::uint64_t{2500} << 10;
  const auto disk = fitted(options, "extra");
  ASSERT_FALSE(memory->stats().measurementsOnDisk);
  ASSERT_TRUE(disk->stats().measurementsOnDisk);
  ASSERT_FALSE(disk->stats().coarserSites);
  for (const auto& fit : {memory, disk}) {
    const FourierMeasurements &a = fitState(base()).measurements, &b = fitState(*fit).measurements;
    const auto scale = static_cast<float>(a.fullScale);
    expectSameStores(a.store, b.store, 1e-6f * scale);
    expectSameStores(a.heldOut, b.heldOut, 1e-6f * scale);
    for (std::size_t i = 0; i < a.dc.size(); ++i) ASSERT_NEAR(a.dc[i], b.dc[i], 2e-6f * scale);
    expectSameMaps(base(), *fit);
  }
  EXPECT_EQ(memory->stats().fitRms, disk->stats().fitRms);
  EXPECT_EQ(memory->stats().holdoutRms, disk->stats().holdoutRms);
  // The same error, of photographs that are brighter by what was added.
  double before = 0, after = 0;
  const FourierCapture bright = capture("extra");
  for (const auto& group : plan->heldOut) {
    for (const int index : group.photo) {
      for (const auto* of : {&plain, &bright}) {
        const auto image = readPhoto(*of, of->photos[static_cast<std::size_t>(index)]);
        ASSERT_TRUE(image.ok());
        for (std::size_t k = 0; k < sites->siteOfPixel.size(); ++k)
          for (std::size_t c = 0; c < 3 && sites->siteOfPixel[k] >= 0; ++c)
            (of == &plain ? before : after) += std::pow(image->samples()[k * 3 + c], 2.0);
      }
    }
  }
  EXPECT_NEAR(memory->stats().holdoutRms * std::sqrt(after / before), base().stats().holdoutRms,
              2e-3 * base().stats().holdoutRms);
}

TEST_F(Corrections, ClippingThatNobodyDeclaredIsLeftOut) {
  const auto level = static_cast<float>(0.8 * fitState(base()).measurements.fullScale);
  makeAltered("clipped", [&](int, std::size_t, Eigen::Array3f& rgb) { rgb = rgb.min(level); });
  FourierCorrections corrections;
  corrections.saturation = level;
  const auto fit = corrected("clipped", corrections), silent = fitted({}, "clipped");
  EXPECT_GT(fit->stats().clippedSamples, 0u);
  EXPECT_EQ(silent->stats().clippedSamples, 0u);
  const double clean = base().stats().fitRms / base().stats().noiseFloorFit;
  EXPECT_LT(fit->stats().fitRms / fit->stats().noiseFloorFit, 1.1 * clean);
  EXPECT_GT(silent->stats().fitRms / silent->stats().noiseFloorFit, 1.3 * clean);
}

TEST_F(Corrections, ASecondFitStartsFromTheFirst) {
  FourierCorrections corrections;
  corrections.sites = std::make_shared<const std::vector<SvbrdfParameters>>(fitState(base()).sites);
  const auto fit = corrected("bundle", corrections);
  EXPECT_LT(fit->stats().meanIterations, 0.7 * base().stats().meanIterations);
  EXPECT_LT(fit->stats().seconds.at("levels"), 0.1 * base().stats().seconds.at("levels"));
  EXPECT_NEAR(fit->stats().holdoutRms / base().stats().holdoutRms, 1, 1e-3);
  expectSameMaps(base(), *fit, 1e-2);
  // Solutions of another capture are no place to start.
  corrections.sites = std::make_shared<const std::vector<SvbrdfParameters>>(7);
  EXPECT_EQ(corrected("bundle", corrections)->stats().fitRms, base().stats().fitRms);
}

TEST_F(Corrections, NothingIsKeptForAnotherFit) {
  FourierFitOptions options;
  FourierFitStorage storage;
  storage.keepFolder = folder_->path() / "keep";
  options.corrections = std::make_shared<const FourierCorrections>();
  ASSERT_TRUE(fitFourier(capture(), options, {}, storage).ok());
  EXPECT_FALSE(fs::exists(storage.keepFolder));
}

TEST_F(Corrections, ImpossibleOnesAreRefused) {
  FourierFitOptions options;
  FourierCorrections corrections;
  corrections.unmix.setZero();
  corrections.photoGain = {1, 0};
  options.corrections = std::make_shared<const FourierCorrections>(corrections);
  const auto fit = fitFourier(capture(), options, {});
  ASSERT_FALSE(fit.ok());
  EXPECT_EQ(fit.error().code, ErrorCode::Invalid);
  EXPECT_THAT(fit.error().what, testing::AllOf(testing::HasSubstr("unmix"), testing::HasSubstr("photoGain")));
}

TEST(ToneTable, FollowsACurveAndComesBack) {
  for (const float gamma : {0.5f, 0.9f, 1.1f, 2.0f}) {
    const auto curve = [gamma](float x) { return std::copysign(std::pow(std::abs(x), gamma), x); };
    const ToneTable table(curve);
    for (float x = 1e-5f; x < 4000; x *= 1.37f) {
      EXPECT_NEAR(table(x) / curve(x), 1, 5e-6) << gamma << " " << x;
      EXPECT_FLOAT_EQ(table(-x), -table(x));
      if (curve(x) < 1e-5f || curve(x) > 4000) continue;
      const auto inverse = table.inverse(curve(x));
      EXPECT_NEAR(inverse.x / x, 1, 1e-5) << gamma << " " << x;
      EXPECT_NEAR(inverse.slope * gamma * curve(x) / x, 1, 5e-3) << gamma << " " << x;
    }
    EXPECT_EQ(table(0), 0.0f);
    EXPECT_EQ(table(1e5f), curve(1e5f));
  }
}

}  // namespace
}  // namespace patina::test
