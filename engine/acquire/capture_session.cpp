#include "engine/acquire/capture_session.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>

#include "engine/acquire/capture_journal.h"
#include "engine/acquire/exposure.h"
#include "engine/base/text.h"
#include "engine/capture/capture.h"
#include "engine/image/exr.h"

namespace patina {
namespace fs = std::filesystem;
namespace {

constexpr const char* kMadeBy = "patina capture";
constexpr double kClipsAt = 0.98;    ///< of full scale: what noise takes off it
constexpr double kBracketRatio = 4;  ///< two stops
constexpr int kMostLearnt = 24;      ///< photographs read again to judge those that come after a restart

std::string hexOf(std::uint64_t value) {
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(value));
  return text;
}

std::string photoFile(int index, int again) {
  char name[48];
  if (again == 0)
    std::snprintf(name, sizeof name, "photos/photo_%03d.exr", index);
  else
    std::snprintf(name, sizeof name, "photos/photo_%03d_r%d.exr", index, again);
  return name;
}

Error cancelledError() {
  return Error{ErrorCode::Cancelled, "the capture was cancelled; what is finished is kept", "", ""};
}

}  // namespace

std::vector<std::string> CaptureOptions::validate() const {
  std::vector<std::string> problems;
  const auto need = [&](bool good, const char* sentence) {
    if (!good) problems.emplace_back(sentence);
  };
  need(!plan.fitted.empty(), "a capture needs at least one frequency to fit");
  need(exposureS >= 0 && gain > 0, "exposure and gain can't be negative");
  need(check || exposureS > 0, "without the checklist an exposure must be given");
  need(framesAveraged >= 1 && framesAveraged <= 1000, "1 to 1000 frames are averaged");
  need(bracket >= 1 && bracket <= 8, "a bracket has 1 to 8 exposures");
  need(attempts >= 1 && attempts <= 100, "a photograph is attempted 1 to 100 times");
  return problems;
}

struct CaptureSession::State {
  fs::path folder;
  RigDescription rig;
  CaptureOptions options;
  CapturePlan plan;
  std::optional<CaptureJournal> journal;
  std::vector<std::string> remarks;
  bool begun = false;

  mutable std::mutex mutex;
  std::condition_variable_any changed;
  std::vector<PhotoState> photos;
  std::vector<int> again;         ///< how often each was asked for anew
  std::vector<bool> wantedAgain;  ///< asked for, and not yet taken
  double exposureS = 0, gain = 1;
  bool paused = false;

  std::optional<PhotoWatch> watch;
  std::optional<PatternSpec> onGlass;

  bool counts(std::size_t i) const { return photos[i].stage != PhotoState::Stage::Waiting; }
  int taken() const {
    int count = 0;
    for (std::size_t i = 0; i < photos.size(); ++i) count += counts(i) ? 1 : 0;
    return count;
  }
  Status readJournal();
  std::string rigHash() const;
  Status writeDescription(bool complete);
  void learnFromDisk(const Screen& screen, const JobContext& job);
  /// True: the photograph counts. False: the four phases that end with it are to be taken again.
  Result<bool> takeOne(std::size_t index, CameraDevice& camera, PatternDisplay& display, const Screen& screen,
                       const JobContext& job, CaptureObserver* observer);
  Status wantAgain(std::size_t index);
  std::map<std::size_t, int> setAttempts;  ///< by their last photograph
  struct Taken {
    Image perSecond, clipped;
    double exposureS = 0;
  };
  Result<Taken> photograph(CameraDevice& camera, RigTime since, const JobContext& job) const;
};

// ---- opening ----

std::string CaptureSession::State::rigHash() const {
  // By what is written of it: the photographs make sense together under one description only.
  nlohmann::json json = {
      {"sample", {rig.sampleWidthMm, rig.sampleHeightMm}},
      {"camera", {rig.camera.width, rig.camera.height}},
      {"screen",
       {rig.screen.widthMm, rig.screen.heightMm, rig.screen.windowSigma.x(), rig.screen.windowSigma.y()}},
      {"frames", options.framesAveraged},
      {"bracket", options.bracket}};
  const auto matrix = [&](const char* key, const auto& values) {
    for (Eigen::Index i = 0; i < values.size(); ++i) json[key].push_back(values.data()[i]);
  };
  matrix("K", rig.camera.intrinsics);
  matrix("distortion", rig.camera.distortion);
  matrix("R", rig.camera.cameraFromWorld);
  matrix("t", rig.camera.translationMm);
  matrix("screenR", rig.screen.worldFromScreen);
  matrix("screenT", rig.screen.originMm);
  const std::string text = json.dump();
  std::uint64_t hash = 0xCBF29CE484222325ull;  // FNV-1a
  for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001B3ull;
  return hexOf(hash);
}

