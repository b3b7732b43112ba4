#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/brdf/brdf.h"
#include "engine/brdf/merl_grid.h"

namespace patina {

/// A BRDF on the MERL grid. Values in 1/sr; a negative one marks a cell that was not measured or that no pair
/// of directions above the surface reaches.
class TabulatedBrdf : public Brdf {
 public:
  /// Planes R, G, B of MerlGrid::kCells values each.
  using Planes = std::array<std::vector<double>, 3>;

  /// Takes the planes as they are. Throws std::invalid_argument where they have another size.
  TabulatedBrdf(Planes planes, BrdfOrigin origin);

  /// Trilinear in grid coordinates over the valid cells around, weights made to sum to one; reciprocal (phiD
  /// has period pi). NaN where no cell around is valid.
  Eigen::Array3d evaluate(const Eigen::Vector3d& toLight, const Eigen::Vector3d& toView) const override;
  Eigen::Array3d evaluate(const HalfDiffAngles& angles) const;

  bool valid(std::size_t cell) const {
    return planes_[0][cell] >= 0 && planes_[1][cell] >= 0 && planes_[2][cell] >= 0;
  }
  std::size_t validCells() const;
  const Planes& planes() const { return planes_; }

 private:
  friend Result<std::shared_ptr<const TabulatedBrdf>> readMerlBytes(std::string_view, const std::string&);
  friend Status writeMerl(const std::filesystem::path&, const TabulatedBrdf&);

  Planes planes_;
  /// What a file held is planes_ / scale moved by so many representable numbers: scaling rounds, and a file
  /// that is read and written again should be the same file. Empty where there was no file.
  std::array<std::vector<std::int8_t>, 3> fileSteps_;
};

/// Any BRDF sampled at the centres of the MERL grid. Anisotropic ones are averaged over `azimuths` positions
/// of the half-vector and the origin's note says so. A BRDF that is not reciprocal stays so: phiD and
/// pi - phiD hold its two answers. Cells that no pair above the surface reaches, and cells where the BRDF is
/// not known, are -1. Threads: `job.threads`. Cost: 1,458,000 evaluations. Progress: "tabulate". Errors:
/// Cancelled.
Result<std::shared_ptr<const TabulatedBrdf>> tabulate(const Brdf& brdf, const JobContext& job = {},
                                                      int azimuths = 16);

/// The table with every cell averaged with the one at pi - phiD: light and view swapped, and mirrored. For
/// an isotropic reciprocal surface without handedness both are the same; measured ones that are not
/// reciprocal would otherwise show a seam where phiD starts over, because the format can't hold two answers.
/// Where only one of the two is known, that one. How far they were apart is added to the origin's note.
std::shared_ptr<const TabulatedBrdf> madeReciprocal(const TabulatedBrdf& table);

/// Reads a MERL `.binary`: three 32-bit sizes (90, 90, 180), then planes R, G, B of doubles, to be multiplied
/// by 1/1500, 1.15/1500 and 1.66/1500. Negative cells stay negative. Errors: NotFound; Malformed (other
/// sizes, truncated or longer, NaN or infinite: the cell is named).
Result<std::shared_ptr<const TabulatedBrdf>> readMerl(const std::filesystem::path& file);
/// The same from bytes; `where` names them in errors.
Result<std::shared_ptr<const TabulatedBrdf>> readMerlBytes(std::string_view bytes, const std::string& where);
/// Writes a MERL `.binary`, atomically. What `readMerl` read is written back byte for byte (numbers below
/// 1e-300, which scaling flattens, excepted). Errors: WriteFailed.
Status writeMerl(const std::filesystem::path& file, const TabulatedBrdf& brdf);

}  // namespace patina
