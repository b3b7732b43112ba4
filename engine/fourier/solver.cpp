#include "engine/fourier/solver.h"

#include <algorithm>
#include <cmath>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/fourier/solver.cpp"
#include <hwy/foreach_target.h>
// after foreach_target
#include <hwy/aligned_allocator.h>
#include <hwy/contrib/math/math-inl.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace patina::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Tag = hn::ScalableTag<float>;
using Vec = hn::Vec<Tag>;
using Mask = hn::Mask<Tag>;

#include "engine/fourier/lanes.inc"
#include "engine/fourier/lobe_kernel.inc"

/// Columns of the model at one real measurement: value and derivatives of the two parts.
enum Column { kD, kS, kDx, kDy, kSl, kSk, kSx, kSy, kColumns };
constexpr int kPairs = kColumns * (kColumns + 1) / 2;
constexpr int pairIndex(int i, int j) {
  return i <= j ? i * kColumns - i * (i - 1) / 2 + (j - i) : pairIndex(j, i);
}

struct Theta {
  Lanes logSigma, logKurtosis, slopeX, slopeY;
};

/// Everything an evaluation gives: cost, albedos at their optimum, gradient and Gauss-Newton matrix of the
/// lobe parameters.
struct Evaluation {
  Lanes cost, dataCost;
  Lanes diffuse[3], specular[3];
  Lanes gradient[4];
  Lanes hessian[10];  // upper triangle, row by row
};
constexpr int kUpper[4][4] = {{0, 1, 2, 3}, {1, 4, 5, 6}, {2, 5, 7, 8}, {3, 6, 8, 9}};

class Batch {
 public:
  Batch(const SolverSetup& setup, float* workspace, std::span<const SiteData> sites)
      : setup_(setup), frequencies_(static_cast<int>(setup.frequency.size())), lanes_(hn::Lanes(Tag())) {
    float* next = workspace;
    auto take = [&](int vectors) {
      float* at = next;
      next += static_cast<std::size_t>(vectors) * lanes_;
      return at;
    };
    diffuse_ = take((frequencies_ + 1) * 6);
    z_ = take(frequencies_ * 6);
    columns_ = take((2 * frequencies_ + 1) * kColumns);
    float* scratch = take(16);
    // Transpose sites into lanes; idle lanes repeat the last site.
    const auto site = [&](std::size_t lane) -> const SiteData& {
      return sites[std::min(lane, sites.size() - 1)];
    };
    for (std::size_t lane = 0; lane < lanes_; ++lane) {
      const SiteData& data = site(lane);
      for (int k = 0; k < (frequencies_ + 1) * 6; ++k) diffuse_[k * lanes_ + lane] = data.diffuse[k];
      for (int k = 0; k < frequencies_ * 6; ++k) z_[k * lanes_ + lane] = data.z[k];
    }
    auto gather = [&](auto get) {
      for (std::size_t lane = 0; lane < lanes_; ++lane) scratch[lane] = get(site(lane));
      return Lanes(hn::Load(Tag(), scratch));
    };
    site_.distance = gather([](const SiteData& s) { return s.geometry.distance; });
    site_.viewX = gather([](const SiteData& s) { return s.geometry.viewX; });
    site_.viewY = gather([](const SiteData& s) { return s.geometry.viewY; });
    site_.viewZ = gather([](const SiteData& s) { return s.geometry.viewZ; });
    site_.lightMeanX = gather([](const SiteData& s) { return s.geometry.lightMeanX; });
    site_.lightMeanY = gather([](const SiteData& s) { return s.geometry.lightMeanY; });
    site_.lightPrecisionX = gather([](const SiteData& s) { return s.geometry.lightPrecisionX; });
    site_.lightPrecisionY = gather([](const SiteData& s) { return s.geometry.lightPrecisionY; });
    site_.lightPeak = gather([](const SiteData& s) { return s.geometry.lightPeak; });
    footX_ = gather([](const SiteData& s) { return s.geometry.footX; });
    footY_ = gather([](const SiteData& s) { return s.geometry.footY; });
    for (int c = 0; c < 3; ++c) {
      weight_[c] = gather([c](const SiteData& s) { return s.weight[c]; });
      dcWeight_[c] = gather([c](const SiteData& s) { return s.dcWeight[c]; });
      dc_[c] = gather([c](const SiteData& s) { return s.dc[c]; });
    }
  }

