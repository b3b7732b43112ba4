#include "engine/acquire/pattern_image.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <set>
#include <tuple>

#include "engine/acquire/capture_plan.h"

namespace patina {
namespace {

constexpr double kPi = std::numbers::pi;

Screen screenOf(int width, int height) {
  Screen screen;
  screen.widthPx = width;
  screen.heightPx = height;
  screen.widthMm = 480;
  screen.heightMm = 270;
  screen.windowSigma = {1.0, 9.0 / 16};
  return screen;
}

PatternSpec sine(int fx, int fy, int phase) {
  PatternSpec spec;
  spec.kind = PatternSpec::Kind::Sine;
  spec.frequency = {fx, fy};
  spec.phase = phase;
  return spec;
}

constexpr double kFloat = 1e-6;

TEST(PatternImage, IsSection43AtThePixelsCentre) {
  const Screen screen = screenOf(320, 180);
  for (const auto& [fx, fy, phase] : {std::tuple{3, 0, 0}, {0, 4, 1}, {6, -6, 2}, {-2, 5, 3}}) {
    const Image image = patternImage(sine(fx, fy, phase), screen);
    for (const auto& [i, j] : {std::pair{0, 0}, {17, 100}, {160, 90}, {319, 179}, {250, 20}}) {
      // In millimetres from the middle, y up, as the capture format has it.
      const double xMm = ((i + 0.5) / 320 - 0.5) * 480, yMm = (0.5 - (j + 0.5) / 180) * 270;
      const double x = kPi * xMm / 240, y = kPi * yMm / 240;
      const double window = std::exp(-0.5 * (x * x + y * y / (9.0 / 16 * 9.0 / 16)));
      EXPECT_NEAR(image.at(i, j), window * std::max(0.0, std::sin(fx * x + fy * y + phase * kPi / 2)),
                  kFloat);
    }
  }
}

TEST(PatternImage, OppositePhasesAddUpToTheRectifiedSineAndNeverOverlap) {
  const Screen screen = screenOf(256, 144);
  for (int first = 0; first < 2; ++first) {
    const Image a = patternImage(sine(3, 2, first), screen), b = patternImage(sine(3, 2, first + 2), screen);
    for (std::size_t i = 0; i < a.samples().size(); ++i)
      EXPECT_TRUE(a.samples()[i] < kFloat || b.samples()[i] < kFloat);
  }
}

TEST(PatternImage, PositiveFrequencyBeginsToRiseInTheMiddle) {
  const Screen screen = screenOf(320, 180);
  EXPECT_GT(patternImage(sine(1, 0, 0), screen).at(200, 90), 0.1f);   // right of the middle
  EXPECT_EQ(patternImage(sine(1, 0, 0), screen).at(120, 90), 0.0f);   // left of it
  EXPECT_GT(patternImage(sine(0, 1, 0), screen).at(160, 60), 0.1f);   // above
  EXPECT_EQ(patternImage(sine(0, 1, 0), screen).at(160, 120), 0.0f);  // below
  EXPECT_GT(patternImage(sine(1, 0, 1), screen).at(160, 90), 0.9f);   // phase 1 is the cosine
}

TEST(PatternImage, WindowBlackFlatAndPatch) {
  const Screen screen = screenOf(101, 55);
  PatternSpec spec;
  spec.kind = PatternSpec::Kind::Window;
  const Image window = patternImage(spec, screen);
  EXPECT_NEAR(window.at(50, 27), 1, kFloat);
  EXPECT_NEAR(window.at(0, 27), std::exp(-0.5 * std::pow(kPi * (1 - 1.0 / 101), 2)), kFloat);
  const Image black = patternImage(PatternSpec{}, screen);
  for (const float sample : black.samples()) EXPECT_EQ(sample, 0.0f);
  spec.kind = PatternSpec::Kind::Flat;
  spec.level = 0.25;
  const Image flat = patternImage(spec, screen);
  for (const float sample : flat.samples()) EXPECT_EQ(sample, 0.25f);
  spec.kind = PatternSpec::Kind::Patch;
  const Image patch = patternImage(spec, screen);
  double lit = 0;
  for (const float sample : patch.samples()) lit += sample > 0;
  EXPECT_EQ(lit, 11 * 11);
  EXPECT_EQ(patch.at(50, 27), 0.25f);
}

TEST(ShownPicture, MeanLightOfFewPixelsIsWhatWasWantedThroughAnyResponse) {
  const Screen screen = screenOf(640, 360);
  for (const ScreenResponse& response : {ScreenResponse::linear(), ScreenResponse::gamma(2.2)}) {
    for (const PatternSpec& spec : {sine(4, 0, 0), sine(10, 10, 3)}) {
      const Image wanted = patternImage(spec, screen);
      const Image light = lightOf(shownPicture(wanted, response, ""), response);
      double worst = 0;
      constexpr int kBlock = 8;
      for (int y = 0; y + kBlock <= 360; y += kBlock)
        for (int x = 0; x + kBlock <= 640; x += kBlock) {
          double difference = 0;
          for (int j = 0; j < kBlock; ++j)
            for (int i = 0; i < kBlock; ++i) difference += light.at(x + i, y + j) - wanted.at(x + i, y + j);
          worst = std::max(worst, std::abs(difference) / (kBlock * kBlock));
        }
      // A step of eight bits is 0.004 to 0.009 of full white; over 64 pixels what is still owed is some of
      // them.
      EXPECT_LT(worst, 6e-4);
    }
  }
}

TEST(ShownPicture, EachPixelIsOneOfTheTwoNearestValues) {
  Image ramp(512, 4, 1);
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 512; ++x) ramp.at(x, y) = static_cast<float>(x) / 511;
  const ScreenResponse response = ScreenResponse::gamma(1.8);
  const ShownPicture shown = shownPicture(ramp, response, "");
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 512; ++x) {
      const double exact = 255 * std::pow(x / 511.0, 1 / 1.8);
      // The light owed by neighbours is less than a step: one value more on either side.
      EXPECT_NEAR((*shown.pixels)[static_cast<std::size_t>(y * 512 + x)], exact, 2.01);
    }
}

