#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <vector>

#include "devices/simulated/screen_integrator.h"
#include "devices/simulated/simulated_effects.h"
#include "devices/simulated/simulated_sheet.h"
#include "devices/simulated/spline_picture.h"
#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/brdf/brdf.h"
#include "engine/geometry/camera.h"
#include "engine/image/image.h"
#include "engine/screen/screen.h"

namespace patina {

/// Something flat with a print on it that lies or is held in front of the camera: a checkerboard, markers.
struct LivePrint {
  Image albedo;  ///< one channel, row 0 at +y of the print; not a number: a hole
  double widthMm = 0, heightMm = 0;
  Eigen::Isometry3d worldFromPrint =
      Eigen::Isometry3d::Identity();  ///< its centre, x right, y up, z to the front
};

/// What lies on the sample's place.
enum class OnTable { Sheet, WhitePaper, WhiteTile, Mirror, Nothing };

/// A distant lamp.
struct LiveLamp {
  Eigen::Vector3d toLight = Eigen::Vector3d::UnitZ();
  Eigen::Array3d irradiance = Eigen::Array3d::Zero();  ///< on a plane that faces it
};

/// Everything that doesn't change from frame to frame.
struct LiveSceneSetup {
  Camera camera;
  Screen screen;  ///< where it truly is
  SimulatedSheet sheet;
  std::vector<BrdfPtr> brdfs;  ///< instead of the sheet's microfacets, one for each material in turn
  SimulatedEffects effects;
  OnTable onTable = OnTable::Sheet;
  Eigen::Vector2d sampleShiftMm = Eigen::Vector2d::Zero();  ///< of what lies on the table
  double sampleTurnDeg = 0;
  std::vector<LivePrint> prints;
  IntegrationQuality quality;
  bool screenLit =
      true;  ///< false: the screen has shown nothing yet, and its light's paths are not worked out
};

/// Albedos of the simulated white paper and tile, R G B.
Eigen::Array3d whitePaperAlbedo();
Eigen::Array3d whiteTileReflectance();

/// The light that comes from the screen's pixels to the camera's: worked out once, linear in the picture.
/// Immutable; threads may share it.
class LiveScene {
 public:
  /// Integrates. Errors: Invalid (a lobe too narrow for the grid, or more light paths than fit in memory),
  /// Cancelled. Cost: 64 x 64 pixels of the laminate, about a second of one core.
  static Result<LiveScene> create(const LiveSceneSetup& setup, const JobContext& job);

  /// R G B radiance at every pixel of the camera under a picture. `light`: one channel, linear, the screen's
  /// pixels; it gives pixels that look at the screen itself, or at it in the mirror.
  Image radiance(const Image& light) const;
  /// Under a lamp, and under the room's even light of radiance one.
  Image underLamp(const LiveLamp& lamp) const;
  const Image& albedo() const { return albedo_; }

 private:
  struct Term {  ///< of a pixel
    int level = 0, x0 = 0, y0 = 0, width = 0, height = 0;
    std::size_t first = 0;  ///< in values_
    Eigen::Array3f colour = Eigen::Array3f::Zero();
  };
  struct Glass {    ///< a pixel that sees the screen: one of its samples
    int index = 0;  ///< of the screen's pixel
    float weight = 0;
  };
  struct Pixel {
    std::vector<Term> terms;
    std::vector<Glass> glass;
    // For lamps.
    Eigen::Vector3d toView = Eigen::Vector3d::UnitZ(), normal = Eigen::Vector3d::UnitZ();
    SheetPoint material;
    const Brdf* brdf = nullptr;
    Eigen::Array3d lambert = Eigen::Array3d::Zero();  ///< where it is no sheet
    bool sheet = false, seen = false;
  };
  LiveSceneSetup setup_;
  int width_ = 0, height_ = 0, finest_ = 0;
  std::vector<Pixel> pixels_;
  std::vector<std::vector<float>> values_;  ///< by row of the camera
  Image albedo_;
};

}  // namespace patina
