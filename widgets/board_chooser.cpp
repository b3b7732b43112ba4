#include "widgets/board_chooser.h"

#include <QComboBox>
#include <QDoubleSpinBox>
#include <QGridLayout>
#include <QSpinBox>

#include "widgets/theme.h"

namespace patina {

BoardChooser::BoardChooser(QWidget* parent) : QWidget(parent) {
  kind_ = new QComboBox(this);
  kind_->setObjectName(QStringLiteral("boardKind"));
  kind_->setAccessibleName(tr("Kind of board"));
  kind_->addItem(tr("ChArUco (squares with markers)"), static_cast<int>(BoardKind::Charuco));
  kind_->addItem(tr("Checkerboard"), static_cast<int>(BoardKind::Checkerboard));
  kind_->setToolTip(
      tr("Of a ChArUco board a part is enough in the picture; a checkerboard must be seen whole."));
  const auto count = [this](const QString& name, const QString& words) {
    auto* box = new QSpinBox(this);
    box->setRange(3, 64);
    box->setObjectName(name);
    box->setAccessibleName(words);
    box->setToolTip(words);
    connect(box, &QSpinBox::valueChanged, this, &BoardChooser::take);
    return box;
  };
  columns_ = count(QStringLiteral("boardColumns"), tr("Squares across"));
  rows_ = count(QStringLiteral("boardRows"), tr("Squares down"));
  side_ = new QDoubleSpinBox(this);
  side_->setRange(0.5, 1000);
  side_->setDecimals(3);
  side_->setSuffix(tr(" mm"));
  side_->setObjectName(QStringLiteral("boardSide"));
  side_->setAccessibleName(tr("Side of a square, as measured on the print"));
  side_->setToolTip(tr("Side of a square as measured on the print: measure ten squares and divide"));
  problem_ = new QLabel(this);
  problem_->setWordWrap(true);
  problem_->setStyleSheet(QStringLiteral("color: %1").arg(theme::kWarning.name()));
  problem_->hide();
  auto* grid = new QGridLayout(this);
  grid->setContentsMargins(0, 0, 0, 0);
  grid->setVerticalSpacing(5);
  grid->addWidget(kind_, 0, 0, 1, 5);
  grid->addWidget(columns_, 1, 0);
  grid->addWidget(new QLabel(QStringLiteral("\u00d7"), this), 1, 1);
  grid->addWidget(rows_, 1, 2);
  grid->addWidget(new QLabel(tr("squares of"), this), 1, 3);
  grid->addWidget(side_, 1, 4);
  grid->addWidget(problem_, 2, 0, 1, 5);
  grid->setColumnStretch(4, 1);
  connect(kind_, &QComboBox::currentIndexChanged, this, &BoardChooser::take);
  connect(side_, &QDoubleSpinBox::valueChanged, this, &BoardChooser::take);
  setBoard(board_);
}

void BoardChooser::setBoard(const Board& board) {
  filling_ = true;
  board_ = board;
  kind_->setCurrentIndex(kind_->findData(static_cast<int>(board.kind)));
  columns_->setValue(board.squaresX);
  rows_->setValue(board.squaresY);
  side_->setValue(board.squareMm);
  filling_ = false;
}

void BoardChooser::take() {
  if (filling_) return;
  Board board = board_;
  board.kind = static_cast<BoardKind>(kind_->currentData().toInt());
  board.squaresX = columns_->value();
  board.squaresY = rows_->value();
  board.squareMm = side_->value();
  const std::vector<std::string> problems = board.validate();
  problem_->setVisible(!problems.empty());
  if (!problems.empty()) {
    QString text = QString::fromStdString(problems.front());
    text[0] = text[0].toUpper();
    problem_->setText(text + QLatin1Char('.'));
    return;
  }
  if (board == board_) return;
  board_ = board;
  Q_EMIT changed();
}

}  // namespace patina
