#pragma once

#include "engine/capture/capture.h"
#include "widgets/photo_cache.h"

namespace patina {

/// The photographs of a Fourier bundle.
class PhotoLibrary : public PhotoCache {
  Q_OBJECT

 public:
  using Reader = std::function<Result<Image>(const FourierCapture&, const FourierPhoto&)>;

  explicit PhotoLibrary(Reader reader, QObject* parent = nullptr);

  void setCapture(std::shared_ptr<const FourierCapture> capture);
  std::shared_ptr<const FourierCapture> capture() const { return capture_; }

 private:
  Reader reader_;
  std::shared_ptr<const FourierCapture> capture_;
};

}  // namespace patina
