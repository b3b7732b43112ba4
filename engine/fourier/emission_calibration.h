#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/capture/capture.h"
#include "engine/screen/screen.h"

namespace patina {

struct EmissionOptions {
  Eigen::Vector3d albedo = Eigen::Vector3d::Zero();  ///< of the paper; 0: the bundle's `sample.known`, else 1
  int points = 400;        ///< of the sample, evenly spaced; more: less noise, slower
  bool freeMeanX = false;  ///< the paper holds the horizontal mean at 0
  int iterations = 60;
};

/// What the white paper told of the screen.
struct EmissionCalibration {
  ScreenEmission emission;  ///< gain: of all channels together, in the bundle's radiance
  Eigen::Vector2d meanSd = Eigen::Vector2d::Zero(), sigmaSd = Eigen::Vector2d::Zero();
  double gainSd = 0;
  Eigen::Vector3d channelGain = Eigen::Vector3d::Ones();  ///< of R G B over emission.gain: the camera's and
                                                          ///< the screen's colours
  Eigen::Vector3d albedo = Eigen::Vector3d::Ones();       ///< that was assumed
  double radianceScale = 1;  ///< that makes the screen's white, seen head-on, 1: for capture.json
  double residual = 0;       ///< relative RMS of measurements minus model
  double noise = 0;          ///< what noise alone would leave
  int points = 0, iterations = 0;
  bool converged = false;
  std::vector<std::string> warnings;  ///< a residual far above noise: the paper shines or isn't flat, the
                                      ///< screen isn't Gaussian
};

/// The screen's emission from a Fourier capture of white paper. Source: frequency-domain paper, appendix A:
/// the fit with the diffuse albedo held (1, or what is known), no specular, normals up; four (five) numbers
/// of the Gaussian and a gain a channel are sought at some hundred points. Instead of appendix B's mixture
/// the diffuse term is integrated over the lit rectangle (engine/fourier/diffuse_transform.h). The bundle's
/// own `screen.emission` is not read. Errors: those of reading the bundle's photographs; Invalid (too dark);
/// Cancelled. Cost: a few seconds.
Result<EmissionCalibration> calibrateEmission(const FourierCapture& capture,
                                              const EmissionOptions& options = {},
                                              const JobContext& job = {});

}  // namespace patina