Status CaptureSession::State::readJournal() {
  const std::string where = (folder / kCaptureJournal).string();
  std::vector<std::string> hashes(photos.size());
  for (const nlohmann::json& line : journal->lines()) {
    const std::string event = line.value("event", "");
    if (event == "begin") {
      if (line.value("plan", "") != hexOf(plan.hash()) || line.value("rig", "") != rigHash())
        return Error{ErrorCode::Refused, "this capture was begun with another plan, rig or settings", where,
                     "go on with those that it was begun with, or choose another folder"};
      exposureS = line.value("exposure_s", 0.0);
      gain = line.value("gain", 1.0);
      begun = true;
      continue;
    }
    const int index = line.value("index", -1);
    if (index < 0 || index >= static_cast<int>(photos.size())) continue;
    const auto at = static_cast<std::size_t>(index);
    if (event == "retake") {
      again[at] = line.value("again", again[at] + 1);
      wantedAgain[at] = true;
    } else if (event == "photo") {
      PhotoState& photo = photos[at];
      photo.file = line.value("file", "");
      photo.exposureS = line.value("exposure_s", 0.0);
      photo.attempts = line.value("attempts", 1);
      photo.quality.sentence = line.value("fault", "");
      photo.stage = photo.quality.sentence.empty() ? PhotoState::Stage::Taken : PhotoState::Stage::Flawed;
      hashes[at] = line.value("hash", "");
      again[at] = line.value("again", 0);
      wantedAgain[at] = false;
    }
  }
  int lost = 0;
  for (std::size_t i = 0; i < photos.size(); ++i) {
    if (!counts(i)) continue;
    const Result<std::string> hash = fileHash(folder / photos[i].file);
    if (hash && *hash == hashes[i]) continue;
    photos[i] = {};
    ++lost;
  }
  if (lost > 0)
    remarks.push_back(counted(static_cast<std::size_t>(lost), "photograph") +
                      " on disk differed from what the journal says, or was missing: taken again.");
  return Done{};
}

Result<std::unique_ptr<CaptureSession>> CaptureSession::open(const fs::path& folder,
                                                             const RigDescription& rig,
                                                             const CaptureOptions& options, bool resume) {
  std::vector<std::string> problems = rig.problems();
  for (std::string& problem : options.validate()) problems.push_back(std::move(problem));
  if (!problems.empty()) {
    std::string all;
    for (const std::string& problem : problems) all += (all.empty() ? "" : "; ") + problem;
    return Error{ErrorCode::Invalid, "this capture can't be taken: " + all, folder.string(),
                 "correct these values"};
  }
  Result<CaptureJournal> journal = beginCapture(folder, resume);
  if (!journal) return journal.error();
  auto state = std::make_unique<State>();
  state->folder = folder;
  state->rig = rig;
  state->options = options;
  state->plan = makeCapturePlan(options.plan);
  state->photos.resize(state->plan.photos.size());
  state->again.resize(state->photos.size(), 0);
  state->wantedAgain.resize(state->photos.size(), false);
  state->journal.emplace(std::move(*journal));
  if (Status read = state->readJournal(); !read) return read.error();
  return std::unique_ptr<CaptureSession>(new CaptureSession(std::move(state)));
}

CaptureSession::CaptureSession(std::unique_ptr<State> state) : state_(std::move(state)) {}
CaptureSession::~CaptureSession() = default;

const CapturePlan& CaptureSession::plan() const {
  return state_->plan;
}
const fs::path& CaptureSession::folder() const {
  return state_->folder;
}
const std::vector<std::string>& CaptureSession::remarks() const {
  return state_->remarks;
}
std::vector<PhotoState> CaptureSession::photos() const {
  const std::lock_guard lock(state_->mutex);
  return state_->photos;
}
int CaptureSession::taken() const {
  const std::lock_guard lock(state_->mutex);
  return state_->taken();
}
void CaptureSession::pause(bool paused) {
  {
    const std::lock_guard lock(state_->mutex);
    state_->paused = paused;
  }
  state_->changed.notify_all();
}
bool CaptureSession::isPaused() const {
  const std::lock_guard lock(state_->mutex);
  return state_->paused;
}