  static std::size_t workspaceFloats(int frequencies) {
    return static_cast<std::size_t>((frequencies + 1) * 6 + frequencies * 6 +
                                    (2 * frequencies + 1) * kColumns + 16) *
           hn::Lanes(Tag());
  }

  HWY_NOINLINE void evaluate(const Theta& theta, Evaluation& out) {
    fillColumns(theta);
    solveAlbedos(out);
    residuals(theta, out);
  }

  /// Predicted columns at `theta`, one lane's taken out: out[row][kColumns].
  void columnsOf(const Theta& theta, std::size_t sites, float* out) {
    fillColumns(theta);
    const std::size_t rows = 2 * static_cast<std::size_t>(frequencies_) + 1;
    for (std::size_t lane = 0; lane < sites; ++lane)
      for (std::size_t i = 0; i < rows * kColumns; ++i)
        out[lane * rows * kColumns + i] = columns_[i * lanes_ + lane];
  }

 private:
  Lanes load(const float* array, int index) const {
    return hn::Load(Tag(), array + static_cast<std::size_t>(index) * lanes_);
  }
  Lanes column(int row, int c) const { return load(columns_, row * kColumns + c); }
  void store(int row, int c, Lanes value) {
    hn::Store(value.v, Tag(), columns_ + static_cast<std::size_t>(row * kColumns + c) * lanes_);
  }

