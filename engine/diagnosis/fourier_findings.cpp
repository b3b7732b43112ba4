#include "engine/diagnosis/fourier_findings.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <numeric>

#include "engine/effect/effect_info.h"

namespace patina {
namespace {

constexpr double kDegrees = 57.29577951308232;

std::string number(double value, int digits = 3) {
  char text[32];
  std::snprintf(text, sizeof text, "%.*g", digits, value);
  return text;
}

std::string materialName(const DiagnosisSession& session, std::size_t k) {
  return session.captures[0].clusterCount > 1 ? "material " + std::to_string(k + 1) : "";
}

/// About their mean, fitted photographs: a factor that all share belongs to the albedos, an offset to the
/// sensor's black level.
double scatterOf(const std::vector<double>& values, const DiagnosisCapture& capture) {
  double sum = 0, square = 0, n = 0;
  for (std::size_t r = 0; r < values.size(); ++r) {
    if (capture.rows[r].holdout) continue;
    sum += values[r];
    square += values[r] * values[r];
    ++n;
  }
  return n > 0 ? std::sqrt(std::max(0.0, square / n - sum * sum / (n * n))) : 0;
}

/// Standard deviation of a column's number in the last solution; 0 where it has none.
double sdOf(const DiagnosisSession& session, const RefitResult* refit, std::string_view id,
            std::string_view name, int material) {
  if (!refit || refit->last.sd.size() == 0) return 0;
  const int column = session.columns.indexOf(id, name);
  for (std::size_t i = 0; i < refit->numbers.size(); ++i)
    if (refit->numbers[i].column == column && (material < 0 || refit->numbers[i].material == material))
      return refit->last.sd[static_cast<Eigen::Index>(i)];
  return 0;
}

}  // namespace

std::vector<EffectEstimate> effectParameters(const DiagnosisSession& session, std::string_view id,
                                             const RefitResult* refit) {
  std::vector<EffectEstimate> out;
  const EffectState& state = session.states[0];
  const DiagnosisCapture& capture = session.captures[0];
  const auto sd = [&](std::string_view name, int material = -1) {
    return sdOf(session, refit, id, name, material);
  };
  const auto put = [&](const char* name, const char* unit, double value, double spread,
                       const std::string& where = "") {
    out.push_back({name, unit, value, spread, where});
  };
  // Strongest first: a reader of one value gets that of the material that shows the effect.
  using Material = EffectState::Material;
  const auto perMaterial = [&](auto strength, auto write) {
    std::vector<std::size_t> order(
        std::min(static_cast<std::size_t>(capture.clusterCount), state.material.size()));
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::ranges::stable_sort(order, std::greater<>(),
                             [&](std::size_t k) { return std::abs(strength(state.material[k])); });
    for (const std::size_t k : order) write(state.material[k], static_cast<int>(k), materialName(session, k));
  };
  if (id == "anisotropy") {
    perMaterial([](const Material& m) { return std::hypot(m.stretch[0], m.stretch[1]); },
                [&](const EffectState::Material& m, int k, const std::string& where) {
                  const double r = std::hypot(m.stretch[0], m.stretch[1]), spread = sd("stretch 1", k);
                  put("ratio", "", std::exp(r), std::exp(r) * spread, where);
                  put("angleDeg", "degrees", 0.5 * kDegrees * std::atan2(m.stretch[1], m.stretch[0]),
                      r > 0 ? 0.5 * kDegrees * spread / r : 90, where);
                });
  } else if (id == "third-lobe") {
    perMaterial([](const Material& m) { return m.third[0] + m.third[1]; },
                [&](const EffectState::Material& m, int k, const std::string& where) {
                  const double share = m.third[0] + m.third[1];
                  put("share", "", share, std::hypot(sd("near", k), sd("broad", k)), where);
                  const double weight = std::abs(m.third[0]) + std::abs(m.third[1]);
                  put("sigmaRatio", "",
                      weight > 0 ? (2.5 * std::abs(m.third[0]) + 5 * std::abs(m.third[1])) / weight : 2.5, 1,
                      where);
                });
  } else if (id == "fresnel") {
    perMaterial([](const Material& m) { return m.fresnelPower - 5; },
                [&](const EffectState::Material& m, int k, const std::string& where) {
                  put("power", "", m.fresnelPower, sd("power", k), where);
                });
  } else if (id == "sheen" || id == "retroreflection" || id == "clearcoat") {
    perMaterial(
        [&](const Material& m) {
          return id == "sheen" ? m.sheen : id == "clearcoat" ? m.clearcoat : m.retro;
        },
        [&](const EffectState::Material& m, int k, const std::string& where) {
          put("strength", "",
              id == "sheen"       ? m.sheen
              : id == "clearcoat" ? m.clearcoat
                                  : m.retro,
              sd("strength", k), where);
        });
  } else if (id == "iridescence") {
    perMaterial([](const Material& m) { return std::hypot(m.iridescence[0], m.iridescence[1]); },
                [&](const EffectState::Material& m, int k, const std::string& where) {
                  put("chromaChange", "", std::hypot(m.iridescence[0], m.iridescence[1]), sd("red-green", k),
                      where);
                });
  } else if (id == "basis-deviation") {
    perMaterial(
        [](const Material& m) {
          return std::abs(m.freeForm[0]) + std::abs(m.freeForm[1]) + std::abs(m.freeForm[2]) +
                 std::abs(m.inPlane);
        },
        [&](const EffectState::Material& m, int k, const std::string& where) {
          double most = std::abs(std::exp(m.inPlane) - 1);
          for (const double f : m.freeForm)
            most = std::max(most, std::abs(std::exp(std::clamp(f, -3.0, 3.0)) - 1));
          put("relativeChange", "", most, sd("core", k), where);
        });
  } else if (id == "subsurface") {
    const double share = state.subsurface[0] + state.subsurface[1];
    put("share", "", share, sd("2 mm"));
    put("distanceMm", "mm", share != 0 ? (2 * state.subsurface[0] + 6 * state.subsurface[1]) / share : 2, 2);
  } else if (id == "self-shadowing") {
    // Of the places that have a horizon: how high it typically is, and how many there are.
    std::vector<double> degrees;
    double usable = 0;
    for (const DiagnosisSite& site : capture.sites) {
      usable += site.usable;
      if (site.usable && site.ownHorizon)
        degrees.push_back(kDegrees * std::asin(std::clamp<double>(site.horizonSine, 0, 1)));
    }
    std::ranges::sort(degrees);
    const auto quantile = [&](double share) {
      return degrees.empty()
                 ? 0.0
                 : degrees[static_cast<std::size_t>(share * static_cast<double>(degrees.size() - 1))];
    };
    put("horizonDeg", "degrees", quantile(0.5), 0.5 * (quantile(0.84) - quantile(0.16)));
    put("share", "of the sample", usable > 0 ? static_cast<double>(degrees.size()) / usable : 0, 0);
  } else if (id == "emission-angular") {
    // At 45 degrees from the screen's perpendicular, mean of the four directions, against straight on.
    double edge = 0;
    for (const auto& [u, v] : {std::pair{0.7, 0.0}, {-0.7, 0.0}, {0.0, 0.7}, {0.0, -0.7}})
      edge += 0.25 * quadrature::logEmission({state.screen.angular, {}}, u, v, 0, 0);
    edge -= quadrature::logEmission({state.screen.angular, {}}, 0, 0, 0, 0);
    put("edgeChange", "", std::exp(edge) - 1, 0.5 * sd("u^2"));
  } else if (id == "emission-spatial") {
    double edge = 0;
    for (const auto& [x, y] : {std::pair{1.0, 0.0}, {-1.0, 0.0}, {0.0, 1.0}, {0.0, -1.0}})
      edge += 0.25 * quadrature::logEmission({{}, state.screen.spatial}, 0, 0, x, y);
    put("edgeChange", "", std::exp(edge) - 1, std::hypot(sd("x^2"), sd("y^2")) / 2);
    put("gradientX", "", state.screen.spatial[0], sd("x"));
    put("gradientY", "", state.screen.spatial[1], sd("y"));
  } else if (id == "screen-response") {
    put("gamma", "", state.screen.screenGamma, sd("gamma"));
  } else if (id == "screen-drift") {
    double change = 0;
    for (int k = 0; k < kDriftCurves; ++k)
      change += state.drift[static_cast<std::size_t>(k)] * (driftCurve(k, 1) - driftCurve(k, 0));
    put("totalChange", "", change, sd("slow"));
  } else if (id == "flicker") {
    put("perPhoto", "", scatterOf(state.photoGain, capture), 0);
  } else if (id == "ambient-drift") {
    put("perPhoto", "of full scale", scatterOf(state.photoOffset, capture) / capture.fullScale, 0);
  } else if (id == "screen-pose") {
    put("tiltDeg", "degrees", state.pose.head<3>().norm() * kDegrees, sd("turn x") * kDegrees);
    put("shiftMm", "mm", state.pose.tail<3>().norm(), sd("shift z"));
  } else if (id == "sample-height") {
    put("heightMm", "mm",
        std::abs(state.height[0]) + std::abs(state.height[3]) + std::abs(state.height[4]) +
            std::abs(state.height[5]),
        sd("1"));
  } else if (id == "sample-tilt") {
    const double slope = 2 * std::hypot(state.height[1] / capture.state->capture.sampleWidthMm,
                                        state.height[2] / capture.state->capture.sampleHeightMm);
    put("tiltDeg", "degrees", std::atan(slope) * kDegrees,
        2 * sd("x") / capture.state->capture.sampleWidthMm * kDegrees);
  } else if (id == "glare") {
    put("share", "", state.glare, sd("share"));
    put("widthPx", "pixels", 4, 2);
  } else if (id == "defocus") {
    put("sigmaPx", "pixels", std::sqrt(std::max(0.0, state.defocus)),
        state.defocus > 0 ? sd("sigma^2") / (2 * std::sqrt(state.defocus)) : 1);
  } else if (id == "camera-response") {
    put("gamma", "", 1 + state.responseGamma, sd("gamma"));
    put("compression", "", state.responseCompression, sd("compression"));
  } else if (id == "black-level") {
    put("offset", "of full scale", state.blackOffset / capture.fullScale, sd("offset") / capture.fullScale);
  } else if (id == "channel-crosstalk") {
    put("share", "", state.mix.cwiseAbs().maxCoeff(), sd("RG"));
  } else if (id == "stray-light") {
    put("share", "", state.stray, sd("share"));
  } else if (id == "saturation") {
    put("level", "of full scale", state.saturation[0] > state.saturation[1] ? 0.6 : 0.8, 0.1);
  }
  return out;
}

std::string effectSentence(std::string_view id, const std::vector<EffectEstimate>& parameters) {
  const EffectInfo* info = findEffect(id);
  std::string text = info ? std::string(info->sentence) : std::string(id);
  if (parameters.empty()) return text;
  text += " Found here: ";
  bool first = true;
  for (const auto& p : parameters) {
    if (!first) text += ", ";
    first = false;
    std::string meaning = p.name;
    if (info)
      for (const auto& known : info->parameters)
        if (known.name == p.name) meaning = std::string(known.name);
    text += (p.where.empty() ? "" : p.where + ": ") + meaning + " " + number(p.value) +
            (p.unit.empty() ? "" : " " + p.unit) + (p.sd > 0 ? " (+-" + number(p.sd, 2) + ")" : "");
  }
  return text + ".";
}

std::vector<PhotoCurve> effectCurves(const DiagnosisSession& session, std::string_view id) {
  const EffectState& state = session.states[0];
  const DiagnosisCapture& capture = session.captures[0];
  PhotoCurve curve;
  for (std::size_t r = 0; r < capture.rowCount(); ++r) {
    double value = 0;
    if (id == "flicker" && !state.photoGain.empty()) {
      curve.name = "brightness", curve.unit = "relative", value = state.photoGain[r];
    } else if (id == "ambient-drift" && !state.photoOffset.empty()) {
      curve.name = "offset", curve.unit = "radiance", value = state.photoOffset[r];
    } else if (id == "screen-drift") {
      curve.name = "brightness", curve.unit = "relative";
      for (int k = 0; k < kDriftCurves; ++k)
        value += state.drift[static_cast<std::size_t>(k)] * driftCurve(k, capture.rows[r].time);
    } else {
      return {};
    }
    curve.photo.push_back(capture.rows[r].photo);
    curve.value.push_back(value);
  }
  std::vector<std::size_t> order(curve.photo.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::sort(order, {}, [&](std::size_t i) { return curve.photo[i]; });
  PhotoCurve sorted{curve.name, curve.unit, {}, {}, {}};
  for (const std::size_t i : order)
    sorted.photo.push_back(curve.photo[i]), sorted.value.push_back(curve.value[i]);
  return {sorted};
}

std::map<std::string, Image> effectMaps(const DiagnosisSession& session, std::string_view id,
                                        const CorrectedCapture* corrected) {
  const bool horizon = id == "self-shadowing";
  if (!(EffectColumns::perMaterial(id) || horizon) || id == "subsurface") return {};
  const DiagnosisCapture& capture = session.captures[0];
  const SvbrdfMaps& maps = capture.fit->maps();
  std::map<std::string, Image> out;
  const auto fillSites = [&](const char* name, auto value) {
    Image image(maps.width, maps.height, 1);
    for (int y = 0; y < maps.height; ++y) {
      for (int x = 0; x < maps.width; ++x) {
        const std::int64_t site = capture.state->siteOfTexel(x, y);
        if (site >= 0) image.at(x, y, 0) = static_cast<float>(value(static_cast<std::size_t>(site)));
      }
    }
    out.emplace(name, std::move(image));
  };
  const auto materialOf = [&](std::size_t site) {
    const std::size_t k = capture.clusterOfSite[site];
    const auto& all = session.states[0].material;
    return k < all.size() ? all[k] : EffectState::Material{};
  };
  const auto fill = [&](const char* name, auto value) {
    fillSites(name, [&](std::size_t site) { return value(materialOf(site)); });
  };
  if (horizon) {
    if (!corrected || corrected->horizonSine.empty()) return {};
    fillSites("horizon_deg", [&](std::size_t site) {
      return kDegrees * std::asin(std::clamp<double>(corrected->horizonSine[site], 0, 1));
    });
    return out;
  }
  using M = EffectState::Material;
  if (id == "anisotropy") {
    // The material's, and what each texel has beyond it.
    const auto stretch = [&](std::size_t site) {
      const M m = materialOf(site);
      const bool own = corrected && !corrected->stretch.empty();
      return Eigen::Vector2d(m.stretch[0] + (own ? corrected->stretch[site][0] : 0.0),
                             m.stretch[1] + (own ? corrected->stretch[site][1] : 0.0));
    };
    fillSites("anisotropy_ratio", [&](std::size_t site) { return std::exp(stretch(site).norm()); });
    fillSites("anisotropy_angle_deg", [&](std::size_t site) {
      const Eigen::Vector2d s = stretch(site);
      return 0.5 * kDegrees * std::atan2(s.y(), s.x());
    });
  } else if (id == "third-lobe") {
    fill("third_lobe_share", [](const M& m) { return m.third[0] + m.third[1]; });
  } else if (id == "fresnel") {
    fill("fresnel_power", [](const M& m) { return m.fresnelPower; });
  } else if (id == "sheen") {
    fill("sheen_strength", [](const M& m) { return m.sheen; });
  } else if (id == "clearcoat") {
    fill("clearcoat_strength", [](const M& m) { return m.clearcoat; });
  } else if (id == "retroreflection") {
    fill("retroreflection_strength", [](const M& m) { return m.retro; });
  } else if (id == "basis-deviation") {
    fill("lobe_deviation_core", [](const M& m) { return m.freeForm[0]; });
    fill("lobe_deviation_tail", [](const M& m) { return m.freeForm[2]; });
    fill("lobe_deviation_in_plane", [](const M& m) { return m.inPlane; });
  }
  return out;
}

SignaturePlot signatureByFrequency(const DiagnosisSession& session, const ScoreTest& test,
                                   std::string_view id, const JobContext& job) {
  SignaturePlot plot;
  const ScoreResult solved = test.solve({std::string(id)});
  const auto numbers = test.numbers({std::string(id)});
  const DiagnosisCapture& capture = session.captures[0];
  const std::size_t rows = capture.rowCount();
  if (solved.estimate.size() == 0) return plot;
  const bool sparse = id == "flicker" || id == "ambient-drift";
  const FourierDiagnosisModel model = modelOf(session, 0);
  std::vector<double> expected(capture.frequencies.size() + 1, 0), seen(expected.size(), 0),
      energy(expected.size(), 0);
  SiteColumns at;
  const std::size_t step = std::max<std::size_t>(1, capture.sites.size() / 120);
  for (std::size_t i = 0; i < capture.sites.size() && !sparse; i += step) {
    const DiagnosisSite& site = capture.sites[i];
    if (!site.usable || job.cancelled()) continue;
    model.evaluate(site, quadrature::kEverything, at);
    Eigen::VectorXd s = Eigen::VectorXd::Zero(session.columns.denseCount());
    for (std::size_t k = 0; k < numbers.size(); ++k)
      if (numbers[k].column < s.size() && (numbers[k].material < 0 || numbers[k].material == site.cluster))
        s[numbers[k].column] += solved.estimate[static_cast<Eigen::Index>(k)];
    // What is left of the effect's signal when the site's own parameters have done what they can.
    const Eigen::Index all = static_cast<Eigen::Index>(3 * rows);
    Eigen::VectorXd w(all), r(all);
    for (std::size_t c = 0; c < 3; ++c) {
      for (std::size_t k = 0; k < rows; ++k) {
        const Eigen::Index row = static_cast<Eigen::Index>(c * rows + k);
        w[row] = capture.rows[k].holdout
                     ? 0
                     : std::sqrt(static_cast<double>(site.robust * site.weight[k * 3 + c]));
        r[row] = w[row] * (static_cast<double>(site.measured[k * 3 + c]) - at.predicted[k * 3 + c]);
      }
    }
    Eigen::MatrixXd j = w.asDiagonal() * at.own;
    Eigen::MatrixXd n = j.transpose() * j;
    n.diagonal().array() += 1e-9 * n.trace() + 1e-12;
    const Eigen::LLT<Eigen::MatrixXd> llt(n);
    Eigen::VectorXd t = w.cwiseProduct(at.effect * s);
    t -= j * llt.solve(j.transpose() * t);
    r -= j * llt.solve(j.transpose() * r);
    for (std::size_t c = 0; c < 3; ++c) {
      for (std::size_t k = 0; k < rows; ++k) {
        const std::size_t f = capture.rows[k].frequency < 0
                                  ? expected.size() - 1
                                  : static_cast<std::size_t>(capture.rows[k].frequency);
        const Eigen::Index row = static_cast<Eigen::Index>(c * rows + k);
        energy[f] += t[row] * t[row];
        seen[f] += t[row] * r[row];
      }
    }
  }
  plot.title = "signal along the effect, by the pattern's frequency";
  plot.xLabel = "frequency, pattern units";
  plot.yLabel = "standard deviations of noise";
  std::map<double, std::pair<double, double>> byLength;
  for (std::size_t f = 0; f < expected.size(); ++f) {
    const double length = f + 1 == expected.size() ? 0 : capture.frequencies[f].cast<double>().norm();
    byLength[length].first += energy[f];
    byLength[length].second += seen[f];
  }
  for (const auto& [length, sums] : byLength) {
    if (!(sums.first > 0)) continue;
    plot.x.push_back(length);
    plot.expected.push_back(std::sqrt(sums.first));
    plot.seen.push_back(sums.second / std::sqrt(sums.first));
    plot.seenSd.push_back(1);
  }
  return plot;
}

std::vector<BudgetLine> effectBudget(const DiagnosisSession& session, const ScoreTest& test,
                                     const std::vector<std::string>& added, double phi) {
  struct Line {
    const char* id;
    const char* column;
    const char* parameter;
    const char* unit;
    double scale;  ///< parameter per column's number
  };
  const DiagnosisCapture& capture = session.captures[0];
  const double width = capture.state->capture.sampleWidthMm;
  const Line lines[] = {{"emission-angular", "u^2", "edgeChange", "", 0.25},
                        {"emission-spatial", "x^2", "edgeChange", "", 0.5},
                        {"screen-response", "gamma", "gamma", "", 1},
                        {"screen-drift", "slow", "totalChange", "", 0.9},
                        {"screen-pose", "turn x", "tiltDeg", "degrees", kDegrees},
                        {"screen-pose", "shift z", "shiftMm", "mm", 1},
                        {"sample-tilt", "x", "tiltDeg", "degrees", 2 / width * kDegrees},
                        {"sample-height", "1", "heightMm", "mm", 1},
                        {"anisotropy", "stretch 1", "ratio", "", 1},
                        {"third-lobe", "broad", "share", "", 1},
                        {"fresnel", "power", "power", "", 1},
                        {"sheen", "strength", "strength", "", 1},
                        {"retroreflection", "strength", "strength", "", 1},
                        {"clearcoat", "strength", "strength", "", 1},
                        {"iridescence", "red-green", "chromaChange", "", 1},
                        {"subsurface", "2 mm", "share", "", 1},
                        {"self-shadowing", "1", "horizonDeg", "degrees", 27},
                        {"glare", "share", "share", "", 1},
                        {"defocus", "sigma^2", "sigmaPx", "pixels", 1},
                        {"vignetting", "corner", "cornerLoss", "", 1},
                        {"camera-response", "gamma", "gamma", "", 1},
                        {"black-level", "offset", "offset", "of full scale", 1 / capture.fullScale},
                        {"channel-crosstalk", "RG", "share", "", 1},
                        {"stray-light", "share", "share", "", 1},
                        {"saturation", "0.8", "level", "", 1}};
  const ScoreSums sums = test.total();
  std::vector<double> specular, diffuse;
  for (const auto& site : capture.sites)
    specular.push_back(site.specular.mean()), diffuse.push_back(site.diffuse.mean());
  const auto median = [](std::vector<double>& v) {
    if (v.empty()) return 1.0;
    std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2), v.end());
    return std::max(v[v.size() / 2], 1e-4);
  };
  const double medianSpecular = median(specular), medianDiffuse = median(diffuse);
  std::vector<BudgetLine> out;
  for (const Line& line : lines) {
    if (std::ranges::find(added, line.id) != added.end()) continue;
    const int column = session.columns.indexOf(line.id, line.column);
    if (column < 0) continue;
    const double prior = session.columns.dense()[static_cast<std::size_t>(column)].prior;
    const double curvature = sums.a(column, column) / phi + 1 / (100 * prior * prior);
    const double estimate = sums.b(column) / phi / curvature, sd = 1 / std::sqrt(curvature);
    const double most = std::abs(estimate) + 1.96 * sd;
    BudgetLine budget;
    budget.id = line.id;
    budget.parameter = line.parameter;
    budget.unit = line.unit;
    budget.largestUnseen = std::abs(most * line.scale);
    if (std::string_view(line.id) == "defocus") budget.largestUnseen = std::sqrt(most);
    const bool blind = curvature < 4 / (100 * prior * prior);
    if (test.shifts().size() > 0) {
      const auto shift = [&](int own) { return test.shifts()(own, column) * most; };
      budget.shifts.push_back(
          {"normal", "degrees", std::hypot(shift(kOwnSlopeX), shift(kOwnSlopeY)) * kDegrees});
      budget.shifts.push_back({"sigma", "%", 100 * shift(kOwnLogSigma)});
      budget.shifts.push_back({"specular", "%", 100 * shift(kOwnSpecular + 1) / medianSpecular});
      budget.shifts.push_back({"diffuse", "%", 100 * shift(kOwnDiffuse + 1) / medianDiffuse});
    }
    std::string text = blind ? "These photographs can't show it"
                             : "Up to " + number(budget.largestUnseen, 2) +
                                   (budget.unit.empty() ? "" : " " + budget.unit) +
                                   " could be there without being seen";
    const auto worst = std::ranges::max_element(
        budget.shifts, {}, [](const auto& s) { return s.unit == "degrees" ? 20 * s.value : s.value; });
    if (worst != budget.shifts.end() && worst->value > 0)
      text += "; it would shift " + worst->quantity + " by " + number(worst->value, 2) +
              (worst->unit == "%" ? " %" : " " + worst->unit);
    budget.sentence = text + ".";
    out.push_back(std::move(budget));
  }
  return out;
}

