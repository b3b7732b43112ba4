#include "tests/report/made_up_explanation.h"

#include <cmath>
#include <limits>
#include <random>

namespace patina::test {

ResidualPicture madeUpPicture(int width, int height, float strength, unsigned seed) {
  ResidualPicture picture;
  picture.captured = picture.predictedBefore = picture.predictedAfter = picture.noiseSigma =
      Image(width, height, 3);
  std::mt19937 random(seed);
  std::normal_distribution<float> noise;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const float u = (x + 0.5f) / width * 2 - 1, v = (y + 0.5f) / height * 2 - 1;
      if (u * u + v * v > 0.9f) continue;
      const float highlight = std::exp(-6 * (u * u + v * v));
      for (int c = 0; c < 3; ++c) {
        const float truth = 0.05f + 0.05f * static_cast<float>(c) + 0.4f * highlight;
        const float sigma = 0.01f + 0.01f * truth;
        picture.noiseSigma.at(x, y, c) = sigma;
        picture.captured.at(x, y, c) = truth + sigma * noise(random);
        picture.predictedAfter.at(x, y, c) = truth;
        picture.predictedBefore.at(x, y, c) = truth - strength * sigma * std::sin(7 * u) * highlight;
      }
    }
  return picture;
}

namespace {

SignaturePlot signature() {
  SignaturePlot plot;
  plot.title = "Residual over the pattern's frequency";
  plot.xLabel = "frequency, pattern units";
  plot.yLabel = "residual / noise";
  for (int i = 0; i < 9; ++i) {
    plot.x.push_back(i * 4);
    plot.expected.push_back(3.0 * i * i / 64.0);
    plot.seen.push_back(3.0 * i * i / 64.0 + (i % 2 ? 0.3 : -0.25));
    plot.seenSd.push_back(0.4);
  }
  return plot;
}

SignaturePlot directions() {
  SignaturePlot plot;
  plot.title = "Residual by the direction of the stripes";
  plot.xLabel = "direction";
  plot.yLabel = "residual / noise";
  plot.xNames = {"along x", "diagonal", "along y", "other diagonal"};
  plot.expected = {2.4, 0.1, -2.3, -0.1};
  plot.seen = {2.1, 0.3, -2.6, -0.3};
  plot.seenSd = {0.3, 0.3, 0.3, 0.3};
  return plot;
}

Image rampMap(int width, int height) {
  Image map(width, height, 1);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      map.at(x, y) = 1.0f + 0.6f * static_cast<float>(x) / static_cast<float>(width);
  return map;
}

}  // namespace

