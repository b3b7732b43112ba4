#include "engine/calibration/camera_response.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>

#include "engine/image/photo_file.h"
#include "tests/base/temp_folder.h"
#include "tests/test_data.h"

namespace patina {
namespace {

using testing::HasSubstr;

// A bracket of 8 bits with 0.3 % noise: the curve is known to about a percent of its value where data decided
// it.
constexpr double kCurveTolerance = 0.02;

/// A smooth scene of six stops, photographed through a tone curve.
std::vector<ExposedPhoto> bracket(const std::function<double(double)>& encoded, int photos, double noise) {
  constexpr int kWidth = 200, kHeight = 150;
  std::vector<ExposedPhoto> series;
  std::mt19937 random(2);
  std::normal_distribution<double> normal(0, noise);
  for (int j = 0; j < photos; ++j) {
    ExposedPhoto photo;
    photo.exposureS = 0.01 * std::pow(2.0, j);
    photo.name = "photo " + std::to_string(j);
    photo.image = Image(kWidth, kHeight, 3);
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        for (int c = 0; c < 3; ++c) {
          const double light =
              std::pow(2.0, 6.0 * x / kWidth + std::sin(0.05 * y) - 1) * photo.exposureS * (1 + 0.2 * c);
          photo.image.at(x, y, c) = static_cast<float>(
              std::round(255 * std::clamp(encoded(std::min(light, 1.0)) + normal(random), 0.0, 1.0)) / 255);
        }
    series.push_back(std::move(photo));
  }
  return series;
}

double worstRelative(const ResponseCurve& curve, const std::function<double(double)>& light, double from,
                     double to) {
  // The scale is free: compared at the middle.
  const double scale = light(0.6) / linearFromResponse(curve, 0.6);
  double worst = 0;
  for (double v = from; v <= to; v += 0.01)
    worst = std::max(worst, std::abs(linearFromResponse(curve, v) * scale / light(v) - 1));
  return worst;
}

TEST(CameraResponse, RecoversKnownCurves) {
  struct Known {
    const char* name;
    std::function<double(double)> encode, light;
  };
  const auto sCurve = [](double v) { return std::pow(v, 2.2) * (0.6 + 0.4 * v * v * (3 - 2 * v)); };
  const Known curves[] = {
      {"linear", [](double l) { return l; }, [](double v) { return v; }},
      {"gamma", [](double l) { return std::pow(l, 1 / 2.2); }, [](double v) { return std::pow(v, 2.2); }},
      {"srgb", [](double l) { return l <= 0.0031308 ? 12.92 * l : 1.055 * std::pow(l, 1 / 2.4) - 0.055; },
       [](double v) { return linearFromSrgbPixel(v); }},
      {"s-curve",
       [&](double l) {
         double low = 0, high = 1;
         for (int i = 0; i < 40; ++i) (sCurve(0.5 * (low + high)) < l ? low : high) = 0.5 * (low + high);
         return high;
       },
       sCurve}};
  for (const Known& known : curves) {
    const Result<CameraResponse> found = recoverResponse(bracket(known.encode, 8, 0.003));
    ASSERT_TRUE(found.ok()) << known.name << ": " << found.error().sentence();
    for (int c = 0; c < 3; ++c) {
      const double worst = worstRelative(found->curves[c], known.light, 0.1, 0.95);
      EXPECT_LT(worst, kCurveTolerance) << known.name << " channel " << c;
    }
    EXPECT_EQ(found->linearity.largestDeviation < 0.01, std::string(known.name) == "linear")
        << found->linearity.sentence;
  }
}

TEST(CameraResponse, NamesAnExposureThatIsNotWhatWasSaid) {
  std::vector<ExposedPhoto> photos = bracket([](double l) { return std::pow(l, 1 / 2.2); }, 7, 0.003);
  photos[3].exposureS *= 1.4;
  const Result<CameraResponse> found = recoverResponse(photos);
  ASSERT_TRUE(found.ok());
  ASSERT_FALSE(found->warnings.empty());
  EXPECT_THAT(found->warnings.front(), HasSubstr("photo 3"));
}

TEST(CameraResponse, SaysWhatIsMissing) {
  const std::vector<ExposedPhoto> photos = bracket([](double l) { return l; }, 4, 0.001);
  EXPECT_FALSE(recoverResponse({photos[0], photos[1]}).ok());
  std::vector<ExposedPhoto> alike = photos;
  for (ExposedPhoto& photo : alike) photo.exposureS = 1;
  EXPECT_THAT(recoverResponse(alike).error().what, HasSubstr("alike"));
  std::vector<ExposedPhoto> sizes = photos;
  sizes[2].image = Image(10, 10, 3);
  EXPECT_FALSE(recoverResponse(sizes).ok());
  std::vector<ExposedPhoto> black = photos;
  for (ExposedPhoto& photo : black)
    for (float& v : photo.image.samples()) v = 0;
  EXPECT_THAT(recoverResponse(black).error().what, HasSubstr("neither black nor clipped"));
}

TEST(CameraResponse, FitsTheMemorialBracket) {
  PATINA_NEEDS_SHARED("hdr/memorial0061.png");
  std::vector<ExposedPhoto> photos;
  for (int i = 61; i <= 68; ++i) {
    // One of them is a JPEG by another name: the content counts.
    const Result<PhotoFile> image =
        readPhotoFile(test::sharedData() / "hdr" / ("memorial00" + std::to_string(i) + ".png"));
    ASSERT_TRUE(image.ok()) << image.error().sentence();
    // Its description says so: what is pure blue along the rim is where pictures were shifted to fit.
    constexpr int kRim = 40;
    Image inner(image->image.width() - 2 * kRim, image->image.height() - 2 * kRim, 3);
    for (int y = 0; y < inner.height(); ++y)
      for (int x = 0; x < inner.width(); ++x)
        for (int c = 0; c < 3; ++c) inner.at(x, y, c) = image->image.at(x + kRim, y + kRim, c);
    // The list gives 1 / shutter speed: 0.03125 is 32 seconds.
    photos.push_back({"memorial00" + std::to_string(i), inner, 32 / std::pow(2.0, i - 61)});
  }
  const Result<CameraResponse> found = recoverResponse(photos);
  ASSERT_TRUE(found.ok()) << found.error().sentence();
  for (int c = 0; c < 3; ++c) {
    // Grain and the scans' registration are in this. Blue is the film's noisiest layer in lamp light (0.135
    // here) and has no bound.
    if (c < 2) {
      EXPECT_LT(found->residual[c], 0.12);
    }
    // And it is a film's curve: far from linear.
    EXPECT_LT(linearFromResponse(found->curves[c], 0.5), 0.35);
    for (std::size_t i = 1; i < found->curves[c].output.size(); ++i)
      ASSERT_GE(found->curves[c].output[i], found->curves[c].output[i - 1]);
  }
  // Whatever the grain: linear, the middle pixel of each exposure and the next differ by the shutter's factor
  // of two.
  constexpr double kPair =
      0.1;  // a mechanical shutter is good to a tenth or so; a wrong exposure order is off by 0.69
  for (int c = 0; c < 3; ++c)
    for (std::size_t j = 1; j < photos.size(); ++j) {
      std::vector<double> ratio;
      for (std::size_t i = c; i < photos[0].image.samples().size(); i += 3) {
        const double longer = photos[j - 1].image.samples()[i], shorter = photos[j].image.samples()[i];
        if (longer > 0.9 || shorter < 0.15) continue;
        ratio.push_back(std::log(linearFromResponse(found->curves[c], longer) /
                                 linearFromResponse(found->curves[c], shorter) / 2));
      }
      ASSERT_GT(ratio.size(), 500u);
      std::nth_element(ratio.begin(), ratio.begin() + static_cast<std::ptrdiff_t>(ratio.size() / 2),
                       ratio.end());
      EXPECT_LT(std::abs(ratio[ratio.size() / 2]), kPair)
          << "channel " << c << ", photographs " << j - 1 << " and " << j;
    }
}

TEST(CameraResponse, WritesWhatTheReaderOfBundlesReads) {
  std::array<ResponseCurve, 3> curves;
  for (int c = 0; c < 3; ++c) curves[c] = {{0, 0.25, 0.5, 1}, {0, 0.05 + 0.001 * c, 0.21, 1}};
  const test::TempFolder folder;
  ASSERT_TRUE(writeResponse(folder / "curve.json", curves).ok());
  const auto read = readResponse(folder / "curve.json");
  ASSERT_TRUE(read.ok()) << read.error().sentence();
  for (int c = 0; c < 3; ++c) EXPECT_EQ((*read)[c].output, curves[c].output);
}

TEST(DarkLevel, IsToldFromTwoFrames) {
  std::vector<Image> frames;
  std::mt19937 random(4);
  std::normal_distribution<double> normal;
  for (int j = 0; j < 2; ++j) {
    Image image(200, 150, 3);
    for (int y = 0; y < 150; ++y)
      for (int x = 0; x < 200; ++x)
        for (int c = 0; c < 3; ++c)
          image.at(x, y, c) =
              static_cast<float>(0.03 + 0.004 * c + 0.002 * normal(random) + (x == 17 && y == 30 ? 0.4 : 0));
    frames.push_back(image);
  }
  const Result<DarkLevel> dark = measureDarkLevel(frames);
  ASSERT_TRUE(dark.ok());
  for (int c = 0; c < 3; ++c) {
    EXPECT_NEAR(dark->level[c], 0.03 + 0.004 * c, 1e-4);
    EXPECT_NEAR(dark->readNoise[c], 0.002, 1e-4);
  }
  EXPECT_FALSE(dark->clippedAtZero);
  EXPECT_NEAR(dark->hotShare, 1.0 / 30000, 1e-5);
  for (Image& frame : frames)
    for (float& v : frame.samples()) v = std::max(0.0f, v - 0.034f);
  EXPECT_TRUE(measureDarkLevel(frames)->clippedAtZero);
  EXPECT_FALSE(measureDarkLevel({Image(100, 100, 3, 0.5f)}).ok());
  EXPECT_FALSE(measureDarkLevel({}).ok());
}

}  // namespace
}  // namespace patina
