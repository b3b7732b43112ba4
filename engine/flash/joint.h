#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "engine/base/job.h"
#include "engine/flash/texel_solver.h"

namespace patina {

/// A few thousand texels that stand for the sample.
struct FlashSample {
  std::vector<FlashSite> sites;
  int blocks = 1;
};

/// A number that texels share.
struct FlashUnknown {
  enum class Kind {
    Sigma,
    Kurtosis,
    Stretch,
    Third,
    ThirdRatio,
    Deviation,
    Tone,
    Gain,
    Beam,
    Aim,
    PhotoAim,
    Vignetting,
    Ambient,
    Black
  };
  Kind kind;
  int material = -1;  ///< of lobe shapes
  int photo = -1;
  int index = 0;       ///< channel, knot, x or y
  double priorSd = 1;  ///< about zero, or about the standard shape
  double priorMean = 0;
  double step = 1e-4;  ///< of a numerical derivative
  bool ofLobe() const { return kind <= Kind::Deviation; }
};
double& slotOf(FlashModel& model, const FlashUnknown& unknown);
/// The lobes' standard shapes.
std::vector<FlashUnknown> lobeUnknowns(const FlashModel& model);
/// What an effect adds. photos: those that are fitted (the others keep the declared light).
std::vector<FlashUnknown> effectUnknowns(FlashEffect effect, const FlashModel& model,
                                         const FlashCapture& capture, std::span<const char> photos);

/// A solution for a sample.
struct JointState {
  FlashModel model;
  std::vector<TexelVector> x;
  std::vector<TexelMatrix> information;
  double cost = 0;
  int iterations = 0;
};

struct JointOptions {
  std::vector<FlashEffect> effects;
  std::vector<char> photos;  ///< which are fitted
  int iterations = 30;
  bool learnPriors = true;  ///< materials' means, spreads and discrepancy follow the texels
};

/// Fits shared numbers and texels together by Levenberg-Marquardt, texels eliminated (Schur complement).
/// Cost: 10 ms for 2,500 texels and seven photographs, an iteration, one core. Cancelled: as far as it came.
void solveJoint(JointState& state, const FlashSample& sample, const FlashCapture& capture,
                const JointOptions& options, const JobContext& job);

/// What a model lacks, relative to value, so that the median of misfit^2 over variance is what it should be.
/// misfits: (difference^2, the sensor's variance, value^2); share: of the degrees of freedom that the texels'
/// own parameters left.
double discrepancyOf(const std::vector<std::array<double, 3>>& misfits, double share);

/// Each texel from several starts (or from where it is alone), the best kept; the model stays.
void restartTexels(JointState& state, const FlashSample& sample, std::span<const char> photos,
                   const JobContext& job, bool otherStarts = true);

/// How plainly the photographs ask for an effect that the state doesn't have: the gradient of the cost by the
/// effect's unknowns at strength zero, with everything that texels and the other unknowns could do projected
/// out, against its own scatter over the blocks of the sample (so that what the model lacks anyway, and
/// neighbours that share their errors, don't count as evidence).
struct EffectScore {
  double chi2 = 0;  ///< about chi-square with `freedom` where there is no effect
  int freedom = 0;
  double sigmas = 0;  ///< the same as standard deviations of a normal number
  double probability = 1;
  /// First guess of the unknowns and their standard deviations (one Newton step).
  Eigen::VectorXd step, sd;
};
EffectScore scoreEffect(const JointState& state, const FlashSample& sample, const FlashCapture& capture,
                        const std::vector<FlashEffect>& active, FlashEffect candidate,
                        std::span<const char> photos);

/// Standard deviations of an active effect's unknowns at a solution, scatter over blocks included.
Eigen::VectorXd unknownSd(const JointState& state, const FlashSample& sample, const FlashCapture& capture,
                          const std::vector<FlashEffect>& active, FlashEffect effect,
                          std::span<const char> photos);

/// What maps would do if an effect that is not in the model had these strengths: medians over the sample.
struct MapShift {
  double normalDeg = 0;
  double diffuse = 0, specular = 0, sigma = 0;  ///< relative
};
/// To first order, with the shared numbers following. amount: one for each of the effect's unknowns.
MapShift shiftOf(const JointState& state, const FlashSample& sample, const FlashCapture& capture,
                 const std::vector<FlashEffect>& active, FlashEffect effect, const Eigen::VectorXd& amount,
                 std::span<const char> photos);

/// The probability of a chi-square above `chi2`, and the standard deviations that are as improbable.
double chiSquareTail(double chi2, int freedom);
double sigmasOf(double probability);

}  // namespace patina
