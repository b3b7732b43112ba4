#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <string>
#include <vector>

#include "app/cli/fit_report.h"
#include "engine/base/atomic_file.h"
#include "engine/image/exr.h"
#include "engine/image/png.h"

namespace patina::cli {
namespace {

namespace fs = std::filesystem;

/// A layer's name: frequency (-3, 2) is "Z_m3_p2".
std::string layerName(const Eigen::Vector2i& frequency) {
  const auto part = [](int value) { return (value < 0 ? "m" : "p") + std::to_string(std::abs(value)); };
  return "Z_" + part(frequency.x()) + "_" + part(frequency.y());
}

/// The value that all but one in two hundred samples stay below, so that a few bright pixels don't make the
/// rest black.
float brightest(const Image& image) {
  std::vector<float> values(image.samples().begin(), image.samples().end());
  std::erase_if(values, [](float value) { return !std::isfinite(value); });
  if (values.empty()) return 1.0f;
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>((values.size() - 1) * 995 / 1000);
  std::nth_element(values.begin(), nth, values.end());
  return *nth > 0 ? *nth : 1.0f;
}

/// A preview: `low`..`high` to 0..1 with a gamma of 2.2 for light, none for others.
Image preview(const Image& image, float low, float high, bool light) {
  Image shown(image.width(), image.height(), image.channels());
  for (std::size_t i = 0; i < image.samples().size(); ++i) {
    const float share = std::clamp((image.samples()[i] - low) / (high - low), 0.0f, 1.0f);
    shown.samples()[i] = light ? std::pow(share, 1.0f / 2.2f) : share;
  }
  return shown;
}

Status writePreviews(const fs::path& folder, const SvbrdfMaps& maps) {
  struct Preview {
    const char* name;
    const Image* map;
    float low, high;
    bool light;
  };
  const Preview previews[] = {
      {"diffuse.png", &maps.diffuse, 0, brightest(maps.diffuse), true},
      {"specular.png", &maps.specular, 0, brightest(maps.specular), true},
      {"normal.png", &maps.normal, -1, 1, false},
      {"sigma.png", &maps.sigma, 0, brightest(maps.sigma), false},
      {"kurtosis.png", &maps.kurtosis, 1, std::max(1.001f, brightest(maps.kurtosis)), false},
      {"residual.png", &maps.residual, 0, brightest(maps.residual), false},
      {"status.png", &maps.status, 0, 6, false}};
  for (const Preview& p : previews) {
    Status written = writePng(folder / p.name, preview(*p.map, p.low, p.high, p.light));
    if (!written) return written;
  }
  return Done{};
}

/// The mean of the window photographs less that of the black ones, as the camera saw it.
Result<Image> windowMinusBlack(const FourierCapture& capture) {
  Image difference(capture.camera.width, capture.camera.height, 3);
  for (const PhotoRole role : {PhotoRole::Window, PhotoRole::Black}) {
    const auto wanted = [&](const FourierPhoto& photo) { return photo.role == role && !photo.holdout; };
    const auto count = std::count_if(capture.photos.begin(), capture.photos.end(), wanted);
    const float weight =
        (role == PhotoRole::Window ? 1.0f : -1.0f) / static_cast<float>(std::max<long>(1, count));
    for (const FourierPhoto& photo : capture.photos) {
      if (!wanted(photo)) continue;
      Result<Image> image = readPhoto(capture, photo);
      if (!image) return image;
      for (std::size_t i = 0; i < difference.samples().size(); ++i) {
        difference.samples()[i] += weight * image->samples()[i];
      }
    }
  }
  return difference;
}

constexpr int kMostSpectra =
    128;  ///< along a side: each costs a prediction, and has a layer for each frequency

/// The spectra of the maps' texels, or of every n-th where the maps are large.
Status writeSpectra(const fs::path& folder, const FourierFit& fit, const JobContext& job) {
  const SvbrdfMaps& maps = fit.maps();
  const int stride = (std::max(maps.width, maps.height) + kMostSpectra - 1) / kMostSpectra;
  const int width = (maps.width + stride - 1) / stride, height = (maps.height + stride - 1) / stride;
  const auto spectrumAt = [&](int x, int y) {
    return fit.spectrumAt(std::min(x * stride + stride / 2, maps.width - 1),
                          std::min(y * stride + stride / 2, maps.height - 1));
  };
  // The layers, from the first texel that a photograph sees; one that none sees has no spectrum.
  std::vector<std::string> layers;
  for (int i = 0; i < width * height && layers.empty() && !job.cancelled(); ++i) {
    for (const SpectrumSample& sample : spectrumAt(i % width, i / width)) {
      layers.push_back(layerName(sample.frequency));
    }
  }
  if (layers.empty() && !job.cancelled()) {
    job.warn("No texel has a spectrum, so none are among the stage images.");
    return Done{};
  }
  Image measured(width, height, static_cast<int>(layers.size())), model = measured;
  Image residual(width, height, 3);
  std::atomic<int> rows{0};
  const auto fillRow = [&](int y) {
    for (int x = 0; x < width && !job.cancelled(); ++x) {
      const std::vector<SpectrumSample> spectrum = spectrumAt(x, y);
      for (std::size_t i = 0; i < std::min(layers.size(), spectrum.size()); ++i) {
        const SpectrumSample& sample = spectrum[i];
        measured.at(x, y, static_cast<int>(i)) = std::abs(sample.measured[1]);
        model.at(x, y, static_cast<int>(i)) = std::abs(sample.diffuse[1] + sample.specular[1]);
        if (i > 0) continue;
        for (std::size_t c = 0; c < 3; ++c) {
          residual.at(x, y, static_cast<int>(c)) =
              (sample.diffuse[c] + sample.specular[c] - sample.measured[c]).real();
        }
      }
    }
    job.progress("dump", ++rows, height, "rows");
  };
  tbb::task_arena arena(job.threads > 0 ? job.threads : tbb::task_arena::automatic);
  arena.execute([&] { tbb::parallel_for(0, height, fillRow); });
  if (job.cancelled()) return Error{ErrorCode::Cancelled, "writing the stage images was cancelled", "", ""};
  if (stride > 1) {
    job.info("The spectra among the stage images are of one texel in " + std::to_string(stride) +
             " along each side.");
  }
  const std::map<std::string, std::string> attributes = {
      {"units", "radiance in units of the screen's full white"}, {"channel", "green"}};
  Status written = writeExr(folder / "spectrum_measured.exr", measured, layers, attributes);
  if (written) written = writeExr(folder / "spectrum_model.exr", model, layers, attributes);
  if (written) {
    written = writeExr(folder / "residual_dc.exr", residual, {"R", "G", "B"},
                       {{"units", "model minus measurement, radiance in units of the screen's full white"}});
  }
  return written;
}

}  // namespace

Status writeDump(const fs::path& folder, const FourierFit& fit, const JobContext& job) {
  Result<StagedFolder> staged = StagedFolder::create(folder);
  if (!staged) return staged.error();
  Result<Image> light = windowMinusBlack(fit.capture());
  if (!light) return light.error();
  Status written =
      writeExr(staged->path() / "window_minus_black.exr", *light, {"R", "G", "B"},
               {{"units", "radiance in units of the screen's full white"}, {"frame", "camera pixels"}});
  if (written) {
    written =
        writePng(staged->path() / "window_minus_black.png", preview(*light, 0, brightest(*light), true));
  }
  if (written) written = writePreviews(staged->path(), fit.maps());
  if (written) written = writeSpectra(staged->path(), fit, job);
  if (!written) return written;
  return staged->commit();
}

}  // namespace patina::cli
