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
#include <set>
#include <thread>
#include <vector>

#include "engine/capture/capture.h"
#include "widgets/tone.h"

namespace patina {

/// Reads a bundle's photographs on a thread of its own, when they are first wanted: thumbnails stay, whole
/// photographs are kept up to `kCacheBytes`. Results of an earlier bundle are dropped. All public functions
/// belong to the window's thread and never wait.
class PhotoLibrary : public QObject {
  Q_OBJECT

 public:
  using Reader = std::function<Result<Image>(const FourierCapture&, const FourierPhoto&)>;
  static constexpr std::size_t kCacheBytes = std::size_t{256} << 20;
  static constexpr int kThumbnailSide = 160;  ///< pixels, the longer side

  explicit PhotoLibrary(Reader reader, QObject* parent = nullptr);
  ~PhotoLibrary() override;

  void setCapture(std::shared_ptr<const FourierCapture> capture);
  std::shared_ptr<const FourierCapture> capture() const { return capture_; }

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
  /// The brightness that suits all photographs of the bundle, from its window photograph.
  void toneReady(patina::ToneSettings tone);

 private:
  struct Work {
    std::uint64_t bundle = 0;
    std::shared_ptr<const FourierCapture> capture;
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

  Reader reader_;
  std::shared_ptr<const FourierCapture> capture_;
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

}  // namespace patina
