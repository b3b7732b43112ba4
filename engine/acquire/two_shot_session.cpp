#include "engine/acquire/two_shot_session.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>

#include "engine/acquire/capture_journal.h"
#include "engine/acquire/exposure.h"
#include "engine/acquire/two_shot_guide.h"
#include "engine/base/text.h"
#include "engine/image/exr.h"

namespace patina {
namespace fs = std::filesystem;
namespace {

constexpr const char* kMadeBy = "patina capture";
constexpr double kClipsAt = 0.98;      ///< of full scale
constexpr double kFill = 0.8;          ///< of full scale that the brightest places may reach
constexpr double kPercentile = 0.999;  ///< of the sample's pixels
constexpr double kDark = 0.03;         ///< of full scale: below, noise and rounding count too much
constexpr double kDarkShare = 0.05;    ///< of the sample that may be darker
constexpr double kRatio = 4;           ///< between the exposures of a bracket
constexpr int kMostExposures = 4, kExposureRounds = 10;
constexpr double kStill = 0.1;  ///< of the tolerance: more is a camera that was moved

template <typename Derived>
nlohmann::json numbersOf(const Eigen::MatrixBase<Derived>& matrix) {
  nlohmann::json list = nlohmann::json::array();
  for (Eigen::Index r = 0; r < matrix.rows(); ++r)
    for (Eigen::Index c = 0; c < matrix.cols(); ++c) list.push_back(matrix(r, c));
  return list;
}

template <typename Matrix>
bool readNumbers(const nlohmann::json& object, const char* key, Matrix& matrix) {
  const auto found = object.find(key);
  if (found == object.end() || !found->is_array() ||
      static_cast<Eigen::Index>(found->size()) != matrix.size())
    return false;
  for (Eigen::Index i = 0; i < matrix.size(); ++i) {
    if (!(*found)[static_cast<std::size_t>(i)].is_number()) return false;
    matrix(i / matrix.cols(), i % matrix.cols()) = (*found)[static_cast<std::size_t>(i)];
  }
  return true;
}

nlohmann::json jsonOfCamera(const Camera& camera) {
  return {{"width", camera.width},
          {"height", camera.height},
          {"K", numbersOf(camera.intrinsics)},
          {"distortion", numbersOf(camera.distortion)},
          {"R", numbersOf(camera.cameraFromWorld)},
          {"t", numbersOf(camera.translationMm)}};
}

std::optional<Camera> cameraOfJson(const nlohmann::json& json) {
  Camera camera;
  camera.width = json.value("width", 0);
  camera.height = json.value("height", 0);
  if (camera.width <= 0 || camera.height <= 0 || !readNumbers(json, "K", camera.intrinsics) ||
      !readNumbers(json, "distortion", camera.distortion) ||
      !readNumbers(json, "R", camera.cameraFromWorld) || !readNumbers(json, "t", camera.translationMm))
    return {};
  return camera;
}

struct TakenPhoto {
  std::string file;
  double exposureS = 0;
};

struct ShotState {
  TwoShotGuide::Placed placed;
  bool sampleDone = false, tilePlaced = false, tileDone = false;
  std::vector<TakenPhoto> sample, tile;
  int again = 0;
};

}  // namespace

std::vector<std::string> TwoShotSetup::validate() const {
  std::vector<std::string> problems;
  const auto need = [&](bool good, const char* sentence) {
    if (!good) problems.emplace_back(sentence);
  };
  need(disc ? radiusMm > 0 : widthMm > 0 && heightMm > 0, "the sample's size must be positive millimetres");
  need(!shots.empty(), "no shots are planned");
  need(holdout.empty() || holdout.size() == shots.size(), "holdout must have an entry a shot");
  need(holdout.empty() || std::ranges::find(holdout, false) != holdout.end(), "every shot is held out");
  need(distanceMm > 0, "the camera's distance must be positive");
  need(toleranceDeg > 0 && toleranceMm > 0, "tolerances must be positive");
  need((whiteReflectance.array() > 0).all() && (whiteReflectance.array() <= 1).all(),
       "the tile's reflectance must lie above 0 and be at most 1");
  for (const PlannedShot& shot : shots)
    need(shot.directions.toCamera.z() > 0 && shot.directions.toLight.z() > 0,
         "a planned direction lies below the sample");
  return problems;
}

struct TwoShotSession::State {
  fs::path folder;
  TwoShotSetup setup;
  std::optional<TwoShotGuide> guide;
  std::optional<CaptureJournal> journal;
  std::vector<ShotState> shots;

