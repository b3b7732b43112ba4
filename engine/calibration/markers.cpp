#include "engine/calibration/markers.h"

#include <array>
#include <map>
#include <mutex>
#include <opencv2/aruco/dictionary.hpp>

#include "engine/calibration/board.h"

namespace patina {
namespace {

struct Named {
  const char* name;
  cv::aruco::PREDEFINED_DICTIONARY_NAME dictionary;
};
constexpr std::array kNamed = {
    Named{"4x4_50", cv::aruco::DICT_4X4_50},   Named{"4x4_100", cv::aruco::DICT_4X4_100},
    Named{"4x4_250", cv::aruco::DICT_4X4_250}, Named{"5x5_50", cv::aruco::DICT_5X5_50},
    Named{"5x5_100", cv::aruco::DICT_5X5_100}, Named{"5x5_250", cv::aruco::DICT_5X5_250},
    Named{"6x6_50", cv::aruco::DICT_6X6_50},   Named{"6x6_100", cv::aruco::DICT_6X6_100},
    Named{"6x6_250", cv::aruco::DICT_6X6_250}, Named{"7x7_50", cv::aruco::DICT_7X7_50},
    Named{"7x7_100", cv::aruco::DICT_7X7_100}, Named{"7x7_250", cv::aruco::DICT_7X7_250}};

MarkerDictionary load(cv::aruco::PREDEFINED_DICTIONARY_NAME name) {
  const cv::Ptr<cv::aruco::Dictionary> source = cv::aruco::getPredefinedDictionary(name);
  MarkerDictionary dictionary;
  dictionary.bits = source->markerSize;
  for (int id = 0; id < source->bytesList.rows; ++id) {
    const cv::Mat bits =
        cv::aruco::Dictionary::getBitsFromByteList(source->bytesList.rowRange(id, id + 1), dictionary.bits);
    std::uint64_t code = 0;
    for (int r = 0; r < dictionary.bits; ++r)
      for (int c = 0; c < dictionary.bits; ++c)
        if (bits.at<unsigned char>(r, c)) code |= std::uint64_t{1} << (r * dictionary.bits + c);
    dictionary.codes.push_back(code);
  }
  return dictionary;
}

template <typename From>
std::uint64_t rearranged(std::uint64_t code, int bits, From&& from) {
  std::uint64_t out = 0;
  for (int r = 0; r < bits; ++r)
    for (int c = 0; c < bits; ++c)
      if (code >> from(r, c) & 1) out |= std::uint64_t{1} << (r * bits + c);
  return out;
}

}  // namespace

std::vector<std::string> markerDictionaries() {
  std::vector<std::string> names;
  for (const Named& named : kNamed) names.emplace_back(named.name);
  return names;
}

const MarkerDictionary* markerDictionary(const std::string& name) {
  static std::mutex mutex;
  static std::map<std::string, MarkerDictionary> loaded;
  const std::lock_guard lock(mutex);
  if (const auto found = loaded.find(name); found != loaded.end()) return &found->second;
  for (const Named& named : kNamed)
    if (name == named.name) return &loaded.emplace(name, load(named.dictionary)).first->second;
  return nullptr;
}

std::uint64_t turnedCode(std::uint64_t code, int bits) {
  return rearranged(code, bits, [bits](int r, int c) { return (bits - 1 - c) * bits + r; });
}

std::uint64_t mirroredCode(std::uint64_t code, int bits) {
  return rearranged(code, bits, [bits](int r, int c) { return r * bits + bits - 1 - c; });
}

}  // namespace patina