  /// Predicted columns at every real measurement. Row 2f: real part of frequency f, 2f + 1: imaginary, last:
  /// zero frequency.
  HWY_NOINLINE void fillColumns(const Theta& theta) {
    const NormalFrame<Lanes> frame = normalFromSlopes(theta.slopeX, theta.slopeY, setup_.normalRows);
    // gamma and the two widths: sigma_1,2 = c sigma gamma^-+1, c = sqrt(2 / (gamma^-2 + gamma^2)) (App. C)
    const Lanes one(1.0f), half(0.5f);
    const Lanes excess = vexp(theta.logKurtosis), gamma = one + excess, gamma2 = gamma * gamma,
                inverse2 = one / gamma2;
    const Lanes spread = inverse2 + gamma2;
    const Lanes scale = vexp(theta.logSigma) * vsqrt(Lanes(2.0f) / spread);
    const Lanes dLogC = (inverse2 - gamma2) / (spread * gamma);  // d log c / d gamma
    LobeMoments<Lanes> lobe[2];
    Lanes dLogWidth[2];  // d log sigma_l / d log(gamma - 1)
    for (int l = 0; l < 2; ++l) {
      const Lanes width = l == 0 ? scale / gamma : scale * gamma;
      dLogWidth[l] = (dLogC + (l == 0 ? -(one / gamma) : one / gamma)) * excess;
      lobe[l] = setup_.lobe == LobeMapping::ExactMoments
                    ? lobeMoments(site_, frame, width)
                    : lobeMomentsPaper(site_, theta.slopeX, theta.slopeY, width, setup_.normalRows);
    }
    for (int f = 0; f <= frequencies_; ++f) {
      // diffuse: index 0 is the zero frequency
      Lanes d[2], dx[2], dy[2];
      for (int part = 0; part < 2; ++part) {
        d[part] = dx[part] = dy[part] = Lanes(0.0f);
        for (int axis = 0; axis < 3; ++axis) {
          const Lanes v = load(diffuse_, (f * 3 + axis) * 2 + part);
          d[part] = mulAdd(v, frame.n[axis], d[part]);
          dx[part] = mulAdd(v, frame.dSlopeX[axis], dx[part]);
          dy[part] = mulAdd(v, frame.dSlopeY[axis], dy[part]);
        }
      }
      if (f == 0) {
        const int row = 2 * frequencies_;
        store(row, kD, d[0]);
        store(row, kDx, dx[0]);
        store(row, kDy, dy[0]);
        Lanes value(0.0f), dValue[4] = {value, value, value, value};
        for (int l = 0; l < 2; ++l) {
          LitFraction<Lanes> lit{one, {Lanes(0.0f), Lanes(0.0f), Lanes(0.0f)}};
          if (setup_.lobe == LobeMapping::ExactMoments)
            lit = litFraction(lobe[l], footX_, footY_, setup_.halfExtent[0], setup_.halfExtent[1]);
          value = mulAdd(lobe[l].mass, lit.value, value);
          for (int p = 0; p < 3; ++p) {
            const Lanes d0 = lobe[l].dMass[p] * lit.value + lobe[l].mass * lit.d[p];
            dValue[p == 0 ? 0 : p + 1] = dValue[p == 0 ? 0 : p + 1] + d0;
            if (p == 0) dValue[1] = mulAdd(d0, dLogWidth[l], dValue[1]);
          }
        }
        store(row, kS, half * value);
        store(row, kSl, half * dValue[0]);
        store(row, kSk, half * dValue[1]);
        store(row, kSx, half * dValue[2]);
        store(row, kSy, half * dValue[3]);
        continue;
      }
      const Lanes wx(setup_.frequency[f - 1].x()), wy(setup_.frequency[f - 1].y());
      const Lanes wxx = half * wx * wx, wxy = wx * wy, wyy = half * wy * wy;
      // k3(w) / 6 and k4(w) / 24 with w's binomial weights
      const Lanes sixth(1.0f / 6.0f), fraction(1.0f / 24.0f), quarter(0.25f);
      const Lanes wxxx = sixth * wx * wx * wx, wxxy = half * wx * wx * wy, wxyy = half * wx * wy * wy,
                  wyyy = sixth * wy * wy * wy;
      const Lanes wxxxx = fraction * wx * wx * wx * wx, wxxxy = sixth * wx * wx * wxy,
                  wxxyy = quarter * wxy * wxy, wxyyy = sixth * wy * wy * wxy,
                  wyyyy = fraction * wy * wy * wy * wy;
      Lanes s[2] = {Lanes(0.0f), Lanes(0.0f)};
      Lanes ds[4][2] = {{Lanes(0.0f), Lanes(0.0f)},
                        {Lanes(0.0f), Lanes(0.0f)},
                        {Lanes(0.0f), Lanes(0.0f)},
                        {Lanes(0.0f), Lanes(0.0f)}};
      for (int l = 0; l < 2; ++l) {
        const LobeMoments<Lanes>& m = lobe[l];
        const Lanes decay = wxx * m.xx + wxy * m.xy + wyy * m.yy;
        const Lanes bend = clampTo(wxxxx * m.fourth[0] + wxxxy * m.fourth[1] + wxxyy * m.fourth[2] +
                                       wxyyy * m.fourth[3] + wyyyy * m.fourth[4],
                                   -kMostBend, kMostBend);
        const Lanes smooth = half * vexp(vmax(-decay, Lanes(-80.0f)));
        const Lanes envelope = smooth * (one + bend);
        const Lanes phase = wx * (m.meanX + footX_) + wy * (m.meanY + footY_) -
                            (wxxx * m.third[0] + wxxy * m.third[1] + wxyy * m.third[2] + wyyy * m.third[3]);
        const Lanes cosine(hn::CallCos(Tag(), phase.v)), sine(hn::CallSin(Tag(), phase.v));
        const Lanes re = envelope * cosine, im = -(envelope * sine);
        const Lanes bendRe = m.mass * smooth * cosine, bendIm = -(m.mass * smooth * sine);
        s[0] = mulAdd(m.mass, re, s[0]);
        s[1] = mulAdd(m.mass, im, s[1]);
        for (int p = 0; p < 3; ++p) {
          // d value = (dM - M/2 w dC w) e - i (w dmean) M e
          const Lanes gain = m.dMass[p] - m.mass * (wxx * m.dXx[p] + wxy * m.dXy[p] + wyy * m.dYy[p]);
          const Lanes turn = m.mass * (wx * m.dMeanX[p] + wy * m.dMeanY[p] -
                                       (wxxx * m.dThird[p][0] + wxxy * m.dThird[p][1] +
                                        wxyy * m.dThird[p][2] + wyyy * m.dThird[p][3]));
          const Lanes dBend = wxxxx * m.dFourth[p][0] + wxxxy * m.dFourth[p][1] + wxxyy * m.dFourth[p][2] +
                              wxyyy * m.dFourth[p][3] + wyyyy * m.dFourth[p][4];
          const Lanes dRe = gain * re + turn * im + dBend * bendRe,
                      dIm = gain * im - turn * re + dBend * bendIm;
          const int target = p == 0 ? 0 : p + 1;
          ds[target][0] = ds[target][0] + dRe;
          ds[target][1] = ds[target][1] + dIm;
          if (p == 0) {
            ds[1][0] = mulAdd(dRe, dLogWidth[l], ds[1][0]);
            ds[1][1] = mulAdd(dIm, dLogWidth[l], ds[1][1]);
          }
        }
      }
      for (int part = 0; part < 2; ++part) {
        const int row = 2 * (f - 1) + part;
        store(row, kD, d[part]);
        store(row, kDx, dx[part]);
        store(row, kDy, dy[part]);
        store(row, kS, s[part]);
        store(row, kSl, ds[0][part]);
        store(row, kSk, ds[1][part]);
        store(row, kSx, ds[2][part]);
        store(row, kSy, ds[3][part]);
      }
    }
  }

