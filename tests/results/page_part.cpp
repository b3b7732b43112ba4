#include "tests/results/page_part.h"

#include <sys/utsname.h>

#include <cmath>
#include <fstream>
#include <iterator>
#include <sstream>

namespace patina::test {

bool replacePagePart(const std::filesystem::path& page, const std::string& part, const std::string& text) {
  std::string content;
  if (std::ifstream in(page); in) content.assign(std::istreambuf_iterator<char>(in), {});
  const std::string begin = "<!-- " + part + ": begin -->\n", end = "<!-- " + part + ": end -->\n";
  const std::string whole = begin + text + end;
  const std::size_t from = content.find(begin), to = content.find(end);
  if (from != std::string::npos && to != std::string::npos && to > from) {
    content.replace(from, to + end.size() - from, whole);
  } else {
    if (!content.empty() && content.back() != '\n') content += "\n";
    content += (content.empty() ? "" : "\n") + whole;
  }
  std::ofstream out(page, std::ios::binary);
  return static_cast<bool>(out << content << std::flush);
}

std::string machineDescription(int threads) {
  std::string processor = "unknown processor";
  std::ifstream cpuinfo("/proc/cpuinfo");
  for (std::string line; std::getline(cpuinfo, line);) {
    if (line.starts_with("model name")) {
      processor = line.substr(line.find(':') + 2);
      break;
    }
  }
  double memoryGb = 0;
  std::ifstream meminfo("/proc/meminfo");
  std::string key;
  if (meminfo >> key >> memoryGb) memoryGb /= 1024.0 * 1024.0;
  utsname kernel{};
  ::uname(&kernel);
  std::ostringstream text;
  text << processor << ", " << threads << (threads == 1 ? " thread" : " threads") << ", "
       << std::lround(memoryGb) << " GiB, " << kernel.sysname << " " << kernel.machine << ", GCC "
#ifdef __GNUC__
       << __GNUC__ << "." << __GNUC_MINOR__
#endif
#ifdef NDEBUG
       << ", release build";
#else
       << ", build with assertions";
#endif
  return text.str();
}

}  // namespace patina::test
