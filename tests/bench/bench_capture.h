#pragma once

#include "engine/base/result.h"
#include "engine/capture/capture.h"

namespace patina::bench {

/// The Fourier capture that is measured: the one of PATINA_BENCH_BUNDLE, else a simulated one of
/// PATINA_BENCH_PIXELS (default 256) pixels a side, made once and kept in the build folder.
const Result<FourierCapture>& benchCapture();

}  // namespace patina::bench