  /// Optimal non-negative albedos of each channel: two unknowns, closed form with its three corners.
  HWY_NOINLINE void solveAlbedos(Evaluation& out) const {
    Lanes dd(0.0f), ds(0.0f), ss(0.0f), dz[3], sz[3];
    for (int c = 0; c < 3; ++c) dz[c] = sz[c] = Lanes(0.0f);
    for (int row = 0; row < 2 * frequencies_; ++row) {
      const Lanes d = column(row, kD), s = column(row, kS);
      dd = mulAdd(d, d, dd);
      ds = mulAdd(d, s, ds);
      ss = mulAdd(s, s, ss);
      const int base = (row / 2) * 6 + (row % 2) * 3;
      for (int c = 0; c < 3; ++c) {
        const Lanes z = load(z_, base + c);
        dz[c] = mulAdd(d, z, dz[c]);
        sz[c] = mulAdd(s, z, sz[c]);
      }
    }
    const Lanes d0 = column(2 * frequencies_, kD), s0 = column(2 * frequencies_, kS), zero(0.0f);
    const Lanes priorD(1.0f / (setup_.priors.diffuseSigma * setup_.priors.diffuseSigma));
    const Lanes priorS(1.0f / (setup_.priors.specularSigma * setup_.priors.specularSigma));
    for (int c = 0; c < 3; ++c) {
      const Lanes w = weight_[c], w0 = dcWeight_[c];
      const Lanes a = w * dd + w0 * d0 * d0 + priorD, b = w * ds + w0 * d0 * s0,
                  e = w * ss + w0 * s0 * s0 + priorS;
      const Lanes p = w * dz[c] + w0 * d0 * dc_[c], q = w * sz[c] + w0 * s0 * dc_[c];
      const Lanes det = vmax(a * e - b * b, Lanes(1e-30f));
      const Lanes x = (e * p - b * q) / det, y = (a * q - b * p) / det;
      const Lanes onlyD = vmax(p / a, zero), onlyS = vmax(q / e, zero);
      const Mask xNegative = less(x, zero), yNegative = less(y, zero);
      // Where both are negative, the one that alone explains more is kept.
      const Mask preferS = less(onlyD * p, onlyS * q);
      const Mask dropD =
          hn::Or(hn::AndNot(yNegative, xNegative), hn::And(hn::And(xNegative, yNegative), preferS));
      const Mask dropS = hn::AndNot(dropD, hn::Or(xNegative, yNegative));
      out.diffuse[c] = select(dropD, zero, select(dropS, onlyD, x));
      out.specular[c] = select(dropS, zero, select(dropD, onlyS, y));
    }
  }

