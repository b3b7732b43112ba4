#pragma once

#include <cmath>
#include <functional>
#include <memory>
#include <random>
#include <vector>

#include "engine/fourier/fit_state.h"
#include "engine/fourier/solve_sheet.h"
#include "tests/fourier/rig.h"

namespace patina::test {

/// What a made-up sheet is made of at a point (mm).
using SheetAt = std::function<SvbrdfParameters(double xMm, double yMm)>;

/// A fit's state as it is before the solve: a square sheet of `side` x `side` sites over `sizeMm`, whose
/// measurements are those that the model predicts (SiteLobe and DiffuseTransform, tested against brute force
/// elsewhere) and noise. The search is under test, not the model; no photographs are involved.
struct MadeUpSheet {
  std::unique_ptr<FourierFitState> state = std::make_unique<FourierFitState>();
  Rig rig;

  /// No photograph sees the square of `holeMm` in the middle.
  MadeUpSheet(int side, double sizeMm, float noise, const SheetAt& at, double holeMm = 0) {
    FourierFitState& s = *state;
    s.capture.sampleWidthMm = s.capture.sampleHeightMm = sizeMm;
    s.capture.screen = rig.screen;
    s.capture.camera.translationMm = -rig.cameraMm;  // rotation: identity
    s.frame = rig.frame;
    FourierMeasurements& m = s.measurements;
    std::vector<Eigen::Vector2d> frequencies = {{0, 0}};
    for (const int w : {1, 2, 3, 4, 6, 10, 20, 40})
      for (const auto& direction :
           {Eigen::Vector2i(1, 0), Eigen::Vector2i(0, 1), Eigen::Vector2i(1, 1), Eigen::Vector2i(1, -1)}) {
        m.plan.fitted.push_back({w * direction, {0, 0, 0, 0}});
        frequencies.push_back((w * direction).cast<double>());
      }
    s.diffuse = std::make_unique<DiffuseTransform>(s.frame, Eigen::Vector2d(sizeMm, sizeMm), frequencies,
                                                   DiffuseMethod::Quadrature);
    m.sites.imageWidth = m.sites.imageHeight = side;
    m.sites.finestPitchMm = sizeMm / side;
    for (int y = 0; y < side; ++y) {
      m.sites.firstSiteOfRow.push_back(static_cast<std::uint32_t>(m.sites.size()));
      for (int x = 0; x < side; ++x) {
        const Eigen::Vector2f point(((x + 0.5) / side - 0.5) * sizeMm, (0.5 - (y + 0.5) / side) * sizeMm);
        const bool seen = point.cwiseAbs().maxCoeff() > holeMm / 2;
        m.sites.siteOfPixel.push_back(seen ? static_cast<std::int32_t>(m.sites.size()) : -1);
        if (!seen) continue;
        m.sites.pixel.emplace_back(x, y);
        m.sites.pixelCount.push_back(1);
        m.sites.pointMm.push_back(point);
      }
    }
    const std::size_t count = m.sites.size();
    m.sites.firstSiteOfRow.push_back(static_cast<std::uint32_t>(count));
    const int fitted = m.frequencyCount();
    auto store = MeasurementStore::make(count, fitted, std::uint64_t{1} << 32);
    m.store = std::move(*store);
    m.dc.resize(count * 3);
    m.dcVariances.assign(count * 3, noise * noise);
    m.black.assign(count * 3, 0);
    m.brightness.assign(count * 3, 0);
    m.clippedFraction.assign(count, 0);
    m.noise.read = noise / std::sqrt(2.0);  // two photographs make a component of Z
    m.fullScale = 0.2;
    std::mt19937 random(1);
    std::normal_distribution<float> normal(0, noise);
    std::vector<float> diffuse(frequencies.size() * 6);
    for (std::size_t i = 0; i < count; ++i) {
      const Eigen::Vector2d point = m.sites.pointMm[i].cast<double>();
      const SvbrdfParameters p = at(point.x(), point.y());
      s.diffuse->at(point, diffuse.data());
      const SiteLobe lobe = siteLobe(s.frame, s.geometry(i), p, LobeMapping::ExactMoments);
      const Eigen::Vector3f n = normalOnScreen(s.frame, p.normal);
      float* z = m.store.zInMemory() + i * fitted * 6;
      for (std::size_t f = 0; f < frequencies.size(); ++f) {
        const float* v = diffuse.data() + f * 6;
        const std::complex<float> d(n.x() * v[0] + n.y() * v[2] + n.z() * v[4],
                                    n.x() * v[1] + n.y() * v[3] + n.z() * v[5]);
        const std::complex<float> sharp = lobe.transform(frequencies[f].cast<float>());
        for (int c = 0; c < 3; ++c) {
          const auto value = p.diffuse[c] * d + p.specular[c] * sharp;
          if (f == 0) {
            m.dc[i * 3 + c] = value.real() + normal(random);
          } else {
            z[(f - 1) * 6 + c] = value.real() + normal(random);
            z[(f - 1) * 6 + 3 + c] = value.imag() + normal(random);
          }
        }
      }
    }
  }

  SolverSetup setup() const { return solverSetup(*state); }
};

/// A material by its sigma: glossy or satin plastic on a coloured ground.
inline SvbrdfParameters madeUpMaterial(float sigma, const Eigen::Array3f& diffuse) {
  SvbrdfParameters p;
  p.diffuse = diffuse;
  p.specular = {0.05f, 0.05f, 0.05f};
  p.sigma = sigma;
  p.kurtosis = 1.3f;
  p.normal = Eigen::Vector3f::UnitZ();
  return p;
}

}  // namespace patina::test
