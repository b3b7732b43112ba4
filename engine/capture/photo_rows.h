#pragma once

#include <memory>
#include <span>

#include "engine/base/result.h"
#include "engine/capture/capture.h"

namespace patina {

/// A photograph read from top to bottom, some rows at a time, decoded as `readPhoto` does (encoding undone,
/// radianceScale applied). Large photographs are never in memory as a whole; no file stays open between two
/// calls. Movable. Threading: one thread at a time; any number of photographs.
class PhotoRows {
 public:
  /// Looks for the file; decoding tables are shared by photographs that are opened with the same `tables`.
  /// Errors as `readPhoto`.
  class Tables;
  static std::shared_ptr<Tables> makeTables();
  static Result<PhotoRows> open(const FourierCapture& capture, const FourierPhoto& photo,
                                const std::shared_ptr<Tables>& tables);
  PhotoRows(PhotoRows&&) noexcept;
  PhotoRows& operator=(PhotoRows&&) noexcept;
  ~PhotoRows();

  /// The next `rowCount` rows, [row][x][R G B] radiance. Errors: those of `readPhoto`, found as the rows
  /// come; pixels are named by their place in the whole picture.
  Status next(int rowCount, std::span<float> out);
  /// Leaves rows out.
  Status skip(int rowCount);

 private:
  struct State;
  explicit PhotoRows(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace patina
