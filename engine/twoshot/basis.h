#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/brdf/tabulated_brdf.h"

namespace patina {

/// Over which directions an error is averaged.
enum class BasisRegion {
  All,      ///< every cell of the grid above the surface
  Trusted,  ///< cells where light and view are within kTrustedAngleDeg of the normal
};
/// Where measured data, the built-in basis among them, are still trustworthy, degrees from the normal.
inline constexpr double kTrustedAngleDeg = 81;

/// What a basis was made from.
struct BasisMaterial {
  std::string name, format, note;
  std::uint64_t checksum =
      0;  ///< XXH3 of the source file's bytes; where there is none, of the column's values
  std::uint64_t bytes = 0;
};

/// The rows of Q that belong to a set of directions, with what mapping needs. Shapes: n rows, k components.
struct BasisRows {
  Eigen::MatrixXd components;   ///< n x k, natural-log units per unit coefficient
  Eigen::VectorXd mean;         ///< n, mapped mean
  Eigen::VectorXd lnReference;  ///< n, ln(f_ref w + eps)
  Eigen::VectorXd weight;       ///< n, max cosine
  Eigen::Index size() const { return mean.size(); }
};

/// A linear basis of log-mapped BRDFs: mapped BRDF = mean + Q c, Q = V Sigma. Immutable; its table is mapped
/// from the file, so that opening is quick and copies in memory are the system's business.
/// Source: two-shot paper, section 3, equations 1 and 2. A column is one colour channel of one material,
/// three consecutive columns a material. Cells: the MERL grid with phiD folded about 90 degrees (an isotropic
/// reciprocal BRDF is even there), so every stored cell stands for two of the grid.
class Basis {
 public:
  virtual ~Basis() = default;

  virtual int componentCount() const = 0;  ///< k
  virtual int columnCount() const = 0;     ///< m: three a material
  /// Cells of the whole grid (both halves of phiD) that the basis covers: p of `region`.
  virtual std::size_t cellCount(BasisRegion region) const = 0;
  virtual const std::vector<BasisMaterial>& materials() const = 0;
  virtual const std::string& name() const = 0;    ///< "built-in" or the file's name
  virtual const std::string& source() const = 0;  ///< sentence on origin and licence
  virtual std::uint64_t checksum() const = 0;     ///< XXH3 of the file's content

  /// Diagonal of Sigma, k, largest first.
  virtual const Eigen::VectorXd& singularValues() const = 0;
  /// k x m: column i holds the coefficients of the training column i.
  virtual const Eigen::MatrixXd& columnCoefficients() const = 0;
  /// Q^T Q over the region, k x k: error^2 of a coefficient error d is d^T G d. For All it is Sigma^2.
  virtual const Eigen::MatrixXd& gram(BasisRegion region) const = 0;
  /// A matrix L, k x k, with L^T L = gram(region): |L d| is the error's norm.
  virtual const Eigen::MatrixXd& gramRoot(BasisRegion region) const = 0;

  /// Rows at directions, trilinear in grid coordinates over the covered cells around. Directions beyond the
  /// covered cells (below the surface; no covered cell around) are left out: `kept` receives the indices of
  /// those answered, in order. Cost: about 8 k multiplications a row.
  virtual BasisRows rows(std::span<const HalfDiffAngles> angles, std::vector<int>* kept = nullptr) const = 0;

  /// The BRDF with coefficients `c`, k x 3 (R, G, B), unmapped, on the MERL grid; uncovered cells -1. All
  /// cores; 300 components: about 0.3 s. Null where `stop` was asked for before it was done.
  virtual std::shared_ptr<const TabulatedBrdf> reconstruct(const Eigen::MatrixXd& c, BrdfOrigin origin,
                                                           const std::stop_token& stop) const = 0;

  /// sqrt(q^T C q) for every cell of the MERL grid, natural-log units, -1 where uncovered, given
  /// C = (I - B^T W B) * scale with B r x k of orthonormal rows and W r x r symmetric: the posterior's
  /// standard deviation. Empty where `stop` was asked for before it was done. All cores.
  virtual std::vector<float> posteriorSd(const Eigen::MatrixXd& b, const Eigen::MatrixXd& w, double scale,
                                         const std::stop_token& stop) const = 0;
};

using BasisPtr = std::shared_ptr<const Basis>;

/// How a basis is built.
struct BasisBuildOptions {
  int components =
      0;  ///< k; 0: all with a singular value above 1e-7 of the first. Fewer: a smaller file, a coarser basis
  bool withBuiltIn = false;  ///< the built-in materials as columns too
  std::string name;          ///< kept in the file
};

/// Builds a basis from measured BRDFs (`readBrdf`) and writes it to `out`, atomically. Two passes over slabs
/// of cells: the mapped columns of a slab go to a scratch file beside `out` and into the m x m Gram matrix,
/// whose eigenvectors then turn them into components; memory is bounded by a slab, never p x m. Errors:
/// Invalid (fewer than 2 materials; a material that covers less than half of the grid, named); those of
/// `readBrdf`; WriteFailed; Cancelled. Progress: "map", "components".
Result<BasisPtr> buildBasis(const std::vector<std::filesystem::path>& files, const std::filesystem::path& out,
                            const BasisBuildOptions& options, const JobContext& job);
/// The same from BRDFs in memory.
Result<BasisPtr> buildBasis(const std::vector<BrdfPtr>& brdfs, const std::filesystem::path& out,
                            const BasisBuildOptions& options, const JobContext& job);

/// Opens a basis file and checks it: header, sizes, checksum. Errors: NotFound, Malformed, Unsupported (a
/// later version).
Result<BasisPtr> openBasis(const std::filesystem::path& file, const JobContext& job = {});

/// The basis that ships: the 100 MERL materials from published fits. Expanded from the networks' weights at
/// first use into the user's cache folder ($PATINA_CACHE, else $XDG_CACHE_HOME/patina, else ~/.cache/patina;
/// a temporary file where that can't be written), which takes some ten seconds; opened from there afterwards.
/// Progress: "built-in basis".
Result<BasisPtr> builtInBasis(const JobContext& job);

/// `file` empty: the built-in one; else `openBasis`.
Result<BasisPtr> basisFor(const std::filesystem::path& file, const JobContext& job);

/// The networks behind the built-in basis, 100.
const std::vector<BrdfPtr>& builtInMaterials();

}  // namespace patina
