#include "engine/diagnosis/fourier_suggest.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <optional>

#include "engine/diagnosis/residual_components.h"

namespace patina {
namespace {

constexpr double kEnoughSigmas = 5, kHalfExposure = 0.5;
constexpr double kAsideRad = 0.5;  // some 30 degrees
constexpr std::size_t kSites = 60;

/// What a site shows in further photographs: weighted rows of its own parameters and of the effects, in the
/// numbers of the capture at hand.
struct FurtherRows {
  Eigen::MatrixXd own, effect;
};

struct FurtherCapture {
  const char* sentence;
  /// Null where the site wouldn't show anything there.
  std::function<std::optional<FurtherRows>(const DiagnosisSite&, SiteColumns&)> rows;
};

/// Information of one site about both effects' numbers, its own parameters eliminated.
void addInformation(const Eigen::MatrixXd& own, const Eigen::MatrixXd& effect, const OwnPrior& prior,
                    Eigen::MatrixXd& information) {
  const OwnSystem system =
      ownSystem(prior, own.transpose() * own, Eigen::VectorXd::Zero(static_cast<Eigen::Index>(own.cols())));
  if (system.llt.info() != Eigen::Success) return;
  const Eigen::MatrixXd cross = own.transpose() * effect;
  information += effect.transpose() * effect - cross.transpose() * system.llt.solve(cross);
}

/// How far effect x at its strength stands out of everything that y can do, standard deviations.
double standsOut(const Eigen::MatrixXd& information, const std::vector<int>& x, const std::vector<int>& y,
                 const Eigen::VectorXd& strength, const std::vector<double>& priors) {
  const auto nx = static_cast<Eigen::Index>(x.size()), ny = static_cast<Eigen::Index>(y.size());
  Eigen::VectorXd s(nx), toY(ny);
  Eigen::MatrixXd yy(ny, ny);
  for (Eigen::Index i = 0; i < nx; ++i) s[i] = strength[x[static_cast<std::size_t>(i)]];
  double own = 0;
  for (Eigen::Index i = 0; i < nx; ++i)
    for (Eigen::Index j = 0; j < nx; ++j)
      own += s[i] * s[j] * information(x[static_cast<std::size_t>(i)], x[static_cast<std::size_t>(j)]);
  for (Eigen::Index i = 0; i < ny; ++i) {
    toY[i] = 0;
    for (Eigen::Index j = 0; j < nx; ++j)
      toY[i] += information(y[static_cast<std::size_t>(i)], x[static_cast<std::size_t>(j)]) * s[j];
    for (Eigen::Index j = 0; j < ny; ++j)
      yy(i, j) = information(y[static_cast<std::size_t>(i)], y[static_cast<std::size_t>(j)]);
    const double sd = priors[static_cast<std::size_t>(y[static_cast<std::size_t>(i)])];
    yy(i, i) += 1 / (sd * sd);
  }
  const Eigen::LLT<Eigen::MatrixXd> llt(yy);
  if (llt.info() != Eigen::Success) return 0;
  return std::sqrt(std::max(0.0, own - toY.dot(llt.solve(toY))));
}

/// The captures that were simulated, cheapest first.
class Captures {
 public:
  Captures(const DiagnosisSession& session, const FourierDiagnosisModel& model)
      : session_(session), capture_(session.captures[0]), model_(model) {
    const FourierFitState& fit = *capture_.state;
    camera_ = fit.capture.camera.positionMm();
    asideMm_ = Eigen::AngleAxisd(kAsideRad, Eigen::Vector3d::UnitZ()) * camera_;
  }

  std::vector<FurtherCapture> all() const {
    return {
        {"Take the window photograph again with half the exposure time: a linear sensor halves it, and what "
         "the light did before the sensor is halved with it.",
         [this](const DiagnosisSite& site, SiteColumns& at) { return halfExposure(site, at); }},
        {"Put a white matte paper of known reflectance in the sample's place and take the same photographs: "
         "it shows the screen and the camera without the sample.",
         [this](const DiagnosisSite& site, SiteColumns& at) { return paper(site, at); }},
        {"Turn the sample by 90 degrees on the table and take the same photographs: what belongs to it turns "
         "with it, what belongs to the rig does not.",
         [this](const DiagnosisSite& site, SiteColumns& at) { return turned(site, at); }},
        {"Move the camera aside by some 30 degrees around the sample, calibrate its place, and take the same "
         "photographs: the sample is seen by other light, the rig stays.",
         [this](const DiagnosisSite& site, SiteColumns& at) { return aside(site, at); }}};
  }

