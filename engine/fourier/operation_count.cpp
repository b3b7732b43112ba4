#include "engine/fourier/operation_count.h"

#include <algorithm>

#include "engine/fourier/frequency_plan.h"

namespace patina {
namespace {

thread_local double operations = 0;

/// A number that is nothing but its operations.
struct Counted {
  Counted() = default;
  explicit Counted(float) {}
};
Counted count(double n) {
  operations += n;
  return {};
}
Counted operator+(Counted, Counted) {
  return count(1);
}
Counted operator-(Counted, Counted) {
  return count(1);
}
Counted operator*(Counted, Counted) {
  return count(1);
}
[[maybe_unused]] Counted operator/(Counted, Counted) {
  return count(1);
}
Counted operator-(Counted) {
  return {};
}
// As in lanes.inc: the operations of the series, of one Newton step.
constexpr double kExp = 18, kSineAndCosine = 25, kInverse = 3, kInverseRoot = 5;
Counted vexp(Counted) {
  return count(kExp);
}
[[maybe_unused]] Counted vsqrt(Counted) {
  return count(1);
}
Counted vinv(Counted) {
  return count(kInverse);
}
Counted vrsqrt(Counted) {
  return count(kInverseRoot);
}
Counted vmax(Counted, Counted) {
  return {};
}
Counted vmin(Counted, Counted) {
  return {};
}

#include "engine/fourier/lobe_kernel.inc"

/// Both lobes' moments and what of them the zero frequency needs.
double moments(LobeMapping mapping) {
  operations = 0;
  LobeSite<Counted> site;
  const float rows[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  const NormalFrame<Counted> frame = normalFromSlopes(Counted(), Counted(), rows);
  if (mapping == LobeMapping::ExactMoments) {
    const SlopePlane<Counted> plane = slopePlane(site, frame);
    const Counted invVariance[2] = {};
    Gaussian2<Counted> mode[2];
    lobeModes<kPlainLobe>(site, plane, invVariance, mode);
    for (int l = 0; l < 2; ++l) {
      const LobeMoments<Counted> moments = momentsAbout<kPlainLobe>(site, plane, invVariance[l], mode[l]);
      static_cast<void>(litFraction(moments, Counted(), Counted(), 1.0f, 1.0f));
    }
  } else {
    for (int l = 0; l < 2; ++l)
      static_cast<void>(lobeMomentsPaper(site, Counted(), Counted(), Counted(), rows));
  }
  return operations;
}

}  // namespace

double solverOperations(const SolverSetup& setup, double litShare) {
  const FrequencyPlan plan(setup);
  const auto rows = 2.0 * static_cast<double>(plan.rows.size()), diffuseRows = 2.0 * plan.diffuseRows;
  const auto directions = static_cast<double>(plan.directions.size());
  // One lobe at one frequency: decay 1, exponential, amplitude 2, bend 1, phase 3, sine and cosine, value 8,
  // three derivatives' factors of 6, the first (also that in kurtosis) 16, the others 12 each.
  const double lobeAtFrequency = 1 + kExp + 2 + 1 + 3 + kSineAndCosine + 8 + 18 + 16 + 24;
  // One lobe along one direction: (5 + 5 + 7 + 9) for the value and each of three derivatives.
  const double lobeAlongDirection = 4 * 26 + 3;
  // Sums over rows: 15 + 3 products of the specular columns, 15 with the diffuse part.
  const double products = litShare * (rows * 36 + diffuseRows * 30);
  // Residuals of three channels and their squares; where the lobe is, its part, their weighed sum, four
  // derivatives; where the diffuse part is, the value, its part, the weighed sum, three axes.
  const double residuals = rows * 6 + litShare * rows * (6 + 6 + 8) + diffuseRows * (5 + 6 + 6 + 6);
  // Albedos, matrix and Schur complement of three channels; the damped step, twice; acceptance.
  const double small = 3 * (40 + 207 + 92) + 2 * 70 + 60;
  return moments(setup.lobe) + litShare * 2 * static_cast<double>(plan.rows.size()) * lobeAtFrequency +
         2 * directions * lobeAlongDirection + products + residuals + small;
}

}  // namespace patina
