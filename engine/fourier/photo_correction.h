#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "engine/capture/capture.h"
#include "engine/fourier/corrections.h"

namespace patina {

/// An increasing function of one number and its inverse, tabulated in steps of 1/256 of the number (its
/// float's leading bits), linear between: relative error 4e-6 for curves as smooth as a power of 0.5 to 2.
/// Linear through zero within +-2^-20; beyond 2^12 the function itself.
class ToneTable {
 public:
  ToneTable() = default;
  explicit ToneTable(std::function<float(float)> function);

  bool empty() const { return !function_; }
  float operator()(float x) const;
  /// x with (*this)(x) = y, and how fast it grows with y. Beyond the function's values: the nearest x.
  struct Inverse {
    float x, slope;
  };
  Inverse inverse(float y) const;

 private:
  std::function<float(float)> function_;
  std::vector<float> argument_, value_, inverse_;  ///< ascending; the last two at `argument_`
};

/// The part of FourierCorrections that acts on photographs: undoing it, pixel by pixel, and doing it to
/// radiances that a model predicts. Immutable; thread-safe as far as `linearFromPhoto` is.
class PhotoCorrection {
 public:
  /// Copies what it needs.
  PhotoCorrection(const FourierCorrections& corrections, const FourierCapture& capture);

  /// Whether there is anything to undo; `saturation` apart.
  bool active() const { return active_; }
  bool hasGain() const { return !gain_.empty(); }
  /// Radiance at which photographs are clipped; 0: as the bundle says.
  double saturation() const { return saturation_; }

  /// Undoes response, crosstalk and offset of R G B, and divides by the gain. What is left of the gain is
  /// `blackShare(photo)` times the corrected black level, to be added: black has none.
  void undo(int photo, float* rgb) const;
  /// 1 - 1 / gain.
  float blackShare(int photo) const { return hasGain() ? 1 - 1 / gain_[static_cast<std::size_t>(photo)] : 0; }

  /// What the photograph says where the corrected radiance is `rgb`, and the derivative of each channel with
  /// respect to each radiance.
  struct Recorded {
    Eigen::Array3f value;
    Eigen::Matrix3f derivative;
  };
  Recorded record(int photo, const Eigen::Array3f& rgb, const Eigen::Array3f& black) const;

 private:
  ToneTable linear_;
  Eigen::Matrix3f unmix_, mix_;
  std::vector<Eigen::Array3f> offset_;
  std::vector<float> gain_;
  double saturation_ = 0;
  bool mixes_ = false, active_ = false;
};

}  // namespace patina
