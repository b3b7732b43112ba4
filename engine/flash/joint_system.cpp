#include "engine/flash/joint_system.h"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace patina {
namespace {

constexpr double kPi = std::numbers::pi;
/// Parts of the sample that are summed by themselves: the same on any number of threads.
constexpr std::size_t kChunk = 64;

double kept(double value, double low, double high) {
  return std::clamp(value, low, high);
}

}  // namespace

double& slotOf(FlashModel& model, const FlashUnknown& u) {
  using Kind = FlashUnknown::Kind;
  FlashRig& rig = model.rig;
  FlashLobe* lobe = u.material >= 0 ? &model.materials[static_cast<std::size_t>(u.material)].lobe : nullptr;
  const auto index = static_cast<std::size_t>(u.index),
             photo = static_cast<std::size_t>(std::max(u.photo, 0));
  switch (u.kind) {
    case Kind::Sigma:
      return lobe->logSigma;
    case Kind::Kurtosis:
      return lobe->logKurtosis;
    case Kind::Stretch:
      return lobe->stretch[u.index];
    case Kind::Third:
      return lobe->thirdShare;
    case Kind::ThirdRatio:
      return lobe->logThirdRatio;
    case Kind::Deviation:
      return lobe->deviation[index];
    case Kind::Tone:
      return rig.toneLogSlope[index];
    case Kind::Gain:
      return rig.logGain[photo];
    case Kind::Beam:
      return rig.beamFallOff;
    case Kind::Aim:
      return rig.aim[u.index];
    case Kind::PhotoAim:
      return rig.photoAim[photo][u.index];
    case Kind::Vignetting:
      return rig.vignetting;
    case Kind::Ambient:
      return rig.ambient[u.index];
    case Kind::Black:
      break;
  }
  return rig.black[u.index];
}

std::vector<FlashUnknown> lobeUnknowns(const FlashModel& model) {
  std::vector<FlashUnknown> unknowns;
  for (int m = 0; m < static_cast<int>(model.materials.size()); ++m) {
    unknowns.push_back({FlashUnknown::Kind::Sigma, m, -1, 0, 0.8, std::log(0.2), 1e-4});
    unknowns.push_back({FlashUnknown::Kind::Kurtosis, m, -1, 0, 0.2, 0.2, 1e-4});
  }
  return unknowns;
}

std::vector<FlashUnknown> effectUnknowns(FlashEffect effect, const FlashModel& model,
                                         const FlashCapture& capture, std::span<const char> photos) {
  using Kind = FlashUnknown::Kind;
  std::vector<FlashUnknown> unknowns;
  const int materials = static_cast<int>(model.materials.size());
  switch (effect) {
    case FlashEffect::CameraResponse:
      for (int k = 0; k < ToneCurve::kKnots; ++k) unknowns.push_back({Kind::Tone, -1, -1, k, 0.3, 0, 1e-3});
      break;
    case FlashEffect::LightPower:
      for (int k = 0; k < static_cast<int>(photos.size()); ++k)
        if (photos[static_cast<std::size_t>(k)]) unknowns.push_back({Kind::Gain, -1, k, 0, 0.3, 0, 1e-4});
      break;
    case FlashEffect::NearLight:
      unknowns.push_back({Kind::Beam, -1, -1, 0, 2.0, 0, 1e-4});
      for (int i = 0; i < 2; ++i) unknowns.push_back({Kind::Aim, -1, -1, i, 0.5, 0, 1e-4});
      break;
    case FlashEffect::Vignetting:
      unknowns.push_back({Kind::Vignetting, -1, -1, 0, 2.0, 0, 1e-4});
      break;
    case FlashEffect::StrayLight: {
      // A twentieth of the flash in the sample's middle is a lit room.
      const FlashPhoto& photo = capture.photos.front();
      const double scale = 0.05 * photo.lightIntensity.mean() / photo.lightPositionMm.squaredNorm();
      for (int c = 0; c < 3; ++c) unknowns.push_back({Kind::Ambient, -1, -1, c, scale, 0, 1e-4 * scale});
      break;
    }
    case FlashEffect::BlackLevel:
      for (int c = 0; c < 3; ++c) unknowns.push_back({Kind::Black, -1, -1, c, 0.01, 0, 1e-5});
      break;
    case FlashEffect::Anisotropy:
      for (int m = 0; m < materials; ++m)
        for (int i = 0; i < 2; ++i) unknowns.push_back({Kind::Stretch, m, -1, i, 0.4, 0, 1e-4});
      break;
    case FlashEffect::ThirdLobe:
      for (int m = 0; m < materials; ++m) {
        unknowns.push_back({Kind::Third, m, -1, 0, 0.4, 0, 1e-4});
        // Without any third lobe its width does nothing.
        if (model.materials[static_cast<std::size_t>(m)].lobe.thirdShare > 0.01)
          unknowns.push_back({Kind::ThirdRatio, m, -1, 0, 0.4, 1.1, 1e-4});
      }
      break;
    case FlashEffect::BasisDeviation:
      for (int m = 0; m < materials; ++m)
        for (int i = 0; i < FlashLobe::kDeviations; ++i)
          unknowns.push_back({Kind::Deviation, m, -1, i, 0.5, 0, 1e-4});
      break;
  }
  return unknowns;
}