  HWY_NOINLINE void residuals(const Theta& theta, Evaluation& out) const {
    const int rows = 2 * frequencies_;
    Lanes gram[kPairs];
    for (auto& g : gram) g = Lanes(0.0f);
    // Few accumulators at a time, so that they stay in registers.
    for (int block = 0; block < kColumns; block += 2) {
      Lanes sumA[kColumns], sumB[kColumns];
      for (int j = 0; j < kColumns; ++j) sumA[j] = sumB[j] = Lanes(0.0f);
      for (int row = 0; row < rows; ++row) {
        const Lanes a = column(row, block), b = column(row, block + 1);
        for (int j = block; j < kColumns; ++j) {
          const Lanes x = column(row, j);
          sumA[j] = mulAdd(a, x, sumA[j]);
          if (j > block) sumB[j] = mulAdd(b, x, sumB[j]);
        }
      }
      for (int j = block; j < kColumns; ++j) {
        gram[pairIndex(block, j)] = sumA[j];
        if (j > block) gram[pairIndex(block + 1, j)] = sumB[j];
      }
    }
    Lanes zero(0.0f), square[3], toResidual[kColumns][3];
    for (int c = 0; c < 3; ++c) {
      square[c] = zero;
      for (auto& t : toResidual) t[c] = zero;
    }
    for (int row = 0; row < rows; ++row) {
      const int base = (row / 2) * 6 + (row % 2) * 3;
      const Lanes d = column(row, kD), s = column(row, kS);
      for (int c = 0; c < 3; ++c) {
        const Lanes r = mulAdd(out.diffuse[c], d, mulAdd(out.specular[c], s, -load(z_, base + c)));
        square[c] = mulAdd(r, r, square[c]);
        for (int j = kDx; j < kColumns; ++j) toResidual[j][c] = mulAdd(column(row, j), r, toResidual[j][c]);
      }
    }

    for (auto& g : out.gradient) g = zero;
    for (auto& h : out.hessian) h = zero;
    Lanes cost = zero;
    Lanes dcRow[kColumns];
    for (int j = 0; j < kColumns; ++j) dcRow[j] = column(rows, j);
    const Lanes priorD(1.0f / (setup_.priors.diffuseSigma * setup_.priors.diffuseSigma));
    const Lanes priorS(1.0f / (setup_.priors.specularSigma * setup_.priors.specularSigma));
    Lanes priorCost = zero;
    for (int c = 0; c < 3; ++c) {
      const Lanes w = weight_[c], w0 = dcWeight_[c], ad = out.diffuse[c], as = out.specular[c];
      const Lanes r0 = ad * dcRow[kD] + as * dcRow[kS] - dc_[c];
      cost = cost + w * square[c] + w0 * r0 * r0;
      priorCost = priorCost + priorD * ad * ad + priorS * as * as;
      Lanes g[kPairs];
      for (int i = 0; i < kColumns; ++i)
        for (int j = i; j < kColumns; ++j)
          g[pairIndex(i, j)] = w * gram[pairIndex(i, j)] + w0 * dcRow[i] * dcRow[j];
      auto at = [&](int i, int j) { return g[pairIndex(i, j)]; };
      Lanes e[kColumns];
      for (int j = kDx; j < kColumns; ++j) e[j] = w * toResidual[j][c] + w0 * dcRow[j] * r0;
      out.gradient[0] = out.gradient[0] + as * e[kSl];
      out.gradient[1] = out.gradient[1] + as * e[kSk];
      out.gradient[2] = out.gradient[2] + ad * e[kDx] + as * e[kSx];
      out.gradient[3] = out.gradient[3] + ad * e[kDy] + as * e[kSy];
      // J^T J of the lobe parameters ...
      const Lanes aa = as * as, da = ad * as, ddd = ad * ad;
      Lanes h[10];
      h[0] = aa * at(kSl, kSl);
      h[1] = aa * at(kSl, kSk);
      h[2] = da * at(kDx, kSl) + aa * at(kSl, kSx);
      h[3] = da * at(kDy, kSl) + aa * at(kSl, kSy);
      h[4] = aa * at(kSk, kSk);
      h[5] = da * at(kDx, kSk) + aa * at(kSk, kSx);
      h[6] = da * at(kDy, kSk) + aa * at(kSk, kSy);
      h[7] = ddd * at(kDx, kDx) + Lanes(2.0f) * da * at(kDx, kSx) + aa * at(kSx, kSx);
      h[8] = ddd * at(kDx, kDy) + da * (at(kDx, kSy) + at(kDy, kSx)) + aa * at(kSx, kSy);
      h[9] = ddd * at(kDy, kDy) + Lanes(2.0f) * da * at(kDy, kSy) + aa * at(kSy, kSy);
      // ... minus the Schur complement of the albedos that are free to move
      const Mask dFree = less(zero, ad), sFree = less(zero, as);
      Lanes crossD[4], crossS[4];
      crossD[0] = as * at(kD, kSl);
      crossD[1] = as * at(kD, kSk);
      crossD[2] = ad * at(kD, kDx) + as * at(kD, kSx);
      crossD[3] = ad * at(kD, kDy) + as * at(kD, kSy);
      crossS[0] = as * at(kS, kSl);
      crossS[1] = as * at(kS, kSk);
      crossS[2] = ad * at(kS, kDx) + as * at(kS, kSx);
      crossS[3] = ad * at(kS, kDy) + as * at(kS, kSy);
      for (int i = 0; i < 4; ++i) {
        crossD[i] = select(dFree, crossD[i], zero);
        crossS[i] = select(sFree, crossS[i], zero);
      }
      const Lanes a = at(kD, kD) + priorD, d = at(kS, kS) + priorS,
                  b = select(hn::And(dFree, sFree), at(kD, kS), zero);
      const Lanes invDet = Lanes(1.0f) / vmax(a * d - b * b, Lanes(1e-30f));
      for (int i = 0; i < 4; ++i) {
        const Lanes u = (d * crossD[i] - b * crossS[i]) * invDet,
                    v = (a * crossS[i] - b * crossD[i]) * invDet;
        for (int j = i; j < 4; ++j) h[kUpper[i][j]] = h[kUpper[i][j]] - u * crossD[j] - v * crossS[j];
      }
      for (int i = 0; i < 10; ++i) out.hessian[i] = out.hessian[i] + h[i];
    }
    // priors on the lobe parameters; slopes stand for the tangential components
    auto prior = [&](int i, Lanes value, float mean, float sigma) {
      const Lanes precision(1.0f / (sigma * sigma)), gap = value - Lanes(mean);
      priorCost = priorCost + precision * gap * gap;
      out.gradient[i] = out.gradient[i] + precision * gap;
      out.hessian[kUpper[i][i]] = vmax(out.hessian[kUpper[i][i]], zero) + precision;
    };
    const FourierPriors& p = setup_.priors;
    prior(0, theta.logSigma, p.logSigmaMean, p.logSigmaSigma);
    prior(1, theta.logKurtosis, p.logKurtosisMean, p.logKurtosisSigma);
    prior(2, theta.slopeX, 0.0f, p.normalSigma);
    prior(3, theta.slopeY, 0.0f, p.normalSigma);
    out.dataCost = cost;
    out.cost = cost + priorCost;
  }

