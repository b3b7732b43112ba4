#include "engine/diagnosis/flash_trials.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace patina {
namespace {

/// More folds than this tell little more and cost as much again.
constexpr int kMostFolds = 7;
constexpr int kRefitIterations = 22, kFoldIterations = 5;

bool has(const std::vector<FlashEffect>& effects, FlashEffect effect) {
  return std::find(effects.begin(), effects.end(), effect) != effects.end();
}

double predictedValue(const FlashTrial& trial, const SeenPrediction& p, int channel) {
  const double limit = trial.data.clip[static_cast<std::size_t>(channel)];
  const double value = std::max(0.0, p.value[channel]);
  return limit > 0 ? std::min(value, limit) : value;
}

double seenValue(const FlashTrial& trial, const FlashObservation& seen, int channel) {
  // A texel with a clipped pixel is a lower bound; its own average is what a photograph of it shows.
  const double limit = trial.data.clip[static_cast<std::size_t>(channel)];
  return limit > 0 ? std::min(seen.value[channel], limit) : seen.value[channel];
}

}  // namespace

Result<FlashTrial> readTrial(const FlashCapture& capture, int size, int texels, const JobContext& job) {
  FlashTrial trial;
  auto data = readFlashData(capture, size, job);
  if (!data) return data.error();
  trial.data = std::move(*data);
  const std::size_t at = sampleLevel(trial.data);
  FlashLevel level = trial.data.levels[at];
  trial.grid = level.grid;
  // Materials come from the fitted photographs alone.
  const FlashSample fitted = drawSample(trial.data, level, texels);
  if (fitted.sites.empty()) {
    return Error{ErrorCode::Invalid, "no texel of the sample is seen by any photograph",
                 capture.folder.string(), "check the cameras and the sample's size"};
  }
  std::vector<Eigen::Array3d> colours;
  for (const FlashSite& site : fitted.sites) colours.push_back(darkColour(site));
  trial.palette = findMaterials(colours, 0);
  for (std::size_t k = 0; k < capture.photos.size(); ++k) {
    trial.fitted.push_back(!capture.photos[k].holdout);
    trial.heldOut.push_back(capture.photos[k].holdout);
    if (!capture.photos[k].holdout) continue;
    auto pixels = readFlashPixels(capture, capture.photos[k]);
    if (!pixels) return pixels.error();
    level.sheets[k] = sheetOf(capture, static_cast<int>(k), *pixels, level.grid, trial.data.clip);
  }
  trial.sample = drawSample(trial.data, level, texels);
  // The same texels: held-out photographs only add to what is seen of them, or they see more.
  std::size_t f = 0;
  std::vector<FlashSite> sites;
  for (FlashSite& site : trial.sample.sites) {
    if (f >= fitted.sites.size() || site.pointMm != fitted.sites[f].pointMm) continue;
    site.material = trial.palette.nearest(darkColour(fitted.sites[f]));
    sites.push_back(std::move(site));
    ++f;
  }
  trial.sample.sites = std::move(sites);
  std::vector<int> indices;
  for (std::size_t k = 0; k < capture.photos.size(); ++k)
    if (trial.fitted[k]) indices.push_back(static_cast<int>(k));
  const int folds = std::min<int>(kMostFolds, static_cast<int>(indices.size()));
  if (indices.size() > 1) {
    trial.folds.resize(static_cast<std::size_t>(folds));
    for (std::size_t i = 0; i < indices.size(); ++i)
      trial.folds[i % static_cast<std::size_t>(folds)].push_back(indices[i]);
  }
  return trial;
}

double FlashErrors::rms() const {
  const double sum = values.sum();
  return sum > 0 ? std::sqrt(squares.sum() / sum) : -1;
}

