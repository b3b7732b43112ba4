#pragma once

#include <cmath>
#include <memory>

#include "engine/fourier/fit.h"

namespace patina::test {

/// A fit with made-up but consistent answers, for tests of widgets alone.
class FakeFit : public FourierFit {
 public:
  FakeFit(FourierCapture capture, int width, int height, bool cancelled = false)
      : capture_(std::move(capture)) {
    maps_.width = width;
    maps_.height = height;
    maps_.widthMm = capture_.sampleWidthMm;
    maps_.heightMm = capture_.sampleHeightMm;
    maps_.diffuse = Image(width, height, 3, 0.4f);
    maps_.specular = Image(width, height, 3, 0.05f);
    maps_.normal = Image(width, height, 3);
    maps_.sigma = Image(width, height, 1);
    maps_.kurtosis = Image(width, height, 1, 1.2f);
    maps_.residual = Image(width, height, 1, 0.01f);
    maps_.status = Image(width, height, 1, 1.0f);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        maps_.normal.at(x, y, 2) = 1;
        maps_.sigma.at(x, y) = 0.05f + 0.1f * x / width;
      }
    maps_.status.at(0, 0) = 0;
    stats_.cancelled = cancelled;
    stats_.texels = static_cast<std::size_t>(width) * height;
    stats_.seconds = {{"read", 0.5},    {"geometry", 0.1}, {"solve", 2.0}, {"maps", 0.1},
                      {"predict", 0.4}, {"holdout", 0.1},  {"total", 3.2}};
    stats_.fitRms = 0.011;
    stats_.holdoutRms = 0.012;
    stats_.noiseFloorHoldout = 0.011;
  }
  /// As an engine does that has not read the held-out photographs.
  void leaveHeldOutUnread() { heldOutRead_ = false; }

  const SvbrdfMaps& maps() const override { return maps_; }
  const FourierFitStats& stats() const override { return stats_; }
  const FourierCapture& capture() const override { return capture_; }
  const FourierFitOptions& options() const override { return options_; }
  SvbrdfParameters parametersAt(int x, int y) const override {
    SvbrdfParameters parameters;
    parameters.diffuse.setConstant(0.4f);
    parameters.specular.setConstant(0.05f);
    parameters.sigma = maps_.sigma.at(x, y);
    parameters.kurtosis = 1.2f;
    return parameters;
  }
  std::vector<SpectrumSample> spectrumAt(int x, int y) const override {
    if (maps_.status.at(x, y) == 0) return {};
    std::vector<SpectrumSample> samples;
    for (const int k : {0, 1, 2, 4, 8}) {
      if (k == 4 && !heldOutRead_) continue;
      SpectrumSample sample{};
      sample.frequency = {k, 0};
      sample.holdout = k == 4;
      for (int c = 0; c < 3; ++c) {
        sample.diffuse[c] = diffuseAt(k);
        sample.specular[c] = specularAt(k);
        sample.measured[c] = sample.diffuse[c] + sample.specular[c];
        sample.noiseSigma[c] = 1e-5f;
      }
      samples.push_back(sample);
    }
    return samples;
  }
  std::vector<SpectrumCurvePoint> modelSpectrumAt(int, int, Eigen::Vector2d, double maxFrequency,
                                                  int count) const override {
    std::vector<SpectrumCurvePoint> curve(count);
    for (int i = 0; i < count; ++i) {
      curve[i].frequency = maxFrequency * i / (count - 1);
      curve[i].diffuse.fill(diffuseAt(curve[i].frequency));
      curve[i].specular.fill(specularAt(curve[i].frequency));
    }
    return curve;
  }
  LobeSlice lobeAt(int, int, bool horizontal, int count) const override {
    LobeSlice slice;
    slice.horizontal = horizontal;
    for (int i = 0; i < count; ++i) {
      const double x = -M_PI + 2 * M_PI * i / (count - 1);
      slice.position.push_back(x);
      const auto value = static_cast<float>(std::exp(-x * x));
      slice.model.push_back({value, value, value});
      slice.measured.push_back({value, value, value});
    }
    return slice;
  }

 private:
  static std::complex<float> diffuseAt(double k) { return static_cast<float>(0.01 * std::exp(-k * k)); }
  static std::complex<float> specularAt(double k) {
    return std::polar(static_cast<float>(0.005 * std::exp(-0.05 * k * k)), static_cast<float>(0.3 * k));
  }

  bool heldOutRead_ = true;
  FourierCapture capture_;
  FourierFitOptions options_;
  FourierFitStats stats_;
  SvbrdfMaps maps_;
};

}  // namespace patina::test
