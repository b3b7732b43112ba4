#include <tbb/parallel_for.h>

#include <cmath>
#include <map>
#include <mutex>

#include "engine/fourier/fit_state.h"

namespace patina {

Result<PhotoError> photoError(FourierFitState& state, bool holdout, const JobContext& job) {
  FourierMeasurements& m = state.measurements;
  const auto& groups = holdout ? m.plan.heldOut : m.plan.fitted;
  const std::size_t count = m.sites.size();
  std::vector<SiteLobe> lobes(count);
  std::vector<Eigen::Vector3f> normals(count);
  tbb::parallel_for(std::size_t{0}, count, [&](std::size_t s) {
    if (s % 256 == 0 && job.cancelled()) return;
    lobes[s] = siteLobe(state.frame, state.geometry(s), state.sites[s], state.options.lobe);
    normals[s] = normalOnScreen(state.frame, state.sites[s].normal);
  });
  if (job.cancelled()) return Error{ErrorCode::Cancelled, "cancelled while predicting photographs", "", ""};
  const DiffuseMethod method = state.diffuseMethod();
  if (holdout) {
    auto store = MeasurementStore::make(count, static_cast<int>(groups.size()),
                                        std::numeric_limits<std::uint64_t>::max());
    if (!store) return store.error();
    m.heldOut = std::move(*store);
  }

  // Multiples 0, 1, 2, 4, 6, ... of every frequency, each computed once. The window needs the first alone.
  std::vector<Eigen::Vector2d> distinct;
  std::map<std::pair<int, int>, int> indexOf;
  auto indexFor = [&](const Eigen::Vector2i& w) {
    const auto [it, fresh] = indexOf.try_emplace({w.x(), w.y()}, static_cast<int>(distinct.size()));
    if (fresh) distinct.push_back(w.cast<double>());
    return it->second;
  };
  std::vector<std::vector<int>> multiples(groups.size() + 1, {indexFor(Eigen::Vector2i::Zero())});
  for (std::size_t g = 0; g < groups.size(); ++g) {
    multiples[g].push_back(indexFor(groups[g].frequency));
    for (int h = 1; h <= kEvenHarmonics; ++h) multiples[g].push_back(indexFor(2 * h * groups[g].frequency));
  }
  const DiffuseTransform allFrequencies(
      state.frame, {state.capture.sampleWidthMm, state.capture.sampleHeightMm}, distinct, method);

  std::mutex mutex;
  std::optional<Error> failure;
  double error = 0, signal = 0, noise = 0;
  std::int64_t done = 0;
  const auto total = static_cast<std::int64_t>(groups.size() + (holdout ? 0 : 1));
  auto used = [&](std::size_t s) {
    return state.siteStatus[s] != TexelStatus::Failed && state.siteStatus[s] != TexelStatus::Cancelled &&
           state.siteStatus[s] != TexelStatus::Clipped;
  };
  tbb::parallel_for(std::size_t{0}, groups.size() + (holdout ? 0 : 1), [&](std::size_t g) {
    if (job.cancelled()) return;
    double sumError = 0, sumSignal = 0, sumNoise = 0;
    auto compare = [&](std::size_t s, float measured, float predicted) {
      const double gap = predicted - measured;
      sumError += gap * gap;
      sumSignal += static_cast<double>(measured) * measured;
      sumNoise += m.noise.variance(measured) / m.sites.pixelCount[s];
    };
    if (g == groups.size()) {  // the window alone
      auto image = readPhoto(state.capture, state.capture.photos[m.plan.window]);
      if (!image) {
        std::scoped_lock lock(mutex);
        if (!failure) failure = image.error();
        return;
      }
      const std::vector<float> windowPhoto = sampleSites(m.sites, *image);
      const DiffuseTransform diffuse = allFrequencies.select(multiples[g]);
      float v[6];
      for (std::size_t s = 0; s < count; ++s) {
        if (!used(s)) continue;
        diffuse.at(m.sites.pointMm[s].cast<double>(), v);
        const float d = normals[s].x() * v[0] + normals[s].y() * v[2] + normals[s].z() * v[4];
        const float l = lobes[s].transform(Eigen::Vector2f::Zero()).real();
        for (int c = 0; c < 3; ++c)
          compare(s, windowPhoto[s * 3 + c],
                  m.black[s * 3 + c] + state.sites[s].diffuse[c] * d + state.sites[s].specular[c] * l);
      }
    } else {
      const DiffuseTransform diffuse = allFrequencies.select(multiples[g]);
      std::vector<Eigen::Vector2f> frequencies;
      for (const int f : multiples[g]) frequencies.push_back(distinct[f].cast<float>());
      std::array<std::vector<float>, 4> photo;
      for (int k = 0; k < 4; ++k) {
        auto image = readPhoto(state.capture, state.capture.photos[groups[g].photo[k]]);
        if (!image) {
          std::scoped_lock lock(mutex);
          if (!failure) failure = image.error();
          return;
        }
        if (job.cancelled()) return;
        photo[k] = sampleSites(m.sites, *image);
      }
      if (holdout) {
        for (std::size_t s = 0; s < count; ++s) {
          float* z = m.heldOut.zInMemory() + (s * groups.size() + g) * 6;
          float* even = m.heldOut.evenInMemory() + (s * groups.size() + g) * 6;
          for (int c = 0; c < 3; ++c) {
            even[c] = photo[0][s * 3 + c] + photo[2][s * 3 + c];
            even[3 + c] = photo[1][s * 3 + c] + photo[3][s * 3 + c];
            z[c] = photo[1][s * 3 + c] - photo[3][s * 3 + c];
            z[3 + c] = photo[2][s * 3 + c] - photo[0][s * 3 + c];
          }
        }
      }
      std::vector<float> v(frequencies.size() * 6);
      for (std::size_t s = 0; s < count; ++s) {
        if (s % 256 == 0 && job.cancelled()) return;
        if (!used(s)) continue;
        diffuse.at(m.sites.pointMm[s].cast<double>(), v.data());
        std::array<std::complex<float>, 2 + kEvenHarmonics> d, l;
        for (std::size_t f = 0; f < frequencies.size(); ++f) {
          const float* at = v.data() + f * 6;
          d[f] = {normals[s].x() * at[0] + normals[s].y() * at[2] + normals[s].z() * at[4],
                  normals[s].x() * at[1] + normals[s].y() * at[3] + normals[s].z() * at[5]};
          l[f] = lobes[s].transform(frequencies[f]);
        }
        for (int k = 0; k < 4; ++k) {
          const float fromDiffuse = patternRadiance(d, k), fromLobe = patternRadiance(l, k);
          for (int c = 0; c < 3; ++c)
            compare(s, photo[k][s * 3 + c],
                    m.black[s * 3 + c] + state.sites[s].diffuse[c] * fromDiffuse +
                        state.sites[s].specular[c] * fromLobe);
        }
      }
    }
    std::scoped_lock lock(mutex);
    error += sumError;
    signal += sumSignal;
    noise += sumNoise;
    job.progress(holdout ? "holdout" : "predict", ++done, total, "frequencies");
  });
  if ((failure || job.cancelled()) && holdout) m.heldOut = {};
  if (failure) return *failure;
  if (job.cancelled()) return Error{ErrorCode::Cancelled, "cancelled while predicting photographs", "", ""};
  if (!(signal > 0)) return PhotoError{};
  return PhotoError{std::sqrt(error / signal), std::sqrt(noise / signal)};
}

}  // namespace patina