  std::vector<TwoShotGuide::Placed> placed() const {
    std::vector<TwoShotGuide::Placed> all;
    for (const ShotState& shot : shots) all.push_back(shot.placed);
    return all;
  }
  std::pair<TwoShotStep, int> next() const {
    for (std::size_t i = 0; i < shots.size(); ++i) {
      const ShotState& shot = shots[i];
      const int index = static_cast<int>(i);
      if (!shot.placed.camera) return {TwoShotStep::PlaceCamera, index};
      if (!shot.placed.toLight) return {TwoShotStep::PlaceLight, index};
      if (!shot.sampleDone) return {TwoShotStep::PhotographSample, index};
      if (!shot.tilePlaced && !shot.tileDone) return {TwoShotStep::PlaceTile, index};
      if (!shot.tileDone) return {TwoShotStep::PhotographTile, index};
    }
    return {TwoShotStep::Done, static_cast<int>(shots.size())};
  }
  nlohmann::json beginning() const;
  Status readJournal();
  Status finishIfDone(TwoShotCapture capture);
  Error wrongStep(const char* what) const {
    return Error{ErrorCode::Refused, std::string(what) + " isn't what comes next", folder.string(),
                 "follow the steps in their order"};
  }
};

// ---- opening ----

nlohmann::json TwoShotSession::State::beginning() const {
  nlohmann::json planned = nlohmann::json::array();
  for (const PlannedShot& shot : setup.shots)
    planned.push_back({numbersOf(shot.directions.toCamera), numbersOf(shot.directions.toLight)});
  return {{"event", "begin"},
          {"kind", "two-shot"},
          {"version", 1},
          {"disc", setup.disc},
          {"size_mm", {setup.radiusMm, setup.widthMm, setup.heightMm}},
          {"white", numbersOf(setup.whiteReflectance)},
          {"shots", planned}};
}

Status TwoShotSession::State::readJournal() {
  const std::string where = (folder / kCaptureJournal).string();
  if (journal->lines().empty()) return journal->append(beginning());
  // Compared as text: numbers come back from the file as they were written.
  if (journal->lines().front().dump() != nlohmann::json::parse(beginning().dump()).dump())
    return Error{ErrorCode::Refused, "this capture was begun with another plan, sample or tile", where,
                 "go on with those that it was begun with, or choose another folder"};
  const auto photosOf = [&](const nlohmann::json& list, std::vector<TakenPhoto>& photos) {
    photos.clear();
    bool whole = list.is_array() && !list.empty();
    for (const nlohmann::json& one : list) {
      const TakenPhoto photo{one.value("file", ""), one.value("exposure_s", 0.0)};
      const Result<std::string> hash = fileHash(folder / photo.file);
      whole &= hash && *hash == one.value("hash", "") && photo.exposureS > 0;
      photos.push_back(photo);
    }
    if (!whole) photos.clear();
    return whole;
  };
  for (const nlohmann::json& line : journal->lines()) {
    const int index = line.value("shot", -1);
    if (index < 0 || index >= static_cast<int>(shots.size())) continue;
    ShotState& shot = shots[static_cast<std::size_t>(index)];
    const std::string event = line.value("event", "");
    if (event == "camera") {
      shot.placed.camera = cameraOfJson(line);
    } else if (event == "light") {
      Eigen::Vector3d toLight;
      if (readNumbers(line, "direction", toLight)) shot.placed.toLight = toLight;
    } else if (event == "tile placed") {
      shot.tilePlaced = true;
    } else if (event == "sample") {
      shot.sampleDone = photosOf(line.value("photos", nlohmann::json()), shot.sample);
    } else if (event == "tile") {
      shot.tileDone = photosOf(line.value("photos", nlohmann::json()), shot.tile);
    } else if (event == "retake") {
      const int again = shot.again + 1;
      shot = {};
      shot.again = again;
    }
  }
  return Done{};
}

Result<std::unique_ptr<TwoShotSession>> TwoShotSession::open(const fs::path& folder,
                                                             const TwoShotSetup& setup, bool resume) {
  if (const std::vector<std::string> problems = setup.validate(); !problems.empty()) {
    std::string all;
    for (const std::string& problem : problems) all += (all.empty() ? "" : "; ") + problem;
    return Error{ErrorCode::Invalid, "this capture can't be taken: " + all, folder.string(),
                 "correct these values"};
  }
  Result<CaptureJournal> journal = beginCapture(folder, resume);
  if (!journal) return journal.error();
  auto state = std::make_unique<State>();
  state->folder = folder;
  state->setup = setup;
  state->shots.resize(setup.shots.size());
  state->guide.emplace(setup);
  state->journal.emplace(std::move(*journal));
  if (Status read = state->readJournal(); !read) return read.error();
  auto session = std::unique_ptr<TwoShotSession>(new TwoShotSession(std::move(state)));
  // Killed between the last photograph and the description.
  if (Status finished = session->state_->finishIfDone(session->capture()); !finished) return finished.error();
  return session;
}

TwoShotSession::TwoShotSession(std::unique_ptr<State> state) : state_(std::move(state)) {}
TwoShotSession::~TwoShotSession() = default;

TwoShotStep TwoShotSession::step() const {
  return state_->next().first;
}
int TwoShotSession::shot() const {
  return state_->next().second;
}
const TwoShotSetup& TwoShotSession::setup() const {
  return state_->setup;
}
const fs::path& TwoShotSession::folder() const {
  return state_->folder;
}

// ---- placing ----

CameraGuide TwoShotSession::guideCamera(const Camera& camera) const {
  const int at = std::min(shot(), static_cast<int>(state_->shots.size()) - 1);
  return state_->guide->camera(static_cast<std::size_t>(at), state_->placed(), camera);
}

LightGuide TwoShotSession::guideLight(const Eigen::Vector3d& toLight) const {
  const int at = std::min(shot(), static_cast<int>(state_->shots.size()) - 1);
  return state_->guide->light(static_cast<std::size_t>(at), state_->placed(), toLight);
}

Status TwoShotSession::placeCamera(const Camera& camera, bool accept) {
  State& s = *state_;
  const auto [step, index] = s.next();
  if (step != TwoShotStep::PlaceCamera) return s.wrongStep("placing the camera");
  const CameraGuide guide = guideCamera(camera);
  if (!(guide.toCamera.z() > 0))
    return Error{ErrorCode::Refused, "the camera is seen below the sample's plane", "",
                 "check that the board of markers lies face up"};
  if (!guide.sampleInPicture)
    return Error{ErrorCode::Refused, "the sample isn't wholly in the picture", "",
                 "turn the camera towards it"};
  if (!guide.within && !accept) {
    char text[200];
    std::snprintf(text, sizeof text, "the camera is %.1f degrees and %.0f mm off", guide.offDeg,
                  std::abs(guide.closerMm));
    return Error{ErrorCode::Refused, text, "", guide.sentence + " Or accept the place as it is"};
  }
  nlohmann::json line = jsonOfCamera(camera);
  line["event"] = "camera";
  line["shot"] = index;
  line["off_deg"] = guide.offDeg;
  if (Status written = s.journal->append(line); !written) return written;
  s.shots[static_cast<std::size_t>(index)].placed.camera = camera;
  return Done{};
}

Status TwoShotSession::placeLight(const Eigen::Vector3d& toLight, bool accept) {
  State& s = *state_;
  const auto [step, index] = s.next();
  if (step != TwoShotStep::PlaceLight) return s.wrongStep("placing the light");
  const LightGuide guide = guideLight(toLight);
  if (!(guide.toLight.z() > 0))
    return Error{ErrorCode::Refused, "the light is below the sample's plane", "",
                 "raise it, or check its direction"};
  if (!guide.within && !accept) {
    char text[120];
    std::snprintf(text, sizeof text, "the light is %.1f degrees off", guide.offDeg);
    return Error{ErrorCode::Refused, text, "", guide.sentence + " Or accept the place as it is"};
  }
  const nlohmann::json line = {{"event", "light"},
                               {"shot", index},
                               {"direction", numbersOf(guide.toLight)},
                               {"off_deg", guide.offDeg}};
  if (Status written = s.journal->append(line); !written) return written;
  s.shots[static_cast<std::size_t>(index)].placed.toLight = guide.toLight;
  return Done{};
}

Status TwoShotSession::tilePlaced() {
  State& s = *state_;
  const auto [step, index] = s.next();
  if (step != TwoShotStep::PlaceTile) return s.wrongStep("placing the tile");
  if (Status written = s.journal->append({{"event", "tile placed"}, {"shot", index}}); !written)
    return written;
  s.shots[static_cast<std::size_t>(index)].tilePlaced = true;
  return Done{};
}

Status TwoShotSession::retakeShot(int shot) {
  State& s = *state_;
  if (shot < 0 || shot >= static_cast<int>(s.shots.size()))
    return Error{ErrorCode::Invalid, "there is no shot " + std::to_string(shot), "",
                 "name one of the planned ones"};
  if (Status written = s.journal->append({{"event", "retake"}, {"shot", shot}}); !written) return written;
  ShotState& state = s.shots[static_cast<std::size_t>(shot)];
  const int again = state.again + 1;
  state = {};
  state.again = again;
  return Done{};
}

// ---- photographing ----

namespace {

/// Exposures for what the camera sees, and the photographs taken with them, shortest first.
struct Exposed {
  std::vector<BracketPhoto> photos;
};

Result<Exposed> exposeByHistogram(CameraDevice& device, const FrameConversion& conversion, const Image& mask,
                                  bool bracketed, const JobContext& job) {
  const Result<std::vector<CameraControl>> controls = device.controls();
  if (!controls) return controls.error();
  const auto control = std::ranges::find(*controls, CameraControlId::ExposureS, &CameraControl::id);
  const bool settable = control != controls->end();
  const double least = settable ? control->least : 0, most = settable ? control->most : 0;
  double exposure = settable ? std::clamp(0.05, least, most) : 0;
  const auto take = [&](double seconds) -> Result<BracketPhoto> {
    StillRequest request;
    if (settable) request.exposureS = seconds;
    const Result<std::vector<Frame>> frames = device.still(request, job.stop);
    if (!frames) return frames.error();
    Result<Image> image = linearImage(frames->front(), conversion);
    if (!image) return image.error();
    if (image->width() != mask.width() || image->height() != mask.height())
      return Error{ErrorCode::Invalid,
                   "the camera's pictures are not of the size that it was calibrated with",
                   device.info().name, "choose that format, or calibrate again"};
    return BracketPhoto{std::move(*image),
                        frames->front().metadata.exposureS.value_or(settable ? seconds : 1.0)};
  };
  Result<BracketPhoto> photo = take(exposure);
  if (!photo) return photo.error();
  for (int round = 0; round < kExposureRounds && settable; ++round) {
    const double next = exposureFor(photo->photo, mask, exposure, kFill, kPercentile, least, most);
    if (std::abs(next / exposure - 1) < 0.05) break;
    exposure = next;
    photo = take(exposure);
    if (!photo) return photo.error();
  }
  Exposed exposed;
  exposed.photos.push_back(std::move(*photo));
  // Where much of the sample is dark beside its highlight, longer ones too.
  while (settable && bracketed && static_cast<int>(exposed.photos.size()) < kMostExposures) {
    const BracketPhoto& last = exposed.photos.back();
    double dark = 0, all = 0;
    for (int y = 0; y < mask.height(); ++y)
      for (int x = 0; x < mask.width(); ++x) {
        if (!(mask.at(x, y) > 0)) continue;
        ++all;
        dark += *std::ranges::max_element(last.photo.pixel(x, y)) < kDark ? 1 : 0;
      }
    if (all == 0 || dark / all < kDarkShare || last.exposureS * kRatio > most) break;
    Result<BracketPhoto> longer = take(last.exposureS * kRatio);
    if (!longer) return longer.error();
    exposed.photos.push_back(std::move(*longer));
  }
  return exposed;
}

}  // namespace

Status TwoShotSession::photograph(CameraDevice& device, PoseSource* poses, const JobContext& job) {
  State& s = *state_;
  const auto [step, index] = s.next();
  const bool tile = step == TwoShotStep::PhotographTile;
  if (!tile && step != TwoShotStep::PhotographSample) return s.wrongStep("a photograph");
  ShotState& shot = s.shots[static_cast<std::size_t>(index)];
  const Camera& camera = *shot.placed.camera;
  Image mask(camera.width, camera.height, 1);
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x)
      if (const auto at = camera.samplePlaneFromPixel({x, y}))
        mask.at(x, y) = (s.setup.disc ? at->head<2>().norm() <= s.setup.radiusMm
                                      : std::abs(at->x()) <= s.setup.widthMm / 2 &&
                                            std::abs(at->y()) <= s.setup.heightMm / 2)
                            ? 1.0f
                            : 0.0f;
  job.progress("photograph", 2 * index + (tile ? 1 : 0), 2 * static_cast<int>(s.shots.size()), "photos");
  const Result<Exposed> exposed = exposeByHistogram(device, s.setup.conversion, mask, !tile, job);
  if (!exposed) return exposed.error();
  if (poses &&
      !tile) {  // the tile hides no marker, but the sample's photograph is the one that must not move
    const Result<PoseEstimate> pose = poses->poseIn(exposed->photos.front().photo);
    if (!pose) return pose.error();
    const Eigen::Vector3d was = camera.positionMm(), is = pose->camera.positionMm();
    const double turned = std::atan2(was.cross(is).norm(), was.dot(is)) * 180 / 3.14159265358979323846;
    const double movedMm = std::abs(was.norm() - is.norm());
    // What the markers themselves get wrong is no movement.
    if (turned > std::max(kStill * s.setup.toleranceDeg, 4 * pose->tiltUncertaintyDeg) ||
        movedMm > std::max(kStill * s.setup.toleranceMm, 4 * pose->distanceUncertaintyMm)) {
      char text[160];
      std::snprintf(text, sizeof text, "the camera has moved by %.2f degrees and %.1f mm since it was placed",
                    turned, movedMm);
      return Error{ErrorCode::Refused, text, "", "place it again (retake this shot), and fasten the stand"};
    }
  }
  nlohmann::json photos = nlohmann::json::array();
  std::vector<TakenPhoto> taken;
  for (std::size_t k = 0; k < exposed->photos.size(); ++k) {
    char name[64];
    std::snprintf(name, sizeof name, shot.again > 0 ? "photos/%s_%03d_%zu_r%d.exr" : "photos/%s_%03d_%zu.exr",
                  tile ? "white" : "shot", index, k, shot.again);
    if (Status written = writeExr(s.folder / name, exposed->photos[k].photo, {"R", "G", "B"},
                                  {{"units", "full scale of the camera"}});
        !written)
      return written;
    const Result<std::string> hash = fileHash(s.folder / name);
    if (!hash) return hash.error();
    taken.push_back({name, exposed->photos[k].exposureS});
    photos.push_back({{"file", name}, {"hash", *hash}, {"exposure_s", exposed->photos[k].exposureS}});
  }
  if (Status written =
          s.journal->append({{"event", tile ? "tile" : "sample"}, {"shot", index}, {"photos", photos}});
      !written)
    return written;
  (tile ? shot.tile : shot.sample) = taken;
  (tile ? shot.tileDone : shot.sampleDone) = true;
  return s.finishIfDone(capture());
}

