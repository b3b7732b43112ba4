#include "engine/acquire/capture_plan.h"

#include <algorithm>
#include <cmath>
#include <map>

namespace patina {

std::vector<Eigen::Vector2i> paperFrequencies() {
  std::vector<Eigen::Vector2i> list;
  for (const int w : {1, 2, 3, 4, 6, 10, 20, 40})
    for (const Eigen::Vector2i& f :
         {Eigen::Vector2i(w, 0), Eigen::Vector2i(0, w), Eigen::Vector2i(w, w), Eigen::Vector2i(w, -w)})
      list.push_back(f);
  return list;
}

std::vector<Eigen::Vector2i> heldOutFrequencies() {
  return {{5, 0}, {0, 5}, {8, 8}, {8, -8}, {14, 0}, {0, 14}, {3, 1}, {7, 3}, {12, -5}};
}

PhotoRole PlannedPhoto::role() const {
  switch (pattern.kind) {
    case PatternSpec::Kind::Sine:
      return PhotoRole::Pattern;
    case PatternSpec::Kind::Window:
      return PhotoRole::Window;
    case PatternSpec::Kind::Black:
      return PhotoRole::Black;
    default:
      return PhotoRole::Geometry;
  }
}

CapturePlan makeCapturePlan(const CapturePlanOptions& options) {
  CapturePlan plan;
  const auto add = [&](PatternSpec::Kind kind, Eigen::Vector2i frequency, int phase, bool holdout) {
    PlannedPhoto photo;
    photo.pattern.kind = kind;
    photo.pattern.frequency = frequency;
    photo.pattern.phase = phase;
    photo.holdout = holdout;
    plan.photos.push_back(photo);
  };
  add(PatternSpec::Kind::Window, {0, 0}, 0, false);
  add(PatternSpec::Kind::Black, {0, 0}, 0, false);
  struct Entry {
    Eigen::Vector2i frequency;
    bool holdout;
  };
  std::vector<Entry> entries;
  for (const Eigen::Vector2i& f : options.fitted) entries.push_back({f, false});
  for (const Eigen::Vector2i& f : options.heldOut) entries.push_back({f, true});
  std::ranges::stable_sort(entries, {}, [](const Entry& entry) { return entry.frequency.squaredNorm(); });
  for (const Entry& entry : entries)
    for (int phase = 0; phase < 4; ++phase)
      add(PatternSpec::Kind::Sine, entry.frequency, phase, entry.holdout);
  if (options.windowAgain) add(PatternSpec::Kind::Window, {0, 0}, 0, true);
  return plan;
}

std::uint64_t CapturePlan::hash() const {
  std::uint64_t value = 0xCBF29CE484222325ull;  // FNV-1a over the plan's numbers
  const auto mix = [&](std::uint64_t number) {
    for (int byte = 0; byte < 8; ++byte) {
      value ^= number >> (8 * byte) & 0xFF;
      value *= 0x100000001B3ull;
    }
  };
  for (const PlannedPhoto& photo : photos)
    for (const int number : {static_cast<int>(photo.pattern.kind), photo.pattern.frequency.x(),
                             photo.pattern.frequency.y(), photo.pattern.phase, photo.holdout ? 1 : 0})
      mix(static_cast<std::uint32_t>(number));
  return value;
}

std::vector<Eigen::Vector2i> tooFine(const std::vector<Eigen::Vector2i>& frequencies, const Screen& screen) {
  constexpr double kLeastPixels = 4;  // a wave: dithering and the pixel grid spoil finer ones
  std::vector<Eigen::Vector2i> fine;
  for (const Eigen::Vector2i& f : frequencies) {
    const double along = static_cast<double>(screen.widthPx) / std::max(1, std::abs(f.x()));
    // Waves over the height: frequencies count over the width in both directions.
    const double down = screen.heightPx * screen.aspect() / std::max(1, std::abs(f.y()));
    if (along < kLeastPixels || down < kLeastPixels) fine.push_back(f);
  }
  return fine;
}

}  // namespace patina
