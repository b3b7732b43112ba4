#pragma once

#include <QColor>
#include <QFont>
#include <QIcon>
#include <QString>

class QApplication;

namespace patina {

/// The window's colours. Every grey is neutral (R = G = B), so that the surround does not tint the judgement
/// of a material's colour; hue is kept for what asks for attention.
namespace theme {

inline constexpr QColor kWindow{38, 38, 38};
inline constexpr QColor kPanel{46, 46, 46};
inline constexpr QColor kSunken{28, 28, 28};
inline constexpr QColor kCanvas{56, 56, 56};  ///< behind pictures: about 4 % luminance
inline constexpr QColor kControl{62, 62, 62};
inline constexpr QColor kBorder{78, 78, 78};
inline constexpr QColor kText{224, 224, 224};
inline constexpr QColor kTextDim{166, 166, 166};
inline constexpr QColor kTextOff{120, 120, 120};
inline constexpr QColor kAccent{86, 156, 214};
inline constexpr QColor kAccentDeep{38, 96, 148};
inline constexpr QColor kWarning{226, 168, 72};
inline constexpr QColor kError{226, 96, 84};
inline constexpr QColor kGood{108, 190, 122};

/// Fusion style, neutral dark palette and the style sheet, for the whole application.
void apply(QApplication& application);

/// Icons drawn from paths at the size asked for, so that they are sharp on any display. Names: "open",
/// "save", "fit", "explain", "cancel", "undo", "redo", "zoom-fit", "zoom-actual", "auto-range", "reset",
/// "light", "close", "options", "app".
QIcon icon(const QString& name);

/// A font with figures of equal width, for numbers that change under the cursor.
QFont numberFont();

/// Smaller than the application's font, for captions.
QFont captionFont();

}  // namespace theme
}  // namespace patina
