#pragma once

#include <QString>
#include <array>
#include <optional>

#include "engine/fourier/maps.h"
#include "widgets/tone.h"

namespace patina {

/// What the picture in the middle of the window shows.
/// The first eight have a tab; a standard deviation is shown in its parameter's place.
enum class ViewKind {
  Photo,
  Diffuse,
  Specular,
  Normal,
  Sigma,
  Kurtosis,
  Residual,
  Status,
  DiffuseSd,
  SpecularSd,
  NormalSd,
  SigmaSd,
  KurtosisSd
};
inline constexpr int kViewKindCount = 13, kTabCount = 8;

/// How a kind is named, explained and coloured.
struct ViewKindInfo {
  ViewKind kind;
  const char* id;       ///< stable, for settings
  const char* title;    ///< on the tab
  const char* unit;     ///< after a value; empty: a pure number
  const char* meaning;  ///< one sentence for the tooltip
  ToneStyle style;
};

const std::array<ViewKindInfo, kViewKindCount>& viewKinds();
const ViewKindInfo& info(ViewKind kind);

/// Whether a kind is a standard deviation, the parameter that it belongs to (itself for others), and the
/// standard deviation of a parameter (none for photographs, residual and status).
bool isUncertainty(ViewKind kind);
ViewKind parameterOf(ViewKind kind);
std::optional<ViewKind> uncertaintyOf(ViewKind kind);

/// The map of a kind; null for `Photo`, and for a standard deviation in a fit of an earlier version.
const Image* mapOf(const SvbrdfMaps& maps, ViewKind kind);

/// States of texels that hold no measurement of this kind (bit i: state i): gloss is not measured where the
/// mirror point is off the screen.
unsigned unmeasuredStates(ViewKind kind);

/// "0.412 0.388 0.301" or "0.0512", with the unit.
QString valueText(ViewKind kind, std::span<const float> pixel);

}  // namespace patina
