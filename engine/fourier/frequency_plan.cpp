#include "engine/fourier/frequency_plan.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

namespace patina {

FrequencyPlan::FrequencyPlan(const SolverSetup& setup) {
  struct Item {
    int ux, uy;
    float x, y, k;
    int source;
  };
  std::vector<Item> items;
  for (std::size_t f = 0; f < setup.frequency.size(); ++f) {
    const float wx = setup.frequency[f].x(), wy = setup.frequency[f].y();
    const auto ix = static_cast<int>(std::lround(wx)), iy = static_cast<int>(std::lround(wy));
    int common = std::gcd(ix, iy);
    // Frequencies are whole numbers; one that isn't is a direction of its own.
    if (common == 0 || wx != static_cast<float>(ix) || wy != static_cast<float>(iy)) {
      items.push_back({1 << 20, static_cast<int>(f), wx, wy, 1.0f, static_cast<int>(f)});
      continue;
    }
    if (ix < 0 || (ix == 0 && iy < 0)) common = -common;
    items.push_back({ix / common, iy / common, static_cast<float>(ix / common),
                     static_cast<float>(iy / common), static_cast<float>(common), static_cast<int>(f)});
  }
  std::stable_sort(items.begin(), items.end(), [](const Item& a, const Item& b) {
    return std::tie(a.ux, a.uy, a.k) < std::tie(b.ux, b.uy, b.k);
  });
  for (std::size_t i = 0; i < items.size(); ++i) {
    const Item& item = items[i];
    if (i == 0 || item.ux != items[i - 1].ux || item.uy != items[i - 1].uy)
      directions.push_back({item.x, item.y, static_cast<int>(i), 0});
    ++directions.back().count;
    const bool counts =
        setup.diffuseCounts.empty() || setup.diffuseCounts[static_cast<std::size_t>(item.source)];
    if (counts) {
      diffuseRow.push_back(static_cast<int>(i));
      diffuseSource.push_back(item.source);
    }
    rows.push_back({item.k, item.source, counts ? diffuseRows++ : -1});
  }
}

}  // namespace patina
