#include "widgets/screen_panel.h"

#include <QDoubleSpinBox>
#include <QGridLayout>
#include <QGroupBox>
#include <QPushButton>

#include "widgets/theme.h"

namespace patina {

ScreenPanel::ScreenPanel(QWidget* parent) : QWidget(parent) {
  question_ = new QLabel(tr("Which number do you see on the screen that lights the sample?"), this);
  question_->setObjectName(QStringLiteral("screenQuestion"));
  QFont large = question_->font();
  large.setPointSizeF(large.pointSizeF() * 1.15);
  question_->setFont(large);
  question_->setWordWrap(true);
  auto* numbersBox = new QWidget(this);
  numbers_ = new QGridLayout(numbersBox);
  numbers_->setContentsMargins(0, 0, 0, 0);
  numbers_->setSpacing(10);
  simulated_ = new QPushButton(tr("None: use the simulated rig's own screen"), this);
  simulated_->setObjectName(QStringLiteral("screenSimulated"));
  simulated_->setToolTip(tr("Patterns go straight to the simulated camera; nothing covers this window"));
  facts_ = new QLabel(this);
  facts_->setObjectName(QStringLiteral("screenFacts"));
  facts_->setWordWrap(true);
  warnings_ = new QLabel(this);
  warnings_->setObjectName(QStringLiteral("screenWarnings"));
  warnings_->setWordWrap(true);
  warnings_->setStyleSheet(QStringLiteral("color: %1;").arg(theme::kWarning.name()));

  sizeBox_ = new QGroupBox(tr("Its true size"), this);
  sizeSentence_ = new QLabel(sizeBox_);
  sizeSentence_->setWordWrap(true);
  const auto length = [this](const QString& name) {
    auto* spin = new QDoubleSpinBox(sizeBox_);
    spin->setObjectName(name);
    spin->setRange(0, 5000);
    spin->setDecimals(2);
    spin->setSuffix(tr(" mm"));
    spin->setSpecialValueText(tr("not known"));
    spin->setKeyboardTracking(false);
    return spin;
  };
  across_ = length(QStringLiteral("screenAcross"));
  down_ = length(QStringLiteral("screenDown"));
  acrossLabel_ = new QLabel(sizeBox_);
  downLabel_ = new QLabel(sizeBox_);
  acrossLabel_->setBuddy(across_);
  downLabel_->setBuddy(down_);
  ruler_ = new QPushButton(tr("Show a Ruler on It"), sizeBox_);
  ruler_->setObjectName(QStringLiteral("screenRuler"));
  ruler_->setCheckable(true);
  ruler_->setToolTip(
      tr("Two bars to measure with a ruler of your own: sizes that a screen tells are rounded"));
  auto* sizes = new QGridLayout(sizeBox_);
  sizes->addWidget(sizeSentence_, 0, 0, 1, 3);
  sizes->addWidget(acrossLabel_, 1, 0);
  sizes->addWidget(across_, 1, 1);
  sizes->addWidget(downLabel_, 2, 0);
  sizes->addWidget(down_, 2, 1);
  sizes->addWidget(ruler_, 1, 2, 2, 1, Qt::AlignVCenter);
  sizes->setColumnStretch(0, 1);

  latencyBox_ = new QGroupBox(tr("From picture to light"), this);
  latencyWords_ = new QLabel(latencyBox_);
  latencyWords_->setObjectName(QStringLiteral("latencyWords"));
  latencyWords_->setWordWrap(true);
  latency_ = new QPushButton(tr("Measure"), latencyBox_);
  latency_->setObjectName(QStringLiteral("measureLatency"));
  auto* latencyRow = new QHBoxLayout(latencyBox_);
  latencyRow->addWidget(latencyWords_, 1);
  latencyRow->addWidget(latency_);

  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(0, 0, 0, 0);
  column->setSpacing(10);
  column->addWidget(question_);
  column->addWidget(numbersBox);
  column->addWidget(simulated_, 0, Qt::AlignLeft);
  column->addWidget(facts_);
  column->addWidget(warnings_);
  column->addWidget(sizeBox_);
  column->addWidget(latencyBox_);
  column->addStretch(1);

  connect(simulated_, &QPushButton::clicked, this, [this] { Q_EMIT chosen(0); });
  connect(ruler_, &QPushButton::toggled, this, &ScreenPanel::rulerRequested);
  connect(latency_, &QPushButton::clicked, this, &ScreenPanel::latencyRequested);
  for (QDoubleSpinBox* spin : {across_, down_})
    connect(spin, &QDoubleSpinBox::valueChanged, this,
            [this] { Q_EMIT measured(across_->value(), down_->value()); });
  setChosen({});
}

void ScreenPanel::setScreens(const std::vector<ScreenInfo>& screens, bool simulated) {
  screens_ = screens;
  for (QPushButton* button : buttons_) delete button;
  buttons_.clear();
  constexpr int kColumns = 4;
  for (std::size_t i = 0; i < screens_.size(); ++i) {
    const ScreenInfo& screen = screens_[i];
    const int number = static_cast<int>(i) + 1;
    auto* button = new QPushButton(QStringLiteral("%1\n%2\n%3 \u00d7 %4")
                                       .arg(number)
                                       .arg(QString::fromStdString(screen.name))
                                       .arg(screen.widthPx)
                                       .arg(screen.heightPx),
                                   this);
    button->setObjectName(QStringLiteral("screenNumber%1").arg(number));
    button->setAccessibleName(
        tr("Screen number %1, %2").arg(number).arg(QString::fromStdString(screen.name)));
    button->setCheckable(true);
    button->setShortcut(QKeySequence(QString::number(number)));
    button->setToolTip(tr("The screen that shows the number %1 (key %1)").arg(number));
    button->setStyleSheet(QStringLiteral("QPushButton:checked { background: %1; border-color: %2; }")
                              .arg(theme::kAccentDeep.name(), theme::kAccent.name()));
    connect(button, &QPushButton::clicked, this, [this, number] { Q_EMIT chosen(number); });
    numbers_->addWidget(button, static_cast<int>(i) / kColumns, static_cast<int>(i) % kColumns);
    buttons_.push_back(button);
  }
  simulated_->setVisible(simulated);
  setChosen(chosen_);
}

QPushButton* ScreenPanel::numberButton(int number) const {
  return number >= 1 && number <= static_cast<int>(buttons_.size())
             ? buttons_[static_cast<std::size_t>(number) - 1]
             : nullptr;
}

void ScreenPanel::setChosen(const std::optional<ScreenInfo>& screen) {
  chosen_ = screen;
  for (std::size_t i = 0; i < buttons_.size(); ++i)
    buttons_[i]->setChecked(screen && screens_[i].id == screen->id);
  sizeBox_->setVisible(screen.has_value());
  latencyBox_->setVisible(screen.has_value());
  facts_->setVisible(screen.has_value());
  warnings_->setVisible(screen && !screen->warnings.empty());
  if (!screen) return;
  facts_->setText(tr("%1: %2 \u00d7 %3 pixels%4.")
                      .arg(QString::fromStdString(screen->name))
                      .arg(screen->widthPx)
                      .arg(screen->heightPx)
                      .arg(screen->refreshHz > 0
                               ? tr(", %1 pictures a second").arg(screen->refreshHz, 0, 'f', 1)
                               : tr(", its refresh rate is not known")));
  QStringList lines;
  for (const std::string& warning : screen->warnings)
    lines << QStringLiteral("\u2022 ") + QString::fromStdString(warning);
  warnings_->setText(lines.join(QLatin1Char('\n')));
  refreshSizes();
}

void ScreenPanel::setRuler(bool shown, int acrossPx, int downPx) {
  rulerShown_ = shown;
  acrossPx_ = acrossPx;
  downPx_ = downPx;
  const QSignalBlocker quiet(ruler_);
  ruler_->setChecked(shown);
  refreshSizes();
}

void ScreenPanel::refreshSizes() {
  if (!chosen_) return;
  const QSignalBlocker quietAcross(across_), quietDown(down_);
  double across = chosen_->widthMm, down = chosen_->heightMm;
  if (rulerShown_) {
    across *= static_cast<double>(acrossPx_) / chosen_->widthPx;
    down *= static_cast<double>(downPx_) / chosen_->heightPx;
  }
  sizeSentence_->setText(
      rulerShown_
          ? tr("Measure both bars on the screen, from end mark to end mark, and enter what you read.")
          : tr("Measure the lit area, or show a ruler on it. The sizes here are what the screen says of "
               "itself until you change them; they may be wrong by some millimetres."));
  acrossLabel_->setText(rulerShown_ ? tr("The bar across is") : tr("Lit width"));
  downLabel_->setText(rulerShown_ ? tr("The bar down is") : tr("Lit height"));
  ruler_->setText(rulerShown_ ? tr("Take the Ruler Away") : tr("Show a Ruler on It"));
  across_->setValue(across);
  down_->setValue(down);
}

void ScreenPanel::setLatency(const QString& words) {
  latencyWords_->setText(words);
}

void ScreenPanel::setMeasuring(bool measuring, bool possible, const QString& whyNot) {
  latency_->setEnabled(possible && !measuring);
  latency_->setText(measuring ? tr("Measuring\u2026") : tr("Measure"));
  latency_->setToolTip(possible ? tr("The screen flashes, the camera looks when") : whyNot);
}

}  // namespace patina
