#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "engine/base/atomic_file.h"
#include "engine/base/file.h"
#include "engine/base/text.h"
#include "engine/brdf/tabulated_brdf.h"

namespace patina {
namespace {

// Source: the reader that is published with the database (Matusik et al. 2003).
constexpr std::array<double, 3> kScale = {1.0 / 1500, 1.15 / 1500, 1.66 / 1500};
constexpr std::size_t kHeaderBytes = 12;
constexpr std::size_t kFileBytes = kHeaderBytes + 3 * MerlGrid::kCells * sizeof(double);
constexpr const char* kChannelNames[] = {"red", "green", "blue"};

static_assert(std::endian::native == std::endian::little,
              "MERL files are read and written as they lie in memory");

std::uint32_t sizeAt(std::string_view bytes, int index) {
  std::uint32_t value;
  std::memcpy(&value, bytes.data() + 4 * index, sizeof value);
  return value;
}

Error malformed(std::string what, const std::string& where) {
  return {ErrorCode::Malformed, std::move(what), where, "fetch or copy the file again"};
}

/// The number so many representable numbers above (positive) or below `value`.
double stepped(double value, int steps) {
  const double towards = std::numeric_limits<double>::infinity() * (steps < 0 ? -1 : 1);
  for (int i = 0; i < std::abs(steps); ++i) value = std::nextafter(value, towards);
  return value;
}

/// How many representable numbers lie from `from` to `to`; 0 where they are too many to matter.
std::int8_t stepsBetween(double from, double to) {
  constexpr int kMost = 4;  // one division and one multiplication round by 2 at most
  for (int steps = 1; steps <= kMost; ++steps) {
    if (stepped(from, steps) == to) return static_cast<std::int8_t>(steps);
    if (stepped(from, -steps) == to) return static_cast<std::int8_t>(-steps);
  }
  return 0;
}

std::string cellName(std::size_t cell) {
  return "cell " + std::to_string(cell) + ": theta_h " +
         std::to_string(cell / (MerlGrid::kThetaD * MerlGrid::kPhiD)) + ", theta_d " +
         std::to_string(cell / MerlGrid::kPhiD % MerlGrid::kThetaD) + ", phi_d " +
         std::to_string(cell % MerlGrid::kPhiD);
}

}  // namespace

Result<std::shared_ptr<const TabulatedBrdf>> readMerlBytes(std::string_view bytes, const std::string& where) {
  if (bytes.size() < kHeaderBytes)
    return malformed("a MERL file begins with three sizes, this one is shorter", where);
  for (int i = 0; i < 3; ++i) {
    constexpr std::uint32_t kExpected[] = {MerlGrid::kThetaH, MerlGrid::kThetaD, MerlGrid::kPhiD};
    if (sizeAt(bytes, i) == kExpected[i]) continue;
    return malformed("the sizes of a MERL file are 90 x 90 x 180, but this one says " +
                         std::to_string(sizeAt(bytes, 0)) + " x " + std::to_string(sizeAt(bytes, 1)) + " x " +
                         std::to_string(sizeAt(bytes, 2)),
                     where);
  }
  if (bytes.size() != kFileBytes) {
    return malformed(std::string("the file is ") + (bytes.size() < kFileBytes ? "cut off" : "too long") +
                         ": " + std::to_string(bytes.size()) + " bytes where " + std::to_string(kFileBytes) +
                         " are needed",
                     where);
  }

  TabulatedBrdf::Planes planes;
  std::array<std::vector<std::int8_t>, 3> fileSteps;
  for (int channel = 0; channel < 3; ++channel) {
    std::vector<double>& plane = planes[channel];
    plane.resize(MerlGrid::kCells);
    fileSteps[channel].assign(MerlGrid::kCells, 0);
    std::memcpy(plane.data(), bytes.data() + kHeaderBytes + channel * MerlGrid::kCells * sizeof(double),
                MerlGrid::kCells * sizeof(double));
    for (std::size_t cell = 0; cell < MerlGrid::kCells; ++cell) {
      const double raw = plane[cell];
      if (!std::isfinite(raw)) {
        return malformed(std::string("a ") + kChannelNames[channel] + " value is not a finite number",
                         where + ", " + cellName(cell));
      }
      plane[cell] = raw * kScale[channel];
      const double back = plane[cell] / kScale[channel];
      if (back != raw) fileSteps[channel][cell] = stepsBetween(back, raw);
    }
  }
  const std::filesystem::path file(where);
  auto brdf =
      std::make_shared<TabulatedBrdf>(std::move(planes), BrdfOrigin{file.stem().string(), "merl", where, ""});
  brdf->fileSteps_ = std::move(fileSteps);
  return std::shared_ptr<const TabulatedBrdf>(std::move(brdf));
}

Result<std::shared_ptr<const TabulatedBrdf>> readMerl(const std::filesystem::path& file) {
  // One byte more than a whole file shows that it is too long.
  Result<std::string> bytes = readFile(file, kFileBytes + 1);
  if (!bytes) return bytes.error();
  return readMerlBytes(*bytes, file.string());
}

Status writeMerl(const std::filesystem::path& file, const TabulatedBrdf& brdf) {
  std::string bytes(kFileBytes, '\0');
  constexpr std::uint32_t kSizes[] = {MerlGrid::kThetaH, MerlGrid::kThetaD, MerlGrid::kPhiD};
  std::memcpy(bytes.data(), kSizes, sizeof kSizes);
  std::vector<double> raw(MerlGrid::kCells);
  for (int channel = 0; channel < 3; ++channel) {
    const std::vector<double>& plane = brdf.planes_[channel];
    const std::vector<std::int8_t>& steps = brdf.fileSteps_[channel];
    for (std::size_t cell = 0; cell < MerlGrid::kCells; ++cell) {
      // A table may mark what it doesn't know by NaN; a MERL file has only negative numbers for that.
      raw[cell] = std::isfinite(plane[cell])
                      ? stepped(plane[cell] / kScale[channel], steps.empty() ? 0 : steps[cell])
                      : -1.0;
    }
    std::memcpy(bytes.data() + kHeaderBytes + channel * MerlGrid::kCells * sizeof(double), raw.data(),
                MerlGrid::kCells * sizeof(double));
  }
  return writeFileAtomically(file, bytes);
}

}  // namespace patina
