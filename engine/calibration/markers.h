#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace patina {

/// The codes of a dictionary of square markers, as OpenCV's aruco module defines them.
struct MarkerDictionary {
  int bits = 6;                      ///< a side, without the black border of one cell
  std::vector<std::uint64_t> codes;  ///< by id; bit r * bits + c is the cell in row r, column c: 1 white

  /// Side in cells, the border included.
  int cells() const { return bits + 2; }
  bool white(int id, int row, int column) const {
    return codes[static_cast<std::size_t>(id)] >> (row * bits + column) & 1;
  }
};

/// By a name of `markerDictionaries()`; null: no such name. Stays valid. Threading: any.
const MarkerDictionary* markerDictionary(const std::string& name);

/// The code turned by 90 degrees clockwise, and swapped left and right.
std::uint64_t turnedCode(std::uint64_t code, int bits);
std::uint64_t mirroredCode(std::uint64_t code, int bits);

}  // namespace patina
