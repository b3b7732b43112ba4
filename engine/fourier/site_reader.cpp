#include "engine/fourier/site_reader.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <limits>
#include <mutex>
#include <optional>

#include "engine/capture/encoding.h"
#include "engine/capture/photo_rows.h"
#include "engine/fourier/photo_correction.h"

namespace patina {
namespace {

constexpr double kTop = 0.9995;          // rounding of the decoded top code
constexpr double kNearlyClipped = 0.98;  // noise may have come after the clipping
constexpr int kRowBlock = 16;            // most compressions of OpenEXR keep 1, 16 or 32 rows together

/// The radiance at which a photograph's samples saturate, R G B; infinite for linear photographs whose bundle
/// doesn't say where the sensor ends.
std::array<float, 3> declaredLevels(const FourierCapture& capture, const FourierPhoto& photo) {
  constexpr float kNever = std::numeric_limits<float>::infinity();
  std::array<float, 3> level{kNever, kNever, kNever};
  const auto encoding = parseEncoding(photo.encoding, photo.file);
  if (!encoding) return level;
  const auto scaled = [&](double pixel) { return static_cast<float>(kTop * pixel * capture.radianceScale); };
  if (encoding->kind == PhotoEncoding::Kind::Linear) {
    if (capture.saturation > 0) level.fill(scaled(capture.saturation));
    return level;
  }
  level.fill(scaled(1));
  if (encoding->kind == PhotoEncoding::Kind::Response) {
    const auto curves = readResponse(capture.folder / encoding->responseFile);
    if (!curves) return level;  // PhotoRows has the error
    for (std::size_t c = 0; c < 3; ++c) level[c] = scaled((*curves)[c].output.back());
  }
  return level;
}

/// The same, or lower where something else has found that the photographs are clipped there.
std::array<float, 3> clippingLevels(const FourierCapture& capture, const FourierPhoto& photo,
                                    const PhotoCorrection* correction) {
  std::array<float, 3> level = declaredLevels(capture, photo);
  if (correction && correction->saturation() > 0)
    for (float& value : level)
      value = std::min(value, static_cast<float>(kNearlyClipped * correction->saturation()));
  return level;
}

Error cancelledError() {
  return {ErrorCode::Cancelled, "the fit was cancelled while reading photographs", "", ""};
}

struct OpenPhoto {
  int index = 0;  ///< into capture.photos
  std::optional<PhotoRows> rows;
  std::array<float, 3> level;
  std::vector<float> pixels, sites;
};

/// Sites between two image rows.
SiteRun sitesOfRows(const SiteSet& sites, int firstRow, int rowCount) {
  if (!sites.grouped()) {
    const std::size_t first = sites.firstSiteOfRow[static_cast<std::size_t>(firstRow)];
    return {first, sites.firstSiteOfRow[static_cast<std::size_t>(firstRow + rowCount)] - first};
  }
  std::size_t low = sites.size(), high = 0;
  const auto width = static_cast<std::size_t>(sites.imageWidth);
  for (std::size_t i = static_cast<std::size_t>(firstRow) * width;
       i < static_cast<std::size_t>(firstRow + rowCount) * width; ++i) {
    if (sites.siteOfPixel[i] < 0) continue;
    low = std::min(low, static_cast<std::size_t>(sites.siteOfPixel[i]));
    high = std::max(high, static_cast<std::size_t>(sites.siteOfPixel[i]) + 1);
  }
  return low < high ? SiteRun{low, high - low} : SiteRun{};
}

/// Takes the sites' values out of the pixels of some rows.
void gather(const SiteSet& sites, const SiteRun& run, int firstRow, const PhotoCorrection* correction,
            OpenPhoto& photo, std::vector<std::uint32_t>& clipped) {
  photo.sites.assign(run.count * 3, 0.0f);
  const std::int32_t* siteOfPixel = sites.siteOfPixel.data() + static_cast<std::size_t>(firstRow) *
                                                                   static_cast<std::size_t>(sites.imageWidth);
  const bool clips = std::isfinite(photo.level[0]);
  const std::size_t pixels = photo.pixels.size() / 3;
  for (std::size_t i = 0; i < pixels; ++i) {
    const auto site = siteOfPixel[i];
    if (site < 0) continue;
    float* from = photo.pixels.data() + i * 3;
    float* to = photo.sites.data() + (static_cast<std::size_t>(site) - run.first) * 3;
    if (clips && (from[0] >= photo.level[0] || from[1] >= photo.level[1] || from[2] >= photo.level[2]))
      clipped.push_back(static_cast<std::uint32_t>(site));
    if (correction) correction->undo(photo.index, from);
    for (int c = 0; c < 3; ++c) to[c] += from[c];
  }
  if (!sites.grouped()) return;
  for (std::size_t s = 0; s < run.count; ++s)
    for (std::size_t c = 0; c < 3; ++c)
      photo.sites[s * 3 + c] /= static_cast<float>(sites.pixelCount[run.first + s]);
}

}  // namespace

Status readSites(const FourierCapture& capture, const SiteSet& sites, std::span<const int> photos,
                 const MeasurementStorage& storage, std::string_view stage, const JobContext& job,
                 const PhotoCorrection* correction, const std::function<Status(const SiteStrip&)>& take) {
  const PhotoCorrection* undone = correction && correction->active() ? correction : nullptr;
  const auto tables = PhotoRows::makeTables();
  std::vector<OpenPhoto> open(photos.size());
  std::mutex mutex;  // guards failure
  std::optional<Error> failure;
  std::size_t failedPhoto = photos.size();
  const auto fail = [&](std::size_t p, const Error& error) {  // the first photograph's, whatever came first
    std::scoped_lock lock(mutex);
    if (p < failedPhoto) failedPhoto = p, failure = error;
  };
  tbb::parallel_for(std::size_t{0}, photos.size(), [&](std::size_t p) {
    if (job.cancelled()) return;
    const FourierPhoto& photo = capture.photos[static_cast<std::size_t>(photos[p])];
    auto rows = PhotoRows::open(capture, photo, tables);
    if (!rows) return fail(p, rows.error());
    open[p].rows = std::move(*rows);
    open[p].index = photos[p];
    open[p].level = clippingLevels(capture, photo, correction);
  });
  if (failure) return *failure;
  if (job.cancelled()) return cancelledError();

  // Rows with sites on them, from a block's first.
  const auto width = static_cast<std::size_t>(sites.imageWidth);
  const auto hasSites = [&](int y) {
    const auto row =
        sites.siteOfPixel.begin() + static_cast<std::ptrdiff_t>(static_cast<std::size_t>(y) * width);
    return std::any_of(row, row + static_cast<std::ptrdiff_t>(width), [](auto site) { return site >= 0; });
  };
  int top = 0, bottom = sites.imageHeight;
  while (top < bottom && !hasSites(top)) ++top;
  while (bottom > top && !hasSites(bottom - 1)) --bottom;
  top -= top % kRowBlock;

  // Pixels and sites of every photograph; one photograph's part stays short enough to poll for a stop.
  const std::uint64_t rowBytes = std::max<std::uint64_t>(1, 24 * width * photos.size());
  constexpr std::size_t kMostPixels = 1 << 20;
  int stripRows = static_cast<int>(
      std::min<std::uint64_t>({storage.memoryLimitBytes / 8 / rowBytes, kMostPixels / width, 1u << 16}));
  stripRows = std::max(kRowBlock, stripRows - stripRows % kRowBlock);
  const int strips = (bottom - top + stripRows - 1) / stripRows;

  std::atomic<std::int64_t> done{0};
  const auto total = static_cast<std::int64_t>(photos.size());
  SiteStrip strip;
  for (int y = top; y < bottom; y += stripRows) {
    const int rowCount = std::min(stripRows, bottom - y);
    strip.run = sitesOfRows(sites, y, rowCount);
    strip.values.assign(photos.size(), {});
    strip.clipped.assign(photos.size(), {});
    tbb::parallel_for(std::size_t{0}, photos.size(), [&](std::size_t p) {
      if (job.cancelled()) return;
      OpenPhoto& photo = open[p];
      if (y == top) {
        if (Status skipped = photo.rows->skip(top); !skipped) return fail(p, skipped.error());
      }
      photo.pixels.resize(static_cast<std::size_t>(rowCount) * width * 3);
      if (Status read = photo.rows->next(rowCount, photo.pixels); !read) return fail(p, read.error());
      gather(sites, strip.run, y, undone, photo, strip.clipped[p]);
      strip.values[p] = photo.sites;
      job.progress(stage, ++done / strips, total, "photos");
    });
    if (failure) return *failure;
    if (job.cancelled()) return cancelledError();
    if (strip.run.count == 0) continue;
    if (Status taken = take(strip); !taken) return taken;
    if (job.cancelled()) return cancelledError();
  }
  return Done{};
}

}  // namespace patina
