#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "engine/base/job.h"
#include "engine/diagnosis/screen_quadrature.h"
#include "engine/fourier/fit_access.h"

namespace patina {

struct PredictedPictures;

/// Which photograph stands behind a row of the numerical model.
struct DiagnosisRow {
  int photo = -1;      ///< index into capture.photos; -1: none (a held-out frequency has no window)
  int frequency = -1;  ///< among the rows' frequencies; -1: the window
  int phase = 0;
  bool holdout = false;
  double time = 0;  ///< place in the order of the photographs, 0 .. 1
};

/// One measured point that effects are tested on: its photographs, one by one, against which the numerical
/// model is held.
struct DiagnosisSite {
  std::size_t site = 0;  ///< of the fit
  int cluster = 0;       ///< material that it looks like
  QuadratureSite model;  ///< parameters so far
  Eigen::Array3f diffuse = Eigen::Array3f::Zero(), specular = Eigen::Array3f::Zero(),
                 black = Eigen::Array3f::Zero();
  std::vector<float> measured;  ///< [row][R G B] radiance
  std::vector<float> weight;    ///< [row][R G B] one over the variance; 0: not to be used
  Eigen::Array3f blackMeasured = Eigen::Array3f::Zero(), blackWeight = Eigen::Array3f::Zero();
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();
  float robust =
      1;  ///< factor on all weights: below 1 where nothing fits, so that few sites don't decide for all
  float horizonSine = 0;           ///< own horizon (self-shadowing), sine of its elevation; 0: none
  std::array<float, 2> stretch{};  ///< own, beyond the material's (anisotropy)
  bool ownHorizon = false, ownStretch = false;  ///< whether they are free
  bool usable = true;                           ///< false: the lobe left the screen, or no finite solution
};

/// One capture with its fit, laid out for diagnosis. Immutable but for the sites' parameters.
struct DiagnosisCapture {
  std::shared_ptr<const FourierFit> fit;
  const FourierFitState* state = nullptr;
  std::vector<Eigen::Vector2i> frequencies;  ///< fitted, then held out
  std::vector<DiagnosisRow> rows;            ///< ScreenQuadrature's: four a frequency, then the window
  std::vector<DiagnosisSite> sites;
  int clusterCount = 1;
  std::vector<std::uint8_t> clusterOfSite;  ///< of every site of the fit
  double fullScale = 1;  ///< brightest prediction over the sites, radiance with black level
  bool knownLambertian = false;
  std::shared_ptr<const PredictedPictures> pictures;  ///< for what spreads light; null until made
  std::vector<float>
      inflation;  ///< [component row][R G B] scatter beyond the noise's variance, a factor; empty: 1

  std::size_t rowCount() const { return rows.size(); }
};

/// Chooses about `count` sites, spread evenly, that were fitted well enough to be tested: lobe on the screen,
/// no saturation, not within a pixel of a border between materials (a photograph's pixel mixes them there).
/// Materials are told apart by albedo and lobe width (k-means, as many as halve the spread again).
/// Errors: Invalid where fewer than 60 sites are left.
Result<DiagnosisCapture> diagnosisCapture(std::shared_ptr<const FourierFit> fit, int count,
                                          const JobContext& job);

/// The model's parameters of any site of the fit.
QuadratureSite quadratureSite(const FourierFitState& state, std::size_t site);

/// Lays a site's photographs out; usable for any site. Held-out rows get weight 0 where the fit has none.
void loadSite(const DiagnosisCapture& capture, DiagnosisSite& site);

}  // namespace patina
