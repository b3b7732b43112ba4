// The main window's menus, tool bar, dialogs, and the state that is kept between starts.
#include <QActionGroup>
#include <QDesktopServices>
#include <QDialog>
#include <QDialogButtonBox>
#include <QFileDialog>
#include <QFileInfo>
#include <QHeaderView>
#include <QMenuBar>
#include <QMessageBox>
#include <QScreen>
#include <QSplitter>
#include <QStatusBar>
#include <QTableWidget>
#include <QToolBar>
#include <QUndoGroup>

#include "app/window/explain_controller.h"
#include "app/window/main_window.h"
#include "app/window/two_shot_controller.h"
#include "widgets/comparison_panel.h"
#include "widgets/empty_state.h"
#include "widgets/explain_page.h"
#include "widgets/fit_options_dialog.h"
#include "widgets/image_view.h"
#include "widgets/map_panel.h"
#include "widgets/photo_strip.h"
#include "widgets/sheet_viewport.h"
#include "widgets/texel_inspector.h"
#include "widgets/theme.h"
#include "widgets/two_shot_page.h"
#include "widgets/viewport_panel.h"

namespace patina {

QAction* MainWindow::action(const QString& name) const {
  const auto found = actions_.find(name);
  return found == actions_.end() ? nullptr : found->second;
}

QAction* MainWindow::addAction(QMenu* menu, const QString& name, const QString& text, const QKeySequence& key,
                               const QString& tip, std::function<void()> handler, const QString& iconName) {
  auto* made = new QAction(text, this);
  made->setObjectName(name);
  if (!key.isEmpty()) made->setShortcut(key);
  if (!iconName.isEmpty()) made->setIcon(theme::icon(iconName));
  if (handler) connect(made, &QAction::triggered, this, [handler = std::move(handler)] { handler(); });
  menu->addAction(made);
  actions_[name] = made;
  tips_[name] =
      key.isEmpty() ? tip : tip + QStringLiteral(" (%1)").arg(key.toString(QKeySequence::NativeText));
  allow(name, true);
  return made;
}

void MainWindow::allow(const QString& name, bool possible, const QString& whyNot) {
  QAction* one = actions_.at(name);
  one->setEnabled(possible);
  const QString tip =
      possible || whyNot.isEmpty() ? tips_.at(name) : tips_.at(name) + QStringLiteral("\n") + whyNot;
  one->setToolTip(tip);
  one->setStatusTip(possible || whyNot.isEmpty() ? tips_.at(name) : whyNot);
}

void MainWindow::buildActions() {
  QMenu* file = menuBar()->addMenu(tr("&File"));
  addAction(
      file, "open", tr("&Open Bundle\u2026"), QKeySequence::Open, tr("Open the folder of a capture bundle"),
      [this] { chooseBundle(); }, "open");
  addAction(file, "open-fit", tr("Open &Fit\u2026"), QKeySequence(Qt::CTRL | Qt::SHIFT | Qt::Key_O),
            tr("Open a fit that was saved"), [this] { chooseFit(); });
  recentMenu_ = file->addMenu(tr("Open &Recent"));
  QMenu* simulated = file->addMenu(tr("Simulated &Capture"));
  simulated->setToolTipsVisible(true);
  for (const auto& [scene, summary] : services_.scenes)
    addAction(simulated, QStringLiteral("simulate-") + QString::fromStdString(scene),
              QString::fromStdString(scene), {}, QString::fromStdString(summary),
              [this, scene = scene] { simulate(scene); });
  simulated->addSeparator();
  for (const auto& [scene, summary] : services_.twoShotScenes)
    addAction(simulated, QStringLiteral("simulate-") + QString::fromStdString(scene),
              tr("Two-shot: %1").arg(QString::fromStdString(scene)), {}, QString::fromStdString(summary),
              [this, scene = scene] { simulate(scene); });
  file->addSeparator();
  addAction(
      file, "save", tr("&Save Fit As\u2026"), QKeySequence::Save, tr("Write maps and fit.json into a folder"),
      [this] { chooseSaveFolder(); }, "save");
  file->addSeparator();
  addAction(file, "quit", tr("&Quit"), QKeySequence(Qt::CTRL | Qt::Key_Q), tr("Close the window"),
            [this] { close(); });

  QMenu* edit = menuBar()->addMenu(tr("&Edit"));
  const auto history = [&](const char* name, QAction* one, QKeySequence::StandardKey key,
                           const QString& tip) {
    one->setObjectName(name);
    one->setShortcut(key);
    one->setIcon(theme::icon(name));
    edit->addAction(one);
    actions_[name] = one;
    tips_[name] = tip;
  };
  history("undo", history_->createUndoAction(this, tr("&Undo")), QKeySequence::Undo,
          tr("Take back the last change"));
  history("redo", history_->createRedoAction(this, tr("&Redo")), QKeySequence::Redo,
          tr("Make the change again"));
  const auto nameHistory = [this] {
    const QUndoStack* stack = history_->activeStack();
    if (!stack) return;
    const auto say = [this](const char* name, bool possible, const QString& what, const QString& nothing) {
      QAction* one = actions_.at(name);
      const QString keys = QStringLiteral(" (%1)").arg(one->shortcut().toString(QKeySequence::NativeText));
      one->setToolTip(possible ? tips_.at(name) + QStringLiteral(": ") + what + keys : nothing + keys);
      one->setStatusTip(possible ? tips_.at(name) : nothing);
      one->setIconText({});
    };
    say("undo", stack->canUndo(), stack->undoText(), tr("There is nothing to take back yet"));
    say("redo", stack->canRedo(), stack->redoText(), tr("Nothing was taken back"));
  };
  connect(history_, &QUndoGroup::indexChanged, this, nameHistory);
  connect(history_, &QUndoGroup::activeStackChanged, this, nameHistory);
  nameHistory();

  viewMenu_ = menuBar()->addMenu(tr("&View"));
  auto* kinds = new QActionGroup(this);
  for (const auto& kind : viewKinds()) {
    if (isUncertainty(kind.kind)) continue;
    const int index = static_cast<int>(kind.kind);
    QAction* one = addAction(viewMenu_, QStringLiteral("view-") + kind.id, QString::fromUtf8(kind.title),
                             QKeySequence(QStringLiteral("Ctrl+%1").arg(index + 1)),
                             QString::fromUtf8(kind.meaning), [this, shown = kind.kind] {
                               showExplain(false);
                               maps_->setKind(shown);
                             });
    one->setCheckable(true);
    one->setChecked(maps_->kind() == kind.kind);
    kinds->addAction(one);
  }
  connect(maps_, &MapPanel::kindChanged, this, [this](ViewKind kind) {
    action(QStringLiteral("view-") + info(parameterOf(kind)).id)->setChecked(true);
  });
  QAction* uncertainty =
      addAction(viewMenu_, "view-uncertainty", tr("Standard &Deviations"), QKeySequence(Qt::CTRL | Qt::Key_U),
                tr("How sure each map is, in its place: from the photographs' noise alone"),
                [this] { maps_->showUncertainty(!maps_->uncertaintyShown()); });
  uncertainty->setCheckable(true);
  connect(maps_, &MapPanel::uncertaintyShownChanged, uncertainty, &QAction::setChecked);
  buildTwoShotViews();
  viewMenu_->addSeparator();
  const auto zoomExplained = [this](double factor) {
    ComparisonView* view = explain_->page()->pictures()->comparison();
    factor > 0 ? view->zoomBy(factor, QPointF(view->rect().center())) : view->zoomToFit();
  };
  addAction(viewMenu_, "zoom-in", tr("Zoom &In"), QKeySequence::ZoomIn, tr("Enlarge the picture"), [=, this] {
    if (explainShown()) return zoomExplained(1.25);
    twoShotOpen() ? twoShot_->page()->comparison()->zoomIn()
                  : maps_->view()->zoomBy(1.25, QPointF(maps_->view()->rect().center()));
  });
  addAction(viewMenu_, "zoom-out", tr("Zoom &Out"), QKeySequence::ZoomOut, tr("Show more of the picture"),
            [=, this] {
              if (explainShown()) return zoomExplained(0.8);
              twoShotOpen() ? twoShot_->page()->comparison()->zoomOut()
                            : maps_->view()->zoomBy(0.8, QPointF(maps_->view()->rect().center()));
            });
  addAction(viewMenu_, "zoom-fit", tr("&Whole Picture"), QKeySequence(Qt::CTRL | Qt::Key_0),
            tr("Show the whole picture"), [=, this] {
              if (explainShown()) return zoomExplained(0);
              twoShotOpen() ? twoShot_->page()->comparison()->zoomToFit() : maps_->view()->zoomToFit();
            });
  addAction(viewMenu_, "auto-range", tr("Automatic &Range"), QKeySequence(Qt::CTRL | Qt::Key_R),
            tr("Set the range from the picture's values"), [this] { maps_->automaticRange(); });
  addAction(viewMenu_, "reset-tone", tr("Reset &Exposure and Range"),
            QKeySequence(Qt::CTRL | Qt::SHIFT | Qt::Key_R), tr("Exposure 0, range from the picture's values"),
            [this] { maps_->resetTone(); });
  viewMenu_->addSeparator();
  const auto panel = [this](const char* name, const QString& text, const QKeySequence& key, QWidget* widget) {
    QAction* one = addAction(viewMenu_, name, text, key, tr("Show or hide this part of the window"), {});
    one->setCheckable(true);
    one->setChecked(true);
    connect(one, &QAction::toggled, widget, &QWidget::setVisible);
    connect(one, &QAction::toggled, this, [this] {
      right_->setVisible(action("show-viewport")->isChecked() || !actions_.count("show-inspector") ||
                         action("show-inspector")->isChecked());
    });
  };
  panel("show-viewport", tr("&3D View"), QKeySequence(Qt::Key_F6), viewport_);
  panel("show-inspector", tr("&Texel Inspector"), QKeySequence(Qt::Key_F7), inspector_);
  panel("show-strip", tr("&Photo Strip"), QKeySequence(Qt::Key_F8), strip_);
  connect(action("show-viewport"), &QAction::toggled, twoShot_->page(), &TwoShotPage::setSphereShown);
  connect(action("show-inspector"), &QAction::toggled, twoShot_->page(), &TwoShotPage::setSlicesShown);
  connect(action("show-strip"), &QAction::toggled, twoShot_->page(), &TwoShotPage::setStripShown);
  QAction* words = addAction(viewMenu_, "show-report", tr("Reconstruction in &Words"),
                             QKeySequence(Qt::Key_F9), tr("Show or hide this part of the window"), {});
  words->setCheckable(true);
  words->setChecked(true);
  connect(words, &QAction::toggled, twoShot_->page(), &TwoShotPage::setReportShown);

  QMenu* fit = menuBar()->addMenu(tr("F&it"));
  addAction(
      fit, "fit", tr("&Fit"), QKeySequence(Qt::Key_F5), tr("Fit the maps to the photographs"),
      [this] { startFit(); }, "fit");
  addAction(
      fit, "cancel", tr("&Cancel"), QKeySequence(Qt::Key_Escape),
      tr("Stop the fit; what is finished is kept and marked"), [this] { cancelFit(); }, "cancel");
  fit->addSeparator();
  addAction(
      fit, "explain", tr("&Explain"), QKeySequence(Qt::CTRL | Qt::Key_E),
      tr("What the model lacks: fit, find it, add it, fit again; or show what was found"),
      [this] { explainOrShow(); }, "explain");
  addAction(fit, "explain-back", tr("&Back to the Maps"), QKeySequence(Qt::ALT | Qt::Key_Left),
            tr("From what was explained back to maps and photographs"), [this] { showExplain(false); });
  addAction(fit, "explain-save", tr("Save &Report As\u2026"), QKeySequence(Qt::CTRL | Qt::SHIFT | Qt::Key_E),
            tr("Write report.html, explain.json and the final fit into a folder"),
            [this] { chooseExplanationFolder(); });
  fit->addSeparator();
  addAction(
      fit, "options", tr("&Options\u2026"), QKeySequence(Qt::CTRL | Qt::Key_Comma), tr("Options of the fit"),
      [this] { editOptions(); }, "options");

  QMenu* capture = menuBar()->addMenu(tr("&Capture"));
  addAction(capture, "capture-fourier", tr("With a &Screen\u2026"), QKeySequence(Qt::CTRL | Qt::Key_K),
            tr("Calibrate camera and screen, and photograph a sample under patterns, step by step"),
            [this] { startCapture(false); });
  addAction(capture, "capture-two-shot", tr("&Two Shots\u2026"),
            QKeySequence(Qt::CTRL | Qt::SHIFT | Qt::Key_K),
            tr("Photograph a sample from the two directions of a plan, step by step"),
            [this] { startCapture(true); });

  QMenu* tools = menuBar()->addMenu(tr("&Tools"));
  addAction(tools, "plan", tr("Plan &Directions\u2026"), QKeySequence(Qt::CTRL | Qt::Key_D),
            tr("Where to put camera and light for a two-shot capture, and what error to expect"),
            [this] { twoShot_->showPlan(); });

  QMenu* help = menuBar()->addMenu(tr("&Help"));
  addAction(help, "shortcuts", tr("&Keyboard and Mouse"), QKeySequence(Qt::Key_F1),
            tr("Every key and gesture"), [this] { showShortcuts(); });
  addAction(help, "about", tr("&About Patina"), {}, tr("Version and sources"), [this] { showAbout(); });
  for (QMenu* menu : {file, edit, viewMenu_, fit, capture, tools, help}) menu->setToolTipsVisible(true);

  toolBar_ = addToolBar(tr("Tools"));
  toolBar_->setObjectName(QStringLiteral("toolBar"));
  toolBar_->setMovable(false);
  toolBar_->setContextMenuPolicy(Qt::PreventContextMenu);
  toolBar_->setIconSize(QSize(fontMetrics().height() + 3, fontMetrics().height() + 3));
  for (const char* name : {"open", "fit", "explain", "cancel", "options", "save", "undo", "redo"}) {
    toolBar_->addAction(action(name));
    auto* button = qobject_cast<QToolButton*>(toolBar_->widgetForAction(action(name)));
    button->setFocusPolicy(Qt::StrongFocus);
    const QString shown(name);
    if (shown == "open" || shown == "fit" || shown == "explain" || shown == "save")
      button->setToolButtonStyle(Qt::ToolButtonTextBesideIcon);
    if (shown == "open" || shown == "options" || shown == "save") toolBar_->addSeparator();
  }
  auto* fitButton = qobject_cast<QToolButton*>(toolBar_->widgetForAction(action("fit")));
  fitButton->setObjectName(QStringLiteral("fitButton"));
  action("open")->setIconText(tr("Open"));
  action("save")->setIconText(tr("Save fit"));
  auto* space = new QWidget(toolBar_);
  space->setSizePolicy(QSizePolicy::Expanding, QSizePolicy::Preferred);
  toolBar_->addWidget(space);
  bundleLabel_ = new QLabel(toolBar_);
  bundleLabel_->setTextFormat(Qt::RichText);
  bundleLabel_->setContentsMargins(0, 0, 8, 0);
  toolBar_->addWidget(bundleLabel_);
}

void MainWindow::buildTwoShotViews() {
  auto* views = new QActionGroup(this);
  ComparisonPanel* comparison = twoShot_->page()->comparison();
  const auto view = [&](const char* name, const QString& text, int key, const QString& tip,
                        std::function<void()> handler) {
    QAction* one = addAction(viewMenu_, name, text, QKeySequence(QStringLiteral("Ctrl+%1").arg(key)), tip,
                             std::move(handler));
    one->setCheckable(true);
    views->addAction(one);
  };
  view("view-wipe", tr("&Wipe"), 1, tr("The photograph left of a divider, the reconstruction right of it"),
       [this, comparison] { showExplain(false), comparison->setMode(ComparisonMode::Wipe); });
  view("view-side", tr("&Side by Side"), 2, tr("Photograph and reconstruction, both whole"),
       [this, comparison] { showExplain(false), comparison->setMode(ComparisonMode::SideBySide); });
  view("view-difference", tr("&Difference"), 3, tr("Where the reconstruction is too bright or too dark"),
       [this, comparison] { showExplain(false), comparison->setMode(ComparisonMode::Difference); });
  view("view-materials", tr("&Materials"), 4, tr("Which material each pixel of the first shot is of"),
       [this, comparison] { showExplain(false), comparison->setLabelsShown(true); });
  const auto check = [this, comparison] {
    const char* names[] = {"view-wipe", "view-side", "view-difference"};
    action(comparison->labelsShown() ? "view-materials" : names[static_cast<int>(comparison->mode())])
        ->setChecked(true);
  };
  connect(comparison, &ComparisonPanel::modeChanged, this, check);
  check();
}

void MainWindow::refreshActions() {
  const bool open = somethingOpen(), twoShot = twoShotOpen(), running = fitJob_.running();
  const QString noBundle = tr("Not now: no bundle is open.");
  // One button and one key for either kind; what they are called and say is the kind's.
  const auto rename = [this](const char* name, const QString& text, const QString& tip) {
    QAction* one = action(name);
    one->setText(text);
    tips_[name] = tip + QStringLiteral(" (%1)").arg(one->shortcut().toString(QKeySequence::NativeText));
  };
  rename("fit", twoShot ? tr("&Reconstruct") : tr("&Fit"),
         twoShot ? tr("Find the reflectance in all directions from the photographs")
                 : tr("Fit the maps to the photographs"));
  rename("cancel", tr("&Cancel"),
         twoShot ? tr("Stop the reconstruction") : tr("Stop the fit; what is finished is kept and marked"));
  rename("options", tr("&Options\u2026"),
         twoShot ? tr("Options of the reconstruction") : tr("Options of the fit"));
  rename("save", tr("&Save Fit As\u2026"),
         twoShot ? tr("Write brdf.binary, fit.json and pictures into a folder")
                 : tr("Write maps and fit.json into a folder"));
  rename("show-inspector", twoShot ? tr("S&lices") : tr("&Texel Inspector"),
         tr("Show or hide this part of the window"));
  action("show-report")->setVisible(twoShot);
  allow("fit", open && !running && !openJob_.running(),
        running  ? tr("Not now: a fit is running.")
        : open   ? tr("Not now: a bundle is being opened.")
        : flash_ ? tr("Not now: flash photographs are fitted while they are explained (Ctrl+E).")
                 : noBundle);
  const bool any = open || flash_;
  allow("explain", any && services_.explain && !openJob_.running(),
        any && !services_.explain ? tr("Not in this version.")
        : any                     ? tr("Not now: a bundle is being opened.")
                                  : noBundle);
  allow("explain-back", open && explainShown(), tr("Not now: the maps are on show."));
  allow("explain-save", explain_->explanation() && !saveJob_.running(),
        tr("Not now: nothing has been explained yet."));
  const bool stoppable = simulating_ ? !openJob_.cancelling() : running && !fitJob_.cancelling();
  allow("cancel", stoppable,
        running || simulating_ ? tr("Already stopping.") : tr("Not now: no fit is running."));
  for (const auto* scenes : {&services_.scenes, &services_.twoShotScenes})
    for (const auto& scene : *scenes)
      allow(QStringLiteral("simulate-") + QString::fromStdString(scene.first), !openJob_.running(),
            tr("Not now: a bundle is being opened."));
  allow("options", !running, tr("Not now: a fit is running with the present options."));
  allow("save", fitted() && !saveJob_.running(),
        fitted() ? tr("Not now: the fit is being saved.") : tr("Not now: there is no fit to save."));
  for (const char* name : {"zoom-in", "zoom-out", "zoom-fit"}) allow(name, any, noBundle);
  for (const char* name : {"auto-range", "reset-tone"}) {
    action(name)->setVisible(!twoShot);
    allow(name, open && !twoShot, noBundle);
  }
  action(QStringLiteral("view-uncertainty"))->setVisible(!twoShot);
  allow(QStringLiteral("view-uncertainty"), open && !twoShot, noBundle);
  for (const auto& kind : viewKinds()) {
    if (isUncertainty(kind.kind)) continue;
    action(QStringLiteral("view-") + kind.id)->setVisible(!twoShot);
    allow(QStringLiteral("view-") + kind.id, open && !twoShot, noBundle);
  }
  const auto fit = twoShot_->document()->fit();
  for (const char* name : {"view-wipe", "view-side", "view-difference", "view-materials"}) {
    action(name)->setVisible(twoShot);
    const bool materials = QLatin1String(name) == QLatin1String("view-materials");
    allow(name, fit && (!materials || !fit->labels.empty()),
          fit ? tr("Not now: the reconstruction has one material.")
              : tr("Not now: nothing is reconstructed yet."));
  }
}

void MainWindow::refreshRecent() {
  recentMenu_->clear();
  const QStringList recent = settings_.recent();
  for (const QString& folder : recent) {
    QAction* one = recentMenu_->addAction(QFileInfo(folder).fileName() + QStringLiteral("   ") +
                                          QFileInfo(folder).path());
    one->setToolTip(folder);
    connect(one, &QAction::triggered, this, [this, folder] { openPath(folder); });
  }
  recentMenu_->setEnabled(!recent.isEmpty());
  recentMenu_->menuAction()->setToolTip(recent.isEmpty() ? tr("Nothing was opened yet")
                                                         : tr("What was opened lately"));
  if (!recent.isEmpty()) {
    recentMenu_->addSeparator();
    connect(recentMenu_->addAction(tr("Clear This List")), &QAction::triggered, this, [this] {
      settings_.clearRecent();
      refreshRecent();
    });
  }
  empty_->setRecent(recent);
}

// ---- dialogs
// --------------------------------------------------------------------------------------------------

void MainWindow::chooseBundle() {
  const QString folder = QFileDialog::getExistingDirectory(
      this, tr("Open a Capture Bundle: the Folder with its capture.json"), settings_.text("last_folder"));
  if (!folder.isEmpty()) openPath(folder);
}

void MainWindow::chooseFit() {
  const QString folder = QFileDialog::getExistingDirectory(
      this, tr("Open a Fit: the Folder with its fit.json"), settings_.text("last_save_folder"));
  if (folder.isEmpty()) return;
  openPath(QFileInfo::exists(folder + QStringLiteral("/fit.json")) ? folder + QStringLiteral("/fit.json")
                                                                   : folder);
}

void MainWindow::chooseSaveFolder() {
  if (!fitted()) return;
  QFileDialog dialog(this, tr("Save the Fit: Name of a New Folder"), settings_.text("last_save_folder"));
  dialog.setAcceptMode(QFileDialog::AcceptSave);
  dialog.setFileMode(QFileDialog::AnyFile);
  dialog.setOption(QFileDialog::DontConfirmOverwrite);
  dialog.setLabelText(QFileDialog::FileName, tr("Folder:"));
  dialog.selectFile(QFileInfo(openPath_).fileName() + QStringLiteral("_fit"));
  if (dialog.exec() != QDialog::Accepted || dialog.selectedFiles().isEmpty()) return;
  const QString folder = dialog.selectedFiles().front();
  if (QFileInfo::exists(folder + QStringLiteral("/fit.json")) &&
      QMessageBox::question(this, tr("Replace the fit?"),
                            tr("%1 already holds a fit. Replace it?").arg(folder)) != QMessageBox::Yes)
    return;
  saveFitTo(folder);
}

void MainWindow::editOptions() {
  if (twoShotOpen()) return twoShot_->editOptions();
  FitOptionsDialog dialog(document_.fitOptions(), this);
  if (dialog.exec() != QDialog::Accepted) return;
  document_.endGesture();
  document_.setFitOptions(dialog.options());
}

void MainWindow::showAbout() {
  QMessageBox about(this);
  about.setWindowTitle(tr("About Patina"));
  about.setIconPixmap(theme::icon("app").pixmap(QSize(64, 64), devicePixelRatioF()));
  about.setTextFormat(Qt::RichText);
  about.setText(
      tr("<h3>Patina %1</h3>"
         "<p>Measures how materials reflect light: fits maps of diffuse and specular reflectance, "
         "normals, lobe width and "
         "kurtosis to photographs that a screen's Fourier patterns lit, and reconstructs the reflectance of "
         "a "
         "flat sample in all directions from a few photographs under a distant light.</p>"
         "<p>Methods: Aittala, Weyrich, Lehtinen, <i>Practical SVBRDF Capture in the Frequency "
         "Domain</i>, ACM Transactions on "
         "Graphics, 2013. Xu and others, <i>Minimal BRDF Sampling for Two-Shot Near-Field Reflectance "
         "Acquisition</i>, ACM Transactions on Graphics, 2016.</p>"
         "<p>Licence: Apache-2.0. Built with Qt %2, VTK, Eigen, OpenEXR, libpng, oneTBB, Highway and "
         "JSON for Modern C++.</p>")
          .arg(QStringLiteral(PATINA_VERSION), QString::fromLatin1(qVersion())));
  about.exec();
}

void MainWindow::showShortcuts() {
  QDialog dialog(this);
  dialog.setWindowTitle(tr("Keyboard and Mouse"));
  auto* table = new QTableWidget(0, 2, &dialog);
  const auto line = [table](const QString& keys, const QString& what, bool heading = false) {
    const int row = table->rowCount();
    table->insertRow(row);
    table->setItem(row, 0, new QTableWidgetItem(keys));
    table->setItem(row, 1, new QTableWidgetItem(what));
    if (!heading) return;
    QFont bold = table->font();
    bold.setBold(true);
    table->item(row, 0)->setFont(bold);
    table->setSpan(row, 0, 1, 2);
  };
  for (QAction* menu : menuBar()->actions()) {
    line(QString(menu->text()).remove('&'), {}, true);
    for (QAction* one : menu->menu()->actions())
      if (!one->shortcut().isEmpty() && one->isVisible())
        line(one->shortcut().toString(QKeySequence::NativeText),
             QString(one->text()).remove('&').remove(QChar(0x2026)));
  }
  line(tr("Picture"), {}, true);
  line(tr("Wheel, + \u2212 0"), tr("Zoom at the cursor; whole picture"));
  line(tr("Drag"), tr("Move the picture"));
  line(tr("Click, arrow keys"), tr("Pick a texel; pick its neighbour"));
  line(tr("3D view"), {}, true);
  line(tr("Drag on the sheet"), tr("The highlight follows the cursor"));
  line(tr("Drag the lamp, arrow keys"), tr("Move the lamp"));
  line(tr("Shift + drag, Ctrl + wheel, Page Up/Down"), tr("Height of the lamp"));
  line(tr("Right drag, Shift + arrow keys"), tr("Orbit"));
  line(tr("Middle drag"), tr("Move the view"));
  line(tr("Wheel, + \u2212"), tr("Distance"));
  line(tr("C, T"), tr("From the camera's place; from above"));
  line(tr("Sphere"), {}, true);
  line(tr("Drag, arrow keys"), tr("Move its light"));
  line(tr("Photo strip"), {}, true);
  line(tr("Left, Right, Home, End"), tr("Step through the photographs"));
  line(tr("Two-shot: photograph against reconstruction"), {}, true);
  line(tr("Drag the divider, Left, Right, Home, End"), tr("Wipe; Shift: in larger steps"));
  line(tr("Double click"), tr("Divider to the middle"));
  line(tr("Wheel, drag, + \u2212 0"), tr("Zoom at the cursor; move; whole picture"));
  line(tr("Up, Down in the list of shots"), tr("Step through the shots"));
  line(tr("Explain: before against after"), {}, true);
  line(tr("Up, Down in the list of photographs"), tr("Step through them, worst first"));
  line(tr("Drag the divider, Left, Right, Home, End"), tr("Wipe; Shift: in larger steps"));
  line(tr("Drawing of a plan"), {}, true);
  line(tr("Drag, arrow keys"), tr("Turn"));
  line(tr("Wheel, + \u2212"), tr("Distance"));
  line(tr("T, S, 0"), tr("From above; from the side; as it was"));
  table->horizontalHeader()->hide();
  table->verticalHeader()->hide();
  table->setShowGrid(false);
  table->setEditTriggers(QAbstractItemView::NoEditTriggers);
  table->setSelectionMode(QAbstractItemView::NoSelection);
  table->setFocusPolicy(Qt::StrongFocus);
  table->horizontalHeader()->setSectionResizeMode(0, QHeaderView::ResizeToContents);
  table->horizontalHeader()->setSectionResizeMode(1, QHeaderView::Stretch);
  table->setHorizontalScrollBarPolicy(Qt::ScrollBarAlwaysOff);
  table->setCurrentItem(nullptr);
  table->verticalHeader()->setDefaultSectionSize(fontMetrics().height() + 6);
  auto* buttons = new QDialogButtonBox(QDialogButtonBox::Close, &dialog);
  connect(buttons, &QDialogButtonBox::rejected, &dialog, &QDialog::reject);
  auto* column = new QVBoxLayout(&dialog);
  column->addWidget(table);
  column->addWidget(buttons);
  dialog.resize(fontMetrics().averageCharWidth() * 80, 560);
  dialog.exec();
}

// ---- state kept between starts
// --------------------------------------------------------------------------------

void MainWindow::restoreState() {
  if (!restoreGeometry(settings_.bytes("window/geometry"))) {
    const QSize room = screen() ? screen()->availableSize() : QSize(1440, 900);
    resize(QSize(1560, 980).boundedTo(room));
  }
  columns_->restoreState(settings_.bytes("window/columns"));
  right_->restoreState(settings_.bytes("window/right"));
  for (const char* name : {"show-viewport", "show-inspector", "show-strip", "show-report"})
    action(name)->setChecked(settings_.flag(QStringLiteral("window/") + name, true));
  document_.restoreFitOptions(settings_.fitOptions());
  LampState lamp = document_.lamp();  // its place comes with the bundle
  lamp.exposureEv = std::clamp(settings_.text("viewport/exposure_ev").toDouble(), -8.0, 8.0);
  document_.restoreLamp(lamp);
  viewport_->setStudio(settings_.flag("viewport/studio", false));
  inspector_->setChannel(settings_.number("inspector/channel", 1));
  inspector_->setDirection(settings_.number("inspector/direction", 0));
  inspector_->setPage(settings_.number("inspector/page", 0));
  inspector_->setFollowsCursor(settings_.flag("inspector/follow", true));
  inspector_->setPhaseAboutLobe(settings_.flag("inspector/phase_about_lobe", true));
  document_.undoStack()->clear();
  twoShot_->restoreState();
  explain_->restoreState();
}

void MainWindow::keepState() {
  settings_.set("window/geometry", saveGeometry());
  settings_.set("window/columns", columns_->saveState());
  settings_.set("window/right", right_->saveState());
  for (const char* name : {"show-viewport", "show-inspector", "show-strip", "show-report"})
    settings_.set(QStringLiteral("window/") + name, action(name)->isChecked());
  settings_.setFitOptions(document_.fitOptions());
  settings_.set("viewport/exposure_ev", document_.lamp().exposureEv);
  settings_.set("viewport/studio", viewport_->studio());
  settings_.set("inspector/channel", inspector_->channel());
  settings_.set("inspector/direction", inspector_->direction());
  settings_.set("inspector/page", inspector_->page());
  settings_.set("inspector/follow", inspector_->followsCursor());
  settings_.set("inspector/phase_about_lobe", inspector_->phaseAboutLobe());
  twoShot_->keepState();
  explain_->keepState();
  settings_.sync();
}

}  // namespace patina