JointSystem::JointSystem(const JointState& state, const FlashSample& sample,
                         const std::vector<FlashUnknown>& unknowns, std::span<const char> photos)
    : state_(state), sample_(sample), unknowns_(unknowns), photos_(photos) {
  for (const FlashMaterial& material : state.model.materials)
    priors_.push_back({material.mean, material.covariance.llt().solve(TexelMatrix::Identity())});
  // The models with one unknown moved, for the derivatives that are taken by differences.
  std::vector<FlashModel> moved;
  for (const FlashUnknown& u : unknowns) {
    moved.push_back(state.model);
    slotOf(moved.back(), u) += u.step;
    if (u.kind == FlashUnknown::Kind::Tone) moved.back().tone = ToneCurve(moved.back().rig.toneLogSlope);
  }
  const auto count = static_cast<Eigen::Index>(unknowns.size());
  sites_.resize(sample.sites.size());
  const std::size_t chunks = (sample.sites.size() + kChunk - 1) / kChunk;
  std::vector<Eigen::MatrixXd> hessians(chunks);
  std::vector<Eigen::MatrixXd> gradients(chunks);
  tbb::parallel_for(std::size_t{0}, chunks, [&](std::size_t chunk) {
    Eigen::MatrixXd& hessian = hessians[chunk];
    hessian = Eigen::MatrixXd::Zero(count, count);
    Eigen::MatrixXd& gradient = gradients[chunk];
    gradient = Eigen::MatrixXd::Zero(count, sample.blocks);
    const std::size_t end = std::min(sample.sites.size(), (chunk + 1) * kChunk);
    Eigen::VectorXd one(count);
    for (std::size_t s = chunk * kChunk; s < end; ++s) {
      one.setZero();
      assemble(s, moved, hessian, one);
      gradient.col(sample.sites[s].block) += one;
    }
  });
  shared_ = Eigen::MatrixXd::Zero(count, count);
  blockGradients_ = Eigen::MatrixXd::Zero(count, sample.blocks);
  for (std::size_t chunk = 0; chunk < chunks; ++chunk)
    shared_ += hessians[chunk], blockGradients_ += gradients[chunk];
  shared_.triangularView<Eigen::StrictlyUpper>() = shared_.transpose();
  gradient_ = blockGradients_.rowwise().sum();
  for (const Site& site : sites_) cost_ += site.cost;
  FlashModel model = state.model;
  for (Eigen::Index g = 0; g < count; ++g) {
    const FlashUnknown& u = unknowns[static_cast<std::size_t>(g)];
    const double precision = 1 / (u.priorSd * u.priorSd);
    shared_(g, g) += precision;
    gradient_[g] += precision * (slotOf(model, u) - u.priorMean);
  }
  cost_ += priorCost(state.model);
}

