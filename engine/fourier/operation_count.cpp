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
  return count(1);
}
// As in lanes.inc: the operations of the series, of one Newton step.
constexpr double kExp = 20, kSineAndCosine = 28, kInverse = 3, kInverseRoot = 6;
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

double momentsOfOneLobe(LobeMapping mapping) {
  operations = 0;
  LobeSite<Counted> site;
  const float rows[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  if (mapping == LobeMapping::ExactMoments) {
    const NormalFrame<Counted> frame = normalFromSlopes(Counted(), Counted(), rows);
    const LobeMoments<Counted> moments = lobeMoments(site, frame, Counted());
    static_cast<void>(litFraction(moments, Counted(), Counted(), 1.0f, 1.0f));
  } else {
    static_cast<void>(lobeMomentsPaper(site, Counted(), Counted(), Counted(), rows));
  }
  return operations;
}

}  // namespace

double solverOperations(const SolverSetup& setup) {
  const FrequencyPlan plan(setup);
  const auto rows = 2.0 * static_cast<double>(plan.rows.size()), diffuseRows = 2.0 * plan.diffuseRows;
  const auto directions = static_cast<double>(plan.directions.size());
  // One lobe at one frequency: decay 1, exponential, amplitude 3, bend 3, envelope 2, phase 4, sine and
  // cosine, value 4, three derivatives of 20, the width's share in kurtosis 4.
  const double lobeAtFrequency = 1 + kExp + 3 + 3 + 2 + 4 + kSineAndCosine + 4 + 60 + 4;
  // One lobe along one direction: (5 + 5 + 7 + 9) for the value and each of three derivatives.
  const double lobeAlongDirection = 4 * 26 + 3;
  // Sums over rows: 15 + 3 products of the specular columns, 15 with the diffuse part.
  const double products = rows * 36 + diffuseRows * 30;
  // Residuals of three channels (7 each), four derivatives, the diffuse value and its three axes.
  const double residuals = rows * (21 + 24) + diffuseRows * (5 + 18);
  // Albedos, matrix and Schur complement of three channels; the damped step, twice; acceptance.
  const double small = 3 * (60 + 230 + 90) + 2 * 70 + 60;
  return 2 * momentsOfOneLobe(setup.lobe) + 2 * static_cast<double>(plan.rows.size()) * lobeAtFrequency +
         2 * directions * lobeAlongDirection + products + residuals + small;
}

}  // namespace patina
