#pragma once

#include <Eigen/Core>
#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/capture/encoding.h"
#include "engine/image/image.h"

namespace patina {

/// One photograph of a series that differs in exposure only.
struct ExposedPhoto {
  std::string name;  ///< for messages: the file
  Image image;       ///< R G B, pixel values 0..1 as the camera gave them (response), or linear (merging)
  double exposureS = 1;
};

/// Whether a series can be used together. Errors: Invalid (not all of one size and R G B; an exposure that is
/// not positive; the photograph named).
Status checkExposures(const std::vector<ExposedPhoto>& photos);

struct ResponseOptions {
  int knots = 256;        ///< of the curve, 16 to 1024
  double smoothness = 1;  ///< how firmly its local exponent is held, > 0; more: smoother. Exposures that all
                          ///< differ by one factor leave the curve between two such steps to it
  int samplesPerChannel =
      600;  ///< places of the picture, spread over its brightness; more: less noise, slower
  double lowest = 0.01, highest = 0.99;  ///< pixel values beyond count as black or clipped
};

/// How far from a straight line the camera is.
struct Linearity {
  double largestDeviation = 0;  ///< of full scale, of the curve from the best straight line through black
  double exponent = 1;          ///< of the best power law: light = value ^ exponent
  std::string sentence;
};

struct CameraResponse {
  std::array<ResponseCurve, 3> curves;  ///< R G B: light over pixel value, light 1 at value 1
  std::array<double, 3> residual{};  ///< RMS of ln(light) that exposures disagree by, weighted as in the fit
  std::array<double, 3> coveredFrom{},
      coveredTo{};                    ///< pixel values that data decided; smooth continuation beyond
  Linearity linearity;                ///< of G
  std::vector<std::string> warnings;  ///< uncovered ends, exposures that don't fit the others, movement
  std::vector<double>
      exposureFactor;  ///< of each photograph: what its exposure really was over what was said
};

/// The camera's response from a bracket of one still scene. Source: Debevec and Malik 1997, equation 3, on a
/// piecewise linear curve over the pixel value instead of 256 codes, with robust weights, and made monotone
/// (isotonic) at the end. Errors: Invalid (fewer than 3 photographs, sizes that differ, exposures all alike,
/// too few pixels that are neither black nor clipped), Cancelled. Cost: about a second for 8 photographs.
Result<CameraResponse> recoverResponse(const std::vector<ExposedPhoto>& photos,
                                       const ResponseOptions& options = {}, const JobContext& job = {});

/// The black level of a camera from photographs taken with the lens covered.
struct DarkLevel {
  Eigen::Vector3d level = Eigen::Vector3d::Zero();  ///< mean pixel value
  Eigen::Vector3d readNoise =
      Eigen::Vector3d::Zero();  ///< of one pixel of one photograph; from differences of
                                ///< two, or over the picture where there is only one
  double pattern = 0;           ///< standard deviation of the level over the picture beyond noise
  double hotShare = 0;          ///< pixels over 8 standard deviations above
  bool clippedAtZero = false;   ///< the camera cuts off at black: noise and level can't be told
  std::vector<std::string> warnings;
};
/// Errors: Invalid (no photographs, sizes that differ, a picture that isn't dark).
Result<DarkLevel> measureDarkLevel(const std::vector<Image>& photos);

/// The text of a response file (docs/response_curves.md), which `parseResponse` reads, and the file.
std::string responseJson(const std::array<ResponseCurve, 3>& curves);
Status writeResponse(const std::filesystem::path& file, const std::array<ResponseCurve, 3>& curves);

}  // namespace patina