  const SolverSetup& setup_;
  const int frequencies_;
  const std::size_t lanes_;
  LobeSite<Lanes> site_;
  Lanes footX_, footY_, weight_[3], dcWeight_[3], dc_[3];
  float *diffuse_, *z_, *columns_;
};

/// (H + lambda diag H) step = -g, by LDL^T on four unknowns.
HWY_INLINE void dampedStep(const Evaluation& e, Lanes lambda, Lanes (&step)[4]) {
  Lanes l[4][4], d[4];
  const Lanes one(1.0f);
  for (int i = 0; i < 4; ++i) {
    Lanes diagonal = e.hessian[kUpper[i][i]] * (one + lambda);
    for (int k = 0; k < i; ++k) diagonal = diagonal - l[i][k] * l[i][k] * d[k];
    d[i] = vmax(diagonal, Lanes(1e-9f));
    for (int j = i + 1; j < 4; ++j) {
      Lanes sum = e.hessian[kUpper[i][j]];
      for (int k = 0; k < i; ++k) sum = sum - l[j][k] * l[i][k] * d[k];
      l[j][i] = sum / d[i];
    }
  }
  Lanes y[4];
  for (int i = 0; i < 4; ++i) {
    y[i] = -e.gradient[i];
    for (int k = 0; k < i; ++k) y[i] = y[i] - l[i][k] * y[k];
  }
  for (int i = 3; i >= 0; --i) {
    step[i] = y[i] / d[i];
    for (int k = i + 1; k < 4; ++k) step[i] = step[i] - l[k][i] * step[k];
  }
}

// Bounds that keep a lane finite; wider than any material or any camera could show.
constexpr float kLogSigmaRange[2] = {-6.5f, 0.7f};
constexpr float kLogKurtosisRange[2] = {-7.0f, 1.6f};
constexpr float kSlopeRange = 1.5f;

