#pragma once

#include <chrono>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "engine/fourier/corrections.h"
#include "engine/fourier/diffuse_transform.h"
#include "engine/fourier/finished_tiles.h"
#include "engine/fourier/fit.h"
#include "engine/fourier/measurements.h"
#include "engine/fourier/point_model.h"
#include "engine/fourier/solver.h"

namespace patina {

/// The fit's inside: everything that FourierFit answers from. Filled by `fitFourier` and `loadFourierFit`.
struct FourierFitState {
  FourierCapture capture;
  FourierFitOptions options;
  ScreenFrame frame;
  SheetShape shape;  ///< of the sheet; the plane, unless corrections know better
  FourierMeasurements measurements;
  std::unique_ptr<DiffuseTransform> diffuse;  ///< zero frequency, then plan.fitted
  /// With FourierCorrections::logEmission: what each site's lobe sees of it; else empty.
  std::vector<EmissionExpansion> emission;
  /// FourierCorrections::lobeTerms: one for each site, or one for all; null: nothing.
  std::shared_ptr<const std::vector<LobeTerms>> lobeTerms;
  std::vector<SvbrdfParameters> sites;  ///< a solution for each site
  std::vector<TexelStatus> siteStatus;
  std::vector<float> siteResidual;
  std::vector<SiteUncertainty> siteSd;
  FinishedTiles finished;  ///< solutions of an earlier, unfinished run of the same fit
  SvbrdfMaps maps;
  FourierFitStats stats;

  SiteGeometry geometry(std::size_t site) const {
    return geometry(site, measurements.sites.pointMm[site].cast<double>());
  }
  /// At another point of the plane near a site's: emission as the site's lobe sees it.
  SiteGeometry geometry(std::size_t site, const Eigen::Vector2d& pointMm) const {
    SiteGeometry out = siteGeometry(frame, shape.pointMm(pointMm), capture.camera.positionMm(),
                                    emission.empty() ? nullptr : &emission[site]);
    if (lobeTerms) out.lobe = (*lobeTerms)[lobeTerms->size() == 1 ? 0 : site];
    return out;
  }
  /// What the corrections add to lobes.
  LobeVariant lobeVariant() const;
  /// At any point of the plane: lobe terms where all sites have the same, emission as a lobe of sigma 0.1
  /// about a flat sheet's mirror point sees it.
  SiteGeometry geometry(const Eigen::Vector2d& pointMm) const;
  /// One over the variance of one component of Z, and of Z(0), as the options weigh them.
  struct Weights {
    double ac[3], dc[3];
  };
  Weights weights(std::size_t site) const;
  DiffuseMethod diffuseMethod() const {
    // The paper's three Gaussians have no room for another emission.
    return options.lobe == LobeMapping::PaperAffine && !frame.logEmission ? DiffuseMethod::PaperMixture
                                                                          : DiffuseMethod::Quadrature;
  }
  /// Fills `diffuse` once capture, options, frame and measurements are there.
  void makeDiffuse();
  /// Fills `emission` from solutions, one a site (none: flat, sigma 0.1), where the frame has a logEmission.
  void expandEmissions(std::span<const SvbrdfParameters> solutions);
  /// The site nearest to a map texel; -1 where no photograph sees it.
  std::int64_t siteOfTexel(int texelX, int texelY) const;
};

/// Maps over the sample rectangle from the sites' solutions. Bilinear between pixels of one material; not
/// across an edge.
/// Runs to its end even if `job` is cancelled (a cancelled fit has maps too); parallel over rows.
SvbrdfMaps mapsFromSites(const FourierFitState& state, int size, const JobContext& job);

/// Relative RMS of prediction over photographs, and the same for a perfect model under the sensor's noise.
struct PhotoError {
  double rms = 0, noiseFloor = 0;
};
/// Predicts every photograph of the groups (and the window, for the fitted split) at every solved site and
/// compares. Reads the photographs again; keeps the held-out measurements in `measurements.heldOut`.
/// Polls for a stop every few hundred sites.
Result<PhotoError> photoError(FourierFitState& state, bool holdout, const JobContext& job,
                              const MeasurementStorage& storage = {});

/// Wraps a finished state; immutable from then on.
std::shared_ptr<const FourierFit> makeFourierFit(std::unique_ptr<FourierFitState> state);

/// Adds the time until its end to a stage of the statistics.
class StageClock {
 public:
  StageClock(FourierFitStats& stats, std::string stage)
      : stats_(stats), stage_(std::move(stage)), start_(std::chrono::steady_clock::now()) {}
  StageClock(const StageClock&) = delete;
  StageClock& operator=(const StageClock&) = delete;
  ~StageClock() {
    stats_.seconds[stage_] +=
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  FourierFitStats& stats_;
  std::string stage_;
  std::chrono::steady_clock::time_point start_;
};

/// A status in words ("mirror point off the screen"), as in fit.json.
const char* statusName(TexelStatus status);

}  // namespace patina