double JointSystem::priorCost(const FlashModel& model) const {
  FlashModel copy = model;
  double cost = 0;
  for (const FlashUnknown& u : unknowns_) {
    const double d = (slotOf(copy, u) - u.priorMean) / u.priorSd;
    cost += 0.5 * d * d;
  }
  return cost;
}

void JointSystem::assemble(std::size_t index, const std::vector<FlashModel>& moved, Eigen::MatrixXd& shared,
                           Eigen::VectorXd& gradient) {
  using Kind = FlashUnknown::Kind;
  const FlashSite& site = sample_.sites[index];
  const FlashModel& model = state_.model;
  const auto material = static_cast<std::size_t>(site.material);
  const TexelVector& x = state_.x[index];
  const FlashTexel texel{x};
  const Eigen::Vector3d normal = texel.normal();
  const Eigen::Array3d diffuse = texel.diffuse(), specular = texel.specular();
  const TexelPrior& prior = priors_[material];
  const auto count = static_cast<Eigen::Index>(unknowns_.size());
  Site& out = sites_[index];
  out.own = prior.precision;
  out.gradient = prior.precision * (x - prior.mean);
  out.cost = 0.5 * (x - prior.mean).dot(out.gradient);
  out.mixed =
      Eigen::Matrix<double, FlashTexel::kParameters, Eigen::Dynamic>::Zero(FlashTexel::kParameters, count);
  out.sd.assign(3 * site.seen.size(), 0);
  std::vector<Eigen::Index> who;
  std::vector<Eigen::Array3d> by;  // d value / d unknown
  for (std::size_t k = 0; k < site.seen.size(); ++k) {
    const FlashObservation& seen = site.seen[k];
    if (!photos_[static_cast<std::size_t>(seen.photo)]) continue;
    const SeenPrediction p = predictSeen(model, site.material, seen, x, true);
    who.clear(), by.clear();
    for (Eigen::Index g = 0; g < count; ++g) {
      const FlashUnknown& u = unknowns_[static_cast<std::size_t>(g)];
      if (u.material >= 0 && u.material != site.material) continue;
      if (u.photo >= 0 && u.photo != seen.photo) continue;
      Eigen::Array3d d = Eigen::Array3d::Zero();
      const FlashModel& there = moved[static_cast<std::size_t>(g)];
      if (u.ofLobe()) {
        const double lobe = flashLobeTimesCos(there.materials[material].lobe, seen.ray, normal);
        d = p.slope * seen.irradiance * specular * (p.factor * (lobe - p.lobe) / u.step);
      } else if (u.kind == Kind::Tone) {
        for (int c = 0; c < 3; ++c)
          d[c] = (there.tone.value(p.light[c]) + model.rig.black[c] - p.value[c]) / u.step;
      } else if (u.kind == Kind::Ambient) {
        d[u.index] = p.slope[u.index] * diffuse[u.index] / kPi;
      } else if (u.kind == Kind::Black) {
        d[u.index] = 1;
      } else {
        const double log = u.kind == Kind::Gain         ? 1
                           : u.kind == Kind::Beam       ? -seen.ray.lightSlope.squaredNorm()
                           : u.kind == Kind::Vignetting ? -seen.ray.axisTan2
                                                        : seen.ray.lightSlope[u.index];
        d = p.slope * p.flashLight * log;
      }
      who.push_back(g), by.push_back(d);
    }
    const double discrepancy = model.materials[material].discrepancy;
    for (int c = 0; c < 3; ++c) {
      const double sd = scatterOf(seen, c, p.value[c], discrepancy);
      out.sd[3 * k + static_cast<std::size_t>(c)] = sd;
      const Misfit m = misfitOf(p.value[c], seen.value[c], sd, (seen.clipped >> c) & 1);
      out.cost += m.cost;
      if (m.perValue == 0) continue;
      const std::array<int, 4> at = {0, 1, 2 + c, 5 + c};
      std::array<double, 4> row;
      for (int a = 0; a < 4; ++a) row[a] = p.byTexel(c, at[a]) * m.perValue;
      for (int a = 0; a < 4; ++a) {
        out.gradient[at[a]] += m.weight * m.residual * row[a];
        for (int b = 0; b < 4; ++b) out.own(at[a], at[b]) += m.weight * row[a] * row[b];
      }
      for (std::size_t i = 0; i < who.size(); ++i) {
        const double mine = by[i][c] * m.perValue;
        if (mine == 0) continue;
        gradient[who[i]] += m.weight * m.residual * mine;
        for (int a = 0; a < 4; ++a) out.mixed(at[a], who[i]) += m.weight * row[a] * mine;
        for (std::size_t j = 0; j <= i; ++j)
          shared(who[i], who[j]) += m.weight * mine * by[j][c] * m.perValue;
      }
    }
  }
  // The texel's part, eliminated.
  const auto solver = out.own.llt();
  const Eigen::Matrix<double, FlashTexel::kParameters, Eigen::Dynamic> solved = solver.solve(out.mixed);
  shared.triangularView<Eigen::Lower>() -= out.mixed.transpose() * solved;
  gradient -= solved.transpose() * out.gradient;
}