Status TwoShotSession::State::finishIfDone(TwoShotCapture capture) {
  if (next().first != TwoShotStep::Done) return Done{};
  return writeTwoShotCapture(capture);
}

TwoShotCapture TwoShotSession::capture() const {
  const State& s = *state_;
  TwoShotCapture capture;
  capture.folder = s.folder;
  capture.disc = s.setup.disc;
  capture.radiusMm = s.setup.disc ? s.setup.radiusMm : 0;
  capture.widthMm = s.setup.disc ? 0 : s.setup.widthMm;
  capture.heightMm = s.setup.disc ? 0 : s.setup.heightMm;
  capture.sampleName = s.setup.sampleName;
  capture.madeBy = kMadeBy;
  capture.whiteReflectance = s.setup.whiteReflectance;
  capture.saturation = kClipsAt;
  for (std::size_t i = 0; i < s.shots.size(); ++i) {
    const ShotState& shot = s.shots[i];
    if (!shot.placed.camera || !shot.placed.toLight) continue;
    TwoShotPhoto photo;
    photo.camera = *shot.placed.camera;
    photo.toLight = *shot.placed.toLight;
    photo.holdout = i < s.setup.holdout.size() && s.setup.holdout[i];
    for (const TakenPhoto& one : shot.sample) {
      photo.file = one.file;
      photo.exposureS = one.exposureS;
      capture.shots.push_back(photo);
    }
    photo.holdout = false;
    for (const TakenPhoto& one : shot.tile) {
      photo.file = one.file;
      photo.exposureS = one.exposureS;
      capture.whiteShots.push_back(photo);
    }
  }
  return capture;
}

}  // namespace patina
