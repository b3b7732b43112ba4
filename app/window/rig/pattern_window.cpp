#include "app/window/rig/pattern_window.h"

#include <QBackingStore>
#include <QGuiApplication>
#include <QImage>
#include <QKeyEvent>
#include <QPainter>
#include <QScreen>
#include <QWindow>
#include <cmath>
#include <condition_variable>
#include <mutex>
#include <optional>

#include "app/window/rig/screen_inhibitor.h"

namespace patina {

namespace {

using std::chrono::microseconds;

constexpr auto kPatience = std::chrono::seconds(5);  ///< until a picture must be on the screen
constexpr double kGuessedHz = 60;                    ///< where a screen doesn't say
/// Until it is measured: nearly every panel and compositor is faster.
constexpr auto kGuessedLatency = std::chrono::milliseconds(150);

QSize pixelsOf(const QScreen& screen) {
  const QSizeF size = QSizeF(screen.geometry().size()) * screen.devicePixelRatio();
  return {static_cast<int>(std::lround(size.width())), static_cast<int>(std::lround(size.height()))};
}

class PatternCanvas;

/// What the window and its display say to each other.
struct Link {
  std::mutex mutex;
  std::condition_variable_any changed;
  std::uint64_t asked = 0, shown = 0;
  RigTime swapped{};
  std::optional<Error> gone;
  microseconds latency = kGuessedLatency;
  ScreenInfo info;
  GlassObserver* observer = nullptr;  ///< its clock is kept
  PatternCanvas* canvas = nullptr;    ///< the window's thread only
};

/// The window itself: draws a picture's values into its pixels, one to one, without a transform.
class PatternCanvas : public QWindow {
 public:
  PatternCanvas(QScreen* screen, std::shared_ptr<Link> link, std::function<void(const Error&)> left)
      : QWindow(screen), store_(this), link_(std::move(link)), left_(std::move(left)) {
    setObjectName(QStringLiteral("patternWindow"));
    setTitle(QStringLiteral("Patina"));
    setSurfaceType(QSurface::RasterSurface);
    setFlags(Qt::Window | Qt::FramelessWindowHint | Qt::WindowStaysOnTopHint);
    setScreen(screen);
    setGeometry(screen->geometry());
    setCursor(Qt::BlankCursor);
    connect(qGuiApp, &QGuiApplication::screenRemoved, this, [this, screen](QScreen* removed) {
      if (removed == screen)
        end({ErrorCode::Refused, "the monitor that shows the patterns is gone", link_->info.name,
             "connect it again and choose it anew; what is finished is kept"});
    });
    connect(screen, &QScreen::geometryChanged, this, [this] {
      end({ErrorCode::Refused, "the monitor that shows the patterns has changed its mode", link_->info.name,
           "choose it anew; what is finished is kept"});
    });
  }

  void draw(const ShownPicture& picture, std::uint64_t number) {
    picture_ = picture;
    number_ = number;
    render();
  }

  void end(const Error& error) {
    {
      const std::lock_guard lock(link_->mutex);
      if (link_->gone) return;
      link_->gone = error;
    }
    link_->changed.notify_all();
    hide();
    if (left_) left_(error);
  }

 protected:
  void exposeEvent(QExposeEvent*) override {
    if (isExposed()) render();
  }
  void resizeEvent(QResizeEvent*) override {
    if (isExposed()) render();
  }
  void keyPressEvent(QKeyEvent* event) override {
    if (event->key() != Qt::Key_Escape) return QWindow::keyPressEvent(event);
    end({ErrorCode::Refused, "the pattern window was left with Esc", link_->info.name,
         "go on when the screen may show patterns again; what is finished is kept"});
  }

