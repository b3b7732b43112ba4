#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/result.h"
#include "engine/capture/json_reader.h"
#include "engine/geometry/camera.h"
#include "engine/image/image.h"
#include "engine/image/image_size.h"

/// What the readers of all kinds of bundle share. Functions that take a JsonObject throw JsonFault; the
/// others return a Result. For this folder only.
namespace patina::capture_parts {

inline constexpr int kVersion = 1;
// Limits say "surely a mistake", generously: they keep arithmetic finite and allocations possible.
inline constexpr double kSmallestMm = 1e-3, kLargestMm = 1e6;  // a micrometre to a kilometre
inline constexpr double kFarthestMm = 1e7;
inline constexpr double kLongestExposureS = 86400;
inline constexpr double kLargestScale = 1e9;
inline constexpr std::size_t kMostPhotos = 100000;
inline constexpr std::uint64_t kLargestDescription = 64u << 20;  // bytes; 100000 photos take some 15 MB

/// Adds the keys that nobody read to `ignored`, as `prefix`.key, each name once.
void noteUnread(const JsonObject& object, const std::string& prefix, std::vector<std::string>* ignored);
/// Fails unless the key `type` is `wanted`.
void requireType(JsonObject& object, const std::string& wanted);
Eigen::Vector2d vector2(JsonObject& object, const std::string& name, double low, double high);
Eigen::Vector3d vector3(JsonObject& object, const std::string& name, double low, double high);

/// `format` and `version`, then the `kind` as it stands there.
std::string readHead(JsonObject& file);
/// The sample's `name`, not absurdly long.
std::string readSampleName(JsonObject& sample);
/// A camera that looks at the sample's front.
Camera readCamera(JsonObject& camera);
/// `file`, as a path that stays inside the bundle.
std::string readFileName(JsonObject& photo, const std::string& where);
/// Whether `split` says holdout.
bool readHoldout(JsonObject& photo);
/// `encoding` of the photograph `file`; "" for linear.
std::string readEncoding(JsonObject& photo, const std::string& where, const std::string& file);

nlohmann::ordered_json jsonOf(const Eigen::Matrix3d& m);
nlohmann::ordered_json jsonOf(const Eigen::Vector2d& v);
nlohmann::ordered_json jsonOf(const Eigen::Vector3d& v);
nlohmann::ordered_json jsonOf(const Camera& camera);

/// Where capture.json is, for a folder or for the file itself. Errors: NotFound.
Result<std::filesystem::path> findDescription(const std::filesystem::path& named);
/// The response file of an encoding, if it has one, exists and can be understood; `where` names the key.
Status checkEncoding(const std::filesystem::path& folder, const std::string& encoding,
                     const std::string& where);
/// One photograph of the bundle in `folder`, decoded to linear, R G B, times `scale`, every pixel finite.
Result<Image> readLinear(const std::filesystem::path& folder, const std::string& file,
                         const std::string& encoding, const Camera& camera, double scale);
/// The same for a photograph whose size is known otherwise, or not at all.
Result<Image> readLinear(const std::filesystem::path& folder, const std::string& file,
                         const std::string& encoding, std::optional<ImageSize> expected, double scale);

}  // namespace patina::capture_parts