std::vector<ResidualBreakdown> residualBreakdowns(const DiagnosisCapture& capture, const ModelError& before,
                                                  const ModelError& after) {
  std::vector<ResidualBreakdown> out;
  const auto group = [&](const char* by, auto labelOf) {
    ResidualBreakdown breakdown;
    breakdown.by = by;
    std::map<std::pair<double, std::string>, std::array<double, 4>> sums;
    for (std::size_t r = 0; r < capture.rowCount(); ++r) {
      const std::pair<double, std::string> key = labelOf(capture.rows[r]);
      auto& s = sums[key];
      s[0] += before.rowChi2[r], s[1] += before.rowCount[r], s[2] += after.rowChi2[r],
          s[3] += after.rowCount[r];
    }
    for (const auto& [key, s] : sums) {
      if (s[1] <= 0) continue;
      breakdown.label.push_back(key.second);
      breakdown.before.push_back(s[0] / s[1]);
      breakdown.after.push_back(s[3] > 0 ? s[2] / s[3] : 0);
    }
    out.push_back(std::move(breakdown));
  };
  group("frequency", [&](const DiagnosisRow& row) -> std::pair<double, std::string> {
    if (row.frequency < 0) return {0, "window"};
    const Eigen::Vector2i w = capture.frequencies[static_cast<std::size_t>(row.frequency)];
    return {
        w.cast<double>().norm() + 1e-3 * std::atan2(w.y(), w.x()),
        "(" + std::to_string(w.x()) + ", " + std::to_string(w.y()) + ")" + (row.holdout ? " held out" : "")};
  });
  group("phase", [&](const DiagnosisRow& row) -> std::pair<double, std::string> {
    return row.frequency < 0 ? std::pair{-1.0, std::string("window")}
                             : std::pair{static_cast<double>(row.phase), std::to_string(row.phase)};
  });
  group("order in time", [&](const DiagnosisRow& row) -> std::pair<double, std::string> {
    const int tenth = std::min(9, static_cast<int>(row.time * 10));
    return {tenth, std::to_string(tenth * 10) + " to " + std::to_string(tenth * 10 + 10) + " %"};
  });
  return out;
}

