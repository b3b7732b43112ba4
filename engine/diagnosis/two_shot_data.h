#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/capture/two_shot_capture.h"
#include "engine/twoshot/deviation.h"
#include "engine/twoshot/reflectance_picture.h"

namespace patina {

/// Widths, pixels, at which photographs are blurred for the tests of glare and defocus.
inline constexpr std::array<double, 4> kBlurPx{1.0, 4.0, 12.0, 32.0};

/// A block of pixels of one photograph, as the diagnosis sees it.
struct DiagnosisRow {
  PhotoPoint point;
  Eigen::Array3d seen = Eigen::Array3d::Zero();      ///< what the white division gives, 1/sr
  Eigen::Array3d variance = Eigen::Array3d::Zero();  ///< of `seen`, by the sensor
  /// The photograph blurred by each of kBlurPx, less itself, divided like `seen`.
  std::array<Eigen::Array3d, kBlurPx.size()> blurred{};
  double brightest = 0;  ///< largest pixel value in the block's photographs, of any channel
  double weight = 0;     ///< of the picture's rows, as in the fit
  bool holdout = false;
};

/// A block of what lies around the sample, photographed beside the sample and beside the white tile by the
/// same camera under the same light. Nothing of the material is in it, so that it tells about the set-up
/// alone.
struct SurroundingBlock {
  std::size_t shot = 0;
  double cornerShare = 0;
  Eigen::Array3d beside = Eigen::Array3d::Zero();    ///< with the sample in its place, pixel units per second
  Eigen::Array3d white = Eigen::Array3d::Zero();     ///< with the tile
  Eigen::Array3d variance = Eigen::Array3d::Zero();  ///< of the difference, by the sensors
  std::array<Eigen::Array3d, kBlurPx.size()>
      blurred{};  ///< as above, of both photographs, the tile's taken off
  double exposureS = 1;
};

/// What is known of one photograph as a whole.
struct DiagnosisShot {
  bool used = false, holdout = false;
  Eigen::Array3d level = Eigen::Array3d::Zero();  ///< median over the sample, pixel units per second
  Eigen::Array3d whiteLevel = Eigen::Array3d::Zero();
  double largest = 0;  ///< pixel value on the sample
  double noiseShare = 0;
  std::size_t picture = 0;
};

/// The tile's own picture as a mean over blocks, for a near light that lit it too.
struct WhiteBlock {
  std::size_t shot = 0;
  Eigen::Vector3d toLight = Eigen::Vector3d::UnitZ();
  Eigen::Vector2d positionMm = Eigen::Vector2d::Zero();
  double cornerShare = 0;
  double lnRate = 0;  ///< ln of the mean of the three channels
  double sd = 0;
};

/// How far the sample's outline in a photograph is from where the bundle says, for its height.
struct OutlineShift {
  std::size_t shot = 0;
  double heightMm = 0, sdMm = 0;  ///< of the sample above z = 0 that would explain it
  double blurPx = 0;              ///< width of the edge, standard deviation
};

struct DiagnosisData {
  std::vector<DiagnosisRow> fitted, held;
  std::vector<SurroundingBlock> surroundings;
  std::vector<WhiteBlock> whites;
  std::vector<OutlineShift> outlines;
  std::vector<DiagnosisShot> shots;  ///< as the capture's
};

/// Rows for the diagnosis: about `rowsPerShot` a photograph, held-out ones too (the others' answers are
/// compared with them; nothing is fitted to them). Pixels that are exactly black in all channels were not
/// measured and are left out. Errors: those of reading; Invalid where nothing can be used; Cancelled.
Result<DiagnosisData> loadDiagnosisData(const TwoShotCapture& capture, int rowsPerShot,
                                        const JobContext& job);

}  // namespace patina
