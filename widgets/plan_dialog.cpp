#include "widgets/plan_dialog.h"

#include <QCheckBox>
#include <QComboBox>
#include <QDoubleSpinBox>
#include <QFileDialog>
#include <QFormLayout>
#include <QHeaderView>
#include <QKeyEvent>
#include <QProgressBar>
#include <QPushButton>
#include <QScrollArea>
#include <QSpinBox>
#include <QSplitter>
#include <QTableWidget>
#include <QTextDocumentFragment>
#include <numbers>

#include "widgets/plan_viewport.h"
#include "widgets/shot_entry.h"
#include "widgets/theme.h"
#include "widgets/two_shot_options_dialog.h"

namespace patina {

namespace {

constexpr double kDeg = 180 / std::numbers::pi;

QString directionText(const Eigen::Vector3d& direction) {
  const double zenith = std::acos(std::clamp(direction.z(), -1.0, 1.0)) * kDeg;
  double azimuth = std::atan2(direction.y(), direction.x()) * kDeg;
  if (azimuth < -0.05) azimuth += 360;
  // Straight above, every azimuth is as true as another.
  return zenith < 0.05
             ? QStringLiteral("0\u00b0")
             : QStringLiteral("%1\u00b0 at %2\u00b0").arg(zenith, 0, 'f', 1).arg(azimuth, 0, 'f', 1);
}

QString errorSentence(const ExpectedError& expected) {
  if (expected.unseen > 0)
    return PlanDialog::tr(
               "<b>%1</b> (%2 ln) for a material that the basis does not hold, %3 for the worst "
               "tenth; %4 for one like the basis' own.")
        .arg(logErrorText(expected.unseen))
        .arg(expected.unseen, 0, 'f', 3)
        .arg(logErrorText(expected.unseenWorstTenth), logErrorText(expected.training));
  return PlanDialog::tr("<b>%1</b> (%2 ln) for a material like the basis' own.")
      .arg(logErrorText(expected.training))
      .arg(expected.training, 0, 'f', 3);
}

}  // namespace

PlanDialog::PlanDialog(QWidget* parent) : QDialog(parent) {
  setObjectName(QStringLiteral("planDialog"));
  setWindowTitle(tr("Plan Directions"));
  setSizeGripEnabled(true);
  chooseFile_ = [this] {
    return QFileDialog::getSaveFileName(this, tr("Save the Plan; its Drawing Goes beside it"),
                                        QStringLiteral("plan.json"), tr("Plan (*.json)"));
  };
  auto* row = new QHBoxLayout;
  row->setContentsMargins(0, 0, 0, 0);
  row->setSpacing(0);
  row->addWidget(buildForm());
  row->addWidget(buildResult(), 1);
  setLayout(row);
  connect(plan_, &QPushButton::clicked, this, &PlanDialog::planRequested);
  connect(judge_, &QPushButton::clicked, this, &PlanDialog::judgeRequested);
  connect(cancel_, &QPushButton::clicked, this, &PlanDialog::cancelRequested);
  connect(save_, &QPushButton::clicked, this, [this] {
    QString file = chooseFile_();
    if (file.isEmpty()) return;
    if (!file.endsWith(QStringLiteral(".json"))) file += QStringLiteral(".json");
    Q_EMIT saveRequested(file);
  });
  connect(asBundle_, &QPushButton::clicked, this, [this] {
    if (capture_) fov_->setValue(discOf(*capture_).fovDeg);
  });
  connect(halfVectors_, &QCheckBox::toggled, viewport_, &PlanViewport::setHalfVectorsShown);
  for (QSpinBox* box : {shots_, restarts_}) connect(box, &QSpinBox::valueChanged, this, &PlanDialog::check);
  for (QDoubleSpinBox* box : {fov_, poseError_})
    connect(box, &QDoubleSpinBox::valueChanged, this, &PlanDialog::check);
  connect(keep_, &QCheckBox::toggled, this, &PlanDialog::check);
  connect(fov_, &QDoubleSpinBox::valueChanged, this, [this] {
    if (!outcome_.plan) refresh();
  });
  setOptions({});
  resize(1180, 740);
  shots_->setFocus();
  refresh();
}

QWidget* PlanDialog::buildForm() {
  auto* side = new QWidget(this);
  side->setFixedWidth(fontMetrics().averageCharWidth() * 62);
  shots_ = new QSpinBox(side);
  shots_->setObjectName(QStringLiteral("planShots"));
  shots_->setRange(1, 30);
  fov_ = new QDoubleSpinBox(side);
  fov_->setObjectName(QStringLiteral("planFov"));
  fov_->setRange(0, 90);
  fov_->setDecimals(1);
  fov_->setSuffix(QStringLiteral("\u00b0"));
  fov_->setSpecialValueText(tr("0\u00b0: single points"));
  asBundle_ = new QPushButton(tr("As Bundle"), side);
  asBundle_->setAutoDefault(false);
  asBundle_->setSizePolicy(QSizePolicy::Fixed, QSizePolicy::Fixed);
  asBundle_->setMinimumWidth(fontMetrics().horizontalAdvance(asBundle_->text()) + 34);
  setup_ = new QComboBox(side);
  setup_->setObjectName(QStringLiteral("planSetup"));
  setup_->addItem(tr("Camera and light free"), static_cast<int>(PlanSetup::Free));
  setup_->addItem(tr("Camera fixed, light moves"), static_cast<int>(PlanSetup::FixedCamera));
  setup_->addItem(tr("Light fixed, camera moves"), static_cast<int>(PlanSetup::FixedLight));
  region_ = new QComboBox(side);
  region_->setObjectName(QStringLiteral("planRegion"));
  region_->addItem(tr("All directions"), static_cast<int>(BasisRegion::All));
  region_->addItem(tr("Up to %1\u00b0 from the normal").arg(kTrustedAngleDeg),
                   static_cast<int>(BasisRegion::Trusted));
  poseError_ = new QDoubleSpinBox(side);
  poseError_->setObjectName(QStringLiteral("planPoseError"));
  poseError_->setRange(0, 10);
  poseError_->setDecimals(1);
  poseError_->setSingleStep(0.5);
  poseError_->setSuffix(QStringLiteral("\u00b0"));
  poseError_->setSpecialValueText(tr("none"));
  restarts_ = new QSpinBox(side);
  restarts_->setObjectName(QStringLiteral("planRestarts"));
  restarts_->setRange(1, 100);
  keep_ = new QCheckBox(tr("Add to the bundle's shots"), side);
  keep_->setObjectName(QStringLiteral("planKeep"));
  basis_ = new BasisChooser(side);

  auto* form = new QFormLayout;
  form->setHorizontalSpacing(12);
  form->setVerticalSpacing(7);
  const auto row = [&](const QString& label, QWidget* field, const QString& effect) {
    form->addRow(label, field);
    field->setToolTip(effect);
    if (auto* text = qobject_cast<QLabel*>(form->labelForField(field))) text->setToolTip(effect);
  };
  row(tr("Shots"), shots_, tr("Photographs to take, 1 to 30. More: a smaller error, a longer search."));
  auto* fovRow = new QWidget(side);
  auto* fovLayout = new QHBoxLayout(fovRow);
  fovLayout->setContentsMargins(0, 0, 0, 0);
  fovLayout->addWidget(fov_, 1);
  fovLayout->addWidget(asBundle_);
  row(tr("Sample subtends"), fovRow,
      tr("Angle that the sample subtends from the camera, degrees. Wider: each photograph tells more."));
  fov_->setToolTip(fovRow->toolTip());
  row(tr("Set-up"), setup_, tr("What may move between the shots"));
  row(tr("Error counts over"), region_,
      tr("Grazing directions are hard to measure and to trust; leaving them out moves the shots away from "
         "them"));
  row(tr("Aiming error"), poseError_,
      tr("Degrees that camera and light may be off. Above none: directions whose error stays small when they "
         "are missed a little; the search takes longer."));
  row(tr("Searches"), restarts_,
      tr("Whole searches from other random numbers; the best is kept. More: slower, seldom much better."));
  row(tr("Basis"), basis_, tr("The materials whose error is made small"));
  form->addRow(QString(), keep_);

  problems_ = new QLabel(side);
  problems_->setWordWrap(true);
  problems_->setStyleSheet(QStringLiteral("color: %1;").arg(theme::kError.name()));
  plan_ = new QPushButton(tr("Plan"), side);
  plan_->setObjectName(QStringLiteral("planStart"));
  plan_->setProperty("primary", true);
  plan_->setDefault(true);
  judge_ = new QPushButton(tr("Judge the Bundle"), side);
  judge_->setObjectName(QStringLiteral("planJudge"));
  judge_->setAutoDefault(false);
  stage_ = new QLabel(side);
  stage_->setObjectName(QStringLiteral("planStage"));
  progress_ = new QProgressBar(side);
  progress_->setObjectName(QStringLiteral("planProgress"));
  progress_->setRange(0, 1000);
  progress_->setFormat(QStringLiteral("%p %"));
  progress_->setAccessibleName(tr("Progress of the search"));
  cancel_ = new QPushButton(tr("Cancel"), side);
  cancel_->setObjectName(QStringLiteral("planCancel"));
  cancel_->setAutoDefault(false);
  cancel_->setToolTip(tr("Stop the search; the best plan so far is shown and marked (Esc)"));
  progressPane_ = new QWidget(side);
  auto* progressLayout = new QVBoxLayout(progressPane_);
  progressLayout->setContentsMargins(0, 0, 0, 0);
  progressLayout->addWidget(stage_);
  auto* barRow = new QHBoxLayout;
  barRow->addWidget(progress_, 1);
  barRow->addWidget(cancel_);
  progressLayout->addLayout(barRow);
  progressPane_->hide();
  said_ = new QLabel(side);
  said_->setObjectName(QStringLiteral("planSaid"));
  said_->setWordWrap(true);
  said_->setTextInteractionFlags(Qt::TextSelectableByMouse);

  auto* buttons = new QHBoxLayout;
  buttons->addWidget(plan_);
  buttons->addWidget(judge_);
  buttons->addStretch(1);
  auto* column = new QVBoxLayout(side);
  column->setContentsMargins(18, 16, 16, 14);
  column->setSpacing(10);
  column->addLayout(form);
  column->addWidget(problems_);
  column->addLayout(buttons);
  column->addWidget(progressPane_);
  column->addWidget(said_);
  column->addStretch(1);
  return side;
}

QWidget* PlanDialog::buildResult() {
  auto* split = new QSplitter(Qt::Vertical, this);
  split->setHandleWidth(3);
  split->setChildrenCollapsible(false);
  viewport_ = new PlanViewport(split);
  viewport_->setEmptyText(tr("The planned directions appear here."));
  auto* below = new QWidget(split);
  halfVectors_ = new QCheckBox(tr("Half-vectors"), below);
  halfVectors_->setObjectName(QStringLiteral("planHalfVectors"));
  halfVectors_->setToolTip(
      tr("Dashed: the direction midway between camera and light, where a mirror would face"));
  auto* above = new QPushButton(tr("Above"), below);
  auto* side = new QPushButton(tr("Side"), below);
  auto* whole = new QPushButton(tr("Reset View"), below);
  above->setToolTip(tr("Look from above (T, in the drawing)"));
  side->setToolTip(tr("Look from the side (S, in the drawing)"));
  whole->setToolTip(tr("Look as at the beginning (0, in the drawing)"));
  save_ = new QPushButton(tr("Save Plan\u2026"), below);
  save_->setObjectName(QStringLiteral("planSave"));
  for (QPushButton* button : {above, side, whole, save_}) button->setAutoDefault(false);
  connect(above, &QPushButton::clicked, viewport_, &PlanViewport::viewFromAbove);
  connect(side, &QPushButton::clicked, viewport_, &PlanViewport::viewFromTheSide);
  connect(whole, &QPushButton::clicked, viewport_, &PlanViewport::resetView);
  table_ = new QTableWidget(0, 4, below);
  table_->setObjectName(QStringLiteral("planTable"));
  table_->setAccessibleName(tr("Directions of the shots"));
  table_->setHorizontalHeaderLabels({tr("Shot"), tr("Camera"), tr("Light"), tr("\u03b8h  \u03b8d  \u03c6d")});
  table_->horizontalHeaderItem(1)->setToolTip(
      tr("Degrees from the normal, at an azimuth counted from x to y"));
  table_->horizontalHeaderItem(2)->setToolTip(table_->horizontalHeaderItem(1)->toolTip());
  table_->horizontalHeaderItem(3)->setToolTip(tr("Half-angle coordinates at the sample's centre, degrees"));
  table_->horizontalHeader()->setSectionResizeMode(QHeaderView::Stretch);
  table_->verticalHeader()->hide();
  table_->verticalHeader()->setDefaultSectionSize(fontMetrics().height() + 7);
  table_->setShowGrid(false);
  table_->setEditTriggers(QAbstractItemView::NoEditTriggers);
  table_->setSelectionBehavior(QAbstractItemView::SelectRows);
  table_->setMinimumHeight(fontMetrics().height() * 5);
  words_ = new QLabel(below);
  words_->setObjectName(QStringLiteral("planWords"));
  words_->setWordWrap(true);
  words_->setTextFormat(Qt::RichText);
  words_->setTextInteractionFlags(Qt::TextSelectableByMouse);
  words_->setAlignment(Qt::AlignTop | Qt::AlignLeft);
  auto* bar = new QHBoxLayout;
  bar->addWidget(above);
  bar->addWidget(side);
  bar->addWidget(whole);
  bar->addSpacing(8);
  bar->addWidget(halfVectors_);
  bar->addStretch(1);
  bar->addWidget(save_);
  auto* column = new QVBoxLayout(below);
  column->setContentsMargins(12, 8, 12, 10);
  column->setSpacing(8);
  column->addLayout(bar);
  column->addWidget(words_);
  column->addWidget(table_, 1);
  split->addWidget(viewport_);
  split->addWidget(below);
  split->setStretchFactor(0, 3);
  split->setStretchFactor(1, 2);
  split->setSizes({430, 290});
  return split;
}

PlanOptions PlanDialog::options() const {
  PlanOptions options = given_;
  options.shots = shots_->value();
  options.fovDeg = fov_->value();
  options.setup = static_cast<PlanSetup>(setup_->currentData().toInt());
  options.region = static_cast<BasisRegion>(region_->currentData().toInt());
  options.poseErrorDeg = poseError_->value();
  options.restarts = restarts_->value();
  options.given.clear();
  if (keep_->isChecked() && capture_)
    for (const TwoShotPhoto& shot : capture_->shots)
      if (!shot.holdout) options.given.push_back(directionsOf(shot));
  return options;
}

void PlanDialog::setOptions(const PlanOptions& options) {
  given_ = options;
  given_.given.clear();
  shots_->setValue(options.shots);
  fov_->setValue(options.fovDeg);
  setup_->setCurrentIndex(setup_->findData(static_cast<int>(options.setup)));
  region_->setCurrentIndex(region_->findData(static_cast<int>(options.region)));
  poseError_->setValue(options.poseErrorDeg);
  restarts_->setValue(options.restarts);
  check();
}

QString PlanDialog::basisFile() const {
  return basis_->file();
}

void PlanDialog::setBasisFile(const QString& file) {
  basis_->setFile(file);
}

void PlanDialog::setCapture(std::shared_ptr<const TwoShotCapture> capture) {
  if (capture == capture_) return;
  capture_ = std::move(capture);
  outcome_.reached.reset();
  if (!capture_) keep_->setChecked(false);
  check();
  refresh();
}

void PlanDialog::setOutcome(const PlanOutcome& outcome) {
  if (outcome.plan) outcome_.plan = outcome.plan;
  if (outcome.reached) outcome_.reached = outcome.reached;
  refresh();
}

void PlanDialog::setRunning(bool running) {
  running_ = running;
  progress_->setValue(0);
  stage_->setText(tr("Starting"));
  cancel_->setText(tr("Cancel"));
  if (running) {
    said_->clear();
    progressPane_->show();
    cancel_->setFocus();  // the button that has it is about to rest
    check();
  } else {
    const bool hadFocus = cancel_->hasFocus();
    check();
    if (hadFocus) plan_->setFocus();
    progressPane_->hide();
  }
}

void PlanDialog::setProgress(const QString& stage, double fraction) {
  stage_->setText(stage);
  progress_->setValue(static_cast<int>(std::lround(1000 * fraction)));
}

void PlanDialog::say(const QString& sentence, bool problem) {
  said_->setStyleSheet(QStringLiteral("color: %1;").arg((problem ? theme::kError : theme::kTextDim).name()));
  said_->setText(sentence);
}

QString PlanDialog::words() const {
  return QTextDocumentFragment::fromHtml(words_->text()).toPlainText();
}

void PlanDialog::check() {
  QStringList lines;
  for (const std::string& problem : options().validate()) lines << QString::fromStdString(problem);
  problems_->setText(lines.join('\n'));
  problems_->setVisible(!lines.isEmpty());
  const QString noBundle = tr("Not now: no two-shot bundle is open."),
                busy = tr("Not now: a search is running.");
  const auto allow = [](QWidget* widget, bool possible, const QString& tip, const QString& whyNot) {
    widget->setEnabled(possible);
    widget->setToolTip(possible ? tip : tip + QStringLiteral("\n") + whyNot);
  };
  allow(plan_, lines.isEmpty() && !running_, tr("Search for the directions that make the error smallest"),
        running_ ? busy : lines.join('\n'));
  allow(judge_, capture_ && !running_,
        tr("The error to expect of the directions that the open bundle reached"), running_ ? busy : noBundle);
  allow(asBundle_, capture_ != nullptr, tr("Take the angle from the open bundle"), noBundle);
  allow(keep_, capture_ != nullptr,
        tr("The open bundle's shots are given; the search adds as many as are asked for"), noBundle);
  allow(save_, outcome_.plan && !running_, tr("Write plan.json, and a drawing of the same name as .svg"),
        running_ ? busy : tr("Not now: there is no plan to save."));
}

void PlanDialog::refresh() {
  std::vector<PlanViewport::Shot> shots;
  const auto ofBundle = [&](const ShotDirections& directions, int number, bool faint) {
    shots.push_back({directions, faint ? QColor(200, 200, 200) : shotColour(number),
                     tr("%1 (bundle)").arg(number + 1), faint});
  };
  // Where the plan adds to the bundle's shots, they are its first.
  const std::size_t given = outcome_.plan ? outcome_.plan->options.given.size() : 0;
  if (outcome_.plan)
    for (std::size_t i = given; i < outcome_.plan->shots.size(); ++i)
      shots.push_back({outcome_.plan->shots[i].directions, shotColour(static_cast<int>(i - given)),
                       QString::number(i + 1), false});
  if (given > 0) {
    for (std::size_t i = 0; i < given; ++i)
      ofBundle(outcome_.plan->options.given[i], static_cast<int>(i), true);
  } else if (capture_) {
    int number = 0;
    for (const TwoShotPhoto& shot : capture_->shots)
      if (!shot.holdout) ofBundle(directionsOf(shot), number++, outcome_.plan.has_value());
  }
  viewport_->setShots(std::move(shots), outcome_.plan ? outcome_.plan->options.fovDeg
                                        : capture_    ? discOf(*capture_).fovDeg
                                                      : fov_->value());
  refreshTable();
  QString text;
  const auto add = [&](const QString& line) {
    text += QStringLiteral("<p style='margin:0 0 3px 0'>%1</p>").arg(line);
  };
  if (outcome_.plan) {
    const Plan& plan = *outcome_.plan;
    add(tr("Expected error of the plan: %1").arg(errorSentence(plan.expected)));
    if (plan.poseTolerant > 0)
      add(tr("Aimed with an error of %1\u00b0: %2 on average for materials like the basis' own.")
              .arg(plan.options.poseErrorDeg > 0 ? plan.options.poseErrorDeg : 1.5)
              .arg(logErrorText(plan.poseTolerant)));
    if (plan.cancelled) add(tr("The search was cancelled: this is the best that it had found."));
  }
  if (outcome_.reached)
    add(tr("Expected error of the open bundle\u2019s directions: %1")
            .arg(errorSentence(outcome_.reached->expected)));
  else if (capture_ && outcome_.plan)
    add(tr("The directions that the open bundle really reached are drawn thin."));
  if (text.isEmpty())
    add(capture_
            ? tr("The open bundle\u2019s directions are drawn. <b>Judge the Bundle</b> says what error to "
                 "expect of them, <b>Plan</b> finds better ones.")
            : tr("<b>Plan</b> finds the directions of camera and light that tell most about an unknown "
                 "material."));
  words_->setText(text);
  check();
}

void PlanDialog::refreshTable() {
  table_->setRowCount(0);
  const auto add = [this](const QString& name, const QColor& colour, const ShotDirections& directions) {
    const int row = table_->rowCount();
    table_->insertRow(row);
    QPixmap swatch(fontMetrics().height() - 2, fontMetrics().height() - 2);
    swatch.fill(colour);
    table_->setItem(row, 0, new QTableWidgetItem(QIcon(swatch), name));
    table_->setItem(row, 1, new QTableWidgetItem(directionText(directions.toCamera)));
    table_->setItem(row, 2, new QTableWidgetItem(directionText(directions.toLight)));
    table_->setItem(row, 3, new QTableWidgetItem(anglesText(directions.centre(), 1)));
  };
  for (const PlanViewport::Shot& shot : viewport_->shots()) add(shot.name, shot.colour, shot.directions);
}

void PlanDialog::keyPressEvent(QKeyEvent* event) {
  if (event->key() == Qt::Key_Escape && running_) {
    Q_EMIT cancelRequested();
    cancel_->setText(tr("Cancelling\u2026"));
    return;
  }
  QDialog::keyPressEvent(event);
}

}  // namespace patina
