#pragma once

#include <Eigen/Core>
#include <atomic>
#include <stop_token>
#include <vector>

#include "devices/simulated/light_kernel.h"
#include "devices/simulated/simulated_effects.h"
#include "devices/simulated/simulated_sheet.h"
#include "engine/base/result.h"
#include "engine/screen/screen.h"

namespace patina {

/// How finely the simulator integrates. The defaults are converged: doubling every one of them changes the
/// noise-free signal by less than 1e-3 of the brightest photograph (tests/devices/convergence).
struct IntegrationQuality {
  int cellsAcross = 1600;    ///< cells over the screen's width. More: sharper patterns, slower to prepare
  double nodesPerSigma = 3;  ///< samples of a lobe per standard deviation on the screen. More: finer, slower
  double nodesPerDistance = 16;  ///< samples of the diffuse term per distance between point and screen
  double lobeReach = 5.5;        ///< a narrow lobe is cut off after so many standard deviations
};

/// What one point sends to the camera under every pattern, per unit of albedo.
struct PointResponse {
  Eigen::ArrayXf diffuse;  ///< one per pattern, last the window alone
  Eigen::ArrayXf specular;
  Eigen::ArrayXf white;  ///< what no albedo scales: coat, sheen, retroreflection; empty: none
};

/// Integrates a true BRDF over a screen that shows clipped-sine patterns under a Gaussian window.
///
/// All in the primal domain. The screen is cut into cells, each showing its pattern's mean. What multiplies
/// the pattern (the BRDF, both cosines, inverse square distance, emission) is smooth at a known scale; it is
/// evaluated at the nodes of a grid that is fine where the lobe is narrow, and the cubic spline through those
/// values is summed against all cells. As the cells and the splines do not depend on the point, those sums
/// are prepared once, a grid level at a time (levels halve the spacing), and a point then costs the
/// evaluation at its nodes and one matrix product. The clipped sine is (|sin| + sin) / 2: |sin| enters with
/// its exact mean over each cell, sin at the cell's centre (a smooth function on a regular grid: nothing is
/// gained by a mean, which would only damp it).
class ScreenIntegrator {
 public:
  /// `frequencies` in pattern units; four photographs each, in phase order. Of the effects, those of
  /// emission, the panel's response, the surface and its horizon act here; `screen` is where the screen truly
  /// is.
  ScreenIntegrator(const Screen& screen, std::vector<Eigen::Vector2i> frequencies,
                   const IntegrationQuality& quality, const SimulatedEffects& effects = {});

  /// Columns of a response: 4 for each frequency, then the window.
  int patternCount() const { return static_cast<int>(4 * frequencies_.size()) + 1; }

  /// The finest grid level that a point needs. -1 where its lobe is narrower than the finest grid resolves.
  int finestLevel(const Eigen::Vector3d& pointMm, const Eigen::Vector3d& toView,
                  const SheetPoint& material) const;

  /// Prepares levels 0 to `finest`. Call before `respond`; not while others do. Cost: about half a second of
  /// one core, and 50 MB at level 4. False when stopped.
  bool prepare(int finest, const std::stop_token& stop);

  /// Radiance towards the viewer under every pattern, in units of the screen's full white, for diffuse and
  /// specular albedo 1. toView: unit, world. Thread-safe once prepared.
  PointResponse respond(const Eigen::Vector3d& pointMm, const Eigen::Vector3d& toView,
                        const SheetPoint& material) const;

  /// One point of a group.
  struct Query {
    Eigen::Vector3d pointMm, toView;
    SheetPoint material;
  };
  /// Responses of several points, a column each. What `respond` gives but for rounding; neighbours share
  /// their nodes, so that the sums are read once for all of them. Thread-safe once prepared.
  struct GroupResponse {
    Eigen::MatrixXf diffuse, specular;  ///< patternCount() (and a few rows of padding) x points
    Eigen::MatrixXf white;              ///< the same, or empty
  };
  void respond(const std::vector<Query>& group, GroupResponse& out) const;

  /// What multiplies the light of the screen at the nodes of one level, for one term of a point.
  struct NodeKernel {
    int level = 0;
    int x0 = 0, y0 = 0, width = 0, height = 0;  ///< nodes, from (x0, y0) on
    bool resolved = true;                       ///< false: narrower than the finest grid resolves
    std::vector<float> values;                  ///< per pattern unit squared; row-major
  };
  /// A term's kernel; `values` empty where it doesn't reach the screen. Needs no `prepare`. Thread-safe.
  NodeKernel kernelOf(const Query& query, const SurfacePart& part) const;
  /// The nodes on which any BRDF that varies over `smoothRad` of the half-vector's angle is sampled finely
  /// enough, over the whole screen; no values.
  NodeKernel nodesFor(const Query& query, double smoothRad) const;

 private:
  /// A rectangle of nodes, inclusive, and the level that it lives on.
  struct Patch {
    int level = 0;
    int x0 = 0, x1 = -1, y0 = 0, y1 = -1;
    bool resolved = true;
  };
  /// Sums of every pattern against the splines of one level. Row-major nodes, patterns contiguous.
  struct Level {
    double spacing = 0;
    int reachX = 0, reachY = 0;  ///< nodes run from -reach to +reach
    std::vector<float> sums;
    std::size_t nodesX() const { return static_cast<std::size_t>(2 * reachX + 1); }
    std::size_t nodesY() const { return static_cast<std::size_t>(2 * reachY + 1); }
  };
  Patch patchOf(const PointFrame& frame, const SurfacePart& part) const;
  Patch lobePatch(const PointFrame& frame, double widest, double narrowest) const;
  /// Nodes over the distance between point and screen for a term that is smooth over so many radians.
  double nodesPerDistance(double smoothRad) const;
  Patch wholeScreen(double scale, double nodesPerScale) const;
  /// Largest rate of change of the half-vector's slope with the screen point.
  double slopePerUnit(const PointFrame& frame, const Eigen::Vector2d& x) const;
  /// Adds one term of all points, a term each, to their columns.
  void accumulate(const std::vector<PointFrame>& frames, const std::vector<SurfacePart>& parts,
                  Eigen::MatrixXf& response) const;
  void fillFinest(Level& level, std::size_t firstFrequency, std::size_t endFrequency,
                  const std::stop_token& stop) const;

  Screen screen_;
  std::vector<Eigen::Vector2i> frequencies_;
  IntegrationQuality quality_;
  SimulatedEffects effects_;
  std::size_t stride_;     ///< floats from node to node, patternCount rounded up
  int finestAllowed_ = 0;  ///< by memory
  std::vector<Level> levels_;
};

}  // namespace patina