std::vector<TexelMatrix> JointSystem::information() const {
  std::vector<TexelMatrix> all;
  all.reserve(sites_.size());
  for (const Site& site : sites_) all.push_back(site.own);
  return all;
}

Eigen::VectorXd JointSystem::step(double damping) const {
  Eigen::MatrixXd damped = shared_;
  damped.diagonal() *= 1 + damping;
  return -damped.ldlt().solve(gradient_);
}

void JointSystem::moveTexels(const Eigen::VectorXd& step, double damping, std::vector<TexelVector>& x) const {
  for (std::size_t s = 0; s < sites_.size(); ++s) {
    TexelMatrix own = sites_[s].own;
    own.diagonal() *= 1 + damping;
    TexelVector change = -own.llt().solve(sites_[s].gradient + sites_[s].mixed * step);
    for (int i = 0; i < FlashTexel::kParameters; ++i) change[i] = kept(change[i], -1, 1);
    x[s] += change;
    for (int i = 0; i < 2; ++i) x[s][i] = kept(x[s][i], -3, 3);
    for (int i = 2; i < FlashTexel::kParameters; ++i) x[s][i] = kept(x[s][i], -16, 8);
  }
}

std::vector<TexelVector> JointSystem::answers(const Eigen::VectorXd& change) const {
  std::vector<TexelVector> all;
  all.reserve(sites_.size());
  for (const Site& site : sites_) all.push_back(-site.own.llt().solve(site.mixed * change));
  return all;
}

double JointSystem::costOf(const JointState& other) const {
  const std::size_t chunks = (sites_.size() + kChunk - 1) / kChunk;
  std::vector<double> costs(chunks, 0.0);
  tbb::parallel_for(std::size_t{0}, chunks, [&](std::size_t chunk) {
    const std::size_t end = std::min(sites_.size(), (chunk + 1) * kChunk);
    for (std::size_t s = chunk * kChunk; s < end; ++s) {
      const FlashSite& site = sample_.sites[s];
      const TexelPrior& prior = priors_[static_cast<std::size_t>(site.material)];
      const TexelVector d = other.x[s] - prior.mean;
      costs[chunk] += 0.5 * d.dot(prior.precision * d);
      for (std::size_t k = 0; k < site.seen.size(); ++k) {
        const FlashObservation& seen = site.seen[k];
        if (!photos_[static_cast<std::size_t>(seen.photo)]) continue;
        const SeenPrediction p = predictSeen(other.model, site.material, seen, other.x[s], false);
        for (int c = 0; c < 3; ++c)
          costs[chunk] += misfitOf(p.value[c], seen.value[c],
                                   sites_[s].sd[3 * k + static_cast<std::size_t>(c)], (seen.clipped >> c) & 1)
                              .cost;
      }
    }
  });
  double sum = priorCost(other.model);
  for (const double cost : costs) sum += cost;
  return sum;
}

}  // namespace patina