Status CaptureSession::State::wantAgain(std::size_t index) {
  const std::lock_guard lock(mutex);
  if (!counts(index)) return Done{};
  if (Status written = journal->append({{"event", "retake"}, {"index", index}, {"again", again[index] + 1}});
      !written)
    return written;
  ++again[index];
  wantedAgain[index] = true;
  return Done{};
}

Status CaptureSession::retake(int photo) {
  if (photo < 0 || photo >= static_cast<int>(state_->photos.size()))
    return Error{ErrorCode::Invalid, "there is no photograph " + std::to_string(photo) + " in this capture",
                 state_->folder.string(), "name one of 0 to " + std::to_string(state_->photos.size() - 1)};
  return state_->wantAgain(static_cast<std::size_t>(photo));
}

// ---- taking ----

Result<CaptureSession::State::Taken> CaptureSession::State::photograph(CameraDevice& camera, RigTime since,
                                                                       const JobContext& job) const {
  Taken taken;
  std::vector<BracketPhoto> bracket;
  const std::vector<double> exposures =
      exposureS > 0 ? bracketExposures(exposureS, kBracketRatio, options.bracket, 0) : std::vector<double>{0};
  for (const double exposure : exposures) {
    StillRequest request;
    if (exposure > 0) {
      request.exposureS = exposure;
      request.gain = gain;
    }
    request.notBefore = since;
    request.frames = options.framesAveraged;
    const Result<std::vector<Frame>> frames = camera.still(request, job.stop);
    if (!frames) return frames.error();
    Result<Image> image = meanImage(*frames, rig.conversion);
    if (!image) return image.error();
    if (image->width() != rig.camera.width || image->height() != rig.camera.height)
      return Error{ErrorCode::Invalid,
                   "the camera's pictures are not of the size that it was calibrated with",
                   camera.info().name, "choose that format, or calibrate again"};
    const double inForce = frames->front().metadata.exposureS.value_or(exposure > 0 ? exposure : 1.0);
    if (taken.exposureS == 0) taken.exposureS = inForce;
    if (exposures.size() == 1) {
      Result<Image> clipped = clippedMask(frames->front());
      if (!clipped) return clipped.error();
      taken.clipped = std::move(*clipped);
    }
    bracket.push_back({std::move(*image), inForce * gain});
  }
  if (bracket.size() == 1) {
    const auto perSecond = static_cast<float>(1 / bracket.front().exposureS);
    taken.perSecond = std::move(bracket.front().photo);
    for (float& sample : taken.perSecond.samples()) sample *= perSecond;
    return taken;
  }
  Result<Image> merged = mergeBracket(bracket, kClipsAt, &taken.clipped);
  if (!merged) return merged.error();
  taken.perSecond = std::move(*merged);
  return taken;
}

Result<bool> CaptureSession::State::takeOne(std::size_t index, CameraDevice& camera, PatternDisplay& display,
                                            const Screen& screen, const JobContext& job,
                                            CaptureObserver* observer) {
  const PlannedPhoto& planned = plan.photos[index];
  const ShownPicture picture = shownPattern(planned.pattern, screen, rig.screenResponse);
  PhotoState next;
  Taken best;
  for (int attempt = 1; attempt <= options.attempts; ++attempt) {
    if (job.cancelled()) return cancelledError();
    if (observer) observer->showing(picture, static_cast<int>(index));
    const Result<OnGlass> shown = display.show(picture, job.stop);
    if (!shown) return shown.error();
    Result<Taken> taken = photograph(camera, shown->since, job);
    if (!taken) return taken.error();
    PhotoQuality quality = watch->judge(taken->perSecond, taken->clipped, planned.pattern, onGlass);
    next.exposureS = taken->exposureS;
    next.attempts = attempt;
    next.quality = quality;
    best = std::move(*taken);
    if (quality.good()) break;
    if (quality.wholeSet && index >= 3 && ++setAttempts[index] < options.attempts) {
      next.stage = PhotoState::Stage::Flawed;
      if (observer) observer->photographed(static_cast<int>(index), best.perSecond, next, false);
      return false;
    }
    if (quality.wholeSet) break;  // all four were tried often enough
    next.stage = PhotoState::Stage::Flawed;
    if (observer && attempt < options.attempts)
      observer->photographed(static_cast<int>(index), best.perSecond, next, false);
  }
  onGlass = planned.pattern;
  next.stage = next.quality.good() ? PhotoState::Stage::Taken : PhotoState::Stage::Flawed;
  int repeat = 0;
  std::string old;
  {
    const std::lock_guard lock(mutex);
    repeat = again[index];
    old = photos[index].file;
  }
  next.file = photoFile(static_cast<int>(index), repeat);
  if (Status written = writeExr(
          folder / next.file, best.perSecond, {"R", "G", "B"},
          {{"units", "full scale of the camera per second"}, {"pattern", patternName(planned.pattern)}},
          true);
      !written)
    return written.error();
  const Result<std::string> hash = fileHash(folder / next.file);
  if (!hash) return hash.error();
  nlohmann::json line = {{"event", "photo"},          {"index", index},
                         {"file", next.file},         {"hash", *hash},
                         {"again", repeat},           {"exposure_s", next.exposureS},
                         {"attempts", next.attempts}, {"pattern", patternName(planned.pattern)}};
  if (!next.quality.good()) line["fault"] = next.quality.sentence;
  if (Status written = journal->append(line); !written) return written.error();
  {
    const std::lock_guard lock(mutex);
    photos[index] = next;
    wantedAgain[index] = false;
  }
  std::error_code ignored;
  if (!old.empty() && old != next.file) fs::remove(folder / old, ignored);
  if (next.quality.good()) watch->learn(best.perSecond, planned.pattern);
  if (observer) observer->photographed(static_cast<int>(index), best.perSecond, next, true);
  return true;
}

