#include "widgets/fit_options_dialog.h"

#include <QCheckBox>
#include <QComboBox>
#include <QDialogButtonBox>
#include <QDoubleSpinBox>
#include <QFormLayout>
#include <QPushButton>
#include <QSpinBox>
#include <cmath>

#include "widgets/theme.h"

namespace patina {

namespace {
constexpr double kGibibyte = 1024.0 * 1024 * 1024;
}

FitOptionsDialog::FitOptionsDialog(const FourierFitOptions& options, QWidget* parent) : QDialog(parent) {
  setWindowTitle(tr("Fit Options"));
  setObjectName(QStringLiteral("fitOptions"));
  size_ = new QSpinBox(this);
  size_->setObjectName(QStringLiteral("optionSize"));
  size_->setRange(0, 16384);
  size_->setSingleStep(32);
  size_->setSuffix(tr(" texels"));
  size_->setSpecialValueText(tr("what the photographs resolve"));
  lobe_ = new QComboBox(this);
  lobe_->setObjectName(QStringLiteral("optionLobe"));
  lobe_->addItem(tr("Exact moments"), static_cast<int>(LobeMapping::ExactMoments));
  lobe_->addItem(tr("Paper's affine map"), static_cast<int>(LobeMapping::PaperAffine));
  weights_ = new QComboBox(this);
  weights_->setObjectName(QStringLiteral("optionWeights"));
  weights_->addItem(tr("From the photographs' noise"), static_cast<int>(MeasurementWeights::Noise));
  weights_->addItem(tr("Paper's constant"), static_cast<int>(MeasurementWeights::PaperConstant));
  iterations_ = new QSpinBox(this);
  iterations_->setObjectName(QStringLiteral("optionIterations"));
  iterations_->setRange(1, 1000);
  toleranceExponent_ = new QDoubleSpinBox(this);
  toleranceExponent_->setObjectName(QStringLiteral("optionTolerance"));
  toleranceExponent_->setRange(-12, -1);
  toleranceExponent_->setDecimals(1);
  toleranceExponent_->setSingleStep(0.5);
  toleranceExponent_->setPrefix(QStringLiteral("10^ "));
  restarts_ = new QCheckBox(tr("Offer each texel its neighbours' solutions"), this);
  restarts_->setObjectName(QStringLiteral("optionRestarts"));
  pool_ = new QCheckBox(tr("Pool neighbours that noise can't tell apart"), this);
  pool_->setObjectName(QStringLiteral("optionPool"));

  schedule_ = new QComboBox(this);
  schedule_->setObjectName(QStringLiteral("optionSchedule"));
  schedule_->addItem(tr("Every texel at full resolution"), static_cast<int>(FitSchedule::Independent));
  schedule_->addItem(tr("Paper's, half resolution"), static_cast<int>(FitSchedule::Paper));
  memory_ = new QDoubleSpinBox(this);
  memory_->setObjectName(QStringLiteral("optionMemory"));
  memory_->setRange(0.25, 1024);
  memory_->setDecimals(2);
  memory_->setSuffix(tr(" GiB"));

  auto* form = new QFormLayout;
  form->setHorizontalSpacing(16);
  form->setVerticalSpacing(4);
  const auto row = [&](const QString& label, QWidget* field, const QString& effect) {
    form->addRow(label, field);
    field->setToolTip(effect);
    auto* note = new QLabel(effect, this);
    note->setProperty("role", "caption");
    note->setFont(theme::captionFont());
    note->setWordWrap(true);
    note->setContentsMargins(0, 0, 0, 8);
    form->addRow(QString(), note);
  };
  row(tr("Longest side of the maps"), size_,
      tr("Larger: finer maps and a longer fit, but no new detail beyond the photographs."));
  row(tr("Specular lobe"), lobe_,
      tr("Exact moments halve the errors of satin samples; the paper's map is for comparison."));
  row(tr("Weights"), weights_,
      tr("Noise weights halve the errors of parameters at equal cost; the constant is for comparison."));
  row(tr("Schedule"), schedule_,
      tr("Coarse levels first in both. The paper then stops at half the resolution and upsamples; for "
         "comparison."));
  row(tr("Memory at most"), memory_,
      tr("Measurements beyond it wait on disk; maps that would not fit are made coarser, with a warning."));
  row(tr("Iterations at most"), iterations_,
      tr("For each texel and start. More: slower, fewer texels stopped early."));
  row(tr("Tolerance"), toleranceExponent_,
      tr("Relative decrease of the cost at which a texel has converged. Smaller: slower."));
  row(QString(), restarts_, tr("Rescues stuck texels at a few percent of the time."));
  row(QString(), pool_,
      tr("Averages a point's measurements with those of neighbouring pixels that the noise can't tell from "
         "it. Off: every pixel alone, noisier where lobes are broad."));

  problems_ = new QLabel(this);
  problems_->setWordWrap(true);
  problems_->setStyleSheet(QStringLiteral("color: %1;").arg(theme::kError.name()));
  buttons_ = new QDialogButtonBox(
      QDialogButtonBox::Ok | QDialogButtonBox::Cancel | QDialogButtonBox::RestoreDefaults, this);
  auto* column = new QVBoxLayout(this);
  column->setContentsMargins(20, 18, 20, 14);
  column->addLayout(form);
  column->addWidget(problems_);
  column->addWidget(buttons_);
  setMinimumWidth(fontMetrics().averageCharWidth() * 72);
  setOptions(options);
  connect(buttons_, &QDialogButtonBox::accepted, this, &QDialog::accept);
  connect(buttons_, &QDialogButtonBox::rejected, this, &QDialog::reject);
  connect(buttons_->button(QDialogButtonBox::RestoreDefaults), &QPushButton::clicked, this,
          [this] { setOptions(FourierFitOptions{}); });
  connect(size_, &QSpinBox::valueChanged, this, &FitOptionsDialog::check);
  connect(iterations_, &QSpinBox::valueChanged, this, &FitOptionsDialog::check);
  connect(toleranceExponent_, &QDoubleSpinBox::valueChanged, this, &FitOptionsDialog::check);
}

FourierFitOptions FitOptionsDialog::options() const {
  FourierFitOptions options;
  options.size = size_->value();
  options.lobe = static_cast<LobeMapping>(lobe_->currentData().toInt());
  options.weights = static_cast<MeasurementWeights>(weights_->currentData().toInt());
  options.maxIterations = iterations_->value();
  options.tolerance = toleranceExponent_->value() == givenExponent_
                          ? givenTolerance_
                          : std::pow(10.0, toleranceExponent_->value());
  options.neighbourRestarts = restarts_->isChecked();
  options.poolNeighbours = pool_->isChecked();
  options.schedule = static_cast<FitSchedule>(schedule_->currentData().toInt());
  options.memoryLimitBytes = static_cast<std::uint64_t>(std::llround(memory_->value() * kGibibyte));
  return options;
}

void FitOptionsDialog::setOptions(const FourierFitOptions& options) {
  size_->setValue(options.size);
  lobe_->setCurrentIndex(lobe_->findData(static_cast<int>(options.lobe)));
  weights_->setCurrentIndex(weights_->findData(static_cast<int>(options.weights)));
  iterations_->setValue(options.maxIterations);
  toleranceExponent_->setValue(std::log10(options.tolerance));
  givenTolerance_ = options.tolerance;
  givenExponent_ = toleranceExponent_->value();
  restarts_->setChecked(options.neighbourRestarts);
  pool_->setChecked(options.poolNeighbours);
  schedule_->setCurrentIndex(schedule_->findData(static_cast<int>(options.schedule)));
  memory_->setValue(static_cast<double>(options.memoryLimitBytes) / kGibibyte);
  check();
}

void FitOptionsDialog::check() {
  QStringList lines;
  for (const std::string& problem : options().validate()) lines << QString::fromStdString(problem);
  problems_->setText(lines.join('\n'));
  problems_->setVisible(!lines.isEmpty());
  buttons_->button(QDialogButtonBox::Ok)->setEnabled(lines.isEmpty());
  buttons_->button(QDialogButtonBox::Ok)->setToolTip(lines.join('\n'));
}

}  // namespace patina