 private:
  void render() {
    if (!isExposed()) return;
    const QRegion whole(QRect(QPoint(), size()));
    store_.resize(size());
    store_.beginPaint(whole);
    // The store's own image takes the values as they are; a painter would first be asked for transforms.
    QSize pixels;
    if (auto* image = dynamic_cast<QImage*>(store_.paintDevice()); image && image->depth() == 32) {
      pixels = image->size();
      copyTo(*image);
    } else {
      QImage copied(pixelsOf(*screen()), QImage::Format_RGB32);
      copyTo(copied);
      copied.setDevicePixelRatio(devicePixelRatio());
      pixels = copied.size();
      QPainter painter(store_.paintDevice());
      painter.setCompositionMode(QPainter::CompositionMode_Source);
      painter.drawImage(QPointF(), copied);
    }
    store_.endPaint();
    store_.flush(whole);
    if (number_ == 0) return;
    if (pixels.width() != link_->info.widthPx || pixels.height() != link_->info.heightPx) {
      // Until a window manager has made it full-screen it may have another size.
      return;
    }
    confirm();
  }

  void copyTo(QImage& image) const {
    image.fill(Qt::black);
    if (!picture_.pixels) return;
    const int width = std::min(picture_.width, image.width()),
              height = std::min(picture_.height, image.height());
    for (int y = 0; y < height; ++y) {
      const std::uint8_t* from =
          picture_.pixels->data() + static_cast<std::size_t>(y) * picture_.width * picture_.channels;
      auto* to = reinterpret_cast<QRgb*>(image.scanLine(y));
      for (int x = 0; x < width; ++x, from += picture_.channels)
        to[x] = picture_.channels == 3 ? qRgb(from[0], from[1], from[2]) : qRgb(from[0], from[0], from[0]);
    }
  }

  void confirm() {
    // A raster window isn't told of the refresh that takes it; the next one begins within a period.
    const double hz = link_->info.refreshHz > 0 ? link_->info.refreshHz : kGuessedHz;
    const auto period = microseconds(std::lround(1e6 / hz));
    const RigTime now = link_->observer ? link_->observer->now() : std::chrono::steady_clock::now();
    const RigTime swapped = now + period;
    if (link_->observer) link_->observer->glassShows(link_->info.id, picture_, swapped);
    {
      const std::lock_guard lock(link_->mutex);
      link_->shown = number_;
      link_->swapped = swapped;
    }
    link_->changed.notify_all();
  }

  ScreenInhibitor inhibitor_;
  QBackingStore store_;
  std::shared_ptr<Link> link_;
  std::function<void(const Error&)> left_;
  ShownPicture picture_;
  std::uint64_t number_ = 0;
};

class WindowDisplay : public PatternDisplay {
 public:
  explicit WindowDisplay(std::shared_ptr<Link> link) : link_(std::move(link)) {}
  ~WindowDisplay() override {
    // The last copy may be a job's.
    QMetaObject::invokeMethod(
        qGuiApp,
        [link = link_] {
          if (!link->canvas) return;
          link->canvas->hide();
          link->canvas->deleteLater();
          link->canvas = nullptr;
        },
        Qt::AutoConnection);
  }

  ScreenInfo screen() const override { return link_->info; }

  Result<OnGlass> show(const ShownPicture& picture, const std::stop_token& stop) override {
    if (picture.width != link_->info.widthPx || picture.height != link_->info.heightPx)
      return Error{ErrorCode::Invalid, "the picture is not as large as the screen", picture.name,
                   "make it as large"};
    std::uint64_t number = 0;
    {
      const std::lock_guard lock(link_->mutex);
      if (link_->gone) return *link_->gone;
      number = ++link_->asked;
    }
    QMetaObject::invokeMethod(
        qGuiApp,
        [link = link_, picture, number] {
          if (link->canvas) link->canvas->draw(picture, number);
        },
        Qt::QueuedConnection);
    OnGlass shown;
    {
      std::unique_lock lock(link_->mutex);
      const bool there = link_->changed.wait_for(lock, stop, kPatience,
                                                 [&] { return link_->shown >= number || link_->gone; });
      if (link_->gone) return *link_->gone;
      if (stop.stop_requested())
        return Error{ErrorCode::Cancelled, "showing a picture was cancelled", "", ""};
      if (!there)
        return Error{ErrorCode::Refused,
                     "the screen has not shown the pattern window in full size within five seconds",
                     link_->info.name, "set its scale to 100 %, and let nothing cover it"};
      shown.swapped = link_->swapped;
      shown.since = shown.swapped + link_->latency;
    }
    if (!waitUntil(shown.since, stop))
      return Error{ErrorCode::Cancelled, "showing a picture was cancelled", "", ""};
    return shown;
  }

