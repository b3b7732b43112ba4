#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "engine/diagnosis/fourier_findings.h"

namespace patina {

void listPhotographs(const DiagnosisCapture& capture, const ModelError& before, const ModelError& after,
                     Explanation& out) {
  for (std::size_t r = 0; r < capture.rowCount(); ++r) {
    const DiagnosisRow& row = capture.rows[r];
    if (row.photo < 0 || before.rowCount[r] <= 0) continue;
    PhotoResidual photo;
    photo.photo = row.photo;
    const FourierPhoto& source = capture.state->capture.photos[static_cast<std::size_t>(row.photo)];
    photo.file = source.file;
    photo.what = row.frequency < 0
                     ? "window"
                     : "pattern (" + std::to_string(source.frequency.x()) + ", " +
                           std::to_string(source.frequency.y()) + ") phase " + std::to_string(source.phase);
    photo.holdout = row.holdout;
    photo.noise = before.rowNoise[r];
    photo.before = photo.noise * std::sqrt(before.rowChi2[r] / before.rowCount[r]);
    photo.after =
        after.rowCount[r] > 0 ? photo.noise * std::sqrt(after.rowChi2[r] / after.rowCount[r]) : photo.before;
    out.photos.push_back(std::move(photo));
  }
  std::ranges::sort(out.photos, std::greater<>(),
                    [](const PhotoResidual& p) { return p.noise > 0 ? p.before / p.noise : 0; });
}

void drawResidual(const DiagnosisSession& base, const DiagnosisSession& session, Explanation& out,
                  const JobContext& job) {
  const DiagnosisCapture& capture = session.captures[0];
  const FourierFitState& beforeFit = *base.captures[0].state;
  const FourierFitState& afterFit = fitState(*out.fourierAfter);
  const SiteSet& set = beforeFit.measurements.sites;
  constexpr std::size_t kMostSites = 150000;
  if (set.size() > kMostSites || afterFit.sites.size() != set.size()) return;
  const bool changed = out.fourierAfter != out.fourierBefore && !capture.knownLambertian;
  std::vector<std::size_t> rows;
  for (const auto& photo : out.photos) {
    for (std::size_t r = 0; r < capture.rowCount(); ++r)
      if (capture.rows[r].photo == photo.photo) rows.push_back(r);
    if (rows.size() >= 4) break;
  }
  out.placeBefore = Image(set.imageWidth, set.imageHeight, 1);
  out.placeAfter = Image(set.imageWidth, set.imageHeight, 1);
  for (const std::size_t r : rows) {
    ResidualPicture picture;
    picture.photo = capture.rows[r].photo;
    picture.file = beforeFit.capture.photos[static_cast<std::size_t>(picture.photo)].file;
    for (Image* image :
         {&picture.captured, &picture.predictedBefore, &picture.predictedAfter, &picture.noiseSigma})
      *image = Image(set.imageWidth, set.imageHeight, 3);
    out.pictures.push_back(std::move(picture));
  }
  std::vector<std::vector<std::int32_t>> pixels(set.size());
  for (std::size_t p = 0; p < set.siteOfPixel.size(); ++p)
    if (set.siteOfPixel[p] >= 0)
      pixels[static_cast<std::size_t>(set.siteOfPixel[p])].push_back(static_cast<std::int32_t>(p));
  const FourierDiagnosisModel plain = modelOf(base, 0), full = modelOf(session, 0);
  tbb::parallel_for(std::size_t{0}, (set.size() + 63) / 64, [&](std::size_t chunk) {
    if (job.cancelled()) return;
    SiteColumns a, b;
    for (std::size_t s = chunk * 64; s < std::min(set.size(), chunk * 64 + 64); ++s) {
      const TexelStatus status = beforeFit.siteStatus[s];
      if (status == TexelStatus::Failed || status == TexelStatus::Clipped ||
          status == TexelStatus::NotMeasured)
        continue;
      DiagnosisSite site;
      site.site = s;
      site.cluster = capture.clusterOfSite[s];
      loadSite(capture, site);
      plain.evaluate(site, quadrature::kPrediction, a);
      if (changed) {
        site.model = quadratureSite(afterFit, s);
        site.model.geometry = beforeFit.geometry(s);
        site.diffuse = afterFit.sites[s].diffuse;
        site.specular = afterFit.sites[s].specular;
      }
      full.evaluate(site, quadrature::kPrediction, b);
      double before = 0, after = 0, count = 0;
      for (std::size_t k = 0; k < capture.rowCount() * 3; ++k) {
        const double w = site.weight[k];
        if (w <= 0) continue;
        before += w * std::pow(site.measured[k] - a.predicted[k], 2);
        after += w * std::pow(site.measured[k] - b.predicted[k], 2);
        ++count;
      }
      for (const std::int32_t pixel : pixels[s]) {
        const int x = pixel % set.imageWidth, y = pixel / set.imageWidth;
        out.placeBefore.at(x, y) = static_cast<float>(before / std::max(count, 1.0));
        out.placeAfter.at(x, y) = static_cast<float>(after / std::max(count, 1.0));
        for (std::size_t k = 0; k < rows.size(); ++k) {
          for (int c = 0; c < 3; ++c) {
            const std::size_t at = rows[k] * 3 + static_cast<std::size_t>(c);
            out.pictures[k].captured.at(x, y, c) = site.measured[at];
            out.pictures[k].predictedBefore.at(x, y, c) = a.predicted[at];
            out.pictures[k].predictedAfter.at(x, y, c) = b.predicted[at];
            out.pictures[k].noiseSigma.at(x, y, c) = site.weight[at] > 0 ? 1 / std::sqrt(site.weight[at]) : 0;
          }
        }
      }
    }
  });
}

}  // namespace patina
