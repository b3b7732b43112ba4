#include "engine/capture/photo_rows.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <vector>

#include "engine/capture/bundle_path.h"
#include "engine/capture/encoding.h"
#include "engine/image/exr.h"
#include "engine/image/png.h"

namespace patina {
namespace {

constexpr std::size_t kCodes = 65536;

/// Radiance of every 16-bit code, R G B.
using Table = std::array<std::vector<float>, 3>;

}  // namespace

class PhotoRows::Tables {
 public:
  Result<std::shared_ptr<const Table>> find(const FourierCapture& capture, const std::string& text,
                                            const PhotoEncoding& encoding, const std::string& where) {
    std::scoped_lock lock(mutex_);
    auto& entry = tables_[text];
    if (entry) return entry;
    std::array<ResponseCurve, 3> curves;
    if (encoding.kind == PhotoEncoding::Kind::Response) {
      const Result<std::filesystem::path> file =
          resolveInBundle(capture.folder, encoding.responseFile, where);
      if (!file) return file.error();
      auto read = readResponse(*file);
      if (!read) return read.error();
      curves = std::move(*read);
    }
    auto table = std::make_shared<Table>();
    for (std::size_t c = 0; c < 3; ++c) {
      (*table)[c].resize(kCodes);
      for (std::size_t code = 0; code < kCodes; ++code) {
        const float value = static_cast<float>(code) / 65535.0f;
        double linear = value;
        if (encoding.kind == PhotoEncoding::Kind::Srgb) linear = linearFromSrgbPixel(value);
        if (encoding.kind == PhotoEncoding::Kind::Gamma) linear = std::pow(double{value}, encoding.gamma);
        if (encoding.kind == PhotoEncoding::Kind::Response) linear = linearFromResponse(curves[c], value);
        (*table)[c][code] = static_cast<float>(static_cast<float>(linear) * capture.radianceScale);
      }
    }
    entry = std::move(table);
    return entry;
  }

 private:
  std::mutex mutex_;
  std::map<std::string, std::shared_ptr<const Table>> tables_;
};

struct PhotoRows::State {
  std::filesystem::path file;
  std::string where;
  ImageSize size;
  double scale = 1;
  int row = 0;
  std::optional<PngRows> png;  ///< else OpenEXR
  std::shared_ptr<const Table> table;
  std::vector<std::uint16_t> codes;
};

PhotoRows::PhotoRows(std::unique_ptr<State> state) : state_(std::move(state)) {}
PhotoRows::PhotoRows(PhotoRows&&) noexcept = default;
PhotoRows& PhotoRows::operator=(PhotoRows&&) noexcept = default;
PhotoRows::~PhotoRows() = default;

std::shared_ptr<PhotoRows::Tables> PhotoRows::makeTables() {
  return std::make_shared<Tables>();
}

Result<PhotoRows> PhotoRows::open(const FourierCapture& capture, const FourierPhoto& photo,
                                  const std::shared_ptr<Tables>& tables) {
  auto state = std::make_unique<State>();
  state->where = (capture.folder / photo.file).string();
  state->size = {capture.camera.width, capture.camera.height};
  state->scale = capture.radianceScale;
  const Result<PhotoEncoding> encoding = parseEncoding(photo.encoding, state->where);
  if (!encoding) return encoding.error();
  const Result<std::filesystem::path> file = resolveInBundle(capture.folder, photo.file, state->where);
  if (!file) return file.error();
  state->file = *file;
  if (encoding->kind != PhotoEncoding::Kind::Linear) {
    auto table = tables->find(capture, photo.encoding, *encoding, state->where);
    if (!table) return table.error();
    state->table = std::move(*table);
    auto png = PngRows::open(*file, state->where, state->size);
    if (!png) return png.error();
    state->png = std::move(*png);
  }
  return PhotoRows(std::move(state));
}

Status PhotoRows::next(int rowCount, std::span<float> out) {
  State& s = *state_;
  const std::size_t rowSamples = static_cast<std::size_t>(s.size.width) * 3;
  if (out.size() != rowSamples * static_cast<std::size_t>(rowCount))
    throw std::invalid_argument("PhotoRows: room for the rows that are asked for");
  if (s.png) {
    s.codes.resize(out.size());
    Status read = s.png->next(s.codes);
    if (!read) return read;
    for (std::size_t i = 0; i < out.size(); ++i) out[i] = (*s.table)[i % 3][s.codes[i]];
  } else {
    Status read = readExrRows(s.file, s.where, {"R", "G", "B"}, s.size, s.row, rowCount, out);
    if (!read) return read;
    if (s.scale != 1.0)
      for (float& value : out) value = static_cast<float>(value * s.scale);
  }
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (std::isfinite(out[i])) continue;
    const std::size_t x = i % rowSamples / 3, y = i / rowSamples + static_cast<std::size_t>(s.row);
    return notFinite(out[i], x, y, i % 3, s.where);
  }
  s.row += rowCount;
  return Done{};
}

Status PhotoRows::skip(int rowCount) {
  State& s = *state_;
  if (!s.png) {
    s.row += rowCount;
    return Done{};
  }
  constexpr int kAtOnce = 16;
  for (int left = rowCount; left > 0; left -= kAtOnce) {
    const int count = std::min(left, kAtOnce);
    s.codes.resize(static_cast<std::size_t>(s.size.width) * 3 * static_cast<std::size_t>(count));
    Status read = s.png->next(s.codes);
    if (!read) return read;
    s.row += count;
  }
  return Done{};
}

}  // namespace patina