FlashErrors errorsOf(const FlashTrial& trial, const JointState& state, const std::vector<char>& which,
                     bool freePower) {
  const auto photos = static_cast<Eigen::Index>(which.size());
  FlashErrors errors;
  errors.squares = errors.values = Eigen::MatrixXd::Zero(photos, trial.sample.blocks);
  FlashModel model = state.model;
  // Power measured on one half of the blocks, by the ratio of sums, judged on the other.
  std::vector<std::array<double, 2>> gain(which.size(), {0, 0});
  if (freePower) {
    std::vector<std::array<double, 4>> sums(which.size(), {1e-12, 1e-12, 1e-12, 1e-12});
    for (int round = 0; round < 2; ++round) {
      for (std::size_t k = 0; k < which.size(); ++k) sums[k] = {1e-12, 1e-12, 1e-12, 1e-12};
      for (std::size_t s = 0; s < trial.sample.sites.size(); ++s) {
        const FlashSite& site = trial.sample.sites[s];
        const auto half = static_cast<std::size_t>(site.block % 2 == (site.block / 8) % 2);
        for (const FlashObservation& seen : site.seen) {
          const auto k = static_cast<std::size_t>(seen.photo);
          if (!which[k] || seen.clipped) continue;
          model.rig.logGain[k] = state.model.rig.logGain[k] + gain[k][1 - half];
          const SeenPrediction p = predictSeen(model, site.material, seen, state.x[s], false);
          for (int c = 0; c < 3; ++c) {
            // As a correction of the logarithm of light, seen through the tone curve.
            const double by = p.slope[c] * p.flashLight[c];
            sums[k][half] += by * by, sums[k][2 + half] += by * (seen.value[c] - p.value[c]);
          }
        }
      }
      for (std::size_t k = 0; k < which.size(); ++k)
        for (std::size_t half = 0; half < 2; ++half)
          gain[k][1 - half] += std::clamp(sums[k][2 + half] / sums[k][half], -0.7, 0.7);
      // gain[k][h] is used on half h's opposite: measured on half, stored for the other.
    }
  }
  for (std::size_t s = 0; s < trial.sample.sites.size(); ++s) {
    const FlashSite& site = trial.sample.sites[s];
    const auto half = static_cast<std::size_t>(site.block % 2 == (site.block / 8) % 2);
    for (const FlashObservation& seen : site.seen) {
      const auto k = static_cast<std::size_t>(seen.photo);
      if (!which[k]) continue;
      model.rig.logGain[k] = state.model.rig.logGain[k] + gain[k][half];
      const SeenPrediction p = predictSeen(model, site.material, seen, state.x[s], false);
      for (int c = 0; c < 3; ++c) {
        const double v = seenValue(trial, seen, c), d = predictedValue(trial, p, c) - v;
        errors.squares(seen.photo, site.block) += d * d;
        errors.values(seen.photo, site.block) += v * v;
      }
    }
  }
  return errors;
}

double chi2Of(const FlashTrial& trial, const JointState& state) {
  double sum = 0, count = 0;
  for (std::size_t s = 0; s < trial.sample.sites.size(); ++s) {
    const FlashSite& site = trial.sample.sites[s];
    for (const FlashObservation& seen : site.seen) {
      if (!trial.fitted[static_cast<std::size_t>(seen.photo)]) continue;
      const SeenPrediction p = predictSeen(state.model, site.material, seen, state.x[s], false);
      for (int c = 0; c < 3; ++c) {
        double d = p.value[c] - seen.value[c];
        if (((seen.clipped >> c) & 1) && d > 0) d = 0;
        sum += d * d / seen.variance[c], count += 1;
      }
    }
  }
  return count > 0 ? sum / count : 0;
}

