#include "engine/fourier/maps.h"

#include <tbb/parallel_for.h>

#include <array>
#include <atomic>
#include <cmath>

#include "engine/fourier/fit_state.h"

namespace patina {

std::int64_t FourierFitState::siteOfTexel(int texelX, int texelY) const {
  const Eigen::Vector3d point(((texelX + 0.5) / maps.width - 0.5) * maps.widthMm,
                              (0.5 - (texelY + 0.5) / maps.height) * maps.heightMm, 0);
  const auto pixel = capture.camera.pixelFromWorld(point);
  if (!pixel) return -1;
  const SiteSet& set = measurements.sites;
  const auto x = std::lround(pixel->x()), y = std::lround(pixel->y());
  // The nearest pixel may lie just outside the rectangle although the texel does not: look one pixel around.
  std::int64_t best = -1;
  double bestDistance = 1e30;
  for (long dy = -1; dy <= 1; ++dy) {
    for (long dx = -1; dx <= 1; ++dx) {
      const long px = x + dx, py = y + dy;
      if (px < 0 || py < 0 || px >= set.imageWidth || py >= set.imageHeight) continue;
      const auto site = set.siteOfPixel[static_cast<std::size_t>(py) * set.imageWidth + px];
      if (site < 0) continue;
      const double distance =
          (Eigen::Vector2d(static_cast<double>(px), static_cast<double>(py)) - *pixel).squaredNorm();
      if (distance < bestDistance) bestDistance = distance, best = site;
    }
  }
  return best;
}

SvbrdfMaps mapsFromSites(const FourierFitState& state, int size, const JobContext& job) {
  const FourierCapture& capture = state.capture;
  const double longest = std::max(capture.sampleWidthMm, capture.sampleHeightMm);
  SvbrdfMaps maps;
  maps.width = std::max(1, static_cast<int>(std::lround(size * capture.sampleWidthMm / longest)));
  maps.height = std::max(1, static_cast<int>(std::lround(size * capture.sampleHeightMm / longest)));
  maps.widthMm = capture.sampleWidthMm;
  maps.heightMm = capture.sampleHeightMm;
  maps.diffuse = Image(maps.width, maps.height, 3);
  maps.specular = Image(maps.width, maps.height, 3);
  maps.normal = Image(maps.width, maps.height, 3);
  for (Image* map : {&maps.sigma, &maps.kurtosis, &maps.residual, &maps.status, &maps.sigmaSd,
                     &maps.kurtosisSd, &maps.normalSd})
    *map = Image(maps.width, maps.height, 1);
  maps.diffuseSd = Image(maps.width, maps.height, 3);
  maps.specularSd = Image(maps.width, maps.height, 3);

  const SiteSet& set = state.measurements.sites;
  auto siteAt = [&](long x, long y) -> std::int64_t {
    if (x < 0 || y < 0 || x >= set.imageWidth || y >= set.imageHeight) return -1;
    return set.siteOfPixel[static_cast<std::size_t>(y) * set.imageWidth + x];
  };
  // How far two solutions may differ and still count as one material; beyond, a texel takes the nearer one
  // alone.
  auto similarity = [&](const SvbrdfParameters& a, const SvbrdfParameters& b) {
    const float width = std::log(a.sigma / b.sigma) / 0.5f;
    const float normal = (a.normal - b.normal).norm() / 0.15f;
    const float albedo =
        ((a.diffuse - b.diffuse).abs() / (0.03f + 0.15f * a.diffuse.max(b.diffuse))).maxCoeff();
    return std::exp(-0.5f * (width * width + normal * normal + albedo * albedo));
  };
  std::atomic<std::int64_t> done{0};
  tbb::parallel_for(0, maps.height, [&](int j) {
    for (int i = 0; i < maps.width; ++i) {
      const Eigen::Vector3d point(((i + 0.5) / maps.width - 0.5) * maps.widthMm,
                                  (0.5 - (j + 0.5) / maps.height) * maps.heightMm, 0);
      maps.normal.at(i, j, 2) = 1.0f;
      maps.kurtosis.at(i, j) = 1.0f;
      const auto pixel = capture.camera.pixelFromWorld(point);
      if (!pixel) continue;
      const long x0 = static_cast<long>(std::floor(pixel->x())),
                 y0 = static_cast<long>(std::floor(pixel->y()));
      const double fx = pixel->x() - static_cast<double>(x0), fy = pixel->y() - static_cast<double>(y0);
      std::array<std::int64_t, 4> site;
      std::array<double, 4> weight;
      int nearest = -1;
      for (int k = 0; k < 4; ++k) {
        const int dx = k % 2, dy = k / 2;
        site[k] = siteAt(x0 + dx, y0 + dy);
        weight[k] = (dx ? fx : 1 - fx) * (dy ? fy : 1 - fy);
        if (site[k] >= 0 && (nearest < 0 || weight[k] > weight[nearest])) nearest = k;
      }
      if (nearest < 0) continue;
      const SvbrdfParameters& centre = state.sites[site[nearest]];
      const TexelStatus status = state.siteStatus[site[nearest]];
      double total = 0;
      Eigen::Array3d diffuse = Eigen::Array3d::Zero(), specular = Eigen::Array3d::Zero();
      Eigen::Vector3d normal = Eigen::Vector3d::Zero();
      double logSigma = 0, logKurtosis = 0, residual = 0;
      // Neighbours' errors are taken for dependent: pooling makes them so. Their mean is the cautious answer.
      SiteUncertainty sd;
      for (int k = 0; k < 4; ++k) {
        if (site[k] < 0 || (k != nearest && state.siteStatus[site[k]] != status)) continue;
        const SvbrdfParameters& p = state.sites[site[k]];
        const double w = std::max(weight[k], 1e-6) * (k == nearest ? 1.0 : similarity(centre, p));
        total += w;
        diffuse += w * p.diffuse.cast<double>();
        specular += w * p.specular.cast<double>();
        normal += w * p.normal.cast<double>();
        logSigma += w * std::log(p.sigma);
        logKurtosis += w * std::log(p.kurtosis);
        residual += w * state.siteResidual[site[k]];
        const SiteUncertainty& one = state.siteSd[site[k]];
        const auto share = static_cast<float>(w);
        sd.diffuse += share * one.diffuse;
        sd.specular += share * one.specular;
        sd.normal += share * one.normal;
        sd.sigma += share * one.sigma;
        sd.kurtosis += share * one.kurtosis;
      }
      normal.normalize();
      for (int c = 0; c < 3; ++c) {
        maps.diffuse.at(i, j, c) = static_cast<float>(diffuse[c] / total);
        maps.specular.at(i, j, c) = static_cast<float>(specular[c] / total);
        maps.normal.at(i, j, c) = static_cast<float>(normal[c]);
        maps.diffuseSd.at(i, j, c) = sd.diffuse[c] / static_cast<float>(total);
        maps.specularSd.at(i, j, c) = sd.specular[c] / static_cast<float>(total);
      }
      constexpr float kDegrees = 57.29578f;
      maps.normalSd.at(i, j) = kDegrees * std::sqrt(sd.normal.square().sum()) / static_cast<float>(total);
      maps.sigmaSd.at(i, j) = sd.sigma / static_cast<float>(total);
      maps.kurtosisSd.at(i, j) = sd.kurtosis / static_cast<float>(total);
      maps.sigma.at(i, j) = static_cast<float>(std::exp(logSigma / total));
      maps.kurtosis.at(i, j) = static_cast<float>(std::exp(logKurtosis / total));
      maps.residual.at(i, j) = static_cast<float>(residual / total);
      maps.status.at(i, j) = static_cast<float>(status);
    }
    job.progress("maps", ++done, maps.height, "rows");
  });
  return maps;
}

}  // namespace patina
