#pragma once

#include <QImage>
#include <QObject>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "engine/base/result.h"
#include "widgets/tone.h"

namespace patina {

/// Reads a bundle's photographs on a thread of its own, when they are first wanted: thumbnails stay, whole
/// photographs are kept up to `kCacheBytes`. Results of an earlier bundle are dropped. All public functions
/// belong to the window's thread and never wait.
class PhotoCache : public QObject {
  Q_OBJECT

 public:
  static constexpr std::size_t kCacheBytes = std::size_t{256} << 20;
  static constexpr int kThumbnailSide = 160;  ///< pixels, the longer side

  /// A bundle's photographs: how many, what they are called, and how one is read. `read` is called on the
  /// reading thread, one call at a time; it owns whatever it needs.
  struct Source {
    std::vector<std::string> names;
    std::function<Result<Image>(int)> read;
    int brightest = -1;  ///< says how bright all are shown, and is read first; -1: whichever comes first
    /// How bright a thumbnail is shown; empty: all alike, as suits the brightest.
    std::function<ToneSettings(int photo, const Image&)> tone;
  };

  explicit PhotoCache(QObject* parent = nullptr);
  ~PhotoCache() override;

  void open(Source source);
  int count() const { return static_cast<int>(thumbnails_.size()); }

  /// The thumbnail, or a null image: then it has been asked for and `thumbnailReady` follows.
  QImage thumbnail(int photo);
  bool failed(int photo) const { return failed_.count(photo) > 0; }
  /// Answered by `photoReady` or `photoFailed`, at once where it is still in memory. A later request replaces
  /// one not begun.
  void requestPhoto(int photo);
  int thumbnailsLoaded() const { return loaded_; }
  std::size_t cachedBytes() const { return cachedBytes_; }

 Q_SIGNALS:
  void thumbnailReady(int photo);
  void photoReady(int photo, std::shared_ptr<const patina::Image> image);
  void photoFailed(int photo, patina::Error error);
  /// The brightness that suits all photographs of the bundle.
  void toneReady(patina::ToneSettings tone);

 private:
  struct Work {
    std::uint64_t bundle = 0;
    std::shared_ptr<const Source> source;
    int photo = 0;
    bool whole = false;
  };
  struct Outcome {
    Work work;
    std::shared_ptr<const Image> image;
    QImage thumbnail;
    ToneSettings tone;
    std::optional<Error> error;
  };
  void run(std::stop_token stop);
  Outcome read(const Work& work, const std::optional<ToneSettings>& tone) const;
  void receive(Outcome outcome);
  void enqueue(Work work);
  void keep(int photo, std::shared_ptr<const Image> image);

  std::shared_ptr<const Source> source_;
  std::uint64_t bundle_ = 0;
  std::vector<QImage> thumbnails_;
  std::set<int> asked_, failed_;
  int loaded_ = 0;
  std::optional<ToneSettings> tone_;
  std::list<std::pair<int, std::shared_ptr<const Image>>> kept_;  ///< latest first
  std::size_t cachedBytes_ = 0;

  std::mutex mutex_;
  std::condition_variable_any wake_;
  std::deque<Work> queue_;
  std::jthread worker_;  ///< last: it uses all of the above
};

/// A picture averaged in blocks so that its longer side is at most `side`.
Image reducedPicture(const Image& image, int side);

}  // namespace patina
