#include "widgets/explain_pictures.h"

#include <QTabBar>

#include "engine/render/tone_map.h"
#include "engine/report/explanation_words.h"
#include "widgets/comparison_view.h"
#include "widgets/image_view.h"
#include "widgets/theme.h"

namespace patina {

namespace {

/// Pixels; more than a window shows of it, and a fraction of a second to make.
constexpr int kLongestSide = 720;
/// Black of the picture of places, in units of the noise's variance.
constexpr double kPlaceLow = 0.7;

/// The views take linear light; these pictures are what should be on the display.
std::shared_ptr<const Image> linear(Image displayEncoded) {
  if (displayEncoded.empty()) return nullptr;
  for (float& sample : displayEncoded.samples()) sample = linearFromSrgb(sample);
  return std::make_shared<const Image>(std::move(displayEncoded));
}

QString words(double rms) {
  return rms >= 0 ? QString::fromStdString(shortNumber(rms)) : ExplainPictures::tr("not known");
}

}  // namespace

ResidualViews residualViews(const Explanation& explanation) {
  auto views = std::make_shared<std::vector<ResidualView>>();
  for (const ResidualPicture& picture : explanation.pictures)
    views->push_back(residualView(picture, kLongestSide, views->size() + 1));
  return views;
}

ExplainPictures::ExplainPictures(QWidget* parent) : QWidget(parent) {
  setObjectName(QStringLiteral("explainPictures"));
  tabs_ = new QTabBar(this);
  tabs_->addTab(tr("Residual"));
  tabs_->addTab(tr("Photograph"));
  tabs_->addTab(tr("Where"));
  tabs_->setTabToolTip(0, tr("Photograph minus prediction, in standard deviations of the noise"));
  tabs_->setTabToolTip(1, tr("The photograph against its prediction"));
  tabs_->setTabToolTip(2, tr("Where in the camera's picture the residual of all photographs sits"));
  tabs_->setAccessibleName(tr("What is shown"));
  comparison_ = new ComparisonView(this);
  comparison_->setObjectName(QStringLiteral("explainComparison"));
  comparison_->setAccessibleName(tr("Before and after"));
  expected_ = new ImageView(this);
  expected_->setObjectName(QStringLiteral("explainExpected"));
  expected_->setAccessibleName(tr("What noise alone would look like"));
  expectedPane_ = new QWidget(this);
  auto* noise = new QLabel(tr("Noise alone would leave"), expectedPane_);
  noise->setProperty("role", "caption");
  noise->setContentsMargins(8, 4, 8, 4);
  auto* column = new QVBoxLayout(expectedPane_);
  column->setContentsMargins(0, 0, 0, 0);
  column->setSpacing(0);
  column->addWidget(noise);
  column->addWidget(expected_, 1);
  caption_ = new QLabel(this);
  caption_->setObjectName(QStringLiteral("explainCaption"));
  caption_->setWordWrap(true);
  caption_->setContentsMargins(10, 5, 10, 6);
  auto* row = new QHBoxLayout;
  row->setSpacing(3);
  auto* left = new QVBoxLayout;
  left->setSpacing(0);
  left->addWidget(comparison_, 1);
  row->addLayout(left, 3);
  row->addWidget(expectedPane_, 2);
  auto* all = new QVBoxLayout(this);
  all->setContentsMargins(0, 0, 0, 0);
  all->setSpacing(2);
  all->addWidget(tabs_);
  all->addLayout(row, 1);
  all->addWidget(caption_);
  connect(tabs_, &QTabBar::currentChanged, this, &ExplainPictures::refresh);
  refresh();
}

void ExplainPictures::setExplanation(std::shared_ptr<const Explanation> explanation, ResidualViews views) {
  explanation_ = std::move(explanation);
  views_ = std::move(views);
  shown_ = -1;
  refresh();
}

void ExplainPictures::showPicture(int picture) {
  if (tabs_->currentIndex() == static_cast<int>(Mode::Place)) tabs_->setCurrentIndex(0);
  shown_ = picture;
  refresh();
}

void ExplainPictures::setMode(Mode mode) {
  tabs_->setCurrentIndex(static_cast<int>(mode));
}

ExplainPictures::Mode ExplainPictures::mode() const {
  return static_cast<Mode>(tabs_->currentIndex());
}

QString ExplainPictures::caption() const {
  return caption_->text();
}

void ExplainPictures::refresh() {
  const bool added = explanation_ && !explanation_->effects.empty();
  const ResidualView* view = views_ && shown_ >= 0 && shown_ < static_cast<int>(views_->size()) &&
                                     !(*views_)[static_cast<std::size_t>(shown_)].empty()
                                 ? &(*views_)[static_cast<std::size_t>(shown_)]
                                 : nullptr;
  expectedPane_->setVisible(mode() == Mode::Residual && view);
  QString caption;
  comparison_->setEmptyText(
      !explanation_ ? QString()
      : mode() == Mode::Place
          ? tr("Where the residual sits was not kept.")
          : tr("No picture of this photograph was kept: only of the worst predicted ones."));
  if (!explanation_ || (mode() != Mode::Place && !view)) {
    comparison_->setPictures(nullptr, nullptr);
  } else if (mode() == Mode::Residual) {
    const QString before = tr("before"), after = tr("after");
    comparison_->setNames(before, after);
    comparison_->setPictures(linear(view->before), added ? linear(view->after) : nullptr);
    expected_->setPicture(linear(view->expected), ToneStyle::LinearRgb);
    caption =
        tr("Photograph minus prediction: grey is as predicted, brighter is a photograph brighter than its "
           "prediction; black and white are %1 standard deviations. ")
            .arg(kResidualRangeSigmas);
    caption += added ? tr("Before: %1 times the noise, after: %2 times.")
                           .arg(words(view->rmsBefore), words(view->rmsAfter))
                     : tr("It is %1 times the noise.").arg(words(view->rmsBefore));
  } else if (mode() == Mode::Photograph) {
    comparison_->setNames(tr("photograph"), tr("prediction"));
    const bool last = added && !view->predictedAfter.empty();
    comparison_->setPictures(linear(view->captured),
                             linear(last ? view->predictedAfter : view->predictedBefore));
    caption = last ? tr("The photograph and its prediction with the added effects.")
                   : tr("The photograph and its prediction by the standard model.");
  } else {
    double most = 2;
    for (const Image* place : {&explanation_->placeBefore, &explanation_->placeAfter})
      for (const float value : place->samples())
        if (std::isfinite(value)) most = std::max(most, std::min(double{value}, 1e6));
    comparison_->setNames(tr("before"), tr("after"));
    const auto first = linear(placePicture(explanation_->placeBefore, kLongestSide, kPlaceLow, most));
    const auto second =
        added ? linear(placePicture(explanation_->placeAfter, kLongestSide, kPlaceLow, most)) : nullptr;
    const bool alike =
        first && second && first->width() == second->width() && first->height() == second->height();
    comparison_->setPictures(first, alike ? second : nullptr);
    caption =
        tr("Mean square residual over all photographs: black %1, cream %2; noise alone is 1.")
            .arg(QString::fromStdString(shortNumber(kPlaceLow)), QString::fromStdString(shortNumber(most)));
  }
  caption_->setText(caption);
}

}  // namespace patina
