#pragma once

#include <Eigen/Core>
#include <vector>

#include "engine/fourier/site_geometry.h"

namespace patina {

/// How the Lambertian term is transformed.
enum class DiffuseMethod {
  PaperMixture,  ///< App. B's three Gaussians, equation 12, over the infinite plane
  Quadrature,  ///< the cosine, distance, window and emission (ScreenFrame::logEmission as well) as they are,
               ///< over the lit rectangle
};

/// Transform of the Lambertian term at any sample point: for each frequency a complex vector v with Z_diffuse
/// = albedo * (n . v), n in the screen's frame. Source: frequency-domain paper, equations 7, 8 and 12. The
/// term is linear in n with coefficients that depend on geometry only, and they vary slowly over the sample:
/// they are tabulated on 9 x 9 Chebyshev nodes and interpolated (error below 2e-6 of DC in the tests, for a
/// screen farther away than half its width).
class DiffuseTransform {
 public:
  /// `frequencies` in pattern units; `sampleSizeMm` the rectangle that points lie in (z = 0), or that the
  /// sheet bends over: the table's nodes lie on its surface then. Heights that nine Chebyshev polynomials a
  /// side don't follow get a second table, the derivative with respect to the height: of the rest, what is
  /// left is of second order, 1e-4 of DC for a millimetre.
  /// Frequencies with a component beyond 48 have no diffuse part that any camera could see (below 1e-5 of
  /// DC); they give 0.
  DiffuseTransform(const ScreenFrame& frame, Eigen::Vector2d sampleSizeMm,
                   const std::vector<Eigen::Vector2d>& frequencies, DiffuseMethod method,
                   const SheetShape& shape = {});

  /// A transform of some of the frequencies only, in the given order (indices into the constructor's list).
  /// Cheap.
  DiffuseTransform select(const std::vector<int>& indices) const;

  /// The same for points between `lowMm` and `highMm`, from fewer nodes where those are near to each other: a
  /// third of the time for a row of an image. Error against the whole: below 1e-6 of DC in the tests. Cost:
  /// as many `at` as there are nodes then.
  DiffuseTransform part(const Eigen::Vector2d& lowMm, const Eigen::Vector2d& highMm) const;

  /// Whether making it takes less time than it saves at so many points.
  bool partPays(const Eigen::Vector2d& lowMm, const Eigen::Vector2d& highMm, std::size_t points) const;

  int frequencyCount() const { return frequencyCount_; }
  /// One for each frequency: 0 where the term stays below 1e-6 of the zero frequency's at every point, and
  /// `at` gives exactly 0.
  std::vector<char> counts() const;
  /// out[(f * 3 + axis) * 2 + {0: re, 1: im}], axis in the screen's frame. Thread-safe. Cost: 81 x 6
  /// multiply-adds a frequency that counts, in SIMD lanes; twice that with two tables. (Of a `part`: as many
  /// as it has nodes.)
  void at(const Eigen::Vector2d& pointMm, float* out) const;
  /// The same, `restMm` higher than the first table has it, whatever the sheet's height there is.
  void at(const Eigen::Vector2d& pointMm, double restMm, float* out) const;
  /// How much higher the sheet is than the first table has it; 0 where there is no second.
  double restMm(const Eigen::Vector2d& pointMm) const;
  bool hasRest() const { return !rest_.empty(); }

  /// The same at one point without a table: for curves with many frequencies.
  static std::vector<float> atPoint(const ScreenFrame& frame, const Eigen::Vector2d& pointMm,
                                    const std::vector<Eigen::Vector2d>& frequencies, DiffuseMethod method,
                                    const SheetShape& shape = {});

 private:
  DiffuseTransform() = default;
  /// The frequencies that count.
  void findKept(const std::vector<float>& full);
  std::vector<float> compacted(const std::vector<float>& full) const;

  static constexpr int kNodes = 9;  ///< of the whole sheet, along each axis
  std::size_t nodeCount() const { return static_cast<std::size_t>(nodes_[0]) * nodes_[1]; }
  /// Of a node's numbers in a table: whole vectors on every instruction set, zeros at the end.
  std::size_t stride() const { return (kept_.size() * 6 + 15) / 16 * 16; }
  Eigen::Vector2d nodeMm(std::size_t node) const;
  /// Products of the nodes' weights at a point: [node y][node x].
  void nodeWeights(const Eigen::Vector2d& pointMm, float (&product)[kNodes * kNodes]) const;
  double smoothHeightMm(const Eigen::Vector2d& pointMm) const;

  int frequencyCount_ = 0;
  int nodes_[2] = {kNodes, kNodes};
  Eigen::Vector2d centreMm_ = Eigen::Vector2d::Zero(), halfSizeMm_;
  std::vector<int> kept_;     ///< frequencies that count, ascending
  std::vector<float> table_;  ///< [node y][node x][kept][axis][re, im], `stride` floats a node
  std::vector<float> rest_;   ///< as table_: derivative by the height in mm; empty where not needed
  std::function<double(const Eigen::Vector2d&)> heightMm_;  ///< where there is a second table
  std::vector<double> nodeHeight_;                          ///< [node y][node x]
};

}  // namespace patina
