#include "app/window/rig/screen_step.h"

#include <QGuiApplication>
#include <QImage>
#include <QPainter>

#include "app/window/rig/screen_inhibitor.h"
#include "app/window/rig/screen_numbers.h"
#include "app/window/settings.h"
#include "devices/simulated/live_rig.h"
#include "engine/acquire/exposure.h"
#include "engine/acquire/latency.h"
#include "widgets/screen_panel.h"

namespace patina {

namespace {

constexpr double kRulerShare = 0.8;  ///< of the screen's sides
constexpr int kFlashes = 4;
constexpr double kLatencyExposureS = 0.05;  ///< at most: it limits how finely the time is known

}  // namespace

RulerPicture rulerPicture(int widthPx, int heightPx) {
  RulerPicture ruler;
  ruler.acrossPx = static_cast<int>(kRulerShare * widthPx);
  ruler.downPx = static_cast<int>(kRulerShare * heightPx);
  const int left = (widthPx - ruler.acrossPx) / 2, top = (heightPx - ruler.downPx) / 2;
  const int middleX = left + ruler.acrossPx / 4, middleY = top + ruler.downPx / 2;
  const int thick = std::max(2, widthPx / 480), mark = widthPx / 40;
  QImage image(widthPx, heightPx, QImage::Format_Grayscale8);
  image.fill(0);
  QPainter painter(&image);
  painter.setPen(Qt::NoPen);
  painter.setBrush(Qt::white);
  // End marks' outer edges are where the bars end.
  painter.drawRect(left, middleY - thick / 2, ruler.acrossPx, thick);
  painter.drawRect(left, middleY - mark, thick, 2 * mark);
  painter.drawRect(left + ruler.acrossPx - thick, middleY - mark, thick, 2 * mark);
  painter.drawRect(middleX - thick / 2, top, thick, ruler.downPx);
  painter.drawRect(middleX - mark, top, 2 * mark, thick);
  painter.drawRect(middleX - mark, top + ruler.downPx - thick, 2 * mark, thick);
  painter.end();
  auto pixels = std::make_shared<std::vector<std::uint8_t>>();
  pixels->reserve(static_cast<std::size_t>(widthPx) * heightPx);
  for (int y = 0; y < heightPx; ++y)
    pixels->insert(pixels->end(), image.constScanLine(y), image.constScanLine(y) + widthPx);
  ruler.picture.name = "ruler";
  ruler.picture.width = widthPx;
  ruler.picture.height = heightPx;
  ruler.picture.pixels = std::move(pixels);
  return ruler;
}

ScreenStep::ScreenStep(RigController& rig) : rig_(rig) {
  connect(&rig_, &RigController::screenChanged, this, &ScreenStep::refresh);
  connect(&rig_, &RigController::cameraChanged, this, &ScreenStep::refresh);
  connect(qGuiApp, &QGuiApplication::screenAdded, this, [this] { listScreens(); });
  connect(qGuiApp, &QGuiApplication::screenRemoved, this, [this] { listScreens(); });
}

ScreenStep::~ScreenStep() = default;

QString ScreenStep::title() const {
  return tr("Screen");
}

QString ScreenStep::sentence() const {
  if (notChosen())
    return tr(
        "Every screen shows a number now. Place the screen that will light the sample where it stays, dim "
        "the "
        "room, and say which one it is.");
  if (screens_.size() == 1 && rig_.screen()->id != kSimulatedScreen)
    return tr(
        "There is one screen: patterns will cover this window while photographs are taken, and Esc brings it "
        "back. Check the size, and measure how late its light comes.");
  return tr(
      "Check the screen's size with a ruler, and measure how late its light comes. Switch off its own "
      "brightness control, night light and power saving.");
}

QWidget* ScreenStep::body(QWidget* parent) {
  if (panel_) return panel_;
  panel_ = new ScreenPanel(parent);
  connect(panel_, &ScreenPanel::chosen, this, &ScreenStep::choose);
  connect(panel_, &ScreenPanel::rulerRequested, this, &ScreenStep::setRuler);
  connect(panel_, &ScreenPanel::measured, this, &ScreenStep::measured);
  connect(panel_, &ScreenPanel::latencyRequested, this, &ScreenStep::measureLatency);
  return panel_;
}

void ScreenStep::enter() {
  entered_ = true;
  listScreens();
}

void ScreenStep::leave() {
  entered_ = false;
  numbers_.reset();
  if (ruler_) setRuler(false);
}

void ScreenStep::listScreens() {
  if (!entered_) return;
  screens_ = rig_.services().listScreens();
  numbers_ = notChosen() ? std::make_unique<ScreenNumbers>() : nullptr;
  panel_->setScreens(screens_, rig_.simulation() != nullptr);
  refresh();
}

QString ScreenStep::settingsKey(const ScreenInfo& screen) const {
  QString name = QString::fromStdString(screen.id + " " + screen.name);
  name.replace(QLatin1Char('/'), QLatin1Char('_'));
  return QStringLiteral("rig/screens/%1 %2x%3").arg(name).arg(screen.widthPx).arg(screen.heightPx);
}

void ScreenStep::choose(int number) {
  ScreenInfo screen;
  if (number == 0) {
    if (!rig_.simulation()) return;
    screen = rig_.simulation()->openDisplay()->screen();
  } else {
    if (number > static_cast<int>(screens_.size())) return;
    screen = screens_[static_cast<std::size_t>(number) - 1];
    const QStringList size = rig_.settings().text(settingsKey(screen)).split(QLatin1Char('x'));
    if (size.size() == 2) {
      screen.widthMm = size[0].toDouble();
      screen.heightMm = size[1].toDouble();
    }
  }
  numbers_.reset();
  if (ruler_) setRuler(false);
  if (number != 0)
    for (const QString& sentence : desktopColourWarnings()) screen.warnings.push_back(sentence.toStdString());
  rig_.chooseScreen(screen);
  if (rig_.simulation() && number != 0) {
    // What a ruler would say of the simulated glass.
    const Screen& glass = rig_.simulation()->setup().screen;
    screen.widthMm = glass.widthMm;
    screen.heightMm = glass.heightMm;
    rig_.chooseScreen(screen);
  }
}

void ScreenStep::setRuler(bool shown) {
  const auto screen = rig_.screen();
  if (shown && screen) {
    ruler_ = rulerPicture(screen->widthPx, screen->heightPx);
    rig_.showPicture(ruler_->picture);
    panel_->setRuler(true, ruler_->acrossPx, ruler_->downPx);
    panel_->window()->activateWindow();  // typing goes on here
  } else {
    ruler_.reset();
    if (!rig_.busy()) rig_.closeDisplay();
    if (panel_) panel_->setRuler(false, 0, 0);
  }
}

void ScreenStep::measured(double acrossMm, double downMm) {
  auto screen = rig_.screen();
  if (!screen) return;
  screen->widthMm = ruler_ ? acrossMm * screen->widthPx / ruler_->acrossPx : acrossMm;
  screen->heightMm = ruler_ ? downMm * screen->heightPx / ruler_->downPx : downMm;
  rig_.settings().set(
      settingsKey(*screen),
      QStringLiteral("%1x%2").arg(screen->widthMm, 0, 'f', 3).arg(screen->heightMm, 0, 'f', 3));
  rig_.chooseScreen(*screen);
}

void ScreenStep::measureLatency() {
  const auto screen = rig_.screen();
  if (!screen || !rig_.camera()) return;
  if (ruler_) setRuler(false);
  const auto display = rig_.display();
  if (!display) return Q_EMIT rig_.failed(tr("The pattern window"), display.error());
  double exposureS = kLatencyExposureS;
  if (const auto controls = rig_.camera()->controls(); controls)
    for (const CameraControl& control : *controls)
      if (control.id == CameraControlId::ExposureS)
        exposureS = wholeRefreshes(std::min(control.value, kLatencyExposureS), screen->refreshHz,
                                   control.least, control.most);
  measuring_ = true;
  refresh();
  CameraDevice* camera = rig_.camera();
  rig_.run<LatencyMeasurement>(
      tr("Measuring how late the light comes"),
      [camera, shown = *display, exposureS](const JobContext& job) {
        return patina::measureLatency(*camera, *shown, exposureS, kFlashes, job);
      },
      [this](Result<LatencyMeasurement> outcome) {
        measuring_ = false;
        rig_.closeDisplay();
        if (outcome) rig_.setLatency(outcome->latency);
        refresh();
      });
}

void ScreenStep::refresh() {
  if (panel_) {
    panel_->setChosen(notChosen() ? std::nullopt : rig_.screen());
    if (const auto latency = rig_.latency())
      panel_->setLatency(tr("The light of a picture is all there %1 ms after it was drawn, as measured.")
                             .arg(static_cast<double>(latency->count()) / 1000, 0, 'f', 0));
    else
      panel_->setLatency(tr(
          "Not measured: 150 ms are waited for each picture, which is more than most screens need. Measuring "
          "it takes some seconds: the screen flashes while the camera looks at it, or at what it lights."));
    panel_->setMeasuring(measuring_, rig_.camera() && rig_.cameraProblem().isEmpty() && !rig_.busy(),
                         tr("Not now: the camera is not open, or in use."));
  }
  Q_EMIT changed();
}

bool ScreenStep::notChosen() const {
  const auto screen = rig_.screen();
  return !screen || (screen->id == kSimulatedScreen && !rig_.simulation());
}

GuideStep::State ScreenStep::state() const {
  if (notChosen()) return State::ToDo;
  return rig_.screen()->widthMm > 0 && rig_.screen()->heightMm > 0 && !measuring_ ? State::Done : State::ToDo;
}

QString ScreenStep::note() const {
  if (state() != State::Done) return {};
  return tr("%1 \u00d7 %2 mm").arg(rig_.screen()->widthMm, 0, 'f', 1).arg(rig_.screen()->heightMm, 0, 'f', 1);
}

QString ScreenStep::whyNot() const {
  if (notChosen()) return tr("No screen is chosen yet.");
  if (measuring_) return tr("The screen is being looked at.");
  return tr("The screen's size in millimetres is not known yet.");
}

}  // namespace patina
