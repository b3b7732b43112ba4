#include "engine/calibration/monotone.h"

#include <algorithm>
#include <cmath>

namespace patina {

std::vector<double> isotonic(const std::vector<double>& values, const std::vector<double>& weights) {
  struct Pool {
    double mean, weight;
    std::size_t count;
  };
  std::vector<Pool> pools;
  for (std::size_t i = 0; i < values.size(); ++i) {
    pools.push_back({values[i], weights[i], 1});
    while (pools.size() > 1 && pools[pools.size() - 2].mean > pools.back().mean) {
      const Pool last = pools.back();
      pools.pop_back();
      Pool& before = pools.back();
      const double weight = before.weight + last.weight;
      before.mean = weight > 0 ? (before.mean * before.weight + last.mean * last.weight) / weight
                               : 0.5 * (before.mean + last.mean);
      before.weight = weight, before.count += last.count;
    }
  }
  std::vector<double> out;
  for (const Pool& pool : pools) out.insert(out.end(), pool.count, pool.mean);
  return out;
}

double monotoneCubic(const std::vector<double>& x, const std::vector<double>& y, double at) {
  const std::size_t n = x.size();
  if (n == 0) return 0;
  if (n == 1 || at <= x.front()) return y.front();
  if (at >= x.back()) return y.back();
  const std::size_t i = static_cast<std::size_t>(std::upper_bound(x.begin(), x.end(), at) - x.begin()) - 1;
  const auto secant = [&](std::size_t k) { return (y[k + 1] - y[k]) / (x[k + 1] - x[k]); };
  // Slopes by the harmonic mean of the neighbouring secants, which never overshoots.
  const auto slope = [&](std::size_t k) {
    if (k == 0) return secant(0);
    if (k == n - 1) return secant(n - 2);
    const double a = secant(k - 1), b = secant(k);
    if (!(a > 0 && b > 0)) return 0.0;
    const double ha = x[k] - x[k - 1], hb = x[k + 1] - x[k];
    return 3 * (ha + hb) / ((2 * hb + ha) / a + (hb + 2 * ha) / b);
  };
  const double h = x[i + 1] - x[i], t = (at - x[i]) / h;
  double left = slope(i), right = slope(i + 1);
  // At the ends the secant itself is the slope, which three secants bound.
  const double most = 3 * secant(i);
  left = std::min(left, most), right = std::min(right, most);
  const double t2 = t * t, t3 = t2 * t;
  return (2 * t3 - 3 * t2 + 1) * y[i] + (t3 - 2 * t2 + t) * h * left + (3 * t2 - 2 * t3) * y[i + 1] +
         (t3 - t2) * h * right;
}

}  // namespace patina
