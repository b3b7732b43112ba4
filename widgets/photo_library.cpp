#include "widgets/photo_library.h"

namespace patina {

PhotoLibrary::PhotoLibrary(Reader reader, QObject* parent) : PhotoCache(parent), reader_(std::move(reader)) {}

void PhotoLibrary::setCapture(std::shared_ptr<const FourierCapture> capture) {
  capture_ = std::move(capture);
  Source source;
  if (capture_) {
    for (std::size_t i = 0; i < capture_->photos.size(); ++i) {
      source.names.push_back(capture_->photos[i].file);
      // The window photograph first: it says how bright the others are.
      if (source.brightest < 0 && capture_->photos[i].role == PhotoRole::Window)
        source.brightest = static_cast<int>(i);
    }
    source.read = [reader = reader_, held = capture_](int photo) {
      return reader(*held, held->photos[photo]);
    };
  }
  open(std::move(source));
}

}  // namespace patina
