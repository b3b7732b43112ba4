#include "engine/capture/capture.h"

#include <map>
#include <set>

#include "engine/base/atomic_file.h"
#include "engine/base/file.h"
#include "engine/base/text.h"
#include "engine/capture/bundle_path.h"
#include "engine/capture/capture_json.h"
#include "engine/capture/capture_parts.h"

namespace patina {
namespace fs = std::filesystem;
using namespace capture_parts;
namespace {

/// Files that exist, and responses that can be understood.
Status checkFiles(const FourierCapture& capture, const std::string& where, const JobContext& job) {
  std::map<fs::path, std::size_t> files;
  std::set<std::string> encodings;
  for (std::size_t i = 0; i < capture.photos.size(); ++i) {
    if (job.cancelled()) return Error{ErrorCode::Cancelled, "reading the bundle was cancelled", where, ""};
    const std::string photo = "photos[" + std::to_string(i) + "]";
    Result<fs::path> file =
        resolveInBundle(capture.folder, capture.photos[i].file, where + ": " + photo + ".file");
    if (!file) return file.error();
    const auto [other, isNew] = files.emplace(*file, i);
    if (!isNew) {
      job.warn("photos[" + std::to_string(other->second) + "] and " + photo + " name the same file, " +
               inQuotes(capture.photos[i].file));
    }
    if (!encodings.insert(capture.photos[i].encoding).second) continue;
    Status encoding =
        checkEncoding(capture.folder, capture.photos[i].encoding, where + ": " + photo + ".encoding");
    if (!encoding) return encoding;
  }
  return Done{};
}

}  // namespace

Result<FourierCapture> readFourierCapture(const fs::path& folder, const JobContext& job) {
  Result<fs::path> description = findDescription(folder);
  if (!description) return description.error();
  Result<std::string> text = readFile(*description, kLargestDescription);
  if (!text) return text.error();
  const fs::path home = description->has_parent_path() ? description->parent_path() : fs::path(".");
  Result<FourierCapture> capture = parseFourierCapture(*text, home, description->string());
  if (!capture) return capture;
  Status files = checkFiles(*capture, description->string(), job);
  if (!files) return files.error();
  for (const std::string& key : capture->ignoredKeys) {
    job.info("The key " + inQuotes(key) + " in " + description->string() +
             " is not known to this version and was ignored.");
  }
  return capture;
}

Status writeFourierCapture(const FourierCapture& capture) {
  std::error_code code;
  fs::create_directories(capture.folder, code);
  if (code && !fs::is_directory(capture.folder)) {
    return Error{ErrorCode::WriteFailed, "the bundle's folder can't be made: " + code.message(),
                 capture.folder.string(), "choose another folder"};
  }
  return writeFileAtomically(capture.folder / "capture.json", fourierCaptureJson(capture));
}

Result<Image> readPhoto(const FourierCapture& capture, const FourierPhoto& photo) {
  return readLinear(capture.folder, photo.file, photo.encoding, capture.camera, capture.radianceScale);
}

}  // namespace patina