std::string describeRest(const DiagnosisCapture& capture, const ModelError& after) {
  double low = 0, lowCount = 0, high = 0, highCount = 0;
  int worst = -1;
  double most = 0;
  for (std::size_t r = 0; r < capture.rowCount(); ++r) {
    if (after.rowCount[r] <= 0 || capture.rows[r].frequency < 0) continue;
    const double chi2 = after.rowChi2[r] / after.rowCount[r];
    const double length =
        capture.frequencies[static_cast<std::size_t>(capture.rows[r].frequency)].cast<double>().norm();
    if (length < 5) low += after.rowChi2[r], lowCount += after.rowCount[r];
    if (length >= 5) high += after.rowChi2[r], highCount += after.rowCount[r];
    if (chi2 > most) most = chi2, worst = static_cast<int>(r);
  }
  if (worst < 0) return "";
  const double lowRatio = lowCount > 0 ? low / lowCount : 1, highRatio = highCount > 0 ? high / highCount : 1;
  if (most < 1.3) return "What is left is the sensor's noise.";
  const Eigen::Vector2i w =
      capture.frequencies[static_cast<std::size_t>(capture.rows[static_cast<std::size_t>(worst)].frequency)];
  return std::string("What is left is strongest at ") + (lowRatio > highRatio ? "low" : "high") +
         " frequencies (mean square " + number(lowRatio) + " of the noise below 5, " + number(highRatio) +
         " above); the worst photograph is that of pattern (" + std::to_string(w.x()) + ", " +
         std::to_string(w.y()) + ") with " + number(most) + ".";
}

}  // namespace patina
