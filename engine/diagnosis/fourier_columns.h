#pragma once

#include <array>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "engine/diagnosis/fourier_sites.h"

namespace patina {

/// One way in which an effect can change the photographs: the derivative of every photograph at every site
/// with respect to one number, at that number's present value.
struct EffectColumn {
  std::string_view effect;  ///< id
  std::string name;         ///< within the effect: "u^2", "share"
  double prior = 1;         ///< standard deviation of the number that makes sense before anything is measured
};

/// The columns of all effects. Dense ones act on all photographs; two more for each photograph are kept apart
/// because they are almost empty: its factor (flicker) and its offset (ambient-drift).
class EffectColumns {
 public:
  explicit EffectColumns(const DiagnosisCapture& capture);

  const std::vector<EffectColumn>& dense() const { return dense_; }
  int denseCount() const { return static_cast<int>(dense_.size()); }
  /// Index of an effect's first column and how many; {-1, 0} where it has none.
  struct Range {
    int first = -1, count = 0;
  };
  Range rangeOf(std::string_view effect) const;
  /// Effects of the surface have own numbers for each material.
  static bool perMaterial(std::string_view effect);
  /// Standard deviation of a photograph's offset that makes sense beforehand, radiance.
  double offsetPrior() const { return offsetPrior_; }
  int indexOf(std::string_view effect, std::string_view name) const;

 private:
  int add(std::string_view effect, std::string name, double prior);
  std::vector<EffectColumn> dense_;
  double offsetPrior_ = 1;
};

/// Strengths in force: what has been added so far. Everything at rest: the standard model.
struct EffectState {
  QuadratureState screen;
  /// Of the sensor: photograph = light + gamma light log(light / S) + compression light^2 / S (and so on), S
  /// full scale.
  double responseGamma = 0, responseCompression = 0;
  double blackOffset = 0;                         ///< radiance, on lit photographs only
  Eigen::Matrix3d mix = Eigen::Matrix3d::Zero();  ///< channel-crosstalk: added share of other channels
  std::vector<double> photoGain;                  ///< [row] relative change; empty: none
  std::vector<double> photoOffset;                ///< [row] radiance; empty: none
  std::array<double, 3> drift{};                  ///< amplitudes of driftCurve
  double stray = 0;                               ///< share of the picture's mean added everywhere
  std::array<double, 2> saturation{};  ///< share of what exceeds 0.6 and 0.8 of full scale that is lost
  Eigen::Matrix<double, 6, 1> pose =
      Eigen::Matrix<double, 6,
                    1>::Zero();  ///< screen: rotation (rad, about its origin), shift (mm), world axes
  Eigen::Matrix<double, 6, 1> height =
      Eigen::Matrix<double, 6, 1>::Zero();  ///< mm: 1, X, Y, X^2, X Y, Y^2, over half the sample
  double glare = 0, defocus = 0;            ///< share; pixels^2
  double footprint = 0;  ///< pixels^2: the blur that a pixel's own extent is, up to 1 / 12; no effect
  std::array<double, 2> subsurface{};  ///< shares of the two distances
  struct Material {
    double fresnelPower = 5, iridescence[2] = {0, 0};
    double stretch[2] = {0, 0};
    double third[2] = {0, 0}, clearcoat = 0, sheen = 0, retro = 0;
    std::array<double, 3> freeForm{};
    double inPlane = 0;  ///< log ratio of variances along and across the plane of view, minus one's sign
  };
  double level = 0;  ///< log factor on the emission as a whole: of a paper with known albedo
  std::vector<Material> material;
  std::vector<std::string> added;  ///< ids, in the order in which they were added
  bool has(std::string_view id) const;
};

/// Predicted light of all sites' neighbourhoods, for what the lens and the sample spread: [site][row][R G B],
/// diffuse part and whole, black level not included.
struct PredictedPictures {
  std::vector<float> whole, diffuse;  ///< empty: not available (too many sites)
  std::size_t rows = 0;
  bool available() const { return !whole.empty(); }
};

/// Which groups of columns to evaluate: what isn't wanted is left zero.
struct WantedColumns {
  bool light = true;        ///< screen and surface: needs the quadrature's own columns
  bool geometry = true;     ///< screen-pose, sample-height, sample-tilt: seven more predictions
  bool spread = true;       ///< glare, defocus, subsurface
  bool photographs = true;  ///< a factor and an offset for each
};

/// A site's prediction and columns. Scratch, reused.
struct SiteColumns {
  std::vector<float> quadrature;  ///< ScreenQuadrature's columns
  std::vector<float> light;       ///< [row][R G B] without black level, before time, lens and sensor
  std::vector<float> predicted;   ///< [row][R G B] as photographed
  Eigen::MatrixXd own;  ///< rows * 3 (channel-major: c * rows + row) x kOwnCount: the site's own parameters
  Eigen::MatrixXd effect;  ///< likewise x denseCount
  Eigen::MatrixXd gain,
      offset;  ///< [row x 3] of the sparse columns: d / d photoGain[row], d / d photoOffset[row]
  bool onScreen = true;
};

/// The site's own parameters, in the order of `own`'s columns.
enum OwnParameter {
  kOwnLogSigma,
  kOwnKurtosis,
  kOwnSlopeX,
  kOwnSlopeY,
  kOwnDiffuse,
  kOwnSpecular = kOwnDiffuse + 3,
  kOwnBlack = kOwnSpecular + 3,
  kOwnHorizon = kOwnBlack + 3,  ///< sine; free where the site has a horizon of its own
  kOwnStretch,                  ///< two; free where the site may differ from its material
  kOwnCount = kOwnStretch + 2
};

/// Everything that predicts photographs at sites of one capture under one state.
class FourierDiagnosisModel {
 public:
  FourierDiagnosisModel(const DiagnosisCapture& capture, const EffectColumns& columns,
                        const EffectState& state);

