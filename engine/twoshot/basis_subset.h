#pragma once

#include <Eigen/Core>
#include <vector>

#include "engine/twoshot/basis.h"
#include "engine/twoshot/metric.h"

namespace patina {

/// The basis that the other materials alone would give: `left` are indices into basis->materials(). Exact,
/// without a pass over cells: the others' columns are known by their coefficients, and an SVD of those (times
/// Sigma) is their own decomposition. The reference of the mapping stays that of all materials, which shifts
/// mapped values by the same amount in every column and changes nothing else. For experiments and
/// calibration; rows cost a product more. Throws std::invalid_argument for an index out of range or fewer
/// than two materials left.
BasisPtr basisWithout(const BasisPtr& basis, const std::vector<int>& left);

/// RMS errors over the region, natural-log units, of `materials` of `basis` (mean over their channels),
/// observed without noise at rows Q~ and reconstructed by `others` = basisWithout(basis, left). `rows`: those
/// of the whole basis
/// (`rowsOfShot`), reduced.
std::vector<double> errorsOfLeftOut(const BasisPtr& basis, const std::vector<int>& left,
                                    const RowFactor& rows, const std::vector<int>& materials,
                                    BasisRegion region, double eta = kPaperEta);

}  // namespace patina