 private:
  FurtherRows weighted(const DiagnosisSite& site, SiteColumns& at, bool ownFree = true) const {
    turnToComponents(capture_, at.own);
    turnToComponents(capture_, at.effect);
    const Eigen::VectorXd w = rootWeights(capture_, site, false);
    FurtherRows out{w.asDiagonal() * at.own, w.asDiagonal() * at.effect};
    // Of a paper nothing is free but the black level, which is another one: left out, it is known well.
    if (!ownFree) out.own.setZero();
    return out;
  }
  void wipe(FurtherRows& out, std::string_view effect) const {
    const EffectColumns::Range range = session_.columns.rangeOf(effect);
    if (range.count > 0) out.effect.middleCols(range.first, range.count).setZero();
  }

  std::optional<FurtherRows> halfExposure(const DiagnosisSite& site, SiteColumns& at) const {
    DiagnosisSite half = site;
    half.diffuse *= static_cast<float>(kHalfExposure), half.specular *= static_cast<float>(kHalfExposure);
    model_.evaluate(half, quadrature::kEverything, at);
    at.own.middleCols(kOwnDiffuse, 6) *= kHalfExposure;
    FurtherRows all = weighted(site, at);
    const auto rows = static_cast<Eigen::Index>(capture_.rowCount());
    FurtherRows out{Eigen::MatrixXd(3, all.own.cols()), Eigen::MatrixXd(3, all.effect.cols())};
    for (Eigen::Index c = 0; c < 3; ++c) {  // the window's row is the last
      out.own.row(c) = all.own.row(c * rows + rows - 1);
      out.effect.row(c) = all.effect.row(c * rows + rows - 1);
    }
    return out;
  }

  std::optional<FurtherRows> paper(const DiagnosisSite& site, SiteColumns& at) const {
    DiagnosisSite white = site;
    white.diffuse = Eigen::Array3f::Constant(0.9f), white.specular.setZero();
    white.model.slopeX = white.model.slopeY = 0, white.model.sigma = 0.3f;
    model_.evaluate(white, quadrature::kEverything, at);
    FurtherRows out = weighted(site, at, false);
    for (const EffectColumn& column : session_.columns.dense())
      if (EffectColumns::perMaterial(column.effect) || column.effect == "sample-height" ||
          column.effect == "sample-tilt" || column.effect == "self-shadowing")
        wipe(out, column.effect);
    return out;
  }

  std::optional<FurtherRows> turned(const DiagnosisSite& site, SiteColumns& at) const {
    DiagnosisSite other = site;
    const Eigen::Vector2f p = site.model.pointMm;
    other.model.pointMm = {-p.y(), p.x()};
    other.model.slopeX = -site.model.slopeY, other.model.slopeY = site.model.slopeX;
    const Eigen::Vector3d point(other.model.pointMm.x(), other.model.pointMm.y(), 0);
    other.model.geometry = siteGeometry(capture_.state->frame, point, camera_);
    model_.evaluate(other, quadrature::kEverything, at);
    if (!at.onScreen) return std::nullopt;
    // Own slopes and stretches in the sample's frame.
    const Eigen::VectorXd byX = at.own.col(kOwnSlopeX), byY = at.own.col(kOwnSlopeY);
    at.own.col(kOwnSlopeX) = byY, at.own.col(kOwnSlopeY) = -byX;
    const EffectColumns::Range stretch = session_.columns.rangeOf("anisotropy"),
                               bent = session_.columns.rangeOf("sample-height"),
                               tilt = session_.columns.rangeOf("sample-tilt");
    if (stretch.count == 2) at.effect.middleCols(stretch.first, 2) *= -1;
    if (tilt.count == 2) {
      const Eigen::VectorXd x = at.effect.col(tilt.first), y = at.effect.col(tilt.first + 1);
      at.effect.col(tilt.first) = y, at.effect.col(tilt.first + 1) = -x;
    }
    if (bent.count == 4) {
      at.effect.col(bent.first + 1).swap(at.effect.col(bent.first + 3));
      at.effect.col(bent.first + 2) *= -1;
    }
    return weighted(site, at);
  }

  std::optional<FurtherRows> aside(const DiagnosisSite& site, SiteColumns& at) const {
    DiagnosisSite other = site;
    const Eigen::Vector3d point(site.model.pointMm.x(), site.model.pointMm.y(), 0);
    other.model.geometry = siteGeometry(capture_.state->frame, point, asideMm_);
    other.model.cameraMm = &asideMm_;
    model_.evaluate(other, quadrature::kEverything, at);
    if (!at.onScreen) return std::nullopt;
    return weighted(site, at);
  }

