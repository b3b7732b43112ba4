#include "widgets/sheet_shading.h"

#include <atomic>
#include <numbers>
#include <thread>

#include "engine/surface/svbrdf.h"

namespace patina {

namespace {

constexpr float kUnmeasuredRadiance = 0.012f;

SvbrdfParameters parametersOf(const SvbrdfMaps& maps, int x, int y) {
  SvbrdfParameters parameters;
  parameters.diffuse = {maps.diffuse.at(x, y, 0), maps.diffuse.at(x, y, 1), maps.diffuse.at(x, y, 2)};
  parameters.specular = {maps.specular.at(x, y, 0), maps.specular.at(x, y, 1), maps.specular.at(x, y, 2)};
  parameters.normal = {maps.normal.at(x, y, 0), maps.normal.at(x, y, 1), maps.normal.at(x, y, 2)};
  parameters.sigma = maps.sigma.at(x, y);
  parameters.kurtosis = maps.kurtosis.at(x, y);
  return parameters;
}

void shadeRow(const SvbrdfMaps& maps, const SheetLighting& lighting, int step, int row,
              std::span<float> line) {
  const double intensity = std::numbers::pi * lighting.referenceDistanceMm * lighting.referenceDistanceMm;
  for (int x = 0; x < maps.width; x += step) {
    const int column = std::min(x + step / 2, maps.width - 1);
    Eigen::Array3f radiance = Eigen::Array3f::Constant(kUnmeasuredRadiance);
    if (static_cast<TexelStatus>(static_cast<int>(maps.status.at(column, row))) != TexelStatus::NotMeasured) {
      const Eigen::Vector3d point(((column + 0.5) / maps.width - 0.5) * maps.widthMm,
                                  (0.5 - (row + 0.5) / maps.height) * maps.heightMm, 0);
      const Eigen::Vector3d light = lighting.lightMm - point, eye = lighting.eyeMm - point;
      const double distance = light.norm();
      radiance = svbrdfBrdfTimesCos((light / distance).cast<float>(), eye.normalized().cast<float>(),
                                    parametersOf(maps, column, row)) *
                 static_cast<float>(intensity / (distance * distance));
    }
    for (int u = x; u < std::min(x + step, maps.width); ++u)
      for (int c = 0; c < 3; ++c) line[3 * u + c] = radiance[c];
  }
}

}  // namespace

void shadeSheet(const SvbrdfMaps& maps, const SheetLighting& lighting, int step, Image& radiance) {
  if (radiance.width() != maps.width || radiance.height() != maps.height)
    radiance = Image(maps.width, maps.height, 3);
  const auto line = [&](int row) {
    return radiance.samples().subspan(static_cast<std::size_t>(row) * maps.width * 3,
                                      static_cast<std::size_t>(maps.width) * 3);
  };
  std::atomic<int> next = 0;
  const auto work = [&] {
    for (int row = next.fetch_add(step); row < maps.height; row = next.fetch_add(step)) {
      shadeRow(maps, lighting, step, std::min(row + step / 2, maps.height - 1), line(row));
      for (int repeat = row + 1; repeat < std::min(row + step, maps.height); ++repeat)
        std::copy(line(row).begin(), line(row).end(), line(repeat).begin());
    }
  };
  // Small sheets take less than a thread's start.
  const long texels = static_cast<long>(maps.width) * maps.height / (step * step);
  const int helpers = texels < 16384 ? 0 : static_cast<int>(std::thread::hardware_concurrency()) - 1;
  std::vector<std::jthread> threads;
  for (int i = 0; i < helpers; ++i) threads.emplace_back(work);
  work();
}

}  // namespace patina
