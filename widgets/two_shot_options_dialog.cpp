#include "widgets/two_shot_options_dialog.h"

#include <QCheckBox>
#include <QComboBox>
#include <QDialogButtonBox>
#include <QDoubleSpinBox>
#include <QFileDialog>
#include <QFileInfo>
#include <QFormLayout>
#include <QPushButton>
#include <QSpinBox>

#include "widgets/theme.h"

namespace patina {

BasisChooser::BasisChooser(QWidget* parent) : QWidget(parent) {
  box_ = new QComboBox(this);
  box_->setObjectName(QStringLiteral("basisBox"));
  box_->setAccessibleName(tr("Basis"));
  box_->addItem(tr("Built in (MERL 100)"), QString());
  box_->setSizeAdjustPolicy(QComboBox::AdjustToMinimumContentsLengthWithIcon);
  box_->setMinimumContentsLength(24);
  browse_ = new QPushButton(tr("File\u2026"), this);
  browse_->setObjectName(QStringLiteral("basisBrowse"));
  browse_->setAutoDefault(false);
  browse_->setToolTip(tr("Choose a basis file that \u201cpatina-cli basis build\u201d wrote"));
  choose_ = [this] {
    return QFileDialog::getOpenFileName(this, tr("Choose a Basis File"),
                                        file().isEmpty() ? QString() : QFileInfo(file()).path());
  };
  auto* row = new QHBoxLayout(this);
  row->setContentsMargins(0, 0, 0, 0);
  row->addWidget(box_, 1);
  row->addWidget(browse_);
  setFocusProxy(box_);
  connect(box_, &QComboBox::currentIndexChanged, this, &BasisChooser::changed);
  connect(browse_, &QPushButton::clicked, this, [this] {
    const QString chosen = choose_();
    if (!chosen.isEmpty()) setFile(chosen);
  });
}

QString BasisChooser::file() const {
  return box_->currentData().toString();
}

void BasisChooser::setFile(const QString& file) {
  int index = box_->findData(file);
  if (index < 0) {
    box_->addItem(QFileInfo(file).fileName(), file);
    index = box_->count() - 1;
    box_->setItemData(index, file, Qt::ToolTipRole);
  }
  box_->setCurrentIndex(index);
}

TwoShotOptionsDialog::TwoShotOptionsDialog(const TwoShotChoices& choices, QWidget* parent) : QDialog(parent) {
  setWindowTitle(tr("Options of the Reconstruction"));
  setObjectName(QStringLiteral("twoShotOptions"));
  basis_ = new BasisChooser(this);
  eta_ = new QDoubleSpinBox(this);
  eta_->setObjectName(QStringLiteral("optionEta"));
  eta_->setRange(0, 1e6);
  eta_->setDecimals(3);
  eta_->setStepType(QAbstractSpinBox::AdaptiveDecimalStepType);
  automaticEta_ = new QCheckBox(tr("Choose eta by cross-validation"), this);
  automaticEta_->setObjectName(QStringLiteral("optionChooseEta"));
  rows_ = new QSpinBox(this);
  rows_->setObjectName(QStringLiteral("optionRows"));
  rows_->setRange(0, 1000000);
  rows_->setSingleStep(500);
  rows_->setGroupSeparatorShown(true);
  noise_ = new QCheckBox(tr("Weigh measurements by the sensor's noise"), this);
  noise_->setObjectName(QStringLiteral("optionNoise"));
  clusters_ = new QSpinBox(this);
  clusters_->setObjectName(QStringLiteral("optionClusters"));
  clusters_->setRange(0, 8);
  clusters_->setSpecialValueText(tr("as many as the colours tell apart"));

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
  row(tr("Basis"), basis_,
      tr("The materials that the reconstruction leans on where nothing was photographed. The built-in one is "
         "made at its first use, which takes some ten seconds."));
  row(tr("Eta"), eta_,
      tr("Weight of the basis against the photographs, for 300 measurements a picture. Larger: closer to "
         "the mean of the basis. The paper's value is 40."));
  row(QString(), automaticEta_, tr("Instead of the value above; takes a little longer."));
  row(tr("Materials on the sample"), clusters_,
      tr("1: the sample is of one material. More: pixels are grouped by colour and each group gets a "
         "reflectance of its own; wants one camera position for all shots."));
  row(tr("Measurements a picture"), rows_,
      tr("Neighbouring pixels are averaged to about so many. More: finer highlights, slower."));
  row(QString(), noise_, tr("Off: every measurement counts alike, as in the paper."));

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
  setChoices(choices);
  connect(buttons_, &QDialogButtonBox::accepted, this, &QDialog::accept);
  connect(buttons_, &QDialogButtonBox::rejected, this, &QDialog::reject);
  connect(buttons_->button(QDialogButtonBox::RestoreDefaults), &QPushButton::clicked, this,
          [this] { setChoices({}); });
  connect(automaticEta_, &QCheckBox::toggled, this, &TwoShotOptionsDialog::check);
  connect(eta_, &QDoubleSpinBox::valueChanged, this, &TwoShotOptionsDialog::check);
  connect(rows_, &QSpinBox::valueChanged, this, &TwoShotOptionsDialog::check);
  connect(clusters_, &QSpinBox::valueChanged, this, &TwoShotOptionsDialog::check);
  connect(basis_, &BasisChooser::changed, this, &TwoShotOptionsDialog::check);
}

TwoShotChoices TwoShotOptionsDialog::choices() const {
  TwoShotChoices choices;
  choices.fit.eta = eta_->value();
  choices.fit.chooseEta = automaticEta_->isChecked();
  choices.fit.rowsPerShot = rows_->value();
  choices.fit.noiseWeights = noise_->isChecked();
  choices.fit.clusters = clusters_->value();
  choices.basisFile = basis_->file();
  return choices;
}

void TwoShotOptionsDialog::setChoices(const TwoShotChoices& choices) {
  eta_->setValue(choices.fit.eta);
  automaticEta_->setChecked(choices.fit.chooseEta);
  rows_->setValue(choices.fit.rowsPerShot);
  noise_->setChecked(choices.fit.noiseWeights);
  clusters_->setValue(choices.fit.clusters);
  basis_->setFile(choices.basisFile);
  check();
}

void TwoShotOptionsDialog::check() {
  const TwoShotChoices chosen = choices();
  eta_->setEnabled(!chosen.fit.chooseEta);
  eta_->setStatusTip(chosen.fit.chooseEta ? tr("Chosen by cross-validation") : QString());
  QStringList lines;
  for (const std::string& problem : chosen.fit.validate()) lines << QString::fromStdString(problem);
  if (!chosen.basisFile.isEmpty() && !QFileInfo(chosen.basisFile).isFile())
    lines << tr("There is no basis file %1.").arg(chosen.basisFile);
  problems_->setText(lines.join('\n'));
  problems_->setVisible(!lines.isEmpty());
  buttons_->button(QDialogButtonBox::Ok)->setEnabled(lines.isEmpty());
  buttons_->button(QDialogButtonBox::Ok)->setToolTip(lines.join('\n'));
}

}  // namespace patina
