#include "widgets/photo_cache.h"

#include <QMetaObject>
#include <exception>
#include <new>

namespace patina {

Image reducedPicture(const Image& image, int side) {
  const int block = std::max(1, (std::max(image.width(), image.height()) + side - 1) / side);
  if (block == 1) return image;
  Image out(std::max(1, image.width() / block), std::max(1, image.height() / block), image.channels());
  for (int y = 0; y < out.height(); ++y)
    for (int x = 0; x < out.width(); ++x)
      for (int c = 0; c < out.channels(); ++c) {
        float sum = 0;
        int count = 0;
        for (int v = y * block; v < std::min((y + 1) * block, image.height()); ++v)
          for (int u = x * block; u < std::min((x + 1) * block, image.width()); ++u, ++count)
            sum += image.at(u, v, c);
        out.at(x, y, c) = sum / count;
      }
  return out;
}

PhotoCache::PhotoCache(QObject* parent) : QObject(parent) {
  worker_ = std::jthread([this](std::stop_token stop) { run(stop); });
}

PhotoCache::~PhotoCache() {
  worker_.request_stop();
  wake_.notify_all();
  worker_.join();
}

void PhotoCache::open(Source source) {
  ++bundle_;
  source_ = std::make_shared<const Source>(std::move(source));
  thumbnails_.assign(source_->names.size(), QImage());
  asked_.clear();
  failed_.clear();
  loaded_ = 0;
  tone_.reset();
  kept_.clear();
  cachedBytes_ = 0;
  {
    const std::lock_guard lock(mutex_);
    queue_.clear();
  }
  if (source_->brightest >= 0) thumbnail(source_->brightest);
}

QImage PhotoCache::thumbnail(int photo) {
  if (photo < 0 || photo >= count()) return {};
  if (thumbnails_[photo].isNull() && !failed_.count(photo) && asked_.insert(photo).second)
    enqueue({bundle_, source_, photo, false});
  return thumbnails_[photo];
}

void PhotoCache::requestPhoto(int photo) {
  if (photo < 0 || photo >= count()) return;
  for (auto entry = kept_.begin(); entry != kept_.end(); ++entry)
    if (entry->first == photo) {
      kept_.splice(kept_.begin(), kept_, entry);
      Q_EMIT photoReady(photo, kept_.front().second);
      return;
    }
  enqueue({bundle_, source_, photo, true});
}

void PhotoCache::enqueue(Work work) {
  {
    const std::lock_guard lock(mutex_);
    if (work.whole) {
      std::erase_if(queue_, [](const Work& other) { return other.whole; });
      queue_.push_front(std::move(work));
    } else {
      queue_.push_back(std::move(work));
    }
  }
  wake_.notify_one();
}

void PhotoCache::run(std::stop_token stop) {
  // The first photograph of a bundle that is read says how bright all of them are shown.
  std::uint64_t toneOf = 0;
  std::optional<ToneSettings> tone;
  while (!stop.stop_requested()) {
    Work work;
    {
      std::unique_lock lock(mutex_);
      if (!wake_.wait(lock, stop, [this] { return !queue_.empty(); })) return;
      work = std::move(queue_.front());
      queue_.pop_front();
    }
    if (work.bundle != toneOf) tone.reset();
    toneOf = work.bundle;
    Outcome outcome;
    try {
      outcome = read(work, tone);
    } catch (const std::bad_alloc&) {
      outcome.error = Error{ErrorCode::Invalid,
                            "there is not enough memory for this photograph",
                            {},
                            "close other programs, or capture at a lower resolution"};
    } catch (const std::exception& fault) {
      outcome.error = Error{ErrorCode::Invalid,
                            std::string("a fault of this program stopped the reading: ") + fault.what(),
                            {},
                            "please report this"};
    } catch (...) {
      outcome.error =
          Error{ErrorCode::Invalid, "a fault of this program stopped the reading", {}, "please report this"};
    }
    if (outcome.error && outcome.error->where.empty()) outcome.error->where = work.source->names[work.photo];
    outcome.work = std::move(work);
    if (!tone && !outcome.error) tone = outcome.tone;
    QMetaObject::invokeMethod(
        this, [this, outcome = std::move(outcome)]() mutable { receive(std::move(outcome)); },
        Qt::QueuedConnection);
  }
}

PhotoCache::Outcome PhotoCache::read(const Work& work, const std::optional<ToneSettings>& tone) const {
  Outcome outcome;
  auto image = work.source->read(work.photo);
  if (!image) {
    outcome.error = image.error();
    return outcome;
  }
  outcome.tone = work.source->tone ? work.source->tone(work.photo, *image)
                 : tone            ? *tone
                                   : automaticTone(ToneStyle::LinearRgb, *image);
  outcome.thumbnail =
      toneMapped(reducedPicture(*image, kThumbnailSide), ToneMapper(ToneStyle::LinearRgb, outcome.tone));
  if (work.whole) outcome.image = std::make_shared<const Image>(std::move(*image));
  return outcome;
}

void PhotoCache::receive(Outcome outcome) {
  if (outcome.work.bundle != bundle_) return;  // of a bundle that is no longer open
  const int photo = outcome.work.photo;
  if (outcome.error) {
    failed_.insert(photo);
    Q_EMIT thumbnailReady(photo);
    Q_EMIT photoFailed(photo, *outcome.error);
    return;
  }
  if (!tone_) {
    tone_ = outcome.tone;
    Q_EMIT toneReady(*tone_);
  }
  if (thumbnails_[photo].isNull()) ++loaded_;
  thumbnails_[photo] = outcome.thumbnail;
  Q_EMIT thumbnailReady(photo);
  if (outcome.image) {
    keep(photo, outcome.image);
    Q_EMIT photoReady(photo, outcome.image);
  }
}

void PhotoCache::keep(int photo, std::shared_ptr<const Image> image) {
  cachedBytes_ += image->samples().size_bytes();
  kept_.emplace_front(photo, std::move(image));
  while (cachedBytes_ > kCacheBytes && kept_.size() > 1) {
    cachedBytes_ -= kept_.back().second->samples().size_bytes();
    kept_.pop_back();
  }
}

}  // namespace patina