void CaptureSession::State::learnFromDisk(const Screen& screen, const JobContext& job) {
  RigDescription used = rig;
  used.screen = screen;
  watch.emplace(used, options.limits);
  std::vector<std::size_t> good;
  for (std::size_t i = 0; i < photos.size(); ++i)
    if (photos[i].stage == PhotoState::Stage::Taken) good.push_back(i);
  const std::size_t step = std::max<std::size_t>(1, good.size() / kMostLearnt);
  for (std::size_t k = 0; k < good.size() && !job.cancelled(); ++k) {
    const PatternSpec& pattern = plan.photos[good[k]].pattern;
    // The last ones all: a set of four phases may be half done.
    if (pattern.kind == PatternSpec::Kind::Sine && k % step != 0 && k + 4 < good.size()) continue;
    const Result<Image> image = readExr(folder / photos[good[k]].file, {"R", "G", "B"});
    if (image) watch->learn(*image, pattern);
  }
}

Status CaptureSession::State::writeDescription(bool complete) {
  FourierCapture capture;
  capture.folder = folder;
  capture.sampleWidthMm = rig.sampleWidthMm;
  capture.sampleHeightMm = rig.sampleHeightMm;
  capture.sampleName = rig.sampleName;
  capture.madeBy = kMadeBy;
  capture.camera = rig.camera;
  capture.screen = rig.screen;
  if (rig.radianceOfFullScaleSecond > 0) capture.radianceScale = rig.radianceOfFullScaleSecond;
  if (options.bracket == 1 && photos.front().exposureS > 0)
    capture.saturation = kClipsAt / (photos.front().exposureS * gain);
  bool window = false, black = false;
  for (std::size_t i = 0; i < photos.size(); ++i) {
    if (!counts(i)) continue;
    const PlannedPhoto& planned = plan.photos[i];
    if (planned.role() == PhotoRole::Pattern && !complete) {
      // A frequency is of use with all its phases only.
      const std::size_t first = i - static_cast<std::size_t>(planned.pattern.phase);
      bool whole = true;
      for (std::size_t k = first; k < first + 4; ++k) whole &= k < photos.size() && counts(k);
      if (!whole) continue;
    }
    FourierPhoto photo;
    photo.file = photos[i].file;
    photo.role = planned.role();
    photo.exposureS = photos[i].exposureS;
    photo.frequency = planned.pattern.frequency;
    photo.phase = planned.pattern.phase;
    photo.holdout = planned.holdout;
    window |= photo.role == PhotoRole::Window && !photo.holdout;
    black |= photo.role == PhotoRole::Black && !photo.holdout;
    capture.photos.push_back(photo);
  }
  if (!window || !black) return Done{};  // nothing that a reader could use
  return writeFourierCapture(capture);
}

