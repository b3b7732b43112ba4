#include "tests/house/house_rules.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <fstream>
#include <iterator>
#include <map>
#include <regex>
#include <set>
#include <sstream>

namespace patina::test {
namespace fs = std::filesystem;
namespace {

// Top-level folders of code, and which of them each may include.
const std::map<std::string, std::set<std::string>> kMayEnter = {
    {"engine", {"engine"}},
    {"devices", {"devices", "engine"}},
    {"widgets", {"widgets", "engine"}},
    {"app", {"app", "widgets", "devices", "engine"}},
    {"tests", {"tests", "app", "widgets", "devices", "engine"}},
};

// Rooms of engine/, in the order in which a photograph walks through them. A room includes itself and rooms
// of a lower number.
const std::map<std::string, int> kEngineOrder = {
    {"base", 0},    {"image", 1},       {"geometry", 2}, {"effect", 1},  {"screen", 3},
    {"light", 3},   {"brdf", 3},        {"surface", 4},  {"lens", 5},    {"sensor", 6},
    {"capture", 7}, {"calibration", 8}, {"fourier", 8},  {"twoshot", 8}, {"flash", 8},
    {"render", 9},  {"diagnosis", 10},  {"export", 10},  {"report", 11},
};

// Libraries by the shape of their header names.
enum class Library {
  Standard,
  System,
  Eigen,
  Ceres,
  OpenExr,
  Highway,
  Tbb,
  Json,
  Png,
  Jpeg,
  Blas,
  Hash,
  OpenCv,
  OpenCvWindow,
  Qt,
  QtWithModule,
  Qt5,
  Vtk,
  Camera,
  CommandLine,
  Testing,
  Unknown
};

const std::vector<std::pair<Library, std::regex>>& librarySignatures() {
  static const std::vector<std::pair<Library, std::regex>> signatures = [] {
    const auto pattern = [](const char* text) { return std::regex(text, std::regex::optimize); };
    return std::vector<std::pair<Library, std::regex>>{
        {Library::Eigen, pattern("^(unsupported/)?Eigen/.*")},
        {Library::Ceres, pattern("^ceres/.*")},
        {Library::OpenExr,
         pattern("^(OpenEXR/|Imath/)?(Imf|Imath|Iex|half|OpenEXR|openexr)[A-Za-z0-9_]*\\.h$")},
        {Library::Highway, pattern("^hwy/.*")},
        {Library::Tbb, pattern("^(tbb|oneapi)/.*")},
        {Library::Json, pattern("^nlohmann/.*")},
        {Library::Png, pattern("^png\\.h$")},
        {Library::Jpeg, pattern("^jpeglib\\.h$")},
        {Library::Blas, pattern("^cblas\\.h$")},
        {Library::Hash, pattern("^xxhash\\.h$")},
        {Library::OpenCvWindow,
         pattern("^opencv2?/(highgui|imgcodecs|videoio|viz|opencv)(\\.hpp|/.*|_c\\.h)$")},
        {Library::OpenCv, pattern("^opencv2?/.*")},
        {Library::Qt5, pattern(".*[Qq]t5.*|^Qt(X11Extras|Script|XmlPatterns|WinExtras)(/.*)?$|^QVTK.*")},
        {Library::QtWithModule, pattern("^Qt(Core|Gui|Network|DBus)/Q.*")},
        {Library::Qt, pattern("^(Qt[A-Z][A-Za-z0-9]*(/.*)?|Q[A-Z][A-Za-z0-9]*|q[a-z]+\\.h)$")},
        {Library::Vtk, pattern("^vtk[A-Z_].*")},
        {Library::Camera, pattern("^(libcamera/|linux/(videodev2|v4l2|media|dma)|libudev|gphoto2/).*")},
        {Library::CommandLine, pattern("^CLI/.*")},
        {Library::Testing, pattern("^(gtest|gmock|benchmark)/.*")},
        {Library::System,
         pattern(
             "^((sys|linux|bits|arpa|netinet|GL|EGL)/.*|(unistd|fcntl|poll|dirent|dlfcn|pthread|sched|errno|"
             "signal|stdlib|stdio|string|math|time|termios|immintrin|malloc|execinfo|spawn|cxxabi)\\.h)$")},
        {Library::Standard, pattern("^[a-z_0-9]+$")},
    };
  }();
  return signatures;
}

Library libraryOf(const std::string& header) {
  for (const auto& [library, pattern] : librarySignatures()) {
    if (std::regex_match(header, pattern)) return library;
  }
  return Library::Unknown;
}

const std::map<std::string, std::set<Library>>& mayKnow() {
  using enum Library;
  static const std::map<std::string, std::set<Library>> table = {
      {"engine",
       {Standard, System, Eigen, Ceres, OpenExr, Highway, Tbb, Json, Png, Jpeg, Blas, Hash, OpenCv}},
      {"devices", {Standard, System, Eigen, Tbb, Json, Camera, QtWithModule}},
      {"widgets", {Standard, System, Eigen, Qt, QtWithModule, Vtk}},
      {"app", {Standard, System, Eigen, Tbb, Json, Qt, QtWithModule, Vtk, CommandLine}},
      {"tests",
       {Standard, System, Eigen, Ceres, OpenExr, Highway, Tbb, Json, Png, Jpeg, Blas, Hash, OpenCv, Qt,
        QtWithModule, Vtk, Camera, CommandLine, Testing}},
  };
  return table;
}

std::string readText(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
}

std::vector<std::string> linesOf(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

// Files below the named top-level folders that `wanted` accepts, sorted, relative to the root.
template <typename Predicate>
std::vector<fs::path> filesBelow(const fs::path& root, const std::vector<std::string>& folders,
                                 Predicate wanted) {
  std::vector<fs::path> found;
  for (const std::string& folder : folders) {
    if (!fs::is_directory(root / folder)) continue;
    for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
      if (entry.is_regular_file() && wanted(entry.path())) found.push_back(fs::relative(entry.path(), root));
    }
  }
  std::sort(found.begin(), found.end());
  return found;
}

std::vector<fs::path> textFiles(const fs::path& root) {
  const auto isText = [](const fs::path& file) {
    static const std::set<std::string> kText = {".h",  ".hpp",  ".cpp", ".cc",  ".inc",  ".txt",     ".cmake",
                                                ".md", ".json", ".sh",  ".svg", ".xml",  ".desktop", ".supp",
                                                ".in", ".qrc",  ".ts",  ".yml", ".yaml", ""};
    return kText.contains(file.extension().string());
  };
  std::vector<fs::path> files = filesBelow(
      root,
      {".ci", "app", "cmake", "devices", "docs", "engine", "packaging", "resources", "tests", "widgets"},
      isText);
  for (const auto& entry : fs::directory_iterator(root)) {
    if (entry.is_regular_file() && isText(entry.path())) files.push_back(entry.path().filename());
  }
  return files;
}

// Why `header`, included in angle brackets from `file` in `room`, is not allowed; empty where it is.
std::string objectionToLibrary(const std::string& room, const fs::path& file, const std::string& header) {
  const Library library = libraryOf(header);
  const auto named = [&](const std::string& reason) { return "<" + header + ">: " + reason; };
  if (library == Library::Qt5) return named("Qt 5 (or VTK's module for it) can't share a process with Qt 6");
  if (library == Library::OpenCvWindow)
    return named("OpenCV's windows, codecs and the header that includes all of them stay out");
  if (library == Library::OpenCv && file.extension() != ".cpp" && room == "engine") {
    return named("OpenCV stays inside .cpp files of engine/");
  }
  if (mayKnow().at(room).contains(library)) return {};
  if (room == "devices" && library == Library::Qt) {
    return named(
        "devices/ knows no widgets; write QtCore and QtGui headers with their module, as <QtGui/QScreen>");
  }
  return named(room + "/ may not know this library; see the table in CONTRIBUTING.md");
}

// The same for a header of ours, included in quotes.
std::string objectionToOwn(const fs::path& root, const std::string& room, const fs::path& file,
                           const std::string& header) {
  const auto named = [&](const std::string& reason) { return "\"" + header + "\": " + reason; };
  const fs::path target(header);
  if (target.extension() == ".moc") return {};
  const std::string targetRoom = target.begin()->string();
  if (!kMayEnter.contains(targetRoom))
    return named("write includes from the root, as \"engine/base/result.h\"");
  for (const fs::path& part : target) {
    if (part == "..") return named("write includes from the root, without \"..\"");
  }
  if (!kMayEnter.at(room).contains(targetRoom)) return named(room + "/ may not enter " + targetRoom + "/");
  if (!fs::exists(root / target)) return named("no such file");
  if (room != "engine" || targetRoom != "engine") return {};

  const auto engineRoom = [](const fs::path& path) { return std::next(path.begin())->string(); };
  const std::string from = engineRoom(file), to = engineRoom(target);
  if (!kEngineOrder.contains(from))
    return named("engine/" + from + " is not in the order of rooms; add it to the test's table");
  if (!kEngineOrder.contains(to))
    return named("engine/" + to + " is not in the order of rooms; add it to the test's table");
  if (from != to && kEngineOrder.at(to) >= kEngineOrder.at(from)) {
    return named("climbs: engine/" + from + " comes before engine/" + to);
  }
  return {};
}

}  // namespace

std::string describe(const std::vector<Violation>& violations) {
  std::string text;
  for (const Violation& violation : violations) {
    text += violation.file + ":" + std::to_string(violation.line) + ": " + violation.rule + "\n";
  }
  return text;
}

std::vector<fs::path> sourceFiles(const fs::path& root) {
  return filesBelow(root, {"app", "devices", "engine", "tests", "widgets"}, [](const fs::path& file) {
    static const std::set<std::string> kSource = {".h", ".hpp", ".cpp", ".cc", ".inc"};
    return kSource.contains(file.extension().string());
  });
}

std::vector<Violation> checkIncludes(const fs::path& root) {
  static const std::regex kInclude(R"re(^\s*#\s*include\s*([<"])([^>"]+)[>"].*)re");
  std::vector<Violation> violations;
  for (const fs::path& file : sourceFiles(root)) {
    const std::string room = file.begin()->string();
    const std::vector<std::string> lines = linesOf(readText(root / file));
    for (std::size_t i = 0; i < lines.size(); ++i) {
      std::smatch match;
      if (!std::regex_match(lines[i], match, kInclude)) continue;
      const std::string objection = match[1] == "<" ? objectionToLibrary(room, file, match[2])
                                                    : objectionToOwn(root, room, file, match[2]);
      if (!objection.empty()) violations.push_back({file.string(), static_cast<int>(i) + 1, objection});
    }
  }
  return violations;
}

