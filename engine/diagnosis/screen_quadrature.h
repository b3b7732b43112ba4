#pragma once

#include <Eigen/Core>
#include <array>
#include <memory>
#include <span>
#include <vector>

#include "engine/fourier/diffuse_transform.h"
#include "engine/fourier/site_geometry.h"
#include "engine/surface/svbrdf_parameters.h"

namespace patina {

/// The numerical forward model of closing the loop: what one point of the sample sends to the camera under
/// every pattern, by quadrature over the screen, with its derivatives with respect to the point's own
/// parameters and to the strength of every effect that acts on the light between screen and eye.
///
/// Where the fit approximates the reflected lobe by moments and cumulants, here the integrand is evaluated as
/// it is: the lobe on 12 x 12 nodes of a trapezoidal rule over +-4 standard deviations about the mode of lobe
/// times window times emission (for a smooth peak its error falls faster than any power of the spacing),
/// everything broad on 24 x 16 Gauss-Legendre nodes over the lit rectangle. Source: frequency-domain paper,
/// equations 1 and 7; the integrand as in docs/fourier_fit.md.

/// Strengths of effects that all points share.
struct QuadratureState {
  static constexpr int kAngular = 6, kSpatial = 6;
  /// Natural logarithm of a factor on the emission: sum of angular[k] A_k(u, v), (u, v) the sines of the
  /// direction to the seeing point along the screen's axes, s their length; A = u^2, v^2, v, and bumps
  /// exp(-(s - c)^2 / (2 0.15^2)) about c = 0.35, 0.55, 0.75.
  std::array<float, kAngular> angular{};
  /// Likewise over the screen, (X, Y) = place over half extent: X, Y, X^2, X Y, Y^2, (X^2 + Y^2)^2.
  std::array<float, kSpatial> spatial{};
  /// The shown value is the wanted one to this power (window included).
  float screenGamma = 1;
};

/// A point of the sample and its parameters.
struct QuadratureSite {
  SiteGeometry geometry;
  Eigen::Vector2f pointMm = Eigen::Vector2f::Zero();  ///< on the sample
  float slopeX = 0, slopeY = 0;                       ///< n = (slopeX, slopeY, 1) normalised, world frame
  float sigma = 0.1f, kurtosis = 1;
  float stretch1 = 0,
        stretch2 = 0;  ///< slope covariance sigma^2 exp([[s1, s2], [s2, -s1]]), sample's x and y
  float fresnelPower = 5;
  float horizonSine = 0;  ///< no light comes from below the elevation of this sine; 0: from everywhere
  std::array<float, 3> freeForm{};            ///< log of a factor on the lobe: see kFreeForm
  const Eigen::Vector3d* cameraMm = nullptr;  ///< another place of the camera than the capture's
  const Eigen::Matrix3d* screenFromWorld =
      nullptr;  ///< another screen's orientation than the frame's; geometry must be of it too
};

/// Columns that the model gives for each photograph.
namespace quadrature {
inline constexpr int kLight = QuadratureState::kAngular + QuadratureState::kSpatial + 3 + 1;
enum LightColumn {  ///< relative to the start of a part's light columns
  kAngularAt = 0,
  kSpatialAt = QuadratureState::kAngular,
  kHorizonAt =
      kSpatialAt + QuadratureState::kSpatial,  ///< three: trial horizons; or, where there is one, by its sine
  kWindowAt = kHorizonAt + 3,                  ///< factor log window: half of the screen's gamma
};
enum DiffuseColumn {
  kDiffuse = 0,
  kDiffuseSlopeX,
  kDiffuseSlopeY,
  kDiffuseLight,
  kDiffuseCount = kDiffuseLight + kLight
};
enum SpecularColumn {
  kSpecular = 0,
  kSpecularSlopeX,
  kSpecularSlopeY,
  kSpecularLogSigma,
  kSpecularKurtosis,  ///< d / d (log gamma)^2
  kStretch1,
  kStretch2,
  kSpecularLight,
  kFresnelPower = kSpecularLight + kLight,
  kIridescence,  ///< times cosine of the difference angle
  kFreeForm,     ///< three: factors exp(-q / 2), q exp(-q / 4) / 4, q / (4 + q), q the squared slope over its
                 ///< variance
  kSpecularCount = kFreeForm + 3
};
/// Further terms, unit strength: two Gaussian lobes broader than the lobe (2.5 and 5 times, at least 0.1 and
/// 0.25), one narrower (0.4 times), a cloth-like sheen, a lobe towards the light.
enum TermColumn { kThirdLobe = 0, kThirdLobeBroad, kClearcoat, kSheen, kRetro, kTermCount };
/// Pattern's shape: d / d gamma of the rectified sine at fixed window.
enum ShapeColumn { kShapeDiffuse = 0, kShapeSpecular, kShapeCount };

inline constexpr int kColumns = int{kDiffuseCount} + int{kSpecularCount} + int{kTermCount} + int{kShapeCount};
inline constexpr int kSpecularStart = kDiffuseCount;
inline constexpr int kTermStart = kSpecularStart + int{kSpecularCount};
inline constexpr int kShapeStart = kTermStart + int{kTermCount};
/// How much to compute: the first alone, those of the point's parameters, all.
enum Want { kPrediction, kParameters, kEverything };
/// The log of the emission's factor, in double precision, for other users. `u`, `v`: sines; `x`, `y`: place
/// over half extent.
double logEmission(const QuadratureState& state, double u, double v, double x, double y);
}  // namespace quadrature

/// What all points share: frequencies, screen, tables. Immutable; thread-safe.
class ScreenQuadrature {
 public:
  ScreenQuadrature(const ScreenFrame& frame, Eigen::Vector2d sampleSizeMm,
                   const std::vector<Eigen::Vector2i>& frequencies, const QuadratureState& state);

