#include "engine/diagnosis/two_shot_candidates.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace patina {
namespace {

using Eigen::VectorXd;

constexpr double kDegree = std::numbers::pi / 180;
/// A retroreflecting lobe is looked for where light and view come this near to each other; a coat's where the
/// half-vector comes this near to the normal.
constexpr double kRetroWithinDeg = 14, kCoatWithinDeg = 25;
constexpr std::size_t kFewestRows = 12;
/// Tilts are looked for from places this far apart, in so many rings: a glossy plastic's highlight is about a
/// degree wide.
constexpr double kTiltStepDeg = 0.5;
constexpr int kTiltRings = 8;

TwoShotCandidate made(const char* id, const char* variant,
                      std::vector<TwoShotCandidate::Parameter> parameters,
                      std::function<void(const VectorXd&, TwoShotDeviation&)> apply) {
  TwoShotCandidate candidate;
  candidate.id = id, candidate.variant = variant;
  candidate.parameters = std::move(parameters);
  candidate.apply = std::move(apply);
  VectorXd start(static_cast<Eigen::Index>(candidate.parameters.size()));
  for (Eigen::Index i = 0; i < start.size(); ++i) start[i] = candidate.parameters[i].middle;
  candidate.starts = {start};
  return candidate;
}

Eigen::Array3d hue(double lnRed, double lnBlue) {
  return {std::exp(std::clamp(lnRed, -3.0, 3.0)), 1, std::exp(std::clamp(lnBlue, -3.0, 3.0))};
}

struct Reach {
  std::size_t nearLight = 0, nearMirror = 0;
  double smallestApartDeg = 180, smallestThetaHDeg = 90;
};

Reach reachOf(const DiagnosisData& data) {
  Reach reach;
  const TwoShotDeviation none;
  for (const DiagnosisRow& row : data.fitted) {
    const HalfDiffAngles angles = none.angles(none.directions(row.point));
    const double apart = 2 * angles.thetaDRad / kDegree, thetaH = angles.thetaHRad / kDegree;
    reach.nearLight += apart < kRetroWithinDeg;
    reach.nearMirror += thetaH < kCoatWithinDeg;
    reach.smallestApartDeg = std::min(reach.smallestApartDeg, apart);
    reach.smallestThetaHDeg = std::min(reach.smallestThetaHDeg, thetaH);
  }
  return reach;
}

std::vector<std::size_t> usedShots(const DiagnosisData& data) {
  std::vector<std::size_t> shots;
  for (std::size_t s = 0; s < data.shots.size(); ++s)
    if (data.shots[s].used) shots.push_back(s);
  return shots;
}

void setUp(const TwoShotCapture& capture, const DiagnosisData& data, std::vector<TwoShotCandidate>& list) {
  const std::vector<std::size_t> used = usedShots(data);
  const std::size_t shots = capture.shots.size();
  TwoShotCandidate tilt =
      made("sample-tilt", "",
           {{"aboutXDeg", "degrees", 0, 1.5, false, ""}, {"aboutYDeg", "degrees", 0, 1.5, false, ""}},
           [](const VectorXd& p, TwoShotDeviation& d) { d.tiltDeg += p.head<2>(); });
  // A narrow highlight that has moved by more than its width has no slope to follow: places all around.
  for (int ring = 1; ring <= kTiltRings; ++ring) {
    for (int turn = 0; turn < 6 * ring; ++turn) {
      const double angle = turn * std::numbers::pi / (3 * ring);
      tilt.starts.push_back(ring * kTiltStepDeg * Eigen::Vector2d(std::cos(angle), std::sin(angle)));
    }
  }
  list.push_back(std::move(tilt));
  double distance = 0;
  for (const TwoShotPhoto& shot : capture.shots)
    distance = std::max(distance, shot.camera.positionMm().norm());
  list.push_back(made("sample-height", "", {{"heightMm", "mm", 0, 0.02 * distance, false, ""}},
                      [](const VectorXd& p, TwoShotDeviation& d) { d.heightMm += p[0]; }));
  for (const double share : {-0.05, -0.02, 0.02, 0.05})
    list.back().starts.push_back(VectorXd::Constant(1, share * distance));
  for (const bool alike : {true, false}) {
    list.push_back(made("near-light", alike ? "tile under the same light" : "fall-off over the sample",
                        {{"perDistance", "1/m", 0, 0.7, false, ""}},
                        [alike](const VectorXd& p, TwoShotDeviation& d) {
                          d.lightPerM += p[0];
                          d.whiteLitAlike = alike;
                        }));
    for (const double perM : {0.3, 0.7, 1.2, 2.0}) list.back().starts.push_back(VectorXd::Constant(1, perM));
  }
  // How lenses darken differs: the loss in the corner, and how much of it comes late.
  list.push_back(
      made("vignetting", "", {{"cornerLoss", "", 0, 0.2, false, ""}, {"late", "", 0, 0.05, false, ""}},
           [](const VectorXd& p, TwoShotDeviation& d) { d.vignetting += p[0], d.vignettingLate += p[1]; }));
  for (const double loss : {0.15, 0.3, 0.5}) list.back().starts.push_back(Eigen::Vector2d(loss, 0));

  // Stray light: the same everywhere, or in proportion to what each photograph holds.
  Eigen::Array3d mean = Eigen::Array3d::Zero();
  std::vector<Eigen::Array3d> level(shots, Eigen::Array3d::Zero());
  for (const std::size_t s : used) {
    mean += data.shots[s].level.max(0.0) / static_cast<double>(used.size());
    // Light that strays in a lens or a room is no more coloured than the sensor is.
    level[s].setConstant(data.shots[s].level.max(0.0).mean());
  }
  const auto room = [shots](TwoShotDeviation& d) {
    if (d.stray.empty()) d.stray.assign(shots, Eigen::Array3d::Zero());
  };
  list.push_back(made("stray-light", "the same in all photographs",
                      {{"strayRed", "of the mean level", 0, 0.06, false, ""},
                       {"strayGreen", "of the mean level", 0, 0.06, false, ""},
                       {"strayBlue", "of the mean level", 0, 0.06, false, ""}},
                      [mean, room](const VectorXd& p, TwoShotDeviation& d) {
                        room(d);
                        for (Eigen::Array3d& s : d.stray) s += p.head<3>().array() * mean;
                      }));
  // What the surroundings say, where they were photographed twice: where searches begin.
  std::vector<Eigen::Array3d> beside(shots, Eigen::Array3d::Zero()), white = beside;
  for (const SurroundingBlock& block : data.surroundings)
    beside[block.shot] += block.beside, white[block.shot] += block.white;
  std::vector<double> blocks(shots, 0.0);
  for (const SurroundingBlock& block : data.surroundings) ++blocks[block.shot];
  VectorXd added(static_cast<Eigen::Index>(used.size())), factor = added;
  for (std::size_t i = 0; i < used.size(); ++i) {
    const std::size_t s = used[i];
    const double n = std::max(blocks[s], 1.0), sum = white[s].sum();
    added[i] = (beside[s] - white[s]).sum() / n / std::max(level[s].sum(), 1e-12);
    factor[i] = sum > 0 && beside[s].sum() > 0 ? std::log(beside[s].sum() / sum) : 0.0;
  }
  // One share, from which photographs differ a little: which level it goes with is the room's secret, and a
  // held-out photograph's own can't be told from its surroundings alone.
  std::vector<TwoShotCandidate::Parameter> each{
      {"strayShare", "of each photograph's level", 0, 0.06, false, ""},
      {"lnRed", "natural log", 0, 0.3, false, ""},
      {"lnBlue", "natural log", 0, 0.3, false, ""}};
  for (const std::size_t s : used)
    each.push_back({"lnOwn", "natural log", 0, 0.2, false, capture.shots[s].file});
  list.push_back(made("stray-light", "in proportion to each photograph", each,
                      [level, room, used](const VectorXd& p, TwoShotDeviation& d) {
                        room(d);
                        for (std::size_t i = 0; i < used.size(); ++i)
                          d.stray[used[i]] +=
                              p[0] * level[used[i]] * hue(p[1], p[2]) *
                              std::exp(std::clamp(p[3 + static_cast<Eigen::Index>(i)], -2.0, 2.0));
                      }));
  {
    VectorXd start = VectorXd::Zero(added.size() + 3);
    const double mean = added.size() > 0 ? added.mean() : 0.0;
    start[0] = mean;
    for (Eigen::Index i = 0; i < added.size() && mean > 0; ++i)
      start[3 + i] = std::clamp(std::log(std::max(added[i] / mean, 0.3)), -0.6, 0.6);
    list.back().starts.push_back(start);
  }
  each.clear();
  for (const std::size_t s : used)
    each.push_back({"lnFactor", "natural log", 0, 0.12, false, capture.shots[s].file});
  list.push_back(made("exposure-mismatch", "", each, [shots, used](const VectorXd& p, TwoShotDeviation& d) {
    if (d.lnGain.empty()) d.lnGain.assign(shots, 0.0);
    for (std::size_t i = 0; i < used.size(); ++i) d.lnGain[used[i]] += p[i];
  }));
  list.back().starts.push_back(factor);
  // A held-out photograph's own factor is known from itself alone.
  std::vector<std::size_t> held;
  each.clear();
  for (const std::size_t s : used) {
    if (!data.shots[s].holdout) continue;
    held.push_back(s);
    each.push_back({"lnFactor", "natural log", 0, 0.2, false, capture.shots[s].file});
  }
  if (!held.empty()) {
    list.push_back(made("exposure-mismatch", "of held-out photographs", each,
                        [shots, held](const VectorXd& p, TwoShotDeviation& d) {
                          if (d.lnGain.empty()) d.lnGain.assign(shots, 0.0);
                          for (std::size_t i = 0; i < held.size(); ++i)
                            d.lnGain[held[i]] += p[static_cast<Eigen::Index>(i)];
                        }));
    list.back().heldOnly = true, list.back().linear = false;
  }

  const double top = [&] {
    double largest = 0;
    for (const std::size_t s : used) largest = std::max(largest, data.shots[s].largest);
    return capture.saturation > 0 ? capture.saturation : std::max(largest, 1e-6);
  }();
  list.push_back(made("camera-response", "", {{"lnExponent", "natural log", 0, 0.1, false, ""}},
                      [top](const VectorXd& p, TwoShotDeviation& d) {
                        d.lnResponse += p[0];
                        d.responseTop = top;
                      }));
  list.push_back(made("channel-crosstalk", "", {{"share", "", 0, 0.05, false, ""}},
                      [](const VectorXd& p, TwoShotDeviation& d) { d.crosstalk += p[0]; }));
  for (const double px : {kBlurPx[1], kBlurPx[2], kBlurPx[3]}) {
    char variant[32];
    std::snprintf(variant, sizeof variant, "over %.0f pixels", px);
    list.push_back(made("glare", variant, {{"share", "", 0, 0.08, false, ""}},
                        [px](const VectorXd& p, TwoShotDeviation& d) { d.glare += p[0], d.glarePx = px; }));
  }
  list.push_back(made("defocus", "", {{"variancePx2", "square pixels", 0, 1, false, ""}},
                      [](const VectorXd& p, TwoShotDeviation& d) {
                        d.defocusPx = std::copysign(std::sqrt(std::abs(p[0])), p[0]);
                      }));
  bool exposuresDiffer = false;
  for (const std::size_t s : used)
    exposuresDiffer |=
        std::abs(capture.shots[s].exposureS / capture.shots[used.front()].exposureS - 1) > 0.01;
  double seconds = 1;
  for (const std::size_t s : used) seconds = std::min(seconds, capture.shots[s].exposureS);
  const Eigen::Array3d pixels = mean * seconds;
  TwoShotCandidate black = made(
      "black-level", "",
      {{"levelRed", "of the mean level", 0, 0.06, false, ""},
       {"levelGreen", "of the mean level", 0, 0.06, false, ""},
       {"levelBlue", "of the mean level", 0, 0.06, false, ""}},
      [pixels](const VectorXd& p, TwoShotDeviation& d) { d.blackLevel += p.head<3>().array() * pixels; });
  if (!exposuresDiffer)
    black.unobservable = "all exposure times are the same, so that it looks exactly like stray light";
  list.push_back(std::move(black));
}

void surface(const DiagnosisData& data, std::vector<TwoShotCandidate>& list) {
  const Reach reach = reachOf(data);
  char text[160];
  TwoShotCandidate retro = made("retroreflection", "",
                                {{"weightRed", "1/sr", 0, 2, true, ""},
                                 {"weightGreen", "1/sr", 0, 2, true, ""},
                                 {"weightBlue", "1/sr", 0, 2, true, ""},
                                 {"widthDeg", "degrees", std::log(3.0), 0.7, true, ""},
                                 {"tail", "", 0.5, 0.8, true, ""},
                                 {"incidence", "", 2, 2, false, ""}},
                                [](const VectorXd& p, TwoShotDeviation& d) {
                                  RetroLobe lobe;
                                  lobe.weight = p.head<3>().array().min(9).max(-9).exp();
                                  lobe.widthDeg = std::exp(std::clamp(p[3], -1.5, 3.5));
                                  lobe.tail = std::exp(std::clamp(p[4], -1.5, 2.0));
                                  lobe.incidence = std::clamp(p[5], 0.0, 20.0);
                                  d.retro = lobe;
                                });
  retro.surface = true, retro.linear = false;
  retro.starts.clear();
  // Beams with long tails (glass beads) and without (prisms; the width is then that of the core's, widened).
  for (const double tail : {0.0, 1.6}) {
    for (const double width : {1.5, 5.0}) {
      for (const double weight : {0.1, 1.0, 8.0, 50.0}) {
        VectorXd start(6);
        start << std::log(weight), std::log(weight), std::log(weight),
            std::log(width * std::sqrt(std::exp(tail))), tail, 2;
        retro.starts.push_back(start);
      }
    }
  }
  if (reach.nearLight < kFewestRows) {
    std::snprintf(text, sizeof text,
                  "no photograph looks along the light: the nearest directions are %.0f degrees apart",
                  reach.smallestApartDeg);
    retro.unobservable = text;
  }
  list.push_back(std::move(retro));

  TwoShotCandidate coat =
      made("clearcoat", "",
           {{"weight", "", std::log(0.5), 1.2, true, ""}, {"alpha", "", std::log(0.1), 0.8, true, ""}},
           [](const VectorXd& p, TwoShotDeviation& d) {
             CoatLobe lobe;
             lobe.weight = std::exp(std::clamp(p[0], -9.0, 3.0));
             lobe.alpha = std::exp(std::clamp(p[1], -4.5, -0.7));
             d.coat = lobe;
           });
  coat.surface = true, coat.linear = false;
  coat.starts.clear();
  for (const double alpha : {0.03, 0.07, 0.15, 0.3}) {
    for (const double weight : {0.02, 0.1, 0.4, 1.0, 2.0}) {
      VectorXd start(2);
      start << std::log(weight), std::log(alpha);
      coat.starts.push_back(start);
    }
  }
  if (reach.nearMirror < kFewestRows) {
    std::snprintf(
        text, sizeof text,
        "no photograph comes near the mirror direction: the half-vector is at least %.0f degrees off the "
        "normal",
        reach.smallestThetaHDeg);
    coat.unobservable = text;
  }
  list.push_back(std::move(coat));

  TwoShotCandidate stretch =
      made("anisotropy", "", {{"alongX", "", 0, 0.1, false, ""}, {"diagonal", "", 0, 0.1, false, ""}},
           [](const VectorXd& p, TwoShotDeviation& d) { d.stretch += p.head<2>(); });
  stretch.surface = true;
  list.push_back(std::move(stretch));
  TwoShotCandidate tint = made("iridescence", "",
                               {{"redBlue", "natural log", 0, 0.4, false, ""},
                                {"redBlueSquare", "natural log", 0, 0.4, false, ""},
                                {"green", "natural log", 0, 0.4, false, ""},
                                {"greenSquare", "natural log", 0, 0.4, false, ""}},
                               [](const VectorXd& p, TwoShotDeviation& d) {
                                 d.tint(0, 0) += p[0], d.tint(0, 1) += p[1], d.tint(1, 0) += p[2],
                                     d.tint(1, 1) += p[3];
                               });
  tint.surface = true;
  list.push_back(std::move(tint));
  TwoShotCandidate sheen = made("sheen", "", {{"weight", "1/sr", 0, 0.1, false, ""}},
                                [](const VectorXd& p, TwoShotDeviation& d) { d.sheen += p[0]; });
  sheen.surface = true;
  list.push_back(std::move(sheen));
  TwoShotCandidate fresnel = made("fresnel", "", {{"lnAtGrazing", "natural log", 0, 0.7, false, ""}},
                                  [](const VectorXd& p, TwoShotDeviation& d) { d.fresnel += p[0]; });
  fresnel.surface = true;
  list.push_back(std::move(fresnel));
  TwoShotCandidate unnamed = made("basis-deviation", "", {{"relativeChange", "", 0, 1, false, ""}},
                                  [](const VectorXd&, TwoShotDeviation&) {});
  unnamed.surface = unnamed.free = true, unnamed.linear = false;
  list.push_back(std::move(unnamed));
}

}  // namespace

std::vector<TwoShotCandidate> twoShotCandidates(const TwoShotCapture& capture, const DiagnosisData& data) {
  std::vector<TwoShotCandidate> list;
  setUp(capture, data, list);
  surface(data, list);
  // Smaller than what calibration and aiming leave anyway; a light farther than ten metres is distant.
  struct Bound {
    const char* id;
    double least;
    bool positive;
  };
  for (const Bound& bound :
       {Bound{"sample-tilt", 0.1, false}, Bound{"sample-height", 0.5, false}, Bound{"near-light", 0.1, true},
        Bound{"vignetting", 0.01, true}, Bound{"stray-light", 0.003, true},
        Bound{"exposure-mismatch", 0.01, false}, Bound{"camera-response", 0.01, false},
        Bound{"channel-crosstalk", 0.005, true}, Bound{"glare", 0.003, true}, Bound{"defocus", 0.1, true},
        Bound{"black-level", 0.003, true}, Bound{"anisotropy", 0.01, false}}) {
    for (TwoShotCandidate& candidate : list)
      if (candidate.id == bound.id) candidate.least = bound.least, candidate.positive = bound.positive;
  }
  return list;
}

}  // namespace patina
