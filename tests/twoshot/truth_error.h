#pragma once

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <numeric>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "engine/brdf/brdf.h"
#include "engine/brdf/brdf_file.h"
#include "engine/brdf/neural_brdf.h"
#include "engine/twoshot/fit.h"
#include "engine/twoshot/mapping.h"
#include "tests/test_data.h"

/// How far a reconstruction is from a true material. For tests and the results program only: a fit never sees
/// it.
namespace patina::test {

/// RMS over directions drawn uniformly over the MERL grid (thetaH = 90 u^2 degrees, thetaD and phiD uniform),
/// all channels, of the difference of ln(f w + eps); directions with both cosines above `smallestCosine`,
/// where both BRDFs are known. Natural-log units.
inline double logRms(const Brdf& found, const Brdf& truth, double smallestCosine = 0.15, int draws = 20000) {
  std::mt19937_64 random(7);
  const auto uniform = [&] { return static_cast<double>(random() >> 11) * 0x1p-53; };
  double sum = 0;
  int count = 0;
  for (int i = 0; i < draws;) {
    const double u = uniform();
    const HalfDiffAngles angles{u * u * std::numbers::pi / 2, uniform() * std::numbers::pi / 2,
                                uniform() * std::numbers::pi};
    const DirectionPair pair = directionsFromHalfDiff(angles);
    if (pair.toLight.z() <= smallestCosine || pair.toView.z() <= smallestCosine) continue;
    ++i;
    const Eigen::Array3d a = found.evaluate(pair.toLight, pair.toView);
    const Eigen::Array3d b = truth.evaluate(pair.toLight, pair.toView);
    if (!a.isFinite().all() || !b.isFinite().all()) continue;
    const double w = mappingWeight(pair.toLight.z(), pair.toView.z());
    for (int c = 0; c < 3; ++c) {
      const double difference = mapBrdf(a[c], w, 0) - mapBrdf(b[c], w, 0);
      sum += difference * difference;
      ++count;
    }
  }
  return count > 0 ? std::sqrt(sum / count) : INFINITY;
}

/// The true material of a bundle: what its truth.json names, "merl:NAME" (the published network) or a
/// measured file. `index`: which of several. Throws where it isn't there.
inline BrdfPtr trueMaterial(const std::filesystem::path& bundle, std::size_t index = 0) {
  std::ifstream in(bundle / "truth" / "truth.json");
  const std::string name = nlohmann::json::parse(in).at("materials").at(index).get<std::string>();
  if (name.rfind("merl:", 0) == 0) {
    for (const BrdfPtr& brdf : builtInNeuralBrdfs())
      if (brdf->origin().name == name.substr(5)) return brdf;
    throw std::runtime_error("no network of " + name);
  }
  for (const char* folder : {"measured/rgl", "measured/retro"}) {
    const auto file = sharedData() / folder / name;
    if (!std::filesystem::exists(file)) continue;
    auto brdf = readBrdf(file);
    if (!brdf) throw std::runtime_error(brdf.error().sentence());
    return *brdf;
  }
  throw std::runtime_error("no file " + name);
}

/// `logRms` of each material of a bundle with several, in the order of its truth: every found material beside
/// another true one, so that the errors' sum is smallest. Empty where their numbers differ.
inline std::vector<double> materialErrors(const TwoShotFit& fit, const std::filesystem::path& bundle) {
  std::ifstream in(bundle / "truth" / "truth.json");
  const std::size_t count = nlohmann::json::parse(in).at("materials").size();
  std::vector<double> best;
  if (count != fit.materials.size()) return best;
  std::vector<BrdfPtr> truths;
  for (std::size_t t = 0; t < count; ++t) truths.push_back(trueMaterial(bundle, t));
  std::vector<std::size_t> truthOf(count);
  std::iota(truthOf.begin(), truthOf.end(), std::size_t{0});
  const auto sum = [](const std::vector<double>& errors) {
    return std::accumulate(errors.begin(), errors.end(), 0.0);
  };
  do {
    std::vector<double> errors(count);
    for (std::size_t m = 0; m < count; ++m)
      errors[truthOf[m]] = logRms(*fit.materials[m].brdf, *truths[truthOf[m]]);
    if (best.empty() || sum(errors) < sum(best)) best = errors;
  } while (std::next_permutation(truthOf.begin(), truthOf.end()));
  return best;
}

}  // namespace patina::test