  void setLatency(microseconds latency) override {
    const std::lock_guard lock(link_->mutex);
    link_->latency = latency;
  }
  microseconds latency() const override {
    const std::lock_guard lock(link_->mutex);
    return link_->latency;
  }
  bool wait(microseconds time, const std::stop_token& stop) override {
    const RigTime now = link_->observer ? link_->observer->now() : std::chrono::steady_clock::now();
    return waitUntil(now + time, stop);
  }

 private:
  bool waitUntil(RigTime when, const std::stop_token& stop) {
    if (link_->observer) return link_->observer->waitUntil(when, stop);
    std::unique_lock lock(link_->mutex);
    link_->changed.wait_until(lock, stop, when, [] { return false; });
    return !stop.stop_requested();
  }

  std::shared_ptr<Link> link_;
};

}  // namespace

std::vector<ScreenInfo> screensThere() {
  std::vector<ScreenInfo> screens;
  for (const QScreen* screen : QGuiApplication::screens()) {
    ScreenInfo info;
    info.id = screen->name().toStdString();
    const QString maker = (screen->manufacturer() + QLatin1Char(' ') + screen->model()).trimmed();
    info.name = (maker.isEmpty() ? screen->name() : maker + QStringLiteral(" (") + screen->name() + ')')
                    .toStdString();
    const QSize pixels = pixelsOf(*screen);
    info.widthPx = pixels.width();
    info.heightPx = pixels.height();
    info.widthMm = screen->physicalSize().width();
    info.heightMm = screen->physicalSize().height();
    info.refreshHz = screen->refreshRate();
    const double ratio = screen->devicePixelRatio();
    if (std::abs(ratio - std::round(ratio)) > 1e-6)
      info.warnings.emplace_back(
          "This screen is scaled by a fraction, which may blur patterns: set its scale to 100 % while you "
          "measure.");
    if (QGuiApplication::platformName().startsWith(QStringLiteral("wayland")))
      info.warnings.emplace_back(
          "Under Wayland it can't be told whether the desktop scales patterns: set its scale to 100 %.");
    if (info.refreshHz <= 0)
      info.warnings.emplace_back(
          "Its refresh rate is not known: exposures can't be a whole number of its periods.");
    screens.push_back(info);
  }
  return screens;
}

Result<std::shared_ptr<PatternDisplay>> openPatternWindow(const std::string& screenId,
                                                          GlassObserver* observer,
                                                          std::function<void(const Error&)> left) {
  const std::vector<ScreenInfo> infos = screensThere();
  const QList<QScreen*> screens = QGuiApplication::screens();
  for (std::size_t i = 0; i < infos.size() && static_cast<qsizetype>(i) < screens.size(); ++i) {
    if (infos[i].id != screenId) continue;
    auto link = std::make_shared<Link>();
    link->info = infos[i];
    link->observer = observer;
    auto* canvas = new PatternCanvas(screens[static_cast<qsizetype>(i)], link, std::move(left));
    link->canvas = canvas;
    canvas->showFullScreen();
    canvas->requestActivate();  // so that Esc reaches it
    return std::shared_ptr<PatternDisplay>(std::make_shared<WindowDisplay>(link));
  }
  return Error{ErrorCode::NotFound, "the screen that was chosen is not there any more", screenId,
               "connect it, and choose it again"};
}

}  // namespace patina
