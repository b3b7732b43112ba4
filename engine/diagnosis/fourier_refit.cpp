#include "engine/diagnosis/fourier_refit.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "engine/diagnosis/site_horizon.h"

namespace patina {
namespace {

bool isOneOf(std::string_view id, std::initializer_list<std::string_view> all) {
  return std::ranges::find(all, id) != all.end();
}

/// The state's variable behind a dense column; null where the column has none.
double* variable(EffectState& state, const EffectColumn& column, int material) {
  const std::string_view id = column.effect, name = column.name;
  while (static_cast<int>(state.material.size()) <= material) state.material.emplace_back();
  EffectState::Material* m = material >= 0 ? &state.material[static_cast<std::size_t>(material)] : nullptr;
  if (name == "level") return &state.level;
  if (id == "screen-drift") return &state.drift[name == "fast" ? 0 : name == "slow" ? 1 : 2];
  if (id == "screen-pose") {
    const int k = name == "turn x"    ? 0
                  : name == "turn y"  ? 1
                  : name == "turn z"  ? 2
                  : name == "shift x" ? 3
                  : name == "shift y" ? 4
                                      : 5;
    return &state.pose[k];
  }
  if (id == "sample-tilt") return &state.height[name == "x" ? 1 : 2];
  if (id == "sample-height")
    return &state.height[name == "1" ? 0 : name == "x^2" ? 3 : name == "x y" ? 4 : 5];
  if (id == "glare") return &state.glare;
  if (id == "defocus") return &state.defocus;
  if (id == "subsurface") return &state.subsurface[name == "2 mm" ? 0 : 1];
  if (id == "camera-response") return name == "gamma" ? &state.responseGamma : &state.responseCompression;
  if (id == "black-level") return &state.blackOffset;
  if (id == "stray-light") return &state.stray;
  if (id == "saturation") return &state.saturation[name == "0.6" ? 0 : 1];
  if (id == "channel-crosstalk") {
    const auto channel = [](char c) { return c == 'R' ? 0 : c == 'G' ? 1 : 2; };
    return &state.mix(channel(name[0]), channel(name[1]));
  }
  if (!m) return nullptr;
  if (id == "anisotropy") return &m->stretch[name == "stretch 1" ? 0 : 1];
  if (id == "third-lobe") return &m->third[name == "near" ? 0 : 1];
  if (id == "fresnel") return &m->fresnelPower;
  if (id == "sheen") return &m->sheen;
  if (id == "retroreflection") return &m->retro;
  if (id == "clearcoat") return &m->clearcoat;
  if (id == "iridescence") return &m->iridescence[name == "red-green" ? 0 : 1];
  if (id == "basis-deviation") {
    if (name == "in plane") return &m->inPlane;
    return &m->freeForm[name == "core" ? 0 : name == "shoulder" ? 1 : 2];
  }
  return nullptr;
}

float* lightVariable(EffectState& state, const EffectColumn& column, const EffectColumns& columns,
                     int index) {
  if (column.name == "level") return nullptr;
  if (column.effect == "emission-angular")
    return &state.screen.angular[static_cast<std::size_t>(index - columns.rangeOf("emission-angular").first)];
  if (column.effect == "emission-spatial")
    return &state.screen.spatial[static_cast<std::size_t>(index - columns.rangeOf("emission-spatial").first)];
  if (column.effect == "screen-response") return &state.screen.screenGamma;
  return nullptr;
}

/// Strengths that no rig or sample has.
constexpr double kNoLess = -5e-4;  ///< of shares that can't be negative, but for noise
bool beyondSense(const EffectState& state) {
  for (const float a : state.screen.angular)
    if (std::abs(a) > 4) return true;
  for (const float a : state.screen.spatial)
    if (std::abs(a) > 2) return true;
  if (std::abs(state.screen.screenGamma - 1) > 0.6) return true;
  if (state.pose.head<3>().norm() > 0.2 || state.pose.tail<3>().norm() > 40) return true;
  if (state.height.norm() > 25) return true;
  if (std::abs(state.responseGamma) > 0.6 || std::abs(state.responseCompression) > 1.5) return true;
  // Light that a lens or a room would have to take away is no light of theirs.
  if (state.glare < kNoLess || state.glare > 0.7 || state.defocus < -0.01 || state.defocus > 6) return true;
  if (state.stray < kNoLess || state.saturation[0] + state.saturation[1] < 10 * kNoLess) return true;
  for (const auto& m : state.material) {
    if (std::hypot(m.stretch[0], m.stretch[1]) > 3) return true;
    if (m.third[0] + m.third[1] > 1.2 || m.third[0] < -0.4 || m.third[1] < -0.4) return true;
    if (m.fresnelPower < 1 || m.fresnelPower > 12) return true;
    if (m.sheen < -0.05 || m.clearcoat < -0.01) return true;
  }
  return false;
}

}  // namespace

DiagnosisSession::DiagnosisSession(std::vector<DiagnosisCapture> all)
    : captures(std::move(all)), states(captures.size()), columns(captures.front()) {
  for (std::size_t k = 0; k < captures.size(); ++k) {
    states[k].material.resize(static_cast<std::size_t>(captures[k].clusterCount));
    // A known paper anywhere: its columns must exist for all.
    if (captures[k].knownLambertian) columns = EffectColumns(captures[k]);
  }
}

int DiagnosisSession::materialOffset(std::size_t capture) const {
  int offset = 0;
  for (std::size_t k = 0; k < capture; ++k) offset += captures[k].clusterCount;
  return offset;
}

FourierDiagnosisModel modelOf(const DiagnosisSession& session, std::size_t capture) {
  FourierDiagnosisModel model(session.captures[capture], session.columns, session.states[capture]);
  model.setPictures(session.captures[capture].pictures);
  return model;
}

DiagnosisSession thinned(const DiagnosisSession& session, std::size_t sites) {
  DiagnosisSession out = session;
  for (auto& capture : out.captures) {
    const std::size_t step = std::max<std::size_t>(1, capture.sites.size() / std::max<std::size_t>(sites, 1));
    std::vector<DiagnosisSite> kept;
    for (std::size_t i = step / 2; i < capture.sites.size(); i += step)
      kept.push_back(std::move(capture.sites[i]));
    capture.sites = std::move(kept);
  }
  return out;
}

WantedColumns wantedFor(const std::vector<std::string>& effects) {
  WantedColumns wanted{false, false, false, false};
  for (const auto& id : effects) {
    wanted.light |= isOneOf(id, {"emission-angular", "emission-spatial", "self-shadowing", "screen-response",
                                 "anisotropy", "third-lobe", "fresnel", "sheen", "retroreflection",
                                 "clearcoat", "iridescence", "basis-deviation"});
    wanted.photographs |= isOneOf(id, {"flicker", "ambient-drift"});
    wanted.geometry |= isOneOf(id, {"screen-pose", "sample-height", "sample-tilt"});
    wanted.spread |= isOneOf(id, {"glare", "defocus", "subsurface"});
  }
  return wanted;
}

std::vector<std::shared_ptr<const PredictedPictures>> sessionPictures(const DiagnosisSession& session,
                                                                      const JobContext& job) {
  constexpr std::size_t kMostSites = 150000;  // 2 kB each
  std::vector<std::shared_ptr<const PredictedPictures>> out;
  for (std::size_t k = 0; k < session.captures.size(); ++k)
    out.push_back(std::make_shared<PredictedPictures>(
        modelOf(session, k).pictures(session.captures[k].sites, kMostSites, job)));
  return out;
}

ScoreTest scoreSession(DiagnosisSession& session, const WantedColumns& wanted, const JobContext& job) {
  ScoreTest test;
  for (std::size_t k = 0; k < session.captures.size(); ++k) {
    const FourierDiagnosisModel model = modelOf(session, k);
    test.add(session.captures[k], model, session.columns, job, wanted, session.materialOffset(k));
  }
  return test;
}

void refineSession(DiagnosisSession& session, int steps, const JobContext& job, bool mayDrop) {
  for (std::size_t k = 0; k < session.captures.size(); ++k) {
    const FourierDiagnosisModel model = modelOf(session, k);
    refineSites(session.captures[k], model, steps, job, mayDrop);
  }
}

SessionError sessionError(const DiagnosisSession& session, const JobContext& job) {
  SessionError out;
  for (std::size_t k = 0; k < session.captures.size(); ++k) {
    const FourierDiagnosisModel model = modelOf(session, k);
    ModelError e = modelError(session.captures[k], model, job);
    out.chi2 += e.chi2;
    out.count += e.count;
    out.heldChi2 += e.heldChi2;
    out.heldCount += e.heldCount;
    for (const double chi2 : e.rowChi2) out.noise += chi2;
    out.heldPatch.insert(out.heldPatch.end(), e.heldPatch.begin(), e.heldPatch.end());
    if (k == 0) out.first = std::move(e);
  }
  return out;
}

void applyNumbers(DiagnosisSession& session, const std::vector<ScoreTest::Number>& numbers,
                  const Eigen::VectorXd& estimate, double scale) {
  const int dense = session.columns.denseCount();
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    const ScoreTest::Number& number = numbers[i];
    const double step = scale * estimate[static_cast<Eigen::Index>(i)];
    if (number.column >= dense) {
      EffectState& state = session.states[0];
      const DiagnosisCapture& capture = session.captures[0];
      std::vector<std::size_t> fitted;
      for (std::size_t r = 0; r < capture.rowCount(); ++r)
        if (!capture.rows[r].holdout) fitted.push_back(r);
      const std::size_t f = static_cast<std::size_t>(number.column - dense);
      const bool gain = f < fitted.size();
      auto& values = gain ? state.photoGain : state.photoOffset;
      if (values.empty()) values.assign(capture.rowCount(), 0.0);
      values[fitted[gain ? f : f - fitted.size()]] += step;
      continue;
    }
    const EffectColumn& column = session.columns.dense()[static_cast<std::size_t>(number.column)];
    for (std::size_t k = 0; k < session.captures.size(); ++k) {
      EffectState& state = session.states[k];
      int material = number.material;
      if (material >= 0) {
        material -= session.materialOffset(k);
        if (material < 0 || material >= session.captures[k].clusterCount) continue;
      }
      if (column.effect == "self-shadowing") continue;  // the sites' own
      if (k > 0 && column.effect == "screen-drift") continue;
      if (float* value = lightVariable(state, column, session.columns, number.column)) {
        *value += static_cast<float>(std::clamp(step, -1.5, 1.5));
      } else if (double* at = variable(state, column, material)) {
        *at += std::clamp(step, -5 * number.prior, 5 * number.prior);
      }
    }
  }
  for (auto& state : session.states)
    for (auto& m : state.material) m.fresnelPower = std::clamp(m.fresnelPower, 1.0, 14.0);
}

