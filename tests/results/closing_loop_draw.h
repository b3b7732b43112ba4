#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "devices/simulated/simulated_rig.h"
#include "engine/base/job.h"
#include "engine/base/result.h"

namespace patina::test {

/// How large the effects of a draw are.
enum class DrawStrength {
  Strong,  ///< near where the error of held-out photographs rises by half over their noise
  Weak,    ///< what all points of the sample together show and one alone doesn't
};

/// A capture drawn at random, with what it hides. Everything follows from the seed, the effects and the
/// strength: materials, rig and noise from the seed alone, so that a clean capture and one with an effect can
/// be compared.
struct DrawnCapture {
  std::uint64_t seed = 0;
  std::vector<std::string> effects;  ///< ids, as asked for; empty: a clean capture
  SimulatedRig rig;
  SimulatedSheet sheet;
  SimulatedCaptureOptions options;
  double strength = 0;        ///< of the first effect: that of the field that was drawn, of emission-angular
                              ///< the change at the screen's most oblique corner; 0 for a clean one
  std::string strengthField;  ///< "anisotropy.ratio"
  std::string summary;        ///< one line for a person
};

/// The effects that are drawn at that strength. Left out are those that a capture of kind `fourier` can't
/// show at all (channels mixed under a white light, vignetting: all in the albedos), and of the strong ones
/// those that stay below half more error at any strength that one meets.
std::vector<std::string> drawnEffects(DrawStrength strength);

/// Draws a capture. `effects`: ids of `drawnEffects` of either strength; an unknown one gives an empty
/// `DrawnCapture::options.effects`, which tests check for. `pixels`: side of the pictures; 0: 40 to 64,
/// drawn.
DrawnCapture drawCapture(std::uint64_t seed, const std::vector<std::string>& effects, DrawStrength strength,
                         int pixels = 0, double factor = 1);
/// The same with the first effect's strength given: a value of `DrawnCapture::strengthField`.
DrawnCapture drawCaptureWith(std::uint64_t seed, const std::string& effect, double strength, int pixels = 0);

/// Simulates it into `folder`, with truth/. Does nothing where the folder already holds the same draw (a file
/// beside the folder says so). Errors: those of `simulateCapture`.
Status simulateDrawn(const DrawnCapture& drawn, const std::filesystem::path& folder, const JobContext& job);

}  // namespace patina::test
