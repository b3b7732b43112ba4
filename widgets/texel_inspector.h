#pragma once

#include <QTimer>
#include <QWidget>

#include "widgets/document.h"

class QButtonGroup;
class QCheckBox;
class QComboBox;
class QLabel;
class QTabWidget;
class QTableWidget;

namespace patina {

class PlotWidget;

/// One texel of a fit: its spectrum as measured and as the model has it (the paper's Fig. 2), its lobe across
/// the screen (Fig. 3) and its parameters.
class TexelInspector : public QWidget {
  Q_OBJECT

 public:
  explicit TexelInspector(Document* document, QWidget* parent = nullptr);

  /// A texel to show for the moment instead of the picked one: what is under the cursor.
  void setHovered(std::optional<QPoint> texel);
  /// The texel on show; none without a fit.
  std::optional<QPoint> shownTexel() const;

  int channel() const;
  void setChannel(int channel);
  int direction() const;  ///< 0 x, 1 y, 2 diagonal, 3 other diagonal
  void setDirection(int direction);
  bool followsCursor() const;
  void setFollowsCursor(bool follows);
  bool phaseAboutLobe() const;
  void setPhaseAboutLobe(bool about);
  int page() const;
  void setPage(int page);

  PlotWidget* magnitudePlot() { return magnitude_; }
  PlotWidget* phasePlot() { return phase_; }
  PlotWidget* lobePlot() { return lobe_; }
  QTableWidget* table() { return table_; }

 private:
  void schedule();
  void refresh();
  void refreshSpectrum(const FourierFit& fit, const QPoint& texel);
  void refreshLobe(const FourierFit& fit, const QPoint& texel);
  void refreshTable(const FourierFit& fit, const QPoint& texel);

  Document* document_;
  std::optional<QPoint> hovered_;
  QTimer coalesce_;

  QLabel* title_;
  QCheckBox *follow_, *aboutLobe_;
  QButtonGroup* channels_;
  QComboBox *direction_, *line_;
  QTabWidget* tabs_;
  PlotWidget *magnitude_, *phase_, *lobe_;
  QTableWidget* table_;
};

}  // namespace patina