std::vector<Violation> checkLinkedModules(const fs::path& root) {
  static const std::regex kForbidden(
      R"re(Qt5|opencv_(highgui|viz|videoio)|OpenCV_LIBS|GUISupportQt|\b(highgui|videoio)\b)re");
  std::vector<Violation> violations;
  for (const fs::path& file : textFiles(root)) {
    if (file.filename() != "CMakeLists.txt" && file.extension() != ".cmake") continue;
    const std::vector<std::string> lines = linesOf(readText(root / file));
    for (std::size_t i = 0; i < lines.size(); ++i) {
      const std::string code = lines[i].substr(0, lines[i].find('#'));
      std::smatch match;
      if (std::regex_search(code, match, kForbidden)) {
        violations.push_back({file.string(), static_cast<int>(i) + 1, match.str() + " must not be linked"});
      }
    }
  }
  return violations;
}

std::vector<Violation> checkLengths(const fs::path& root, int maxLines) {
  std::vector<Violation> violations;
  for (const fs::path& file : sourceFiles(root)) {
    const auto count = static_cast<int>(linesOf(readText(root / file)).size());
    if (count > maxLines) {
      violations.push_back(
          {file.string(), 0, std::to_string(count) + " lines; files stay under " + std::to_string(maxLines)});
    }
  }
  return violations;
}