Explanation madeUpExplanation() {
  Explanation e;
  e.kind = "fourier";
  e.bundles = {"/somewhere/brushed_plate"};
  e.noiseFloorFit = 0.0101, e.noiseFloorHoldout = 0.0104;
  e.before = {0.021, 0.0483};
  e.after = {0.0106, 0.0112};
  e.chi2Before = 8.4, e.chi2After = 1.03;

  EffectFinding anisotropy;
  anisotropy.id = "anisotropy";
  anisotropy.added = true;
  anisotropy.verdict =
      "It lowers the error of prediction from 4.83 % to 1.31 %, far more than chance allows.";
  anisotropy.sentence = "Highlights are 1.32 times longer along 12 degrees than across it.";
  anisotropy.sigmas = 214, anisotropy.correctedP = 0, anisotropy.explained = 0.87,
  anisotropy.confidence = 0.98;
  anisotropy.holdoutRmsWith = 0.0131, anisotropy.holdoutRmsWithout = 0.0483;
  anisotropy.parameters = {{"ratio", "", 1.32, 0.004, ""}, {"angleDeg", "degrees", 12.1, 0.4, ""}};
  anisotropy.plots = {signature(), directions()};
  anisotropy.maps["anisotropy_ratio"] = rampMap(48, 32);
  e.effects.push_back(anisotropy);

  EffectFinding flicker;
  flicker.id = "flicker";
  flicker.added = true;
  flicker.verdict = "With anisotropy in the model, whole photographs still differ by a factor.";
  flicker.sentence = "The screen's brightness differs by 0.8 % from photograph to photograph.";
  flicker.sigmas = 12.4, flicker.correctedP = 3e-9, flicker.explained = 0.4, flicker.confidence = 0.93;
  flicker.holdoutRmsWith = 0.0112, flicker.holdoutRmsWithout = 0.0131;
  flicker.parameters = {{"perPhoto", "", 0.008, 0.0006, ""}};
  PhotoCurve curve{"brightness", "percent", {}, {}, {}};
  for (int i = 0; i < 40; ++i) {
    curve.photo.push_back(i);
    curve.value.push_back(0.8 * std::sin(i * 2.3));
    curve.sd.push_back(0.1);
  }
  flicker.curves = {curve};
  e.effects.push_back(flicker);

  EffectFinding pose;
  pose.id = "screen-pose";
  pose.verdict = "Looks like anisotropy before that was added; nothing is left for it afterwards.";
  pose.sigmas = 38, pose.correctedP = 1e-30, pose.explained = 0.22, pose.holdoutRmsWith = 0.046;
  pose.holdoutRmsWithout = 0.0483;
  pose.plots = {signature()};
  e.considered.push_back(pose);
  EffectFinding glare;
  glare.id = "glare";
  glare.verdict = "No evidence.";
  glare.sigmas = 0.8, glare.correctedP = 0.9;
  e.considered.push_back(glare);

  e.confusable = {{"screen-pose", "sample-height"}};
  e.suggest = {{"screen-pose", "sample-height",
                "The same sample turned by 90 degrees on the table, all patterns up to frequency 8.", 14}};
  e.unexplained.fraction = 0.04;
  e.unexplained.description = "Low frequencies of the blue channel at the left edge.";
  e.budget = {{"emission-angular",
               "edgeChange",
               "",
               0.021,
               {{"diffuse", "", 0.004}, {"normal", "degrees", 0.3}},
               "The screen's brightness at a slant could be 2.1 % off without being seen."},
              {"screen-pose",
               "shiftMm",
               "mm",
               1.2,
               {{"normal", "degrees", 0.21}},
               "The screen could stand 1.2 mm higher than calibrated."}};
  for (int i = 0; i < 40; ++i) {
    PhotoResidual photo;
    photo.photo = i;
    photo.file = "photo_" + std::to_string(i) + ".exr";
    photo.what = "pattern (" + std::to_string(40 - i) + ", 0) phase " + std::to_string(i % 4);
    photo.holdout = i % 5 == 0;
    photo.noise = 0.0104;
    photo.before = 0.09 - 0.002 * i;
    photo.after = 0.0115 - 0.00002 * i;
    e.photos.push_back(photo);
  }
  e.breakdowns = {{"frequency",
                   {"0", "1", "2", "4", "8", "16", "32"},
                   {1.1, 1.4, 2.2, 5.1, 11, 24, 38},
                   {1.0, 1.02, 1.01, 1.04, 1.06, 1.1, 1.12}},
                  {"phase", {"0", "90", "180", "270"}, {8.1, 8.4, 8.3, 8.6}, {1.02, 1.03, 1.03, 1.04}},
                  {"channel", {"red", "green", "blue"}, {8.5, 8.2, 8.6}, {1.02, 1.02, 1.06}}};
  for (int i = 0; i < 3; ++i) {
    ResidualPicture picture =
        madeUpPicture(96, 72, 5.0f - static_cast<float>(i), static_cast<unsigned>(i + 1));
    picture.photo = i;
    picture.file = "photo_" + std::to_string(i) + ".exr";
    e.pictures.push_back(picture);
  }
  e.placeBefore = e.placeAfter = Image(96, 72, 1);
  for (int y = 10; y < 62; ++y)
    for (int x = 10; x < 86; ++x) {
      e.placeBefore.at(x, y) = 1.0f + 20.0f * std::exp(-0.005f * static_cast<float>((x - 48) * (x - 48)));
      e.placeAfter.at(x, y) = 1.02f;
    }
  e.remarks = {"Three photographs are clipped in the highlight; their clipped pixels were left out."};
  e.seconds = {{"fit", 6.1}, {"score", 3.2}, {"refit", 9.8}, {"total", 21.4}};
  return e;
}