void estimateHeldOutPhotographs(DiagnosisSession& session, const JobContext& job) {
  EffectState& state = session.states[0];
  const bool gains = state.has("flicker"), offsets = state.has("ambient-drift");
  if (!gains && !offsets) return;
  const DiagnosisCapture& capture = session.captures[0];
  const std::size_t rows = capture.rowCount();
  if (gains && state.photoGain.empty()) state.photoGain.assign(rows, 0.0);
  if (offsets && state.photoOffset.empty()) state.photoOffset.assign(rows, 0.0);
  for (int pass = 0; pass < 2; ++pass) {
    const FourierDiagnosisModel model = modelOf(session, 0);
    SiteColumns at;
    std::vector<Eigen::Matrix2d> a(rows, Eigen::Matrix2d::Zero());
    std::vector<Eigen::Vector2d> b(rows, Eigen::Vector2d::Zero());
    const std::size_t step = std::max<std::size_t>(1, capture.sites.size() / 400);
    for (std::size_t i = 0; i < capture.sites.size(); i += step) {
      const DiagnosisSite& site = capture.sites[i];
      if (!site.usable || job.cancelled()) continue;
      model.evaluate(site, quadrature::kPrediction, at);
      for (std::size_t r = 0; r < rows; ++r) {
        if (!capture.rows[r].holdout) continue;
        for (std::size_t c = 0; c < 3; ++c) {
          const double w = site.weight[r * 3 + c],
                       gap = static_cast<double>(site.measured[r * 3 + c]) - at.predicted[r * 3 + c];
          const Eigen::Vector2d t(gains ? at.light[r * 3 + c] : 0.0, offsets ? 1.0 : 0.0);
          a[r] += w * t * t.transpose();
          b[r] += w * gap * t;
        }
      }
    }
    for (std::size_t r = 0; r < rows; ++r) {
      if (!capture.rows[r].holdout) continue;
      Eigen::Matrix2d n = a[r];
      n(0, 0) += gains ? 1 / (0.05 * 0.05) : 1;
      n(1, 1) += offsets ? 1e-9 * n(1, 1) + 1e-12 : 1;
      const Eigen::Vector2d s = n.inverse() * b[r];
      if (gains) state.photoGain[r] += s[0];
      if (offsets) state.photoOffset[r] += s[1];
    }
  }
}