void SolveBatch(const SolverSetup& setup, std::span<const SiteData> data,
                std::span<const LobeParameters> start, float* workspace, std::span<SiteSolution> out) {
  const Tag tag;
  const std::size_t lanes = hn::Lanes(tag);
  Batch batch(setup, workspace, data);
  HWY_ALIGN float buffer[HWY_MAX_BYTES / sizeof(float)] = {};
  auto gather = [&](auto get) {
    for (std::size_t i = 0; i < lanes; ++i) buffer[i] = get(start[std::min(i, start.size() - 1)]);
    return Lanes(hn::Load(tag, buffer));
  };
  Theta theta{clampTo(gather([](const LobeParameters& p) { return p.logSigma; }), kLogSigmaRange[0],
                      kLogSigmaRange[1]),
              clampTo(gather([](const LobeParameters& p) { return p.logKurtosis; }), kLogKurtosisRange[0],
                      kLogKurtosisRange[1]),
              clampTo(gather([](const LobeParameters& p) { return p.slopeX; }), -kSlopeRange, kSlopeRange),
              clampTo(gather([](const LobeParameters& p) { return p.slopeY; }), -kSlopeRange, kSlopeRange)};
  Evaluation current, trial;
  batch.evaluate(theta, current);
  Lanes lambda(1e-3f), iterations(0.0f);
  const Lanes zero(0.0f), one(1.0f);
  Mask active = less(zero, one), converged = less(one, zero);
  // A lane has converged when an accepted step lowers the cost by less than `tolerance` of it, or when no
  // step lowers it any more.
  for (int iteration = 0; iteration < setup.maxIterations && !hn::AllFalse(tag, active); ++iteration) {
    Lanes step[4];
    dampedStep(current, lambda, step);
    const Lanes longestSlope = vmax(Lanes(0.04f), Lanes(1.5f) * vexp(theta.logSigma));
    const Lanes slopeLength = vsqrt(step[2] * step[2] + step[3] * step[3] + Lanes(1e-20f));
    Lanes scale = vmin(one, longestSlope / slopeLength);
    scale = vmin(scale, Lanes(0.7f) / vmax(Lanes(hn::Abs(step[0].v)), Lanes(1e-6f)));
    scale = vmin(scale, one / vmax(Lanes(hn::Abs(step[1].v)), Lanes(1e-6f)));
    const Theta next{clampTo(theta.logSigma + scale * step[0], kLogSigmaRange[0], kLogSigmaRange[1]),
                     clampTo(theta.logKurtosis + scale * step[1], kLogKurtosisRange[0], kLogKurtosisRange[1]),
                     clampTo(theta.slopeX + scale * step[2], -kSlopeRange, kSlopeRange),
                     clampTo(theta.slopeY + scale * step[3], -kSlopeRange, kSlopeRange)};
    batch.evaluate(next, trial);
    const Mask better = hn::And(less(trial.cost, current.cost), active);  // false for NaN
    const Lanes gain = current.cost - trial.cost;
    const Mask small = hn::And(better, less(gain, Lanes(setup.tolerance) * current.cost));
    auto take = [&](Lanes& to, Lanes from) { to = select(better, from, to); };
    take(theta.logSigma, next.logSigma);
    take(theta.logKurtosis, next.logKurtosis);
    take(theta.slopeX, next.slopeX);
    take(theta.slopeY, next.slopeY);
    take(current.cost, trial.cost);
    take(current.dataCost, trial.dataCost);
    for (int c = 0; c < 3; ++c)
      take(current.diffuse[c], trial.diffuse[c]), take(current.specular[c], trial.specular[c]);
    for (int i = 0; i < 4; ++i) take(current.gradient[i], trial.gradient[i]);
    for (int i = 0; i < 10; ++i) take(current.hessian[i], trial.hessian[i]);
    iterations = select(active, iterations + one, iterations);
    lambda = select(better, vmax(lambda * Lanes(0.2f), Lanes(1e-7f)), lambda * Lanes(5.0f));
    const Mask stuck = hn::AndNot(better, less(Lanes(1e5f), lambda));
    const Mask finished = hn::And(hn::Or(small, stuck), active);
    converged = hn::Or(converged, finished);
    active = hn::AndNot(finished, active);
  }
  auto scatter = [&](Lanes value, auto set) {
    hn::Store(value.v, tag, buffer);
    for (std::size_t i = 0; i < out.size(); ++i) set(out[i], buffer[i]);
  };
  scatter(theta.logSigma, [](SiteSolution& s, float x) { s.lobe.logSigma = x; });
  scatter(theta.logKurtosis, [](SiteSolution& s, float x) { s.lobe.logKurtosis = x; });
  scatter(theta.slopeX, [](SiteSolution& s, float x) { s.lobe.slopeX = x; });
  scatter(theta.slopeY, [](SiteSolution& s, float x) { s.lobe.slopeY = x; });
  scatter(current.cost, [](SiteSolution& s, float x) { s.cost = x; });
  scatter(current.dataCost, [](SiteSolution& s, float x) { s.dataCost = x; });
  for (int c = 0; c < 3; ++c) {
    scatter(current.diffuse[c], [c](SiteSolution& s, float x) { s.diffuse[c] = x; });
    scatter(current.specular[c], [c](SiteSolution& s, float x) { s.specular[c] = x; });
  }
  scatter(iterations, [](SiteSolution& s, float x) { s.iterations = static_cast<int>(x); });
  scatter(select(converged, one, zero), [](SiteSolution& s, float x) {
    s.outcome = !std::isfinite(s.cost) ? SolveOutcome::Failed
                : x > 0.5f             ? SolveOutcome::Converged
                                       : SolveOutcome::IterationLimit;
  });
}