Explanation madeUpCleanExplanation() {
  Explanation e = madeUpExplanation();
  e.effects.clear();
  e.confusable.clear();
  e.suggest.clear();
  e.before = e.after = {0.0102, 0.0105};
  e.chi2Before = e.chi2After = 1.01;
  e.unexplained.fraction = 0;
  e.unexplained.description.clear();
  for (EffectFinding& finding : e.considered) finding.sigmas = 0.7, finding.correctedP = 0.8;
  return e;
}

Explanation hostileExplanation() {
  Explanation e = madeUpExplanation();
  const double nan = std::numeric_limits<double>::quiet_NaN(),
               infinite = std::numeric_limits<double>::infinity();
  const std::string evil = "</style></script><script>alert('x')</script>\"onload=\"x&\x01\xff\xe2\x80\xae";
  e.bundles = {"/x/" + std::string("<img src=http://evil.example/x>&\".d")};
  e.before = {nan, infinite};
  e.after = {-infinite, 1e300};
  e.noiseFloorHoldout = nan;
  e.chi2Before = nan, e.chi2After = infinite;
  for (EffectFinding& finding : e.effects) {
    finding.verdict = finding.sentence = evil;
    finding.sigmas = infinite, finding.correctedP = nan, finding.explained = 1e9, finding.confidence = nan;
    finding.holdoutRmsWith = nan, finding.holdoutRmsWithout = infinite;
    for (EffectEstimate& estimate : finding.parameters) {
      estimate.value = nan, estimate.sd = infinite;
      estimate.unit = estimate.where = evil;
    }
    for (SignaturePlot& plot : finding.plots) {
      plot.title = plot.xLabel = plot.yLabel = evil;
      plot.seen[0] = nan, plot.expected[1] = infinite;
      plot.seenSd.clear();
      for (std::string& name : plot.xNames) name = evil;
    }
    for (PhotoCurve& curve : finding.curves) curve.value[3] = nan, curve.name = evil, curve.sd.resize(2);
  }
  e.effects.front().id = evil;
  e.effects.front().maps[evil] = rampMap(4, 4);
  Image holes(5, 3, 1);
  for (float& value : holes.samples()) value = std::numeric_limits<float>::quiet_NaN();
  e.effects.front().maps["holes"] = holes;
  e.effects.front().maps["empty"] = Image();
  e.confusable = {{evil, "flicker"}, {}, {"glare"}};
  e.suggest = {{evil, evil, evil, nan}};
  e.unexplained.fraction = nan;
  e.unexplained.description = evil;
  e.budget.front().largestUnseen = nan;
  e.budget.front().sentence = e.budget.front().parameter = e.budget.front().unit = evil;
  e.photos.front().file = e.photos.front().what = evil;
  e.photos.front().before = nan, e.photos[1].after = infinite;
  e.breakdowns.front().before = {nan, infinite, -3};
  e.breakdowns.front().after.clear();
  for (std::string& label : e.breakdowns.front().label) label = evil;
  ResidualPicture broken = madeUpPicture(8, 6, 1);
  broken.file = evil;
  broken.predictedAfter = Image(3, 3, 3);
  broken.predictedBefore.at(4, 3, 0) = std::numeric_limits<float>::infinity();
  broken.captured.at(4, 2, 0) = std::numeric_limits<float>::quiet_NaN();
  e.pictures.push_back(broken);
  e.pictures.emplace_back();
  e.placeAfter = Image(2, 2, 3);
  e.placeBefore.at(20, 20) = std::numeric_limits<float>::infinity();
  e.remarks = {evil, ""};
  e.seconds["total"] = nan;
  e.seconds[evil] = infinite;
  return e;
}

}  // namespace patina::test