Result<CaptureSession::Outcome> CaptureSession::run(CameraDevice& camera, PatternDisplay& display,
                                                    const JobContext& job, CaptureObserver* observer) {
  State& s = *state_;
  Outcome outcome;
  outcome.remarks = s.remarks;
  outcome.total = static_cast<int>(s.photos.size());
  const ScreenInfo info = display.screen();
  Screen screen = s.rig.screen;
  screen.widthPx = info.widthPx;
  screen.heightPx = info.heightPx;
  std::vector<Eigen::Vector2i> frequencies = s.options.plan.fitted;
  frequencies.insert(frequencies.end(), s.options.plan.heldOut.begin(), s.options.plan.heldOut.end());
  if (const auto fine = tooFine(frequencies, screen); !fine.empty())
    outcome.remarks.push_back("The finest pattern, frequency " + std::to_string(fine.back().x()) + ", " +
                              std::to_string(fine.back().y()) +
                              ", has fewer than four of this screen's pixels a wave.");
  if (!(s.rig.radianceOfFullScaleSecond > 0))
    outcome.remarks.push_back(
        "The radiance of the camera's pixels is not known (white paper): albedos of this capture are "
        "relative.");

  const auto finish = [&](bool complete) -> Result<Outcome> {
    if (Status written = s.writeDescription(complete); !written) return written.error();
    outcome.complete = complete;
    outcome.taken = s.taken();
    for (const PhotoState& photo : s.photos)
      outcome.flawed += photo.stage == PhotoState::Stage::Flawed ? 1 : 0;
    return outcome;
  };
  const auto cancelled = [&]() -> Result<Outcome> {
    outcome.cancelled = true;
    return finish(false);
  };
  if (!s.begun) {
    s.exposureS = s.options.exposureS;
    s.gain = s.options.gain;
    if (s.options.check) {
      const Result<Checklist> list = checkRig(camera, display, s.rig, s.options.checks, job);
      if (!list && list.error().code == ErrorCode::Cancelled) return cancelled();
      if (!list) return list.error();
      if (observer) observer->checked(*list);
      for (const CheckItem& item : list->items)
        if (item.state == CheckItem::State::Bad || item.state == CheckItem::State::Warning)
          outcome.remarks.push_back(item.title + ": " + item.sentence + " Try: " + item.tryThis + ".");
      if (!list->good()) {
        std::string all;
        for (const CheckItem& item : list->items)
          if (item.state == CheckItem::State::Bad)
            all += (all.empty() ? "" : " ") + item.sentence + " Try: " + item.tryThis + ".";
        return Error{ErrorCode::Refused, "the rig isn't ready: " + all, camera.info().name,
                     "mend that, or go on without the checklist"};
      }
      if (!(s.exposureS > 0)) {
        s.exposureS = list->exposureS;
        s.gain = list->gain;
      }
    }
    nlohmann::json begin = {
        {"event", "begin"},          {"version", 1},   {"plan", hexOf(s.plan.hash())}, {"rig", s.rigHash()},
        {"exposure_s", s.exposureS}, {"gain", s.gain}, {"camera", camera.info().name}, {"screen", info.name}};
    if (Status written = s.journal->append(begin); !written) return written.error();
    s.begun = true;
  }
  s.learnFromDisk(screen, job);
  s.onGlass.reset();
  const auto total = static_cast<std::int64_t>(s.photos.size());
  for (std::size_t i = 0; i < s.photos.size(); ++i) {
    {
      std::unique_lock lock(s.mutex);
      if (s.paused) {
        if (observer) observer->paused(true);
        s.changed.wait(lock, job.stop, [&] { return !s.paused; });
        if (observer) observer->paused(false);
      }
      if (s.counts(i) && !s.wantedAgain[i]) continue;
    }
    if (job.cancelled()) return cancelled();
    job.progress("photograph", s.taken(), total, "photos");
    const Result<bool> taken = s.takeOne(i, camera, display, screen, job, observer);
    if (taken && !*taken) {
      for (std::size_t k = i - 3; k < i; ++k)
        if (Status asked = s.wantAgain(k); !asked) return asked.error();
      i -= 4;  // the loop adds one
      continue;
    }
    if (!taken) {
      if (taken.error().code == ErrorCode::Cancelled) return cancelled();
      // What is finished is worth a description, whatever failed; its own failure is the smaller news.
      if (const Status described = s.writeDescription(false); !described)
        job.warn(described.error().sentence());
      return taken.error();
    }
  }
  job.progress("photograph", total, total, "photos");
  return finish(true);
}

}  // namespace patina
