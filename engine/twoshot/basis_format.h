#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "engine/base/result.h"
#include "engine/twoshot/basis.h"

namespace patina {

/// The layout of a basis file: 16 bytes of magic, the header's length (uint64), the header (JSON, its own
/// XXH3 behind it), then the arrays, each at a multiple of 64 bytes, little-endian:
///   singular values f64 k, column coefficients f64 k x m (column-major), Gram matrix of the trusted region
///   f64 k x k, component scales f32 k, folded cells u32 n, mean f32 n, lnReference f32 n, components i16 n x
///   k (row-major: component j of cell i is scale[j] * value).
inline constexpr char kBasisMagic[17] = "PATINA BASIS 001";
inline constexpr std::size_t kBasisAlignment = 64;

/// Cells of the grid with phiD folded: 90 x 90 x 90, phiD fastest.
inline constexpr int kFoldedPhiD = MerlGrid::kPhiD / 2;
inline constexpr std::size_t kFoldedCells = std::size_t{MerlGrid::kThetaH} * MerlGrid::kThetaD * kFoldedPhiD;
HalfDiffAngles foldedCentre(std::size_t cell);
/// Cosines of light and view at a folded cell's centre.
struct CellCosines {
  double light, view;
};
CellCosines foldedCosines(std::size_t cell);
/// Both directions above the surface.
bool foldedCellReachable(std::size_t cell);
bool foldedCellTrusted(std::size_t cell);

/// What the header says.
struct BasisHeader {
  std::string name, source;
  std::vector<BasisMaterial> materials;
  int components = 0, columns = 0;
  std::size_t cells = 0;         ///< folded
  std::size_t trustedCells = 0;  ///< folded
  std::uint64_t dataChecksum = 0;
};

/// Byte offsets of the arrays, from the file's start.
struct BasisLayout {
  std::size_t singularValues, coefficients, trustedGram, scales, cells, mean, lnReference, components, end;
};
BasisLayout basisLayout(const BasisHeader& header, std::size_t dataStart);

std::string basisHeaderJson(const BasisHeader& header);
Result<BasisHeader> parseBasisHeader(std::string_view text, const std::string& where);

/// XXH3 of bytes; as 16 hexadecimal digits.
std::uint64_t contentChecksum(std::string_view bytes);
/// The same in pieces.
class ContentChecksum {
 public:
  ContentChecksum();
  ~ContentChecksum();
  ContentChecksum(const ContentChecksum&) = delete;
  ContentChecksum& operator=(const ContentChecksum&) = delete;
  void add(const void* bytes, std::size_t count);
  std::uint64_t value() const;

 private:
  void* state_;
};
std::string checksumText(std::uint64_t checksum);

}  // namespace patina