TEST(ShownPicture, BlackAndWhiteStayPureAndEqualPicturesHaveEqualHashes) {
  const Screen screen = screenOf(64, 36);
  const ScreenResponse response = ScreenResponse::gamma(2.2);
  PatternSpec white;
  white.kind = PatternSpec::Kind::Flat;
  const ShownPicture dark = shownPattern(PatternSpec{}, screen, response),
                     bright = shownPattern(white, screen, response);
  for (const std::uint8_t value : *dark.pixels) EXPECT_EQ(value, 0);
  for (const std::uint8_t value : *bright.pixels) EXPECT_EQ(value, 255);
  const ShownPicture a = shownPattern(sine(3, 1, 2), screen, response),
                     b = shownPattern(sine(3, 1, 2), screen, response);
  EXPECT_EQ(*a.pixels, *b.pixels);
  EXPECT_EQ(a.hash(), b.hash());
  EXPECT_NE(a.hash(), shownPattern(sine(3, 1, 3), screen, response).hash());
  EXPECT_EQ(a.name, "frequency 3, 1, phase 2");
}

TEST(ShownPicture, ThresholdPicturesAddUpToThePattern) {
  // Section 4.2: over an exposure the black and white pictures are worth the grey one.
  const Screen screen = screenOf(64, 36);
  const Image pattern = patternImage(sine(2, 1, 0), screen);
  constexpr int kSteps = 180;  // three seconds at 60 Hz
  std::vector<int> lit(pattern.pixelCount(), 0);
  for (int s = 0; s < kSteps; ++s) {
    const ShownPicture picture = thresholdPicture(pattern, (s + 0.5) / kSteps, "");
    for (std::size_t i = 0; i < lit.size(); ++i) {
      const int value = (*picture.pixels)[i];
      ASSERT_TRUE(value == 0 || value == 255);
      lit[i] += value == 255;
    }
  }
  for (std::size_t i = 0; i < lit.size(); ++i)
    EXPECT_NEAR(static_cast<double>(lit[i]) / kSteps, pattern.samples()[i], 0.51 / kSteps);
}

TEST(ScreenResponse, FromACurveIsNormalisedAndNeverFalls) {
  const Result<ScreenResponse> response = ScreenResponse::fromCurve({{0, 0.5, 1}, {0.01, 0.1, 0.5}});
  ASSERT_TRUE(response.ok());
  EXPECT_EQ(response->level[255], 1);
  EXPECT_NEAR(response->level[0], 0.02, 1e-9);
  EXPECT_FALSE(ScreenResponse::fromCurve({{0, 1}, {0, 0}}).ok());
}

TEST(CapturePlan, HoldsThePapersFrequenciesWithFourPhasesAndOthersHeldOut) {
  const CapturePlan plan = makeCapturePlan();
  // 32 frequencies of the paper, nine held out, window, black, and the window again.
  EXPECT_EQ(plan.photos.size(), 4u * (32 + 9) + 3);
  EXPECT_EQ(plan.photos[0].role(), PhotoRole::Window);
  EXPECT_EQ(plan.photos[1].role(), PhotoRole::Black);
  EXPECT_TRUE(plan.photos.back().holdout && plan.photos.back().role() == PhotoRole::Window);
  std::set<std::tuple<int, int, int>> seen;
  int heldOut = 0;
  std::set<int> onAxis;
  for (const PlannedPhoto& photo : plan.photos) {
    if (photo.role() != PhotoRole::Pattern) continue;
    const auto& f = photo.pattern.frequency;
    EXPECT_TRUE(seen.emplace(f.x(), f.y(), photo.pattern.phase).second);
    heldOut += photo.holdout;
    if (f.y() == 0 && !photo.holdout) onAxis.insert(f.x());
  }
  EXPECT_EQ(heldOut, 36);
  EXPECT_EQ(onAxis, (std::set<int>{1, 2, 3, 4, 6, 10, 20, 40}));
  CapturePlanOptions none;
  none.heldOut.clear();
  EXPECT_NE(makeCapturePlan(none).hash(), plan.hash());
  EXPECT_EQ(makeCapturePlan().hash(), plan.hash());
}

TEST(CapturePlan, TellsFrequenciesThatAScreenIsTooCoarseFor) {
  EXPECT_TRUE(tooFine(paperFrequencies(), screenOf(1920, 1080)).empty());
  const auto fine = tooFine(paperFrequencies(), screenOf(100, 56));
  ASSERT_FALSE(fine.empty());
  for (const Eigen::Vector2i& f : fine) EXPECT_EQ(f.cwiseAbs().maxCoeff(), 40);
}

}  // namespace
}  // namespace patina
