#pragma once

#include <string>
#include <vector>

#include "engine/fourier/maps.h"
#include "engine/image/image.h"
#include "engine/render/colour_map.h"
#include "engine/render/relit_sheet.h"

namespace patina {

struct ContactSheetOptions {
  int panelSize = 300;    ///< longest side of a panel, pixels
  std::string title;      ///< one line above; letters are shown as capitals
  bool withRelit = true;  ///< a last panel: the sheet under a light
};

/// All maps of a fit on one page, display-encoded R G B: albedos (specular brightened by a power of two, said
/// in its label), normals (slopes times four), sigma, kurtosis and residual in colours with their range,
/// status, and the sheet relit. Ranges run from the 1st to the 99th percentile of measured texels. Where
/// gloss was not measured (mirror point off the screen) sigma, kurtosis and specular are hatched; unmeasured
/// texels are grey. Empty maps give an empty image.
Image contactSheet(const SvbrdfMaps& maps, const ContactSheetOptions& options = {});

/// A one-channel map in colours over `low` to `high`, at the map's own size, display-encoded.
Image colouredMap(const Image& map, float low, float high, ColourMap colours);

/// The value below which `fraction` of the measured texels of a one-channel map lie; 0 where none was
/// measured.
float mapPercentile(const SvbrdfMaps& maps, const Image& map, float fraction);

/// `relitSheet` exposed for the display, on the page's own grey; `view.background` is not used.
Image relitPicture(const SvbrdfMaps& maps, const PointLight& light, SheetView view);

/// Pictures side by side with a margin and a label below each; display-encoded. Sizes may differ.
Image labelledRow(const std::vector<Image>& pictures, const std::vector<std::string>& labels);

}  // namespace patina
