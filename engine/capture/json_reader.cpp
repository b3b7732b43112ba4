#include "engine/capture/json_reader.h"

#include <Eigen/LU>
#include <Eigen/SVD>
#include <cmath>
#include <cstdio>

#include "engine/base/text.h"

namespace patina {
namespace {

using Json = nlohmann::json;

constexpr int kDeepestNesting = 32;          // our formats need 4; more is an attack or a mistake
constexpr double kRotationTolerance = 1e-4;  // four decimals in a hand-written file
constexpr double kRotationExact = 1e-12;     // this close, a rotation is left as it is written

/// "a number", "text", ...: what a value is, to a person.
std::string kindOf(const Json& value) {
  switch (value.type()) {
    case Json::value_t::null:
      return "null";
    case Json::value_t::object:
      return "an object {...}";
    case Json::value_t::array:
      return "a list [...]";
    case Json::value_t::string:
      return "text";
    case Json::value_t::boolean:
      return "true or false";
    default:
      return "a number";
  }
}

std::string shown(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.10g", value);
  return text;
}

std::string lineAndColumn(std::string_view text, std::size_t byte) {
  const std::size_t at = std::min(byte > 0 ? byte - 1 : 0, text.size());
  std::size_t line = 1, column = 1;
  for (std::size_t i = 0; i < at; ++i) {
    if (text[i] == '\n') {
      ++line;
      column = 1;
    } else {
      ++column;
    }
  }
  return "line " + std::to_string(line) + ", column " + std::to_string(column);
}

}  // namespace

Json parseJson(std::string_view text, const std::string& where) {
  // One set of names for each object that is open, to find a key given twice (the parser would keep the last,
  // silently).
  std::vector<std::set<std::string>> open;
  const Json::parser_callback_t watch = [&](int depth, Json::parse_event_t event, Json& parsed) {
    if (depth > kDeepestNesting) {
      throw JsonFault{{ErrorCode::Malformed,
                       "the JSON is nested more than " + std::to_string(kDeepestNesting) + " levels deep",
                       where, "write the file again as the capture format says"}};
    }
    if (event == Json::parse_event_t::object_start) open.emplace_back();
    if (event == Json::parse_event_t::object_end) open.pop_back();
    if (event == Json::parse_event_t::key && !open.back().insert(parsed.get<std::string>()).second) {
      throw JsonFault{{ErrorCode::Malformed,
                       "the key " + inQuotes(parsed.get<std::string>()) + " is given twice in one object",
                       where, "remove one of the two"}};
    }
    return true;
  };
  try {
    return Json::parse(text.begin(), text.end(), watch);
  } catch (const Json::parse_error& failure) {
    throw JsonFault{{ErrorCode::Malformed, "the file is not valid JSON",
                     where + ": " + lineAndColumn(text, failure.byte),
                     "correct that place (numbers such as NaN are not JSON; text must be UTF-8)"}};
  } catch (const Json::exception&) {
    throw JsonFault{{ErrorCode::Malformed, "the file holds a number too large for any computer number", where,
                     "look for a number with a very large exponent, such as 1e999"}};
  }
}

JsonObject::JsonObject(const Json& value, const std::string& where, std::string key)
    : value_(value), where_(where), key_(std::move(key)) {
  if (!value_.is_object()) {
    throw JsonFault{{ErrorCode::Malformed, "an object {...} is needed here, and it is " + kindOf(value_),
                     key_.empty() ? where_ : where_ + ": " + key_, "write it as the capture format says"}};
  }
}

std::string JsonObject::keyOf(const std::string& name) const {
  std::string key = key_;
  if (!key.empty()) key += '.';
  return key += name;
}

void JsonObject::fail(ErrorCode code, const std::string& name, const std::string& what,
                      const std::string& tryThis) const {
  throw JsonFault{
      {code, what, where_ + ": " + keyOf(name), tryThis.empty() ? "correct this key in the file" : tryThis}};
}

bool JsonObject::has(const std::string& name) const {
  return value_.contains(name);
}

const Json& JsonObject::required(const std::string& name) {
  read_.insert(name);
  const auto found = value_.find(name);
  if (found != value_.end()) return *found;
  std::vector<std::string> others;
  for (const auto& [key, ignored] : value_.items()) {
    if (!read_.contains(key)) others.push_back(key);
  }
  const std::string nearest = nearestWord(name, others);
  fail(ErrorCode::Malformed, name, "the required key " + inQuotes(keyOf(name)) + " is missing",
       nearest.empty()
           ? "add it, as the capture format says"
           : "the file has " + inQuotes(keyOf(nearest)) + "; rename it if that is what was meant");
}

double JsonObject::number(const std::string& name, double low, double high) {
  const Json& value = required(name);
  if (!value.is_number())
    fail(ErrorCode::Malformed, name, "a number is needed here, and it is " + kindOf(value));
  const double number = value.get<double>();
  if (!(number >= low && number <= high)) {
    fail(ErrorCode::Invalid, name,
         "the number " + shown(number) + " is outside of what makes sense, " + shown(low) + " to " +
             shown(high));
  }
  return number;
}

double JsonObject::number(const std::string& name, double low, double high, double fallback) {
  return has(name) ? number(name, low, high) : fallback;
}

int JsonObject::integer(const std::string& name, int low, int high) {
  const double value = number(name, low, high);
  if (value != std::floor(value)) {
    fail(ErrorCode::Malformed, name, "a whole number is needed here, and it is " + shown(value));
  }
  return static_cast<int>(value);
}

std::string JsonObject::text(const std::string& name) {
  const Json& value = required(name);
  if (!value.is_string()) fail(ErrorCode::Malformed, name, "text is needed here, and it is " + kindOf(value));
  return value.get<std::string>();
}

std::string JsonObject::text(const std::string& name, const std::string& fallback) {
  return has(name) ? text(name) : fallback;
}

JsonObject JsonObject::object(const std::string& name) {
  return JsonObject(required(name), where_, keyOf(name));
}

const Json& JsonObject::list(const std::string& name, std::size_t shortest, std::size_t longest) {
  const Json& value = required(name);
  if (!value.is_array()) {
    fail(ErrorCode::Malformed, name, "a list [...] is needed here, and it is " + kindOf(value));
  }
  if (value.size() < shortest || value.size() > longest) {
    const std::string wanted = shortest == longest
                                   ? std::to_string(shortest)
                                   : std::to_string(shortest) + " to " + std::to_string(longest);
    fail(ErrorCode::Malformed, name,
         "the list has " + std::to_string(value.size()) + " entries, and " + wanted + " are needed");
  }
  return value;
}

std::vector<double> JsonObject::numbers(const std::string& name, std::size_t count, double low, double high) {
  const Json& values = list(name, count, count);
  std::vector<double> result;
  for (std::size_t i = 0; i < count; ++i) {
    const std::string entry = name + "[" + std::to_string(i) + "]";
    if (!values[i].is_number()) {
      fail(ErrorCode::Malformed, entry, "a number is needed here, and it is " + kindOf(values[i]));
    }
    const double number = values[i].get<double>();
    if (!(number >= low && number <= high)) {
      fail(ErrorCode::Invalid, entry,
           "the number " + shown(number) + " is outside of what makes sense, " + shown(low) + " to " +
               shown(high));
    }
    result.push_back(number);
  }
  return result;
}

Eigen::Matrix3d JsonObject::matrix3(const std::string& name, double low, double high) {
  const Json& rows = list(name, 3, 3);
  Eigen::Matrix3d matrix;
  for (int row = 0; row < 3; ++row) {
    const std::string rowName = name + "[" + std::to_string(row) + "]";
    const Json& values = rows[static_cast<std::size_t>(row)];
    if (!values.is_array() || values.size() != 3) {
      fail(ErrorCode::Malformed, rowName, "a row of three numbers is needed here");
    }
    for (int column = 0; column < 3; ++column) {
      const std::string entry = rowName + "[" + std::to_string(column) + "]";
      const Json& value = values[static_cast<std::size_t>(column)];
      if (!value.is_number()) {
        fail(ErrorCode::Malformed, entry, "a number is needed here, and it is " + kindOf(value));
      }
      matrix(row, column) = value.get<double>();
      if (!(matrix(row, column) >= low && matrix(row, column) <= high)) {
        fail(ErrorCode::Invalid, entry,
             "the number " + shown(matrix(row, column)) + " is outside of what makes sense, " + shown(low) +
                 " to " + shown(high));
      }
    }
  }
  return matrix;
}

Eigen::Matrix3d JsonObject::rotation(const std::string& name) {
  const Eigen::Matrix3d matrix =
      matrix3(name, -2, 2);  // a rotation's entries lie in -1..1; the message below says more
  const double error = (matrix * matrix.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (!(error <= kRotationTolerance)) {
    fail(ErrorCode::Invalid, name,
         "this matrix is not a rotation: its rows are not unit vectors at right angles",
         "write the rotation matrix row by row, with at least four decimals");
  }
  if (matrix.determinant() < 0) {
    fail(ErrorCode::Invalid, name, "this matrix is a rotation with a reflection (its determinant is -1)",
         "turn the sign of one axis; the frames of the format are right-handed");
  }
  if (error <= kRotationExact) return matrix;
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(matrix, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return svd.matrixU() * svd.matrixV().transpose();
}

std::vector<std::string> JsonObject::unread() const {
  std::vector<std::string> keys;
  for (const auto& [key, ignored] : value_.items()) {
    if (!read_.contains(key)) keys.push_back(key);
  }
  return keys;
}

}  // namespace patina