std::vector<Violation> checkForeignPaths(const fs::path& root) {
  // Not preceded by a word character or by "..", "}" and the like: "a/home/b" and "${x}/work" are not
  // absolute.
  static const std::regex kForeign(
      R"re((^|[\s"'(=:,`<\[])(/(home|root|work|tmp|Users|mnt|media)/[A-Za-z0-9_.-]+))re");
  std::vector<Violation> violations;
  for (const fs::path& file : textFiles(root)) {
    const std::vector<std::string> lines = linesOf(readText(root / file));
    for (std::size_t i = 0; i < lines.size(); ++i) {
      std::smatch match;
      if (std::regex_search(lines[i], match, kForeign)) {
        violations.push_back(
            {file.string(), static_cast<int>(i) + 1, match[2].str() + " exists on one machine only"});
      }
    }
  }
  return violations;
}

std::string withoutCommentsAndStrings(const std::string& source) {
  std::string code = source;
  const auto blank = [&](std::size_t from, std::size_t to) {
    for (std::size_t i = from; i < std::min(to, code.size()); ++i) {
      if (code[i] != '\n') code[i] = ' ';
    }
  };
  const auto endOf = [&](std::size_t found, std::size_t length) {
    return found == std::string::npos ? source.size() : found + length;
  };
  for (std::size_t i = 0; i < source.size();) {
    std::size_t end = i + 1;
    bool hide = true;
    if (source.compare(i, 2, "//") == 0) {
      end = endOf(source.find('\n', i), 0);
    } else if (source.compare(i, 2, "/*") == 0) {
      end = endOf(source.find("*/", i + 2), 2);
    } else if (source.compare(i, 2, "R\"") == 0) {
      const std::size_t open = source.find('(', i);
      if (open == std::string::npos) break;
      const std::string close = ")" + source.substr(i + 2, open - i - 2) + "\"";
      end = endOf(source.find(close, open), close.size());
    } else if (source[i] == '"' ||
               (source[i] == '\'' && (i == 0 || !std::isalnum(static_cast<unsigned char>(source[i - 1]))))) {
      while (end < source.size() && source[end] != source[i] && source[end] != '\n')
        end += source[end] == '\\' ? 2 : 1;
      ++end;
    } else {
      hide = false;
    }
    if (hide) blank(i, end);
    i = end;
  }
  return code;
}

std::vector<Violation> checkNames(const fs::path& root) {
  static const std::regex kBanned(R"re(\b(wi|wo|roughness)\b)re");
  static const std::regex kInclude(R"re(^\s*#\s*include.*)re");
  std::vector<Violation> violations;
  for (const fs::path& file : sourceFiles(root)) {
    const std::vector<std::string> lines = linesOf(withoutCommentsAndStrings(readText(root / file)));
    for (std::size_t i = 0; i < lines.size(); ++i) {
      std::smatch match;
      if (std::regex_match(lines[i], kInclude) || !std::regex_search(lines[i], match, kBanned)) continue;
      const std::string instead =
          match.str() == "roughness" ? "sigma, alpha or perceptualRoughness" : "toLight or toView";
      violations.push_back(
          {file.string(), static_cast<int>(i) + 1, "the name `" + match.str() + "`: say " + instead});
    }
  }
  return violations;
}

std::vector<std::string> forbiddenLibraries(const std::string& lddOutput) {
  static const std::regex kForbidden(R"re((lib(Qt5|opencv_highgui|vtkGUISupportQt)\S*|\S+ => not found))re");
  std::set<std::string> found;
  for (std::sregex_iterator it(lddOutput.begin(), lddOutput.end(), kForbidden), end; it != end; ++it)
    found.insert(it->str());
  return {found.begin(), found.end()};
}

}  // namespace patina::test
