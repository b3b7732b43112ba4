#pragma once

#include <Eigen/Core>
#include <array>
#include <memory>
#include <string>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/brdf/tabulated_brdf.h"
#include "engine/image/image.h"
#include "engine/render/environment.h"

namespace patina {

/// A measured BRDF made ready for pictures: its table folded to phiD in 0 to 90 degrees (an isotropic
/// reciprocal BRDF is even there; the average of both cells), with the posterior's standard deviation beside
/// each value, and a density of half-vectors that follows the material's own highlight. About 12 MB;
/// immutable, may be shared between threads.
class SphereMaterial {
 public:
  /// `posteriorSd`: for each cell of the MERL grid, natural-log units, -1 where nothing is known; null: no
  /// certainty. Where nothing is known, `priorSd` holds. Cells that were not measured take the mean of their
  /// measured neighbours, twice (grazing directions fall between cells above and below the surface); others
  /// are black. Cost: about 40 ms. Throws std::invalid_argument for a `posteriorSd` of another size.
  explicit SphereMaterial(const TabulatedBrdf& brdf, const std::vector<float>* posteriorSd = nullptr,
                          double priorSd = 0);

  struct Seen {
    Eigen::Array4f value;   ///< R G B in 1/sr, and the standard deviation (0 without one)
    float halfDensity = 0;  ///< 1/sr of half-vectors, with which `sampleThetaH` chose this pair's
    float cosThetaD = 1;
  };
  /// Unit vectors in one frame, `toLight` and `toView` above the surface.
  Seen evaluate(const Eigen::Vector3f& normal, const Eigen::Vector3f& toLight,
                const Eigen::Vector3f& toView) const;

  /// The angle of a half-vector to the normal, radians, for a number in 0 to 1.
  float sampleThetaH(float u) const;
  /// How far the highlight's half-vectors are spread as those of a matt surface: 1 for Lambert, towards 0 for
  /// a mirror.
  float mattPart() const { return mattPart_; }

  bool hasCertainty() const { return hasCertainty_; }
  double priorSd() const { return priorSd_; }

 private:
  void fold(const TabulatedBrdf& brdf, const std::vector<float>* posteriorSd);
  void fillNeighbours();
  void prepareSampling();
  float halfDensity(float thetaHRad, float sinThetaH) const;

  static constexpr int kThetaH = 90, kThetaD = 90, kPhiD = 90;
  std::vector<Eigen::Array4f> table_;  ///< [thetaH][thetaD][phiD]
  std::array<float, kThetaH + 1> sums_{};
  std::array<float, kThetaH> chance_{};  ///< of each step of sqrt(thetaH)
  float mattPart_ = 1;
  bool hasCertainty_ = false;
  double priorSd_ = 0;
};

/// What lights the sphere. View frame: x right, y up, z to the eye.
struct MeasuredSphereLighting {
  EnvironmentPtr environment;  ///< null: none
  Eigen::Matrix3f environmentFromView =
      Eigen::Matrix3f::Identity();  ///< rotation: how the environment is turned
  Eigen::Vector3f toLight =
      Eigen::Vector3f(-0.45f, 0.6f, 0.66f);  ///< of the small distant light; need not be unit
  Eigen::Array3f lightIrradiance =
      Eigen::Array3f::Zero();  ///< R G B, on a surface that faces it; pi: white matt is just white; 0: none
};

struct MeasuredSphereOptions {
  int size = 256;       ///< pixels a side, 1 to 4096
  int samples = 64;     ///< of the environment a pixel, at least 4; half of them along its light, the
                        ///< others along the material's highlight and evenly. More: less grain, slower
  int firstSample = 0;  ///< for pictures made in parts: those with the samples that follow can be averaged
  int lightSamplesAcross = 3;  ///< squared: places a pixel where the small light is evaluated
};

/// The picture in parts, so that it can be laid over anything.
struct MeasuredSphere {
  Image radiance;   ///< R G B, linear; right up to the rim, 0 beyond
  Image coverage;   ///< how much of a pixel the sphere covers, 0 to 1
  Image certainty;  ///< standard deviation of the pixel's radiance, natural-log units, -1 where no light
                    ///< comes from; empty where the material has none
  /// The sphere on an even background, linear.
  Image over(float background) const;
};

/// Of the picture's side: the sphere's radius.
inline constexpr float kMeasuredSphereRadius = 0.48f;

/// A sphere of the material seen from afar, interreflection-free. Each pixel's integral over the environment
/// is estimated with three densities, the environment's own, one of half-vectors after the material's
/// highlight and one after the cosine, combined by the balance heuristic (Veach and Guibas 1995), so that
/// mirrors are as smooth as matt materials; the small light is evaluated exactly. Places in a pixel vary with
/// the samples: edges in reflections are smooth. The certainty of a pixel is the mean of the directions'
/// standard deviations, weighted by what each contributes (errors of a reconstruction go together;
/// independent ones would give less). Deterministic under `job.seed` for any number of threads. Errors:
/// Cancelled; Invalid (size, samples). Progress: "sphere". Threads: job.threads. Cost: 256 pixels, 64
/// samples: about 0.5 s on two cores.
Result<MeasuredSphere> measuredSphere(const SphereMaterial& material, const MeasuredSphereLighting& lighting,
                                      const MeasuredSphereOptions& options = {}, const JobContext& job = {});

/// The exposure that shows a white matt sphere in this light as just white where it is brightest, so that a
/// material looks as light or dark as it is. 1 without any light. Source: `Environment::irradianceOverPi`
/// over the normals that face the eye.
float exposureForWhite(const MeasuredSphereLighting& lighting);

/// Adds a picture's part to those before it: `sum` is the mean of `parts` pictures and becomes that of parts
/// +
/// 1. Sizes must agree (std::invalid_argument).
void accumulate(MeasuredSphere& sum, const MeasuredSphere& next, int parts);

/// The colour of a certainty: blue where measured (0), grey half way, orange where extrapolated (1, the
/// prior's own). Told apart without colour vision by blue's and orange's different hue for all common kinds.
/// Display-encoded.
std::array<float, 3> certaintyColour(float sdOverPrior);
/// The picture painted by certainty: hue from `certaintyColour`, lightness from the shown picture
/// (display-encoded R G B, same size). Pixels without light keep a dark grey.
Image certaintyPicture(const Image& shown, const Image& certainty, double priorSd);

/// Options of a finished picture.
struct SpherePictureOptions {
  int size = 512;                      ///< of one sphere, pixels
  int samples = 128;                   ///< as MeasuredSphereOptions
  std::string environment = "studio";  ///< id of a built-in one
  float background = 0.04f;            ///< display's linear value round the sphere
};

/// One sphere, tone-mapped and ready for `writePng`: exposed by `exposureForWhite`, dark
/// materials up to three times brighter. Errors: Invalid (no such
/// environment; the nearest is named); Cancelled.
Result<Image> spherePicture(const TabulatedBrdf& brdf, const SpherePictureOptions& options = {},
                            const JobContext& job = {});
/// Studio, window, clear sky and the small light alone side by side with labels, and, with a posterior, the
/// certainty under the small light. `options.environment` is not used. Ready for `writePng`.
Result<Image> sphereSheet(const TabulatedBrdf& brdf, const std::vector<float>* posteriorSd, double priorSd,
                          const SpherePictureOptions& options = {}, const JobContext& job = {});

}  // namespace patina
