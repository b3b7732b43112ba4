#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/job.h"
#include "engine/base/result.h"
#include "engine/geometry/camera.h"
#include "engine/image/image.h"

namespace patina {

/// What a tile's certificate says, as the camera's three channels see it.
struct CertifiedReflectance {
  Eigen::Vector3d rgb = Eigen::Vector3d::Constant(0.99);  ///< 0 to 1.05
  Eigen::Vector3d spread =
      Eigen::Vector3d::Zero();  ///< standard deviation of the table over each channel's band:
                                ///< how much not knowing the camera's bands matters
  std::string source;           ///< "entered", or the file
};

/// A table of wavelength in nm and reflectance (0 to 1.05, or percent where the header or the values say so),
/// separated by comma, semicolon, tab or blanks, # and text lines ignored. Weighted with three bands
/// (Gaussians of 25 nm about 600, 540 and 455 nm: typical colour filters; the certificate of a white tile is
/// flat to 0.3 % over them, `spread` tells). Errors: NotFound, Malformed (line named), Invalid (a band that
/// the table doesn't reach).
Result<CertifiedReflectance> readReflectanceTable(const std::filesystem::path& file);
Result<CertifiedReflectance> parseReflectanceTable(std::string_view text, const std::string& where);

/// Part of a picture, pixels; inclusive of its first, exclusive of its end. Empty: the whole picture.
struct PixelRegion {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  bool whole() const { return x1 <= x0 || y1 <= y0; }
};

struct WhiteTileOptions {
  PixelRegion region;  ///< the tile in the picture; whole: all of it is tile
  double exposureS = 1;
  double saturation = 0;  ///< pixel value at which the sensor clips; 0: a plateau at the largest value
  Eigen::Vector3d blackLevel = Eigen::Vector3d::Zero();  ///< subtracted
  int smoothOrder = 4;  ///< order of the polynomial that the light over the tile follows, 0 to 6; higher
                        ///< follows the lamp closer and averages less noise
};

/// What may be wrong with a photograph of the tile.
struct TileCheck {
  std::string id;  ///< "clipped", "dark", "uneven", "shadow", "noise"
  bool passed = true;
  double value =
      0;  ///< clipped share; brightness over full scale; lowest over highest light; shaded share; sd
  std::string sentence;  ///< what it is, and what to do where it didn't pass
};

struct WhiteTileCalibration {
  Image irradiance;  ///< R G B: E cos(theta_i), pixel units a second: pixel = f_r * irradiance * exposure.
                     ///< Smooth over the region, 0 elsewhere
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();  ///< over the region
  Eigen::Vector3d relativeSd =
      Eigen::Vector3d::Zero();  ///< of the smooth light, from noise and the fit's residual
  double residual = 0;          ///< RMS of photograph over smooth light minus 1, pixels without shadows
  PixelRegion region;
  CertifiedReflectance reflectance;
  std::vector<TileCheck> checks;
  bool passed() const;
};

/// Irradiance over the tile from its photograph: linear, black level taken off. f_r = reflectance / pi. The
/// smooth light is a polynomial in the pixel position, fitted robustly, so that dust and a shadow's edge
/// don't pull it. Errors: Invalid (values, a region outside of the picture, fewer than 100 pixels, a tile
/// that is black or clipped nearly everywhere). Cost: 60 ns a pixel.
Result<WhiteTileCalibration> calibrateWhiteTile(const Image& photo, const CertifiedReflectance& reflectance,
                                                const WhiteTileOptions& options = {},
                                                const JobContext& job = {});

}  // namespace patina
