#include "engine/brdf/brdf_file.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdint>
#include <cstring>

#include "engine/base/file.h"
#include "engine/base/text.h"
#include "engine/brdf/alta_file.h"
#include "engine/brdf/rgl_file.h"
#include "engine/brdf/tabulated_brdf.h"

namespace patina {
namespace {

constexpr std::uint64_t kMostBytes = std::uint64_t{512} << 20;  // the largest published file has some 200 MB
constexpr std::size_t kHeaderText = 64u << 10;                  // an ALTA header is a few lines

/// Three sizes, small and not zero: a table like MERL's, of the right size or not.
bool looksLikeMerl(std::string_view bytes) {
  std::array<std::uint32_t, 3> sizes;
  if (bytes.size() < sizeof sizes) return false;
  std::memcpy(sizes.data(), bytes.data(), sizeof sizes);
  constexpr std::uint32_t kLargest = 4096;
  return std::all_of(sizes.begin(), sizes.end(), [](std::uint32_t s) { return s > 0 && s <= kLargest; });
}

std::string lowerEnding(const std::filesystem::path& file) {
  std::string ending = file.extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return ending;
}

}  // namespace

Result<BrdfPtr> readBrdfBytes(std::string_view bytes, const std::string& where) {
  if (bytes.starts_with("tensor_file")) return readRglBytes(bytes, where);
  if (bytes.substr(0, kHeaderText).find("#PARAM_IN") != std::string_view::npos) {
    return readAltaBytes(bytes, where);
  }
  if (looksLikeMerl(bytes)) {
    Result<std::shared_ptr<const TabulatedBrdf>> table = readMerlBytes(bytes, where);
    if (!table) return table.error();
    return BrdfPtr(*table);
  }
  return Error{ErrorCode::Unsupported,
               bytes.empty() ? "the file is empty" : "this is no BRDF file that is known", where,
               "name a MERL .binary file, an RGL _rgb.bsdf file, or an ALTA table with #PARAM_IN"};
}

Result<BrdfPtr> readBrdf(const std::filesystem::path& file) {
  Result<std::string> bytes = readFile(file, kMostBytes);
  if (!bytes) return bytes.error();
  return readBrdfBytes(*bytes, file.string());
}

Result<std::vector<std::filesystem::path>> listBrdfFiles(const std::filesystem::path& folder) {
  std::error_code code;
  std::filesystem::directory_iterator at(folder, code);
  if (code) {
    return Error{ErrorCode::NotFound, "this folder can't be read: " + code.message(), folder.string(),
                 "name a folder with measured BRDFs"};
  }
  std::vector<std::filesystem::path> files;
  for (; at != std::filesystem::directory_iterator(); at.increment(code)) {
    std::error_code ignored;
    const std::string ending = lowerEnding(at->path());
    const bool known = ending == ".binary" || ending == ".bsdf" || ending == ".dat" || ending == ".alta";
    if (known && at->is_regular_file(ignored)) files.push_back(at->path());
    if (code) break;
  }
  if (code) {
    return Error{ErrorCode::NotFound, "listing this folder failed: " + code.message(), folder.string(),
                 "check the disk or the network folder it is on"};
  }
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace patina
