#include "widgets/board_watcher.h"

#include <QMetaObject>
#include <map>

namespace patina {

BoardWatcher::BoardWatcher(QObject* parent)
    : QObject(parent), thread_([this](const std::stop_token& stop) { work(stop); }) {}

BoardWatcher::~BoardWatcher() {
  thread_.request_stop();
  thread_.join();
}

void BoardWatcher::setBoards(std::vector<WatchedBoard> boards) {
  boards_ = std::move(boards);
  forget();
}

void BoardWatcher::look(LiveFramePtr frame) {
  if (!frame || boards_.empty()) return;
  auto sighting = std::make_shared<BoardSighting>();
  sighting->frame = std::move(frame);
  sighting->boards = boards_;
  {
    const std::lock_guard lock(mutex_);
    next_ = std::move(sighting);
  }
  changed_.notify_one();
}

void BoardWatcher::forget() {
  const std::lock_guard lock(mutex_);
  next_.reset();
  ++era_;
}

void BoardWatcher::work(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    std::shared_ptr<BoardSighting> sighting;
    std::uint64_t era = 0;
    {
      std::unique_lock lock(mutex_);
      if (!changed_.wait(lock, stop, [this] { return next_ != nullptr; })) return;
      sighting = std::move(next_);
      era = era_;
    }
    for (const WatchedBoard& wanted : sighting->boards) {
      BoardDetectionOptions options;
      options.side = wanted.side;
      // A live picture: rather the next frame than one more attempt at this one.
      options.timeLimit = std::chrono::milliseconds(300);
      sighting->found.push_back(detectBoard(sighting->frame->linear, wanted.board, options, stop));
    }
    QMetaObject::invokeMethod(
        this,
        [this, era, sighting] {
          {
            const std::lock_guard lock(mutex_);
            if (era != era_) return;
          }
          Q_EMIT seen(sighting);
        },
        Qt::QueuedConnection);
  }
}

std::optional<double> meanCornerDistance(const BoardView& a, const BoardView& b) {
  double sum = 0;
  int count = 0;
  std::size_t i = 0, j = 0;
  while (i < a.corners.size() && j < b.corners.size()) {
    if (a.corners[i].id < b.corners[j].id) {
      ++i;
    } else if (b.corners[j].id < a.corners[i].id) {
      ++j;
    } else {
      sum += (a.corners[i++].pixel - b.corners[j++].pixel).norm();
      ++count;
    }
  }
  constexpr int kFewest = 4;
  if (count < kFewest) return std::nullopt;
  return sum / count;
}

bool StillnessJudge::add(const BoardView& view) {
  if (!run_.empty()) {
    const auto moved = meanCornerDistance(run_.front(), view);
    if (!moved || *moved > mostPx_) run_.clear();
  }
  run_.push_back(view);
  return static_cast<int>(run_.size()) >= needed_;
}

BoardView StillnessJudge::mean() const {
  if (run_.empty()) return {};
  BoardView view = run_.front();
  std::map<int, std::pair<Eigen::Vector2d, int>> sums;
  for (const BoardView& one : run_)
    for (const BoardCorner& corner : one.corners) {
      auto [at, made] = sums.try_emplace(corner.id, Eigen::Vector2d::Zero(), 0);
      at->second.first += corner.pixel;
      ++at->second.second;
    }
  view.corners.clear();
  for (const auto& [id, sum] : sums) {
    // One that is seen in some frames only is one that is hard to see.
    if (2 * sum.second <= static_cast<int>(run_.size())) continue;
    view.corners.push_back({id, sum.first / sum.second});
  }
  return view;
}

}  // namespace patina