RefitResult refitEffects(DiagnosisSession& session, const std::vector<std::string>& effects, int iterations,
                         const JobContext& job) {
  RefitResult out;
  for (auto& state : session.states)
    for (const auto& id : effects)
      if (!state.has(id)) state.added.push_back(id);
  // Horizons are the sites' own: at none of it the derivative says nothing, so trial ones are the start.
  const bool horizon = std::ranges::find(effects, "self-shadowing") != effects.end();
  if (horizon)
    for (std::size_t k = 0; k < session.captures.size(); ++k)
      findHorizons(session.captures[k], modelOf(session, k), job);
  std::vector<std::string> linear = effects;
  std::erase(linear, "self-shadowing");
  estimateHeldOutPhotographs(session, job);
  SessionError error = sessionError(session, job);
  double gained = 0;
  const WantedColumns wanted = wantedFor(linear);
  for (int k = 0; k < iterations && !linear.empty() && !job.cancelled(); ++k) {
    ScoreTest test = scoreSession(session, wanted, job);
    out.numbers = test.numbers(linear);
    out.last = test.solve(linear);
    if (out.last.estimate.size() == 0 || !out.last.estimate.allFinite()) break;
    ++out.iterations;
    bool better = false;
    double scale = 1;
    const double before = error.chi2;
    for (int attempt = 0; attempt < 3; ++attempt, scale *= 0.4) {
      DiagnosisSession trial = session;
      applyNumbers(trial, out.numbers, out.last.estimate, scale);
      std::size_t index = 0;
      for (auto& capture : trial.captures) {
        for (auto& site : capture.sites) {
          const Eigen::VectorXd delta = test.ownStep(index++, out.numbers, scale * out.last.estimate);
          if (delta.size() > 0 && delta.allFinite()) stepSite(site, delta);
        }
      }
      refineSession(trial, 2, job, false);
      SessionError trialError = sessionError(trial, job);
      if (!(trialError.chi2 < before)) continue;
      session = std::move(trial);
      error = std::move(trialError);
      better = true;
      break;
    }
    if (!better) break;
    gained += before - error.chi2;
    if (before - error.chi2 < 0.004 * gained + 0.5) break;
  }
  estimateHeldOutPhotographs(session, job);
  out.error = sessionError(session, job);
  for (const auto& state : session.states) out.plausible &= !beyondSense(state);
  return out;
}

void resetEffect(DiagnosisSession& session, const std::string& id) {
  const EffectColumns::Range range = session.columns.rangeOf(id);
  for (std::size_t k = 0; k < session.captures.size(); ++k) {
    EffectState& state = session.states[k];
    std::erase(state.added, id);
    if (id == "flicker") state.photoGain.clear();
    if (id == "ambient-drift") state.photoOffset.clear();
    if (id == "self-shadowing") {
      for (auto& site : session.captures[k].sites) site.horizonSine = 0, site.ownHorizon = false;
      continue;
    }
    for (int column = range.first; column < range.first + range.count; ++column) {
      const EffectColumn& at = session.columns.dense()[static_cast<std::size_t>(column)];
      if (float* value = lightVariable(state, at, session.columns, column)) {
        *value = id == "screen-response" ? 1.0f : 0.0f;
        continue;
      }
      const int copies = EffectColumns::perMaterial(id) ? session.captures[k].clusterCount : 1;
      for (int m = 0; m < copies; ++m)
        if (double* value = variable(state, at, EffectColumns::perMaterial(id) ? m : -1))
          *value = id == "fresnel" ? 5 : 0;
    }
  }
}

}  // namespace patina
