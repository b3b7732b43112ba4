#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

namespace patina {

/// What a simulated sheet is made of at one point. The truth that a fit is measured against; a fit never sees
/// it.
struct SheetPoint {
  Eigen::Array3d diffuse = Eigen::Array3d::Zero();    ///< R G B Lambertian albedo
  Eigen::Array3d specular = Eigen::Array3d::Zero();   ///< R G B lobe albedo at normal incidence
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  ///< unit, world frame
  double sigma = 0.1;                                 ///< standard deviation of the half-vector's slope
  double kurtosis = 1.0;                              ///< the paper's gamma, >= 1
  int material = 0;                                   ///< index into the sheet's materials
};

/// One material of a sheet, before the sheet's own variation.
struct SheetMaterial {
  Eigen::Array3d diffuse = Eigen::Array3d::Constant(0.3);
  Eigen::Array3d specular = Eigen::Array3d::Constant(0.05);
  double sigma = 0.1;
  double kurtosis = 1.2;
};

/// How the materials of a sheet are laid out.
enum class SheetPattern {
  Uniform,  ///< the first material everywhere
  Stripes,  ///< wavy bands, materials in turn
  Checker,  ///< squares, materials in turn
  Spots,    ///< round islands of the second (and third, in turn) in the first
};

/// A flat sheet with materials, a layout and smooth relief. Everything follows from the fields: the same
/// sheet gives the same picture everywhere.
struct SimulatedSheet {
  std::string name = "sheet";
  double widthMm = 120, heightMm = 120;
  std::vector<SheetMaterial> materials{SheetMaterial{}};
  SheetPattern pattern = SheetPattern::Uniform;
  double periodMm = 40;           ///< of the layout
  double slopeRms = 0.05;         ///< of the relief; 0.05 is about 3 degrees
  double reliefPeriodMm = 45;     ///< shortest wave of the relief; shorter: finer bumps
  double albedoVariation = 0.15;  ///< relative amplitude of a smooth change of the diffuse albedo
  double sigmaVariation = 0.1;    ///< relative amplitude of a smooth change of sigma
  std::uint64_t seed = 1;

  /// Every problem with the fields, not only the first; empty when usable.
  std::vector<std::string> validate() const;
};

/// Evaluates a sheet. Immutable after construction: may be used from several threads.
class SheetSampler {
 public:
  explicit SheetSampler(const SimulatedSheet& sheet);
  /// The material at a point of the sample plane. xMm to the right, yMm up, origin in the sheet's centre.
  SheetPoint at(double xMm, double yMm) const;
  /// Index into the sheet's materials.
  int materialAt(double xMm, double yMm) const;
  const SimulatedSheet& sheet() const { return sheet_; }

 private:
  struct Wave {
    Eigen::Vector2d perMm;  ///< wave vector, rad/mm
    double phase, amplitude;
  };
  static double sum(const std::vector<Wave>& waves, double xMm, double yMm);

  SimulatedSheet sheet_;
  std::vector<Wave> relief_;  ///< of the height, mm
  std::vector<Wave> tint_, wear_, edge_;
};

/// The names of the built-in scenes, in the order in which to offer them.
std::vector<std::string> simulatedSceneNames();
/// One line for a person: what the scene shows. Empty for an unknown name.
std::string simulatedSceneSummary(const std::string& name);
/// A built-in scene's sheet; `laminate` (two glossy materials), `cardstock` (satin print on card),
/// `mirror-mix` (foil, gloss and matte paper). An unknown name gives a sheet without materials: `validate`
/// says so.
SimulatedSheet simulatedScene(const std::string& name);

}  // namespace patina
