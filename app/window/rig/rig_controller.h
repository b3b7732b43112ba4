#pragma once

#include <QObject>
#include <QStringList>
#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>

#include "app/window/job_runner.h"
#include "app/window/rig/rig_services.h"
#include "widgets/live_view.h"

namespace patina {

/// The id of the simulated rig's own screen, which has no window.
inline constexpr const char* kSimulatedScreen = "simulated";

class LiveFeed;
class Settings;

/// The rig as the guided pages share it: the camera that is open, the screen that was chosen, where
/// calibrations are kept, and the one job that uses them. Whatever fails is said by `failed`, and nothing
/// that is on disk or open is lost. Lives in the window's thread.
class RigController : public QObject {
  Q_OBJECT

 public:
  /// `settings` must outlive this.
  RigController(RigServices services, Settings& settings, QObject* parent = nullptr);
  ~RigController() override;

  const RigServices& services() const { return services_; }
  Settings& settings() { return settings_; }

  // ---- the camera ----
  /// Opens it in place of the one that is open; on a thread of its own, `cameraChanged` says when.
  void openCamera(const std::string& id);
  void closeCamera();
  /// Null while none is open or one is being opened. Use it in a job (`run`), or while none runs.
  CameraDevice* camera() const { return camera_.get(); }
  bool openingCamera() const { return openJob_.running(); }
  /// Why it can't be used now ("it was unplugged"), though open; empty: it can.
  QString cameraProblem() const { return cameraProblem_; }
  /// The simulated rig that it is of; null for a real one.
  std::shared_ptr<LiveRig> simulation() const { return simulation_; }
  std::string cameraId() const { return cameraId_; }  ///< as it was asked for; empty: none
  /// Chooses a format; the live picture is interrupted. Errors: those of the camera; Refused while a job
  /// runs.
  Status setFormat(const FrameFormat& format);
  /// Sets a control and says what is in force then. Errors likewise.
  Result<double> setControl(CameraControlId id, double value);
  /// Switches off what the camera would set by itself; sentences about what can't be.
  QStringList holdAutomatics();
  /// A live picture by `frameArrived`, whenever no job has the camera to itself; jobs show what they see too.
  void setLive(bool live);
  LiveFramePtr lastFrame() const { return lastFrame_; }

  // ---- the screen ----
  void chooseScreen(const ScreenInfo& screen);
  std::optional<ScreenInfo> screen() const { return screen_; }
  /// From picture to light, measured on the chosen screen; empty: guessed.
  void setLatency(std::optional<std::chrono::microseconds> latency);
  std::optional<std::chrono::microseconds> latency() const { return latency_; }
  /// The pattern window on the chosen screen, opened at the first call. Errors: Refused (none chosen, or it
  /// is gone). Keep the copy for as long as a job shows pictures.
  Result<std::shared_ptr<PatternDisplay>> display();
  /// Shows a picture of the screen's size on it without waiting for it, e.g. a board to aim at.
  void showPicture(const ShownPicture& picture);
  /// Takes the pattern window down, unless a job still has it.
  void closeDisplay();

  // ---- calibrations ----
  /// The folder that they are kept in: "camera.json", "screen-pose.json", "emission.json", ...
  std::filesystem::path folder() const { return folder_; }
  void setFolder(const std::filesystem::path& folder);
  /// A kind's file in it, whether there is one or not. `kind`: as `kindOf` says; "rig": the description that
  /// captures are taken with.
  std::filesystem::path file(const std::string& kind) const;
  /// Says that one was written: `calibrationChanged`.
  void noteCalibration(const std::string& kind);

  // ---- what it is all for ----
  /// The bundle that was taken whole; its panel's last button opens it in the window.
  void setFinishedBundle(const std::filesystem::path& folder) { finished_ = folder; }
  std::filesystem::path finishedBundle() const { return finished_; }

  // ---- jobs ----
  /// Runs `work` with the camera to itself; `done` comes in the window's thread. What fails (other than by
  /// being cancelled) is also said by `failed` as "`doing`: ...". One at a time: false, and nothing is
  /// started, while another runs.
  template <typename Value>
  bool run(const QString& doing, std::function<Result<Value>(const JobContext&)> work,
           std::function<void(Result<Value>)> done) {
    if (job_.running()) return false;
    beginJob();
    job_.start<Value>(std::move(work), [this, doing, done = std::move(done)](Result<Value> outcome) {
      endJob(doing, outcome.ok() ? nullptr : &outcome.error());
      done(std::move(outcome));
    });
    return true;
  }
  JobRunner& job() { return job_; }
  /// Ends what runs and waits for it, and lets the camera go: before the pages that it reports to are gone.
  void shutDown();
  bool busy() const { return job_.running(); }

 Q_SIGNALS:
  void cameraChanged();
  void frameArrived(patina::LiveFramePtr frame);
  void screenChanged();
  void calibrationChanged(QString kind);
  void failed(QString doing, patina::Error error);
  void noticed(QString sentence);
  /// The person wants to see the bundle that was taken.
  void bundleReady(std::filesystem::path folder);

 private:
  void beginJob();
  void endJob(const QString& doing, const Error* error);
  void startStream();
  void stopStream();
  void cameraEnded(const Error& error);

  RigServices services_;
  Settings& settings_;
  std::filesystem::path folder_, finished_;
  std::shared_ptr<LiveRig> simulation_;
  std::unique_ptr<LiveFeed> feed_;  ///< outlives the camera, whose thread fills it
  std::unique_ptr<CameraDevice> camera_;
  std::string cameraId_;
  QString cameraProblem_;
  std::optional<std::chrono::microseconds> latency_;
  std::optional<ScreenInfo> screen_;
  std::shared_ptr<PatternDisplay> display_;
  bool live_ = false;
  LiveFramePtr lastFrame_;
  JobRunner openJob_, showJob_, job_;  ///< last: destroyed first
};

}  // namespace patina
