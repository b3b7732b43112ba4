#include "widgets/theme.h"

#include <QFontDatabase>
#include <QIconEngine>
#include <QPalette>
#include <QStyleFactory>

namespace patina::theme {

namespace {

QString css(const QColor& colour) {
  return colour.name();
}

void drawIcon(QPainter& painter, const QString& name, const QColor& ink) {
  // A 24 x 24 canvas, strokes of 1.8.
  QPen pen(ink, 1.8, Qt::SolidLine, Qt::RoundCap, Qt::RoundJoin);
  painter.setPen(pen);
  painter.setBrush(Qt::NoBrush);
  QPainterPath path;
  if (name == "open") {
    path.moveTo(3, 19);
    path.lineTo(3, 5);
    path.lineTo(9, 5);
    path.lineTo(11, 8);
    path.lineTo(19, 8);
    path.lineTo(19, 11);
    path.moveTo(3, 19);
    path.lineTo(6.5, 11);
    path.lineTo(22, 11);
    path.lineTo(18.5, 19);
    path.closeSubpath();
  } else if (name == "save") {
    path.moveTo(12, 3);
    path.lineTo(12, 14);
    path.moveTo(7.5, 9.5);
    path.lineTo(12, 14);
    path.lineTo(16.5, 9.5);
    path.moveTo(4, 15);
    path.lineTo(4, 20);
    path.lineTo(20, 20);
    path.lineTo(20, 15);
  } else if (name == "fit") {
    // Dots and the curve through them.
    path.moveTo(3, 18);
    path.cubicTo(9, 18, 9, 5, 12, 5);
    path.cubicTo(15, 5, 15, 18, 21, 18);
    painter.setBrush(ink);
    for (const QPointF& dot : {QPointF(5.5, 15), QPointF(9.5, 11.5), QPointF(15.5, 9), QPointF(18.5, 15.5)})
      painter.drawEllipse(dot, 0.9, 0.9);
    painter.setBrush(Qt::NoBrush);
  } else if (name == "explain") {
    // A lens over what is left.
    path.addEllipse(QPointF(10, 10), 6.2, 6.2);
    path.moveTo(14.6, 14.6);
    path.lineTo(20.5, 20.5);
    path.moveTo(7, 11.2);
    path.lineTo(9, 8.4);
    path.lineTo(11, 11.4);
    path.lineTo(13, 8.8);
  } else if (name == "cancel") {
    path.addRoundedRect(QRectF(6, 6, 12, 12), 1.5, 1.5);
  } else if (name == "undo" || name == "redo") {
    if (name == "redo") {
      painter.translate(24, 0);
      painter.scale(-1, 1);
    }
    path.moveTo(8, 4.5);
    path.lineTo(3.5, 9);
    path.lineTo(8, 13.5);
    path.moveTo(4, 9);
    path.lineTo(14, 9);
    path.cubicTo(22, 9, 22, 19.5, 14, 19.5);
    path.lineTo(10, 19.5);
  } else if (name == "zoom-fit") {
    for (int corner = 0; corner < 4; ++corner) {
      const double sx = corner % 2 ? -1 : 1, sy = corner / 2 ? -1 : 1;
      path.moveTo(12 - 8 * sx, 12 - 4 * sy);
      path.lineTo(12 - 8 * sx, 12 - 8 * sy);
      path.lineTo(12 - 4 * sx, 12 - 8 * sy);
    }
  } else if (name == "zoom-actual") {
    path.moveTo(5, 8);
    path.lineTo(7.5, 6);
    path.lineTo(7.5, 18);
    path.moveTo(15.5, 8);
    path.lineTo(18, 6);
    path.lineTo(18, 18);
    painter.setBrush(ink);
    painter.drawEllipse(QPointF(12, 10), 0.7, 0.7);
    painter.drawEllipse(QPointF(12, 15), 0.7, 0.7);
    painter.setBrush(Qt::NoBrush);
  } else if (name == "auto-range") {
    path.moveTo(3, 19);
    path.cubicTo(8, 19, 8, 6, 12, 6);
    path.cubicTo(16, 6, 16, 19, 21, 19);
    path.moveTo(6.5, 3.5);
    path.lineTo(6.5, 21);
    path.moveTo(17.5, 3.5);
    path.lineTo(17.5, 21);
  } else if (name == "reset") {
    path.arcMoveTo(QRectF(5, 5, 14, 14), 60);
    path.arcTo(QRectF(5, 5, 14, 14), 60, -300);
    path.moveTo(15.5, 2.5);
    path.lineTo(15.5, 6.4);
    path.lineTo(19.5, 6.4);
  } else if (name == "light") {
    path.addEllipse(QPointF(12, 12), 4, 4);
    for (int ray = 0; ray < 8; ++ray) {
      const double angle = ray * M_PI / 4;
      path.moveTo(12 + 6.8 * std::cos(angle), 12 + 6.8 * std::sin(angle));
      path.lineTo(12 + 9.4 * std::cos(angle), 12 + 9.4 * std::sin(angle));
    }
  } else if (name == "close") {
    path.moveTo(7, 7);
    path.lineTo(17, 17);
    path.moveTo(17, 7);
    path.lineTo(7, 17);
  } else if (name == "options") {
    for (int row = 0; row < 3; ++row) {
      const double y = 6 + 6 * row;
      const double knob = row == 1 ? 15 : 8;
      path.moveTo(3, y);
      path.lineTo(knob - 2.4, y);
      path.addEllipse(QPointF(knob, y), 2.2, 2.2);
      path.moveTo(knob + 2.4, y);
      path.lineTo(21, y);
    }
  } else if (name == "app") {
    // A sheet under a lobe.
    painter.setPen(Qt::NoPen);
    QLinearGradient sheen(3, 22, 21, 8);
    sheen.setColorAt(0, QColor(40, 84, 84));
    sheen.setColorAt(0.55, QColor(122, 178, 160));
    sheen.setColorAt(0.75, QColor(240, 236, 214));
    sheen.setColorAt(1, QColor(150, 108, 64));
    painter.setBrush(sheen);
    QPainterPath sheet;
    sheet.moveTo(2, 17);
    sheet.lineTo(12, 11.5);
    sheet.lineTo(22, 17);
    sheet.lineTo(12, 22.5);
    sheet.closeSubpath();
    painter.drawPath(sheet);
    painter.setPen(QPen(QColor(240, 236, 214), 1.5, Qt::SolidLine, Qt::RoundCap));
    painter.setBrush(QColor(240, 236, 214, 60));
    path.moveTo(12, 17);
    path.cubicTo(7, 12, 13, 3, 18.5, 2.5);
    path.cubicTo(20.5, 6, 17.5, 15, 12, 17);
  }
  painter.drawPath(path);
}

class PathIconEngine : public QIconEngine {
 public:
  explicit PathIconEngine(QString name) : name_(std::move(name)) {}
  void paint(QPainter* painter, const QRect& rect, QIcon::Mode mode, QIcon::State) override {
    painter->save();
    painter->setRenderHint(QPainter::Antialiasing);
    painter->translate(rect.topLeft());
    painter->scale(rect.width() / 24.0, rect.height() / 24.0);
    drawIcon(*painter, name_, mode == QIcon::Disabled ? kTextOff : kText);
    painter->restore();
  }
  QPixmap pixmap(const QSize& size, QIcon::Mode mode, QIcon::State state) override {
    QPixmap pixmap(size);
    pixmap.fill(Qt::transparent);
    QPainter painter(&pixmap);
    paint(&painter, QRect(QPoint(), size), mode, state);
    return pixmap;
  }
  QIconEngine* clone() const override { return new PathIconEngine(name_); }

