// Precompiled: the Qt and standard headers that nearly every file here wants.
#pragma once

#include <Eigen/Core>
#include <QAction>
#include <QApplication>
#include <QBoxLayout>
#include <QImage>
#include <QLabel>
#include <QMouseEvent>
#include <QObject>
#include <QPainter>
#include <QPainterPath>
#include <QString>
#include <QToolButton>
#include <QWidget>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>
