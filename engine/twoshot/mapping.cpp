#include "engine/twoshot/mapping.h"

namespace patina {

double mappingWeight(const HalfDiffAngles& angles) {
  const DirectionPair pair = directionsFromHalfDiff(angles);
  return mappingWeight(pair.toLight.z(), pair.toView.z());
}

}  // namespace patina
