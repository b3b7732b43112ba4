#pragma once

#include <QColor>
#include <QString>
#include <QWidget>
#include <functional>
#include <optional>
#include <vector>

namespace patina {

/// One set of points in a plot. A point with a NaN breaks a line.
struct PlotSeries {
  enum class Mark {
    Line,
    DashedLine,
    DottedLine,
    Dots,
    HollowDots,
    Band,  ///< an area, translucent: its upper edge from left to right, then its lower edge back; not read
           ///< out
  };
  QString name;  ///< at the cursor, and in the legend; empty: not listed
  QColor colour;
  Mark mark = Mark::Line;
  std::vector<QPointF> points;
  double penWidth = 1.5;
  std::optional<QString> legend =
      std::nullopt;  ///< what the legend says instead of the name; empty: not listed
};

struct PlotAxis {
  QString title;  ///< with its unit
  bool logarithmic = false;
  double low = 0, high = 1;
  /// Places and texts of ticks; empty: round values.
  std::vector<std::pair<double, QString>> ticks;
};

/// A small plot of our own: linear or logarithmic axes, lines and dots, a legend, the values under the
/// cursor.
class PlotWidget : public QWidget {
  Q_OBJECT

 public:
  explicit PlotWidget(QWidget* parent = nullptr);
  void setAxes(PlotAxis horizontal, PlotAxis vertical);
  void setSeries(std::vector<PlotSeries> series);
  /// Vertical lines behind the series, e.g. the screen's edges.
  void setGuides(std::vector<std::pair<double, QString>> guides);
  void setEmptyText(const QString& text);
  /// Where the legend stands; none hides it.
  void setLegend(std::optional<Qt::Corner> corner);
  /// What the bubble at a point says; none: its series' name and its two values.
  void setReadout(std::function<QString(const PlotSeries&, const QPointF&)> readout);
  void clear();
  const std::vector<PlotSeries>& series() const { return series_; }
  const PlotAxis& horizontalAxis() const { return horizontal_; }
  const PlotAxis& verticalAxis() const { return vertical_; }

  QSize sizeHint() const override { return {380, 200}; }
  QSize minimumSizeHint() const override { return {180, 58}; }

 protected:
  void paintEvent(QPaintEvent* event) override;
  void mouseMoveEvent(QMouseEvent* event) override;
  void leaveEvent(QEvent* event) override;
  bool event(QEvent* event) override;

 private:
  QRectF frame() const;
  QPointF place(const QPointF& value) const;
  std::optional<QPointF> nearest(const QPointF& cursor, const PlotSeries** of) const;
  void paintAxes(QPainter& painter, const QRectF& frame);
  void paintSeries(QPainter& painter, const PlotSeries& series);
  void paintLegend(QPainter& painter, const QRectF& frame);

  PlotAxis horizontal_, vertical_;
  std::vector<PlotSeries> series_;
  std::vector<std::pair<double, QString>> guides_;
  QString emptyText_;
  std::optional<Qt::Corner> legend_ = Qt::TopRightCorner;
  std::optional<QPointF> cursor_;
  std::function<QString(const PlotSeries&, const QPointF&)> readout_;
};

}  // namespace patina