FlashTry tryEffects(const FlashTrial& trial, const JointState& start, const std::vector<FlashEffect>& effects,
                    const JobContext& job) {
  FlashTry result;
  result.effects = effects;
  result.state = start;
  JointOptions options;
  options.effects = effects;
  options.photos = trial.fitted;
  options.iterations = kRefitIterations;
  if (has(effects, FlashEffect::ThirdLobe)) {
    // From nothing the third lobe's width has no derivative.
    for (FlashMaterial& material : result.state.model.materials)
      if (!(material.lobe.thirdShare > 0)) material.lobe.thirdShare = 0.1;
  }
  solveJoint(result.state, trial.sample, trial.data.capture, options, job);
  result.held = errorsOf(trial, result.state, trial.heldOut, false);
  result.chi2 = chi2Of(trial, result.state);
  const auto photos = static_cast<Eigen::Index>(trial.fitted.size());
  result.left.squares = result.left.values = Eigen::MatrixXd::Zero(photos, trial.sample.blocks);
  for (const std::vector<int>& fold : trial.folds) {
    if (job.cancelled()) return result;
    JointState state = result.state;
    JointOptions without = options;
    without.iterations = kFoldIterations;
    without.learnPriors = false;
    std::vector<char> judged(trial.fitted.size(), 0);
    for (const int k : fold) {
      without.photos[static_cast<std::size_t>(k)] = 0;
      judged[static_cast<std::size_t>(k)] = 1;
      state.model.rig.photoAim[static_cast<std::size_t>(k)].setZero();
    }
    // Texels must forget the photograph before they are asked for it.
    restartTexels(state, trial.sample, without.photos, job, false);
    solveJoint(state, trial.sample, trial.data.capture, without, job);
    restartTexels(state, trial.sample, without.photos, job, false);
    const FlashErrors errors = errorsOf(trial, state, judged, true);
    result.left.squares += errors.squares, result.left.values += errors.values;
  }
  return result;
}

FlashGain gainOf(const FlashErrors& before, const FlashErrors& after) {
  FlashGain gain;
  const double all = before.squares.sum();
  if (!(all > 0)) return gain;
  gain.share = (before.squares - after.squares).sum() / all;
  // By how much each photograph (each block) is predicted better, as a logarithm: one that gains much doesn't
  // make the others' gains doubtful. The less certain of the two counts.
  const auto certainty = [](const Eigen::VectorXd& from, const Eigen::VectorXd& to) {
    double count = 0, mean = 0, squares = 0;
    for (Eigen::Index i = 0; i < from.size(); ++i)
      if (from[i] > 0 && to[i] > 0) count += 1, mean += std::log(from[i] / to[i]);
    if (count < 2) return 0.0;
    mean /= count;
    for (Eigen::Index i = 0; i < from.size(); ++i) {
      if (!(from[i] > 0 && to[i] > 0)) continue;
      const double d = std::log(from[i] / to[i]) - mean;
      squares += d * d;
    }
    const double sd = std::sqrt(squares / (count * (count - 1)));
    return sd > 0 ? mean / sd : 0.0;
  };
  // An effect of one material of several gains on few blocks, but much: for it the sums say more.
  const auto certaintyOfSum = [](const Eigen::VectorXd& from, const Eigen::VectorXd& to) {
    double count = 0, squares = 0;
    for (Eigen::Index i = 0; i < from.size(); ++i) count += from[i] > 0;
    if (count < 2) return 0.0;
    const double mean = (from - to).sum() / count;
    for (Eigen::Index i = 0; i < from.size(); ++i)
      if (from[i] > 0) squares += (from[i] - to[i] - mean) * (from[i] - to[i] - mean);
    const double sd = std::sqrt(squares * count / (count - 1));
    return sd > 0 ? count * mean / sd : 0.0;
  };
  const Eigen::VectorXd photosBefore = before.squares.rowwise().sum(),
                        photosAfter = after.squares.rowwise().sum();
  const Eigen::VectorXd blocksBefore = before.squares.colwise().sum().transpose(),
                        blocksAfter = after.squares.colwise().sum().transpose();
  gain.sigmas = std::max(
      std::min(certainty(photosBefore, photosAfter), certainty(blocksBefore, blocksAfter)),
      std::min(certaintyOfSum(photosBefore, photosAfter), certaintyOfSum(blocksBefore, blocksAfter)));
  return gain;
}

}  // namespace patina