 private:
  QString name_;
};

}  // namespace

void apply(QApplication& application) {
  application.setStyle(QStyleFactory::create("Fusion"));
  QPalette palette;
  palette.setColor(QPalette::Window, kWindow);
  palette.setColor(QPalette::WindowText, kText);
  palette.setColor(QPalette::Base, kSunken);
  palette.setColor(QPalette::AlternateBase, QColor(33, 33, 33));
  palette.setColor(QPalette::Text, kText);
  palette.setColor(QPalette::PlaceholderText, kTextOff);
  palette.setColor(QPalette::Button, kControl);
  palette.setColor(QPalette::ButtonText, kText);
  palette.setColor(QPalette::BrightText, Qt::white);
  palette.setColor(QPalette::Highlight, kAccentDeep);
  palette.setColor(QPalette::HighlightedText, Qt::white);
  palette.setColor(QPalette::ToolTipBase, QColor(66, 66, 66));
  palette.setColor(QPalette::ToolTipText, kText);
  palette.setColor(QPalette::Link, kAccent);
  palette.setColor(QPalette::LinkVisited, kAccent);
  palette.setColor(QPalette::Light, QColor(90, 90, 90));
  palette.setColor(QPalette::Midlight, QColor(74, 74, 74));
  palette.setColor(QPalette::Mid, QColor(52, 52, 52));
  palette.setColor(QPalette::Dark, QColor(24, 24, 24));
  palette.setColor(QPalette::Shadow, QColor(12, 12, 12));
  for (const auto role : {QPalette::WindowText, QPalette::Text, QPalette::ButtonText})
    palette.setColor(QPalette::Disabled, role, kTextOff);
  palette.setColor(QPalette::Disabled, QPalette::Highlight, QColor(70, 70, 70));
  application.setPalette(palette);

  application.setStyleSheet(
      QStringLiteral(
          "QToolTip { background: #424242; color: %1; border: 1px solid %2; padding: 4px; }"
          "QMenuBar { background: %3; padding: 1px 4px; }"
          "QMenuBar::item { padding: 4px 9px; border-radius: 4px; background: transparent; }"
          "QMenuBar::item:selected { background: %4; }"
          "QMenu { background: #303030; border: 1px solid %2; padding: 4px; }"
          "QMenu::item { padding: 5px 26px 5px 22px; border-radius: 4px; }"
          "QMenu::item:selected { background: %5; color: white; }"
          "QMenu::item:disabled { color: %6; }"
          "QMenu::separator { height: 1px; background: %2; margin: 4px 8px; }"
          "QToolBar { background: %3; border: none; border-bottom: 1px solid #1c1c1c; padding: 3px 6px; "
          "spacing: 3px; }"
          "QToolButton { border: 1px solid transparent; border-radius: 5px; padding: 4px 7px; }"
          "QToolButton:hover:enabled { background: %4; }"
          "QToolButton:pressed { background: #333333; }"
          "QToolButton:checked { background: %5; color: white; }"
          "QToolButton:focus { border-color: %7; }"
          "QToolButton:disabled { color: %6; }"
          "#fitButton:enabled { background: %5; color: white; padding-left: 12px; padding-right: 14px; }"
          "#fitButton:enabled:hover { background: #2f74b0; }"
          "QPushButton { background: %4; border: 1px solid %2; border-radius: 5px; padding: 5px 14px; }"
          "QPushButton:hover:enabled { background: #4a4a4a; }"
          "QPushButton:pressed { background: #333333; }"
          "QPushButton:focus { border-color: %7; }"
          "QPushButton:disabled { color: %6; }"
          "QPushButton[primary=true] { background: %5; border-color: %5; color: white; font-weight: 600; }"
          "QPushButton[primary=true]:hover { background: #2f74b0; }"
          "QPushButton[primary=true]:disabled { background: #3a3f45; border-color: #3a3f45; color: #80858c; }"
          "QStatusBar { background: %3; border-top: 1px solid #1c1c1c; }"
          "QStatusBar::item { border: none; }"
          "QSplitter::handle { background: #1c1c1c; }"
          "QSplitter::handle:hover { background: %7; }"
          "QTabBar { qproperty-drawBase: 0; }"
          "QTabBar::tab { padding: 5px 10px; margin-right: 1px; border-radius: 5px; color: %8; background: "
          "transparent; }"
          "QTabBar::tab:selected { background: %4; color: %1; }"
          "QTabBar::tab:hover:!selected { background: #343434; }"
          "QTabBar::tab:disabled { color: %6; }"
          "QTabBar::tab:focus { border: 1px solid %7; }"
          "QTabWidget::pane { border: none; }"
          "QProgressBar { background: %9; border: 1px solid %2; border-radius: 4px; text-align: center; "
          "min-height: 14px; }"
          "QProgressBar::chunk { background: %5; border-radius: 3px; }"
          "QHeaderView::section { background: %3; color: %8; border: none; padding: 3px 6px; }"
          "QTableWidget { gridline-color: #3a3a3a; border: none; }"
          "QScrollBar:horizontal { background: transparent; height: 10px; }"
          "QScrollBar:vertical { background: transparent; width: 10px; }"
          "QScrollBar::handle { background: #5a5a5a; border-radius: 4px; min-width: 28px; min-height: 28px; "
          "margin: 1px; }"
          "QScrollBar::handle:hover { background: #727272; }"
          "QScrollBar::add-line, QScrollBar::sub-line { width: 0; height: 0; }"
          "QScrollBar::add-page, QScrollBar::sub-page { background: transparent; }"
          "QDialogButtonBox, QMessageBox { dialogbuttonbox-buttons-have-icons: 0; }"
          "QLabel[role=caption] { color: %8; }")
          .arg(css(kText), css(kBorder), css(kWindow), css(kControl), css(kAccentDeep), css(kTextOff),
               css(kAccent), css(kTextDim), css(kSunken)));
}

QIcon icon(const QString& name) {
  return QIcon(new PathIconEngine(name));
}

QFont numberFont() {
  QFont font = QApplication::font();
  font.setStyleHint(QFont::SansSerif);
  font.setFamilies({QFontDatabase::systemFont(QFontDatabase::FixedFont).family()});
  font.setPointSizeF(QApplication::font().pointSizeF() * 0.95);
  return font;
}

QFont captionFont() {
  QFont font = QApplication::font();
  font.setPointSizeF(font.pointSizeF() * 0.9);
  return font;
}

}  // namespace patina::theme
