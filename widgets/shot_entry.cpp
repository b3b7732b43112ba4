#include "widgets/shot_entry.h"

#include <QCoreApplication>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace patina {

namespace {

constexpr double kDeg = 180 / std::numbers::pi;

QString tr(const char* text) {
  return QCoreApplication::translate("ShotEntry", text);
}

double phiDDeg(const HalfDiffAngles& angles) {
  const double deg = std::fmod(angles.phiDRad * kDeg + 360, 180);
  return deg > 179.995 ? 0 : deg;
}

}  // namespace

std::vector<ShotEntry> shotEntries(const TwoShotCapture& capture, const TwoShotFit* fit) {
  std::vector<ShotEntry> entries;
  const auto add = [&](bool holdout) {
    int number = 0;
    for (std::size_t i = 0; i < capture.shots.size(); ++i) {
      const TwoShotPhoto& shot = capture.shots[i];
      if (shot.holdout != holdout) continue;
      ShotEntry entry;
      entry.photo = static_cast<int>(i);
      entry.shot = &shot;
      entry.title = (holdout ? tr("Held out %1") : tr("Shot %1")).arg(++number);
      if (fit)
        for (const TwoShotComparison& comparison : fit->comparisons)
          if (comparison.file == shot.file) entry.comparison = &comparison;
      entries.push_back(entry);
    }
  };
  add(false);
  add(true);
  for (std::size_t i = 0; i < capture.whiteShots.size(); ++i) {
    ShotEntry entry;
    entry.photo = static_cast<int>(capture.shots.size() + i);
    entry.shot = &capture.whiteShots[i];
    entry.white = true;
    entry.title = tr("White %1").arg(i + 1);
    entries.push_back(entry);
  }
  return entries;
}

ShotDirections directionsOf(const TwoShotPhoto& shot) {
  return {shot.toLight, shot.camera.positionMm().normalized()};
}

NearFieldDisc discOf(const TwoShotCapture& capture) {
  const double radiusMm =
      capture.disc ? capture.radiusMm : std::sqrt(capture.widthMm * capture.heightMm / std::numbers::pi);
  double sumDeg = 0;
  int count = 0;
  for (const TwoShotPhoto& shot : capture.shots)
    if (!shot.holdout) {
      sumDeg += 2 * std::atan(radiusMm / shot.camera.positionMm().norm()) * kDeg;
      ++count;
    }
  NearFieldDisc disc;
  if (count > 0) disc.fovDeg = sumDeg / count;
  return disc;
}

ToneSettings shotTone(const Image& photograph) {
  constexpr float kHeadroom = 2.5f;  ///< of white over an even sample
  constexpr float kLit = 0.02f;      ///< of the bright end: below it is what stands round the sample
  ToneSettings tone = automaticTone(ToneStyle::LinearRgb, photograph);
  std::vector<float> lit;
  const std::size_t stride = std::max<std::size_t>(1, photograph.samples().size() / 65536) | 1;
  for (std::size_t i = 0; i < photograph.samples().size(); i += stride)
    if (photograph.samples()[i] > kLit * tone.high) lit.push_back(photograph.samples()[i]);
  if (lit.empty()) return tone;
  std::nth_element(lit.begin(), lit.begin() + lit.size() / 2, lit.end());
  tone.high = std::max<double>(tone.high, kHeadroom * lit[lit.size() / 2]);
  return tone;
}

QString anglesText(const HalfDiffAngles& angles, int decimals) {
  return QStringLiteral("%1\u00b0 %2\u00b0 %3\u00b0")
      .arg(angles.thetaHRad * kDeg, 0, 'f', decimals)
      .arg(angles.thetaDRad * kDeg, 0, 'f', decimals)
      .arg(phiDDeg(angles), 0, 'f', decimals);
}

QString namedAnglesText(const HalfDiffAngles& angles, int decimals) {
  return QStringLiteral("\u03b8h %1\u00b0  \u03b8d %2\u00b0  \u03c6d %3\u00b0")
      .arg(angles.thetaHRad * kDeg, 0, 'f', decimals)
      .arg(angles.thetaDRad * kDeg, 0, 'f', decimals)
      .arg(phiDDeg(angles), 0, 'f', decimals);
}

QString percentText(double fraction) {
  if (!(fraction >= 0)) return QStringLiteral("\u2013");
  return QStringLiteral("%1 %").arg(100 * fraction, 0, 'f', fraction < 0.0995 ? 1 : 0);
}

QString logErrorText(double lnUnits) {
  return percentText(std::expm1(lnUnits));
}

std::optional<HalfDiffAngles> anglesAtPixel(const TwoShotCapture& capture, const TwoShotPhoto& shot, double x,
                                            double y) {
  const auto place = shot.camera.samplePlaneFromPixel({x, y});
  if (!place || !capture.onSample(place->x(), place->y())) return std::nullopt;
  return halfDiffFromDirections(shot.toLight, (shot.camera.positionMm() - *place).normalized());
}

}  // namespace patina
