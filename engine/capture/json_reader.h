#pragma once

#include <Eigen/Core>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "engine/base/result.h"

namespace patina {

/// Thrown inside the readers of `capture/` and caught where they end; never leaves this folder.
struct JsonFault {
  Error error;
};

/// The text as JSON, with a limit on depth and without a key given twice. `where` names the file. Throws
/// JsonFault (line and column named) for anything that is not JSON: bad UTF-8, NaN, a number too large for a
/// double.
nlohmann::json parseJson(std::string_view text, const std::string& where);

/// Reads one JSON object key by key, and knows afterwards which keys nobody asked for. Every getter throws
/// JsonFault that names file and key ("capture.json: photos[17].phase") for a wrong type or a value outside
/// of its range.
class JsonObject {
 public:
  /// `key` is the path of the object itself ("" for the whole file). The value must outlive this.
  JsonObject(const nlohmann::json& value, const std::string& where, std::string key);

  bool has(const std::string& name) const;
  double number(const std::string& name, double low, double high);
  double number(const std::string& name, double low, double high, double fallback);
  /// An integer; 3.0 is one, 3.5 isn't.
  int integer(const std::string& name, int low, int high);
  std::string text(const std::string& name);
  std::string text(const std::string& name, const std::string& fallback);
  JsonObject object(const std::string& name);
  /// The raw list, its length checked.
  const nlohmann::json& list(const std::string& name, std::size_t shortest, std::size_t longest);
  /// Exactly `count` numbers.
  std::vector<double> numbers(const std::string& name, std::size_t count, double low, double high);
  Eigen::Matrix3d matrix3(const std::string& name, double low, double high);
  /// As `matrix3`, orthonormal with determinant +1 within 1e-4; then made so exactly.
  Eigen::Matrix3d rotation(const std::string& name);

  /// Keys that are there and were not asked for.
  std::vector<std::string> unread() const;
  /// "photos[17].phase"
  std::string keyOf(const std::string& name) const;
  [[noreturn]] void fail(ErrorCode code, const std::string& name, const std::string& what,
                         const std::string& tryThis = {}) const;

 private:
  const nlohmann::json& required(const std::string& name);

  const nlohmann::json& value_;
  const std::string& where_;
  std::string key_;
  std::set<std::string> read_;
};

}  // namespace patina