void SolveSites(const SolverSetup& setup, std::span<const SiteData> data,
                std::span<const LobeParameters> start, std::span<SiteSolution> out) {
  thread_local hwy::AlignedFreeUniquePtr<float[]> workspace;
  thread_local std::size_t held = 0;
  const std::size_t need = Batch::workspaceFloats(static_cast<int>(setup.frequency.size()));
  if (held < need) workspace = hwy::AllocateAligned<float>(need), held = need;
  const std::size_t lanes = hn::Lanes(Tag());
  for (std::size_t first = 0; first < data.size(); first += lanes) {
    const std::size_t count = std::min(lanes, data.size() - first);
    SolveBatch(setup, data.subspan(first, count), start.subspan(first, count), workspace.get(),
               out.subspan(first, count));
  }
}

CostAndGradient EvaluateSite(const SolverSetup& setup, const SiteData& data, const LobeParameters& at) {
  auto workspace =
      hwy::AllocateAligned<float>(Batch::workspaceFloats(static_cast<int>(setup.frequency.size())));
  Batch batch(setup, workspace.get(), {&data, 1});
  Evaluation e;
  batch.evaluate({Lanes(at.logSigma), Lanes(at.logKurtosis), Lanes(at.slopeX), Lanes(at.slopeY)}, e);
  CostAndGradient out;
  out.cost = hn::GetLane(e.cost.v);
  for (int i = 0; i < 4; ++i) out.gradient[i] = hn::GetLane(e.gradient[i].v);
  return out;
}

void ModelColumns(const SolverSetup& setup, std::span<const SiteData> data,
                  std::span<const LobeParameters> at, float* out) {
  static_assert(kColumns == kModelColumns);
  const Tag tag;
  const std::size_t lanes = hn::Lanes(tag), rows = 2 * setup.frequency.size() + 1;
  auto workspace =
      hwy::AllocateAligned<float>(Batch::workspaceFloats(static_cast<int>(setup.frequency.size())));
  HWY_ALIGN float buffer[HWY_MAX_BYTES / sizeof(float)] = {};
  for (std::size_t first = 0; first < data.size(); first += lanes) {
    const std::size_t count = std::min(lanes, data.size() - first);
    const auto gather = [&](auto get) {
      for (std::size_t i = 0; i < lanes; ++i) buffer[i] = get(at[first + std::min(i, count - 1)]);
      return Lanes(hn::Load(tag, buffer));
    };
    Batch batch(setup, workspace.get(), data.subspan(first, count));
    batch.columnsOf({gather([](const LobeParameters& p) { return p.logSigma; }),
                     gather([](const LobeParameters& p) { return p.logKurtosis; }),
                     gather([](const LobeParameters& p) { return p.slopeX; }),
                     gather([](const LobeParameters& p) { return p.slopeY; })},
                    count, out + first * rows * kColumns);
  }
}

int LaneCount() {
  return static_cast<int>(hn::Lanes(Tag()));
}
const char* TargetName() {
  return hwy::TargetName(HWY_TARGET);
}

}  // namespace patina::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace patina {

HWY_EXPORT(SolveSites);
HWY_EXPORT(EvaluateSite);
HWY_EXPORT(ModelColumns);
HWY_EXPORT(LaneCount);
HWY_EXPORT(TargetName);

void solveSites(const SolverSetup& setup, std::span<const SiteData> data,
                std::span<const LobeParameters> start, std::span<SiteSolution> out) {
  HWY_DYNAMIC_DISPATCH(SolveSites)(setup, data, start, out);
}
CostAndGradient evaluateSite(const SolverSetup& setup, const SiteData& data, const LobeParameters& at) {
  return HWY_DYNAMIC_DISPATCH(EvaluateSite)(setup, data, at);
}
void modelColumns(const SolverSetup& setup, std::span<const SiteData> data,
                  std::span<const LobeParameters> at, float* out) {
  HWY_DYNAMIC_DISPATCH(ModelColumns)(setup, data, at, out);
}
int solverLanes() {
  return HWY_DYNAMIC_DISPATCH(LaneCount)();
}
const char* solverTarget() {
  return HWY_DYNAMIC_DISPATCH(TargetName)();
}

}  // namespace patina
#endif
