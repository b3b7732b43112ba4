#include "engine/diagnosis/fourier_candidate.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace patina {
namespace {

constexpr double kNumberCost = 4;  ///< chi2 that a number must earn

/// Uncertainty of a difference of sums over patches, from the patches' scatter.
double patchSd(const std::vector<double>& a, const std::vector<double>& b) {
  const std::size_t n = std::min(a.size(), b.size());
  if (n < 2) return 0;
  double mean = 0, square = 0;
  for (std::size_t i = 0; i < n; ++i) mean += (a[i] - b[i]) / static_cast<double>(n);
  for (std::size_t i = 0; i < n; ++i) square += std::pow(a[i] - b[i] - mean, 2);
  return std::sqrt(square * static_cast<double>(n) / static_cast<double>(n - 1));
}

/// Numbers of self-shadowing: a horizon for each site that has one.
double horizonsOf(const DiagnosisSession& session) {
  double n = 0;
  for (const auto& capture : session.captures)
    for (const auto& site : capture.sites) n += site.ownHorizon;
  return n;
}

}  // namespace

double chiSquareTail(double x, double n) {
  if (x <= 0 || n <= 0) return 1;
  const double z = (std::cbrt(x / n) - (1 - 2 / (9 * n))) / std::sqrt(2 / (9 * n));
  return 0.5 * std::erfc(z / std::sqrt(2.0));
}

double sigmasOf(double gain, double n) {
  const double x = std::max(gain, 0.0);
  const double z = (std::cbrt(x / n) - (1 - 2 / (9 * n))) / std::sqrt(2 / (9 * n));
  return z > 6 ? std::sqrt(std::max(0.0, x - n)) : z;
}

void judgeRefit(FourierCandidate& c, const SessionError& before, const DiagnosisSession& refitted,
                double heldRows) {
  c.tried = true;
  c.plausible = c.refit.plausible;
  const double phi = std::max(1.0, c.refit.error.chi2 / std::max(c.refit.error.count, 1.0));
  c.phi = phi;
  double numbers = c.score.numbers;
  if (c.id == "flicker" || c.id == "ambient-drift") numbers += heldRows;
  if (c.id == "self-shadowing") numbers = horizonsOf(refitted);
  c.improvement = before.all() - c.refit.error.all() - phi * numbers * kNumberCost;
  c.heldGain = before.heldChi2 - c.refit.error.heldChi2;
  if (c.id == "flicker" || c.id == "ambient-drift") c.heldGain -= phi * heldRows;
  c.heldSd =
      std::max(patchSd(before.heldPatch, c.refit.error.heldPatch), 2 * std::sqrt(phi * std::abs(c.heldGain)));
  const std::size_t patches = std::min(before.heldPatch.size(), c.refit.error.heldPatch.size());
  double seen = 0;
  for (std::size_t p = 0; p < patches; ++p) {
    if (before.heldPatch[p] <= 0) continue;  // no site of it was usable
    ++seen;
    c.betterPatches += c.refit.error.heldPatch[p] < before.heldPatch[p];
  }
  c.betterPatches /= std::max(seen, 1.0);
  c.heldRms = c.refit.error.first.heldRms;
  c.noiseGain = before.noise - c.refit.error.noise;
  c.explained = std::clamp((before.first.noiseChi2 - c.refit.error.first.noiseChi2) /
                               std::max(before.first.noiseChi2 - before.first.noiseCount, 1.0),
                           0.0, 1.0);
}

double confidenceOf(const FourierCandidate& best, double secondShare) {
  const double lead = best.improvement * (1 - secondShare) / best.phi;
  const double byNoise = 1 - std::exp(-std::max(lead, 0.0) / 20),
               byShare = 1 - 0.5 * std::pow(std::clamp(secondShare, 0.0, 1.0), 8);
  return std::clamp(byNoise * byShare, 0.05, 0.99);
}

std::string scoreText(const FourierCandidate& c) {
  char text[200];
  std::snprintf(text, sizeof text,
                "score %s: gain %.1f for %d numbers, log evidence %.1f, held-out gain %.1f +- %.1f, p %.2g",
                c.id.c_str(), c.score.gain, c.score.numbers, c.score.logEvidence, c.score.heldGain,
                c.score.heldSd, c.correctedP);
  return text;
}

std::string refitText(const FourierCandidate& c, const SessionError& before) {
  char text[256];
  std::snprintf(
      text, sizeof text,
      "%s: chi-square %.3f to %.3f, held out %.3f to %.3f, gain %.0f (%.0f of noise), held-out gain %.0f +- "
      "%.0f%s",
      c.id.c_str(), before.chi2 / std::max(before.count, 1.0),
      c.refit.error.chi2 / std::max(c.refit.error.count, 1.0),
      before.heldChi2 / std::max(before.heldCount, 1.0),
      c.refit.error.heldChi2 / std::max(c.refit.error.heldCount, 1.0), c.improvement, c.noiseGain, c.heldGain,
      c.heldSd, c.plausible ? "" : ", beyond what makes sense");
  return text;
}

}  // namespace patina
