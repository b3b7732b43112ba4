#pragma once

#include <QWidget>
#include <memory>
#include <vector>

namespace patina {

/// A large number on every screen, for as long as this lives: the person says which they see. Clicks and keys
/// pass by it.
class ScreenNumbers {
 public:
  /// 1, 2, ... in the order of `screensThere`.
  ScreenNumbers();
  ~ScreenNumbers();
  const std::vector<std::unique_ptr<QWidget>>& windows() const { return windows_; }

 private:
  std::vector<std::unique_ptr<QWidget>> windows_;
};

}  // namespace patina
