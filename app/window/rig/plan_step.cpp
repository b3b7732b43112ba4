#include "app/window/rig/plan_step.h"

#include <QCheckBox>
#include <QDoubleSpinBox>
#include <QFileDialog>
#include <QGridLayout>
#include <QHeaderView>
#include <QProgressBar>
#include <QPushButton>
#include <QSpinBox>
#include <QTableWidget>
#include <numbers>

#include "app/window/settings.h"
#include "widgets/theme.h"

namespace patina {

namespace {

constexpr double kDegree = std::numbers::pi / 180;

/// Two shots that tolerate an operator: planned over directions that can be trusted, for any material.
std::vector<PlannedShot> usualShots() {
  std::vector<PlannedShot> shots;
  for (const HalfDiffAngles& angles : {HalfDiffAngles{6 * kDegree, 15 * kDegree, 37.5 * kDegree},
                                       HalfDiffAngles{16 * kDegree, 60 * kDegree, 89 * kDegree}})
    shots.push_back({shotFromHalfDiff(angles), angles});
  return shots;
}

QString polarWords(const Eigen::Vector3d& direction) {
  return QStringLiteral("%1\u00b0 from the normal, azimuth %2\u00b0")
      .arg(std::acos(std::clamp(direction.z(), -1.0, 1.0)) / kDegree, 0, 'f', 1)
      .arg(std::round(10 * std::atan2(direction.y(), direction.x()) / kDegree) / 10 + 0.0, 0, 'f', 1);
}

QString capitalised(QString text) {
  if (!text.isEmpty()) text[0] = text[0].toUpper();
  return text;
}

}  // namespace

PlanStep::PlanStep(TwoShotTask& task) : task_(task) {
  connect(&task_, &TwoShotTask::changed, this, &PlanStep::refresh);
  connect(&job_, &JobRunner::progressed, this, [this](const QString&, qint64 done, qint64 total) {
    progress_->setRange(0, static_cast<int>(std::max<qint64>(1, total)));
    progress_->setValue(static_cast<int>(done));
  });
  connect(&job_, &JobRunner::finished, this, &PlanStep::refresh);
}

PlanStep::~PlanStep() {
  job_.disconnect();
}

QString PlanStep::title() const {
  return tr("Plan");
}

QString PlanStep::sentence() const {
  return tr(
      "Say how large the sample is and how far the camera will stand, and decide from where it is "
      "photographed. The usual pair is good for any material; a search finds the best one for your case.");
}

QWidget* PlanStep::body(QWidget* parent) {
  if (body_) return body_;
  body_ = new QWidget(parent);
  body_->setObjectName(QStringLiteral("plan-step"));
  const auto number = [this](const char* name, const QString& words, double least, double most,
                             double value) {
    auto* box = new QDoubleSpinBox(body_);
    box->setObjectName(QLatin1String(name));
    box->setAccessibleName(words);
    box->setRange(least, most);
    box->setDecimals(1);
    box->setValue(value);
    box->setSuffix(tr(" mm"));
    connect(box, &QDoubleSpinBox::valueChanged, this,
            [this] { task_.setSample(radius_->value(), height_->value(), distance_->value()); });
    return box;
  };
  radius_ =
      number("plan-radius", tr("Radius of the part of the sample that counts"), 1, 500, task_.radiusMm());
  height_ = number("plan-height", tr("Height of the sample's surface over the markers"), -50, 200,
                   task_.sampleHeightMm());
  distance_ =
      number("plan-distance", tr("Distance of the camera from the sample"), 20, 5000, task_.distanceMm());
  shots_ = new QSpinBox(body_);
  shots_->setObjectName(QStringLiteral("plan-shots"));
  shots_->setRange(1, 6);
  shots_->setValue(2);
  trusted_ = new QCheckBox(tr("Only directions in which a result can be trusted"), body_);
  trusted_->setObjectName(QStringLiteral("plan-trusted"));
  trusted_->setChecked(true);
  const auto button = [this](const QString& text, const char* name) {
    auto* made = new QPushButton(text, body_);
    made->setObjectName(QLatin1String(name));
    return made;
  };
  usual_ = button(tr("Use the Usual Pair"), "plan-usual");
  usual_->setProperty("primary", true);
  search_ = button(tr("Search"), "plan-search");
  open_ = button(tr("Open a Plan\u2026"), "plan-open");
  cancel_ = button(tr("Cancel"), "plan-cancel");
  progress_ = new QProgressBar(body_);
  progress_->setTextVisible(false);
  table_ = new QTableWidget(0, 2, body_);
  table_->setObjectName(QStringLiteral("plan-table"));
  table_->setAccessibleName(tr("Shots"));
  table_->setHorizontalHeaderLabels({tr("Camera"), tr("Lamp")});
  table_->horizontalHeader()->setSectionResizeMode(QHeaderView::Stretch);
  table_->setEditTriggers(QAbstractItemView::NoEditTriggers);
  table_->setSelectionMode(QAbstractItemView::NoSelection);
  words_ = new QLabel(body_);
  words_->setObjectName(QStringLiteral("plan-words"));
  words_->setWordWrap(true);

  auto* form = new QGridLayout;
  form->setVerticalSpacing(6);
  form->addWidget(new QLabel(tr("Radius of the sample"), body_), 0, 0);
  form->addWidget(radius_, 0, 1);
  form->addWidget(new QLabel(tr("Surface over the markers"), body_), 1, 0);
  form->addWidget(height_, 1, 1);
  form->addWidget(new QLabel(tr("Camera's distance"), body_), 2, 0);
  form->addWidget(distance_, 2, 1);
  form->addWidget(new QLabel(tr("Shots to search for"), body_), 0, 3);
  form->addWidget(shots_, 0, 4);
  form->addWidget(trusted_, 1, 3, 1, 2);
  form->setColumnMinimumWidth(2, 24);
  form->setColumnStretch(5, 1);
  auto* row = new QHBoxLayout;
  row->addWidget(usual_);
  row->addWidget(search_);
  row->addWidget(open_);
  row->addWidget(progress_, 1);
  row->addWidget(cancel_);
  row->addStretch(1);
  auto* note = new QLabel(
      tr("Azimuths are counted counter-clockwise from the markers' right side, seen from above."), body_);
  note->setProperty("role", "caption");
  auto* column = new QVBoxLayout(body_);
  column->setContentsMargins(0, 8, 0, 0);
  column->setSpacing(12);
  column->addLayout(form);
  column->addLayout(row);
  column->addWidget(table_, 1);
  column->addWidget(note);
  column->addWidget(words_);
  connect(usual_, &QPushButton::clicked, this, &PlanStep::recommended);
  connect(search_, &QPushButton::clicked, this, &PlanStep::search);
  connect(open_, &QPushButton::clicked, this, [this] {
    const QString file =
        choose_ ? choose_()
                : QFileDialog::getOpenFileName(body_, tr("Open a Plan"), {}, tr("Plans (*.json)"));
    if (!file.isEmpty()) openPlan(file);
  });
  connect(cancel_, &QPushButton::clicked, &job_, &JobRunner::cancel);
  refresh();
  return body_;
}

double PlanStep::fovDeg() const {
  return 2 * std::atan(task_.radiusMm() / task_.distanceMm()) / kDegree;
}

void PlanStep::recommended() {
  openPlan({});
}

/// Empty: the usual pair.
void PlanStep::openPlan(const QString& file) {
  if (job_.running()) return;
  std::vector<PlannedShot> shots = usualShots();
  if (!file.isEmpty()) {
    const auto plan = readPlan(file.toStdString());
    if (!plan) return words_->setText(QString::fromStdString(plan.error().sentence()));
    shots = plan->shots;
  }
  using Outcome = std::pair<BasisPtr, Plan>;
  NearFieldDisc disc;
  disc.fovDeg = fovDeg();
  job_.start<Outcome>(
      [shots, disc, region = trusted_->isChecked() ? BasisRegion::Trusted : BasisRegion::All,
       file = task_.rig().settings().text(QStringLiteral("two_shot/basis_file"))](
          const JobContext& job) -> Result<Outcome> {
        auto basis = basisFor(file.toStdString(), job);
        if (!basis) return basis.error();
        std::vector<ShotDirections> directions;
        for (const PlannedShot& shot : shots) directions.push_back(shot.directions);
        return Outcome{*basis, expectationOf(*basis, directions, disc, region, kPaperEta)};
      },
      [this, shots](Result<Outcome> outcome) {
        if (!outcome) return words_->setText(QString::fromStdString(outcome.error().sentence()));
        take(shots, outcome->first, outcome->second);
      });
  refresh();
}

void PlanStep::search() {
  if (job_.running()) return;
  PlanOptions options;
  options.shots = shots_->value();
  options.region = trusted_->isChecked() ? BasisRegion::Trusted : BasisRegion::All;
  options.fovDeg = fovDeg();
  using Outcome = std::pair<BasisPtr, Plan>;
  job_.start<Outcome>(
      [options, file = task_.rig().settings().text(QStringLiteral("two_shot/basis_file"))](
          const JobContext& job) -> Result<Outcome> {
        auto basis = basisFor(file.toStdString(), job);
        if (!basis) return basis.error();
        auto plan = planDirections(*basis, options, job);
        if (!plan) return plan.error();
        return Outcome{*basis, std::move(*plan)};
      },
      [this](Result<Outcome> outcome) {
        if (!outcome)
          return words_->setText(outcome.error().code == ErrorCode::Cancelled
                                     ? tr("Cancelled before anything was found.")
                                     : QString::fromStdString(outcome.error().sentence()));
        const std::vector<PlannedShot> shots = outcome->second.shots;
        take(shots, outcome->first, outcome->second);
      });
  refresh();
}

void PlanStep::take(std::vector<PlannedShot> shots, BasisPtr basis, const Plan& expected) {
  expected_ = expected.expected.training;
  QStringList sentences;
  for (const std::string& remark : planRemarks(expected))
    sentences << capitalised(QString::fromStdString(remark));
  words_->setText(sentences.join(QLatin1Char('\n')));
  task_.setShots(std::move(shots), std::move(basis));
}

void PlanStep::refresh() {
  if (body_) {
    const bool running = job_.running();
    for (QWidget* widget : std::initializer_list<QWidget*>{usual_, search_, open_})
      widget->setEnabled(!running);
    progress_->setVisible(running);
    cancel_->setVisible(running);
    table_->setRowCount(static_cast<int>(task_.shots().size()));
    for (int row = 0; row < table_->rowCount(); ++row) {
      const ShotDirections& shot = task_.shots()[static_cast<std::size_t>(row)].directions;
      table_->setItem(row, 0, new QTableWidgetItem(polarWords(shot.toCamera)));
      table_->setItem(row, 1, new QTableWidgetItem(polarWords(shot.toLight)));
    }
  }
  Q_EMIT changed();
}

GuideStep::State PlanStep::state() const {
  return task_.shots().empty() || job_.running() ? State::ToDo : State::Done;
}

QString PlanStep::note() const {
  if (state() != State::Done) return {};
  return tr("%1 shots").arg(task_.shots().size());
}

QString PlanStep::whyNot() const {
  return job_.running() ? tr("Directions are being worked out.") : tr("No directions are chosen yet.");
}

}  // namespace patina
