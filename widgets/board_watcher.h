#pragma once

#include <QObject>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "engine/calibration/board_detection.h"
#include "widgets/live_view.h"

namespace patina {

/// A board to look for, and on which side of a mirror.
struct WatchedBoard {
  Board board;
  BoardSide side = BoardSide::Direct;
};

/// What a live frame shows of the boards that are looked for.
struct BoardSighting {
  LiveFramePtr frame;
  std::vector<WatchedBoard> boards;
  std::vector<BoardDetection> found;  ///< one for each of `boards`
};
using BoardSightingPtr = std::shared_ptr<const BoardSighting>;

/// Looks for boards in live frames on a thread of its own. The newest frame wins: those that come while one
/// is being looked at are dropped. The window's thread never waits.
class BoardWatcher : public QObject {
  Q_OBJECT

 public:
  explicit BoardWatcher(QObject* parent = nullptr);
  ~BoardWatcher() override;
  /// What to look for from now on; a sighting of other boards that is on its way is dropped.
  void setBoards(std::vector<WatchedBoard> boards);
  const std::vector<WatchedBoard>& boards() const { return boards_; }
  void look(LiveFramePtr frame);
  /// Drops what is on its way.
  void forget();

 Q_SIGNALS:
  void seen(patina::BoardSightingPtr sighting);

 private:
  void work(const std::stop_token& stop);

  std::vector<WatchedBoard> boards_;  ///< the window's thread only
  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::shared_ptr<BoardSighting> next_;
  std::uint64_t era_ = 0;
  std::jthread thread_;  ///< last: destroyed first
};

/// Tells when a board that is held in the hand stands still. Corners are compared by their ids.
class StillnessJudge {
 public:
  /// So many sightings in a row whose corners moved by less than `mostPx` from the first of them on.
  explicit StillnessJudge(int sightings = 5, double mostPx = 0.35) : needed_(sightings), mostPx_(mostPx) {}
  /// Takes a view in; true where it stands still with it.
  bool add(const BoardView& view);
  void reset() { run_.clear(); }
  /// 0 to 1: how long it has been still, of what is needed.
  double progress() const { return std::min(1.0, static_cast<double>(run_.size()) / needed_); }
  /// The views of the run, averaged corner by corner.
  BoardView mean() const;

 private:
  int needed_;
  double mostPx_;
  std::vector<BoardView> run_;
};

/// Mean distance of corners that both views have, pixels; nothing where they share fewer than four.
std::optional<double> meanCornerDistance(const BoardView& a, const BoardView& b);

}  // namespace patina
