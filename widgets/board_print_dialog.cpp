#include "widgets/board_print_dialog.h"

#include <QComboBox>
#include <QDialogButtonBox>
#include <QDoubleSpinBox>
#include <QFileDialog>
#include <QPushButton>
#ifdef PATINA_HAS_PRINTER
#include <QPrintDialog>
#include <QPrinter>
#endif

#include "engine/base/atomic_file.h"
#include "widgets/board_chooser.h"
#include "widgets/theme.h"

namespace patina {

namespace {

constexpr double kRulerMm = 100;  ///< of the lines beside the board
constexpr int kPreviewPx = 380;

struct Paper {
  const char* name;
  double widthMm, heightMm;
};
constexpr Paper kPapers[] = {{"A4", 297, 210}, {"A3", 420, 297},         {"A2", 594, 420},
                             {"A1", 841, 594}, {"Letter", 279.4, 215.9}, {"Tabloid", 431.8, 279.4}};

/// The board in pixels of `squarePx` a square, as a picture of grey values.
QImage pictureOf(const Board& board, int squarePx) {
  Board drawn = board;
  const Result<Image> pixels = drawBoardPixels(drawn, squarePx, 0);
  if (!pixels) return {};
  QImage image(pixels->width(), pixels->height(), QImage::Format_Grayscale8);
  for (int y = 0; y < image.height(); ++y)
    for (int x = 0; x < image.width(); ++x) image.scanLine(y)[x] = pixels->at(x, y) > 0.5f ? 255 : 0;
  return image;
}

}  // namespace

BoardPrintDialog::BoardPrintDialog(const Board& board, QWidget* parent) : QDialog(parent) {
  setWindowTitle(tr("Print a Board"));
  chooser_ = new BoardChooser(this);
  chooser_->setBoard(board);
  paper_ = new QComboBox(this);
  paper_->setObjectName(QStringLiteral("printPaper"));
  for (const Paper& paper : kPapers)
    paper_->addItem(tr("%1, %2 \u00d7 %3 mm")
                        .arg(QString::fromLatin1(paper.name))
                        .arg(paper.widthMm)
                        .arg(paper.heightMm));
  preview_ = new QLabel(this);
  preview_->setAlignment(Qt::AlignCenter);
  preview_->setFixedSize(kPreviewPx, kPreviewPx * 3 / 4);
  fits_ = new QLabel(this);
  fits_->setObjectName(QStringLiteral("printFits"));
  fits_->setWordWrap(true);
  print_ = new QPushButton(tr("Print\u2026"), this);
  print_->setObjectName(QStringLiteral("printPrint"));
  save_ = new QPushButton(tr("Save as PDF or SVG\u2026"), this);
  save_->setObjectName(QStringLiteral("printSave"));
#ifndef PATINA_HAS_PRINTER
  print_->hide();
#endif
  auto* check = new QLabel(tr("Print at 100 %, not \u201cfit to page\u201d. Then measure a line beside the "
                              "board: it must be 100 mm long. "
                              "Glue the print to something flat and stiff: a bent board bends the result."),
                           this);
  check->setWordWrap(true);
  measured_ = new QDoubleSpinBox(this);
  measured_->setObjectName(QStringLiteral("printMeasured"));
  measured_->setAccessibleName(tr("Length of the 100 mm line as measured"));
  measured_->setRange(50, 150);
  measured_->setDecimals(2);
  measured_->setValue(kRulerMm);
  measured_->setSuffix(tr(" mm"));
  said_ = new QLabel(this);
  said_->setObjectName(QStringLiteral("printSaid"));
  said_->setWordWrap(true);
  auto* buttons = new QDialogButtonBox(QDialogButtonBox::Close, this);
  auto* use = buttons->addButton(tr("Use This Board"), QDialogButtonBox::AcceptRole);
  use->setObjectName(QStringLiteral("printUse"));
  use->setProperty("primary", true);

  auto* column = new QVBoxLayout;
  column->addWidget(chooser_);
  auto* paperRow = new QHBoxLayout;
  paperRow->addWidget(new QLabel(tr("Paper"), this));
  paperRow->addWidget(paper_, 1);
  column->addLayout(paperRow);
  column->addWidget(fits_);
  auto* out = new QHBoxLayout;
  out->addWidget(print_);
  out->addWidget(save_);
  out->addStretch(1);
  column->addLayout(out);
  column->addWidget(check);
  auto* ruler = new QHBoxLayout;
  ruler->addWidget(new QLabel(tr("The line is"), this));
  ruler->addWidget(measured_);
  ruler->addStretch(1);
  column->addLayout(ruler);
  column->addWidget(said_);
  column->addStretch(1);
  auto* row = new QHBoxLayout;
  row->setSpacing(16);
  row->addWidget(preview_);
  row->addLayout(column, 1);
  auto* all = new QVBoxLayout(this);
  all->addLayout(row);
  all->addWidget(buttons);
  setMinimumWidth(820);

  connect(chooser_, &BoardChooser::changed, this, &BoardPrintDialog::refresh);
  connect(paper_, &QComboBox::currentIndexChanged, this, &BoardPrintDialog::refresh);
  connect(measured_, &QDoubleSpinBox::valueChanged, this, &BoardPrintDialog::refresh);
  connect(save_, &QPushButton::clicked, this, &BoardPrintDialog::save);
  connect(print_, &QPushButton::clicked, this, &BoardPrintDialog::print);
  connect(use, &QPushButton::clicked, this, &QDialog::accept);
  connect(buttons, &QDialogButtonBox::rejected, this, &QDialog::reject);
  refresh();
}

PrintOptions BoardPrintDialog::options() const {
  const Paper& paper = kPapers[static_cast<std::size_t>(std::max(0, paper_->currentIndex()))];
  PrintOptions options;
  options.paperWidthMm = paper.widthMm;
  options.paperHeightMm = paper.heightMm;
  return options;
}

Board BoardPrintDialog::board() const {
  Board board = chooser_->board();
  board.squareMm *= measured_->value() / kRulerMm;
  return board;
}

void BoardPrintDialog::refresh() {
  const Board board = chooser_->board();
  const QImage picture = pictureOf(board, 48);
  if (!picture.isNull()) {
    // On its paper, to scale.
    const PrintOptions paper = options();
    const double ratio = devicePixelRatioF();
    QImage page(preview_->size() * ratio, QImage::Format_RGB32);
    page.setDevicePixelRatio(ratio);
    page.fill(theme::kCanvas);
    QPainter painter(&page);
    painter.setRenderHint(QPainter::SmoothPixmapTransform);
    const double zoom = std::min((preview_->width() - 20) / paper.paperWidthMm,
                                 (preview_->height() - 20) / paper.paperHeightMm);
    const QPointF middle(0.5 * preview_->width(), 0.5 * preview_->height());
    const QSizeF sheet(zoom * paper.paperWidthMm, zoom * paper.paperHeightMm);
    painter.fillRect(QRectF(middle - QPointF(sheet.width(), sheet.height()) / 2, sheet), Qt::white);
    const QSizeF size(zoom * board.widthMm(), zoom * board.heightMm());
    painter.drawImage(QRectF(middle - QPointF(size.width(), size.height()) / 2, size), picture);
    painter.end();
    preview_->setPixmap(QPixmap::fromImage(page));
  }
  const Result<std::string> drawing = drawBoardPdf(board, options());
  fits_->setText(drawing ? tr("%1 \u00d7 %2 mm of squares.").arg(board.widthMm()).arg(board.heightMm())
                         : QString::fromStdString(drawing.error().sentence()));
  fits_->setStyleSheet(QStringLiteral("color: %1").arg((drawing ? theme::kTextDim : theme::kWarning).name()));
  save_->setEnabled(drawing.ok());
  print_->setEnabled(drawing.ok());
  const double off = measured_->value() / kRulerMm - 1;
  constexpr double kReading = 0.0015;  // what a ruler can be read to
  said_->setText(std::abs(off) < kReading ? QString()
                                          : tr("The printer scaled by %1 %: squares are taken as %2 mm.")
                                                .arg(100 * off, 0, 'f', 1)
                                                .arg(this->board().squareMm, 0, 'f', 3));
}

Status BoardPrintDialog::saveTo(const QString& file) const {
  const Result<std::string> drawing = file.endsWith(QStringLiteral(".svg"), Qt::CaseInsensitive)
                                          ? drawBoardSvg(chooser_->board(), options())
                                          : drawBoardPdf(chooser_->board(), options());
  if (!drawing) return drawing.error();
  return writeFileAtomically(file.toStdString(), *drawing);
}

void BoardPrintDialog::save() {
  QString file = choose_
                     ? choose_()
                     : QFileDialog::getSaveFileName(this, tr("Save the Board"), QStringLiteral("board.pdf"),
                                                    tr("Drawings (*.pdf *.svg)"));
  if (file.isEmpty()) return;
  if (!file.contains(QLatin1Char('.'))) file += QStringLiteral(".pdf");
  const Status saved = saveTo(file);
  said_->setText(saved ? tr("Saved as %1. Print it at 100 %.").arg(file)
                       : QString::fromStdString(saved.error().sentence()));
}

void BoardPrintDialog::print() {
#ifdef PATINA_HAS_PRINTER
  QPrinter printer(QPrinter::HighResolution);
  printer.setFullPage(true);
  const PrintOptions paper = options();
  printer.setPageSize(QPageSize(QSizeF(paper.paperHeightMm, paper.paperWidthMm), QPageSize::Millimeter));
  printer.setPageOrientation(QPageLayout::Landscape);
  QPrintDialog dialog(&printer, this);
  if (dialog.exec() != QDialog::Accepted) return;
  const Board board = chooser_->board();
  QPainter painter;
  if (!painter.begin(&printer)) {
    said_->setText(tr("The printer can't be used. Try: save the board as PDF and print that."));
    return;
  }
  const double dotsX = printer.logicalDpiX() / 25.4, dotsY = printer.logicalDpiY() / 25.4;
  const double left = 0.5 * (paper.paperWidthMm - board.widthMm()),
               top = 0.5 * (paper.paperHeightMm - board.heightMm());
  painter.drawImage(QRectF(left * dotsX, top * dotsY, board.widthMm() * dotsX, board.heightMm() * dotsY),
                    pictureOf(board, 192));
  painter.setPen(QPen(Qt::black, 0.25 * dotsX));
  const double y = (top + board.heightMm() + 4) * dotsY, end = (left + kRulerMm) * dotsX;
  painter.drawLine(QPointF(left * dotsX, y), QPointF(end, y));
  for (const double x : {left * dotsX, end}) painter.drawLine(QPointF(x, y - dotsY), QPointF(x, y + dotsY));
  painter.end();
  said_->setText(tr("Sent to the printer. Measure the line when it is dry."));
#endif
}

}  // namespace patina
