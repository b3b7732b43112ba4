#pragma once

#include <vector>

#include "engine/fourier/solver.h"

namespace patina {

/// The frequencies by direction: along w = k u everything that depends on w is a polynomial in k.
struct FrequencyPlan {
  struct Row {
    float k = 1;
    int source = 0;    ///< index into setup.frequency
    int diffuse = -1;  ///< index among the rows that have a diffuse part
  };
  struct Direction {
    float x = 1, y = 0;
    int first = 0, count = 0;  ///< rows
  };
  std::vector<Row> rows;
  std::vector<Direction> directions;
  int diffuseRows = 0;
  std::vector<int> diffuseRow,
      diffuseSource;  ///< of each row that has a diffuse part: index of `rows`, `source`

  explicit FrequencyPlan(const SolverSetup& setup);
};

}  // namespace patina