  /// Rows of a result: four photographs (phase 0 to 3) for each frequency, then the window photograph.
  int rowCount() const { return 4 * static_cast<int>(frequency_.size()) + 1; }

  /// out[column * rowCount() + row], for unit albedos, black level not included; columns that aren't wanted
  /// are left alone. False where the lobe isn't on the lit area: the diffuse part is there all the same.
  /// Cost: with 41 frequencies 15 us for kPrediction, 100 us for kEverything on AVX-512. Thread-safe.
  bool evaluate(const QuadratureSite& site, quadrature::Want want, float* out) const;

  const QuadratureState& state() const { return state_; }
  const ScreenFrame& frame() const { return frame_; }

  struct Harmonics {
    std::array<float, 4> odd{};    ///< of sin t, sin 3 t, sin 5 t, sin 7 t
    std::array<float, 25> even{};  ///< of cos 2 m t
  };
  /// Fourier series of half of sign(sin t) |sin t|^gamma and of half of |sin t|^gamma: a photograph of phase
  /// 0 is their sum.
  static Harmonics harmonicsOf(double gamma);

  // Read by the kernels.
  ScreenFrame frame_;
  QuadratureState state_;
  std::vector<Eigen::Vector2f> frequency_;
  Harmonics shown_, shownSlope_;                   ///< and d / d gamma
  Eigen::Vector3f up_ = Eigen::Vector3f::UnitZ();  ///< sample's normal in the screen's frame
  Eigen::Vector3f sampleX_, sampleY_;
  int gridCount_ = 0;                              ///< padded to whole vectors, weight 0
  std::vector<float> gridX_, gridY_, gridWeight_;  ///< pattern coordinates; weight times window
  std::vector<float> gridLogWindow_;
  /// At frequencies beyond what the grid resolves, the lit area's rim is all that the diffuse part still
  /// shows; the fit's own table has it.
  std::vector<int> beyondGrid_;
  std::shared_ptr<const DiffuseTransform> rim_;
  /// [frequency][4 or 8][gridCount_] row functions; empty where the frequency can't be resolved or seen.
  std::vector<std::vector<float>> gridRows_;
};

}  // namespace patina
