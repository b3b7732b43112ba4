#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "engine/base/result.h"
#include "engine/image/image.h"

namespace patina {

/// Light from all directions, from far away: radiance R G B over a latitude-longitude table, with what
/// importance sampling needs. Immutable, may be shared between threads.
///
/// Frame: x right, y up, z towards the eye that looks at the object. The table's first row is up, its middle
/// column is what lies behind the object (-z), columns run to the right.
/// Normalised: the irradiance on a plane that faces up is pi (luminance, Rec. 709 weights), so that a white
/// matt surface facing up has radiance 1. Where next to nothing comes from above (under 1 % of the mean), the
/// mean radiance is 1.
class Environment {
 public:
  /// `latLong` has three channels, values finite and not negative, some above zero, of any size from 2 x 2;
  /// larger ones than `kWidth` wide are averaged down to it. Throws std::invalid_argument otherwise.
  Environment(std::string id, std::string name, const Image& latLong);

  static constexpr int kWidth = 1024, kHeight = 512;

  const std::string& id() const { return id_; }
  const std::string& name() const { return name_; }
  /// By what the values were multiplied to normalise them.
  double scale() const { return scale_; }
  const Image& picture() const { return picture_; }

  struct Seen {
    Eigen::Array3f radiance;
    float density = 0;  ///< 1/sr, with which `samples` chose this direction; positive everywhere
  };
  /// What is seen in a unit direction, bilinear.
  Seen look(const Eigen::Vector3f& direction) const;
  Eigen::Array3f radiance(const Eigen::Vector3f& direction) const { return look(direction).radiance; }

  struct Sample {
    Eigen::Vector3f direction;
    float density = 0;  ///< 1/sr
    Eigen::Array3f radiance;
  };
  /// Directions chosen in proportion to the light that comes from them, in an order of which every stretch is
  /// spread evenly (additive recurrence). kSamples of them; start anywhere and go round.
  std::span<const Sample> samples() const { return samples_; }
  static constexpr int kSamples = 1 << 14;

  /// Irradiance on a plane of the given unit normal, over pi, R G B: from the first nine spherical harmonics
  /// (Ramamoorthi and Hanrahan 2001: within some per cent; worse for one small strong light). For backdrops
  /// and labels, not for measurement.
  Eigen::Array3d irradianceOverPi(const Eigen::Vector3d& normal) const;

 private:
  Eigen::Vector2f place(const Eigen::Vector3f& direction) const;
  float texelDensity(int x, int y, float sinFromUp) const;
  void prepareSampling();
  void prepareIrradiance();

  std::string id_, name_;
  Image picture_;
  double scale_ = 1;
  std::vector<float> chance_;  ///< of each texel, sums to 1
  std::vector<Sample> samples_;
  Eigen::Array<double, 9, 3> harmonics_ = Eigen::Array<double, 9, 3>::Zero();
};

using EnvironmentPtr = std::shared_ptr<const Environment>;

/// Id and name of an environment that ships.
struct EnvironmentEntry {
  std::string id;    ///< stable: "studio", "window", "overcast", "clear", "strips", "white"
  std::string name;  ///< for people
  std::string note;  ///< what it is good for, a sentence
};
/// Those that ship, all made from formulas: a grey studio with two soft boxes; a room with a window; the
/// overcast sky of CIE (1:3 between horizon and zenith) over grey ground; the clear sky of CIE with a sun (2
/// degrees across, four times the sky's irradiance); light strips in the dark; even white.
const std::vector<EnvironmentEntry>& builtInEnvironments();

/// One of them, made at first use (about 50 ms) and kept. Null for another id. Threading: any.
EnvironmentPtr builtInEnvironment(const std::string& id);

/// A person's own latitude-longitude picture: OpenEXR with R G B, twice as wide as high (within 1 %).
/// Negative values (of resampling filters) count as 0. Errors: those of `readExr`; Invalid (another shape, a
/// value that is not a number, no light at all).
Result<EnvironmentPtr> loadEnvironment(const std::filesystem::path& file);

}  // namespace patina
