#include "engine/diagnosis/two_shot_odds.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace patina {
namespace {

/// ln odds around which compression begins.
constexpr double kCompressed = 10;
/// Changes of an error beyond these factors, as logarithms, say no more.
constexpr double kMostLoss = 0.7, kMostGain = 2.3;
constexpr int kSteps = 60;

double compressed(double lnOdds) {
  return std::copysign(std::log1p(std::abs(lnOdds) / kCompressed), lnOdds);
}

double gainOf(double ratio) {
  return std::clamp(-std::log(std::max(ratio, 1e-3)), -kMostLoss, kMostGain);
}

}  // namespace

EvidenceFeatures featuresOf(const TwoShotEvidence& e, double around) {
  EvidenceFeatures x = EvidenceFeatures::Zero();
  const double fit = gainOf(e.fitRatio), held = e.held ? gainOf(e.heldRatio) : 0;
  const double better = e.held ? e.heldBetter - 0.5 : 0;
  if (e.lobe) {
    // A lobe towards the light has no rival among materials; one around the mirror direction has many.
    x[13] = e.id == "retroreflection";
    x[0] = 1, x[1] = fit, x[2] = held, x[3] = better;
  } else if (e.heldOnly) {
    // Of one photograph alone: nothing else can be better for it.
    x[4] = 1, x[5] = compressed(e.lnHeld);
  } else {
    x[6] = 1;
    x[7] = compressed(e.lnEvidence - e.lnAround), x[8] = e.held ? compressed(e.lnHeld) : 0;
    x[9] = fit + held, x[10] = better;
  }
  // What the surroundings say, and how much less that is than another explanation makes of them.
  x[11] = compressed(e.lnAround);
  x[12] = -std::max(0.0, compressed(around) - compressed(std::max(e.lnAround, 0.0)));
  return x;
}

double lnOddsOf(const TwoShotEvidence& evidence, double around) {
  return evidenceWeights().dot(featuresOf(evidence, around));
}

std::vector<double> probabilitiesOf(const std::vector<double>& lnOdds) {
  double top = 0;
  for (const double ln : lnOdds) top = std::max(top, ln);
  double sum = std::exp(-top);
  std::vector<double> out;
  for (const double ln : lnOdds) sum += out.emplace_back(std::exp(ln - top));
  for (double& p : out) p /= sum;
  return out;
}

EvidenceFeatures fitEvidenceWeights(const std::vector<WeighedCapture>& captures,
                                    const EvidenceFeatures& before, double priorSd) {
  using Matrix = Eigen::Matrix<double, kEvidenceFeatures, kEvidenceFeatures>;
  const auto value = [&](const EvidenceFeatures& w, EvidenceFeatures* gradient, Matrix* information) {
    double ln = -0.5 * (w - before).squaredNorm() / (priorSd * priorSd);
    if (gradient) *gradient = -(w - before) / (priorSd * priorSd);
    if (information) *information = Matrix::Identity() / (priorSd * priorSd);
    for (const WeighedCapture& capture : captures) {
      std::vector<double> odds;
      for (const EvidenceFeatures& x : capture.tried) odds.push_back(w.dot(x));
      const std::vector<double> p = probabilitiesOf(odds);
      EvidenceFeatures mean = EvidenceFeatures::Zero(), right = EvidenceFeatures::Zero();
      double all = 0, good = 0;
      for (std::size_t i = 0; i < p.size(); ++i) {
        mean += p[i] * capture.tried[i], all += p[i];
        if (capture.right[i]) right += p[i] * capture.tried[i], good += p[i];
      }
      const bool any = std::count(capture.right.begin(), capture.right.end(), char{1}) > 0;
      ln += std::log(std::max(any ? good : 1 - all, 1e-12));
      if (gradient)
        *gradient +=
            (any ? EvidenceFeatures(right / std::max(good, 1e-12)) : EvidenceFeatures::Zero().eval()) - mean;
      // Curvature of the sum over answers, the convex part: always positive.
      if (information) {
        for (std::size_t i = 0; i < p.size(); ++i)
          *information += p[i] * capture.tried[i] * capture.tried[i].transpose();
        *information -= mean * mean.transpose();
      }
    }
    return ln;
  };
  EvidenceFeatures w = before;
  for (int step = 0; step < kSteps; ++step) {
    EvidenceFeatures gradient;
    Matrix information;
    const double here = value(w, &gradient, &information);
    const EvidenceFeatures move = information.ldlt().solve(gradient);
    double share = 1;
    while (share > 1e-4 && !(value(w + share * move, nullptr, nullptr) > here)) share /= 2;
    if (share <= 1e-4) break;
    w += share * move;
  }
  return w;
}

EvidenceFeatures evidenceWeightsBefore() {
  EvidenceFeatures w;
  // Lobes: none, fitted, held out, share. Held-out factors: none, evidence. Others: none, fitted and
  // held-out evidence, errors, share. Surroundings: explained, missed. A lobe towards the light: more.
  w << -3, 1.5, 1.5, 1,  //
      -4, 1,             //
      -4, 1, 1, 1, 1,    //
      1, 1,              //
      0;
  return w;
}

const EvidenceFeatures& evidenceWeights() {
  // 67 captures drawn with seed 72 (patina-two-shot-rates --seed 72 --bundles 70 --singles 0.72 --pairs 0.03,
  // then --weigh); those with saturation alone are left out.
  static const EvidenceFeatures weights = [] {
    EvidenceFeatures w;
    w << -2.969, 1.895, 0.850, 0.577,        //
        -2.296, 0.714,                       //
        -2.840, 1.514, 0.150, 1.528, 1.016,  //
        1.333, 0.936,                        //
        0.730;
    return w;
  }();
  return weights;
}

}  // namespace patina
