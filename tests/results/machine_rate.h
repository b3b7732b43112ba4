#pragma once

#include <string>

namespace patina::test {

/// What the machine can do, measured now: the floor under any kernel's time.
struct MachineRate {
  double multiplyAddsPerSecond = 0;  ///< of single-precision lanes, one core; one multiply-add counts as one
  double allCoresMultiplyAddsPerSecond = 0;  ///< with all `threads` at once
  double bytesPerSecond = 0;  ///< a + s b over arrays beyond any cache, all threads: read and written
  int lanes = 0;
  std::string instructions;  ///< "AVX3", "AVX2", ...
};

/// Multiply-adds a second of the calling thread's processor time, from one run of a few milliseconds: to be
/// taken in turn with what it is compared with, since a shared machine's clock and its bookkeeping drift.
double multiplyAddRate();

/// Multiply-adds over registers in the widest vectors that the solver may use, then a sweep over memory.
/// Takes about a second. `threads` > 0.
MachineRate measureMachine(int threads);

}  // namespace patina::test