  /// Light of one site: D and S times albedos plus terms; no time, lens, sensor.
  void light(const DiagnosisSite& site, quadrature::Want want, SiteColumns& out) const;
  /// Prediction and, with kParameters, `own`; with kEverything all columns.
  void evaluate(const DiagnosisSite& site, quadrature::Want want, SiteColumns& out,
                const WantedColumns& wanted = {}) const;
  /// Predicts every fitted site's light; where there are more than `most` sites nothing is done. Parallel.
  PredictedPictures pictures(const std::vector<DiagnosisSite>& sampled, std::size_t most,
                             const JobContext& job) const;
  void setPictures(std::shared_ptr<const PredictedPictures> pictures) { pictures_ = std::move(pictures); }
  const ScreenQuadrature& quadrature() const { return quadrature_; }
  const EffectState& state() const { return state_; }
  /// Mean of a photograph's predicted light over the sample.
  const Eigen::Array3d& meanOfRow(std::size_t row) const { return meanOfRow_[row]; }

  /// Site moved as the state's pose and height say.
  QuadratureSite placed(const DiagnosisSite& site) const;

 private:
  QuadratureSite moved(const QuadratureSite& site, int axis, double shiftMm, double heightMm) const;
  std::array<double, 2> planeOfView(const QuadratureSite& site) const;
  void geometryColumns(const DiagnosisSite& site, SiteColumns& out) const;
  /// `all`: every column; else those that the state needs.
  void spreadColumns(const DiagnosisSite& site, SiteColumns& out, bool all) const;

  const DiagnosisCapture& capture_;
  const EffectColumns& columns_;
  EffectState state_;
  ScreenQuadrature quadrature_;
  Eigen::Vector3d cameraMm_;
  std::array<Eigen::Matrix3d, 7>
      turned_;  ///< screenFromWorld of the state's pose, then with a step about each axis
  std::shared_ptr<const PredictedPictures> pictures_;
  std::vector<Eigen::Array3d> meanOfRow_;  ///< for stray light: the picture's mean, from the photographs
};

/// Curves of screen-drift over time 0 .. 1: 1 - exp(-t / tau) for slow and quick warming up, taken relative
/// to the fit's mean.
inline constexpr int kDriftCurves = 3;
double driftCurve(int curve, double time);

}  // namespace patina
