#pragma once

#include <filesystem>
#include <sstream>
#include <string>

#include "engine/twoshot/basis.h"

namespace patina::test {

/// What the sections of the two-shot page share.
struct TwoShotPage {
  std::filesystem::path data, images;  ///< test data; docs/images
  BasisPtr basis;
  bool quick = false;  ///< fewer numbers of images, one restart: to try the program
  std::ostringstream text;
  bool within = true;  ///< whether every bound was kept
};

// Each writes its section. They throw std::runtime_error with a sentence where something can't be read.
void writeErrorAgainstImages(TwoShotPage& page);
void writeLeaveOut(TwoShotPage& page);
void writeMeasuredMaterials(TwoShotPage& page);
void writeTwoShotBundles(TwoShotPage& page);

}  // namespace patina::test