  const DiagnosisSession& session_;
  const DiagnosisCapture& capture_;
  const FourierDiagnosisModel& model_;
  Eigen::Vector3d camera_, asideMm_;
};

}  // namespace

Suggestion suggestCapture(const DiagnosisSession& session, const ScoreTest& test, const std::string& a,
                          const std::string& b, const JobContext& job) {
  Suggestion out{a, b, "", 0};
  const auto oneOf = [&](std::string_view id) { return a == id || b == id; };
  // Factors and offsets of single photographs have no number in a further capture.
  if (oneOf("flicker") || oneOf("ambient-drift")) {
    out.capture =
        "Repeat the window photograph every ten patterns: it shows the screen's brightness, and a black one "
        "beside it the room's light, over time.";
    return out;
  }
  if (oneOf("retroreflection")) {
    out.capture =
        "Photograph the sample with the camera beside the screen: light that returns to where it came "
        "from shows there alone.";
    return out;
  }
  const DiagnosisSession few = thinned(session, kSites);
  const DiagnosisCapture& capture = few.captures[0];
  const FourierDiagnosisModel model = modelOf(few, 0);
  const EffectColumns& columns = few.columns;
  // One number for each column; of each material its own estimate.
  std::vector<int> ofA, ofB;
  std::vector<double> priors;
  for (int k = 0; k < columns.denseCount(); ++k) {
    const EffectColumn& column = columns.dense()[static_cast<std::size_t>(k)];
    priors.push_back(column.prior);
    if (column.effect == a) ofA.push_back(k);
    if (column.effect == b) ofB.push_back(k);
  }
  const auto strengths = [&](const std::string& id) {
    const ScoreResult solved = test.solve({id});
    const auto numbers = test.numbers({id});
    std::vector<Eigen::VectorXd> byMaterial(static_cast<std::size_t>(capture.clusterCount),
                                            Eigen::VectorXd::Zero(columns.denseCount()));
    for (std::size_t i = 0; i < numbers.size() && static_cast<Eigen::Index>(i) < solved.estimate.size(); ++i)
      for (int m = 0; m < capture.clusterCount; ++m)
        if ((numbers[i].material < 0 || numbers[i].material == m) && numbers[i].column < columns.denseCount())
          byMaterial[static_cast<std::size_t>(m)][numbers[i].column] =
              solved.estimate[static_cast<Eigen::Index>(i)];
    return byMaterial;
  };
  const auto strengthA = strengths(a), strengthB = strengths(b);
  const Captures further(few, model);
  const std::vector<FurtherCapture> captures = further.all();
  const auto materials = static_cast<std::size_t>(capture.clusterCount);
  std::vector<std::vector<Eigen::MatrixXd>> information(
      captures.size(), std::vector<Eigen::MatrixXd>(
                           materials, Eigen::MatrixXd::Zero(columns.denseCount(), columns.denseCount())));
  SiteColumns at;
  for (const DiagnosisSite& site : capture.sites) {
    if (!site.usable || job.cancelled()) continue;
    model.evaluate(site, quadrature::kEverything, at);
    turnToComponents(capture, at.own);
    turnToComponents(capture, at.effect);
    const Eigen::VectorXd w = rootWeights(capture, site, false);
    const Eigen::MatrixXd own = w.asDiagonal() * at.own, effect = w.asDiagonal() * at.effect;
    for (std::size_t k = 0; k < captures.size(); ++k) {
      const auto rows = captures[k].rows(site, at);
      Eigen::MatrixXd allOwn = own, allEffect = effect;
      if (rows && rows->own.allFinite() && rows->effect.allFinite()) {
        allOwn.resize(own.rows() + rows->own.rows(), own.cols());
        allOwn << own, rows->own;
        allEffect.resize(effect.rows() + rows->effect.rows(), effect.cols());
        allEffect << effect, rows->effect;
      }
      addInformation(allOwn, allEffect, ownPrior(capture, site),
                     information[k][static_cast<std::size_t>(site.cluster)]);
    }
  }
  // A few sites stand for all that a capture would have.
  const double scale = static_cast<double>(session.captures[0].sites.size()) /
                       static_cast<double>(std::max<std::size_t>(capture.sites.size(), 1));
  for (std::size_t k = 0; k < captures.size(); ++k) {
    double aOut = 0, bOut = 0;
    for (std::size_t m = 0; m < materials; ++m) {
      aOut += std::pow(standsOut(information[k][m], ofA, ofB, strengthA[m], priors), 2);
      bOut += std::pow(standsOut(information[k][m], ofB, ofA, strengthB[m], priors), 2);
    }
    const double sigmas = std::sqrt(std::min(aOut, bOut) * scale);
    if (sigmas > out.separationSigmas) {
      out.separationSigmas = sigmas;
      out.capture = captures[k].sentence;
    }
    if (sigmas >= kEnoughSigmas) break;  // cheapest first
  }
  if (out.capture.empty()) {
    out.capture =
        "None of the further captures that were simulated would tell the two apart: calibrate the "
        "screen's place and the sample's plane again.";
  } else if (out.separationSigmas < kEnoughSigmas) {
    out.capture +=
        " It would help, and hardly be enough: of the captures that were simulated it separates the "
        "two best.";
  }
  return out;
}

}  // namespace patina
