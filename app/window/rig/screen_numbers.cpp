#include "app/window/rig/screen_numbers.h"

#include <QGuiApplication>
#include <QScreen>

#include "widgets/theme.h"

namespace patina {

namespace {

constexpr double kShareOfHeight = 0.28;

class NumberWindow : public QWidget {
 public:
  NumberWindow(int number, const QScreen& screen)
      : QWidget(nullptr, Qt::ToolTip | Qt::FramelessWindowHint | Qt::WindowStaysOnTopHint |
                             Qt::WindowTransparentForInput | Qt::WindowDoesNotAcceptFocus),
        number_(number) {
    setObjectName(QStringLiteral("screenNumberWindow%1").arg(number));
    setAttribute(Qt::WA_ShowWithoutActivating);
    const QRect whole = screen.geometry();
    const int side = static_cast<int>(kShareOfHeight * whole.height());
    // In a corner: on the person's own screen the question stays readable.
    setGeometry(whole.right() - side - whole.height() / 30, whole.bottom() - side - whole.height() / 30, side,
                side);
  }

 protected:
  void paintEvent(QPaintEvent*) override {
    QPainter painter(this);
    painter.setRenderHint(QPainter::Antialiasing);
    painter.fillRect(rect(), theme::kAccentDeep);
    painter.setPen(QPen(Qt::white, width() / 40.0));
    painter.drawRect(
        QRectF(rect()).adjusted(width() / 80.0, width() / 80.0, -width() / 80.0, -width() / 80.0));
    QFont font = painter.font();
    font.setPixelSize(static_cast<int>(0.75 * height()));
    font.setBold(true);
    painter.setFont(font);
    painter.drawText(rect(), Qt::AlignCenter, QString::number(number_));
  }

 private:
  int number_;
};

}  // namespace

ScreenNumbers::ScreenNumbers() {
  int number = 0;
  for (const QScreen* screen : QGuiApplication::screens()) {
    windows_.push_back(std::make_unique<NumberWindow>(++number, *screen));
    windows_.back()->show();
  }
}

ScreenNumbers::~ScreenNumbers() = default;

}  // namespace patina
