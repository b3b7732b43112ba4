#pragma once

#include <optional>
#include <string>
#include <utility>
#include <variant>

namespace patina {

/// What kind of thing went wrong. `Cancelled` is not a failure of anything; it travels the same road so that
/// callers have one place to look.
enum class ErrorCode {
  NotFound,     ///< a file or folder that is not there
  Malformed,    ///< a file that is there but is not what it says it is
  Invalid,      ///< well-formed, but the values make no sense together
  Unsupported,  ///< a kind or version that this program does not handle
  Refused,      ///< something we will not do (a path that leaves its bundle)
  WriteFailed,  ///< no space, no permission
  Cancelled,
};

/// A failure of the outside world, told to a person: what happened, where, and what to try.
/// Our own bugs throw; see CONTRIBUTING.md, "Errors".
struct Error {
  ErrorCode code = ErrorCode::Invalid;
  std::string what;     ///< one sentence, no trailing full stop
  std::string where;    ///< file, key, photo or texel; may be empty
  std::string tryThis;  ///< what the person can do about it; may be empty

  /// "what (where). Try: tryThis." on one line.
  std::string sentence() const;
};

/// A value or an Error. Never both, never neither.
template <typename T>
class [[nodiscard]] Result {
 public:
  Result(T value) : content_(std::in_place_index<0>, std::move(value)) {}
  Result(Error error) : content_(std::in_place_index<1>, std::move(error)) {}

  bool ok() const { return content_.index() == 0; }
  explicit operator bool() const { return ok(); }

  /// The value. Throws std::bad_variant_access where there is none: asking without looking is our own bug.
  T& value() & { return std::get<0>(content_); }
  const T& value() const& { return std::get<0>(content_); }
  T&& value() && { return std::get<0>(std::move(content_)); }
  T& operator*() & { return value(); }
  const T& operator*() const& { return value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }

  const Error& error() const { return std::get<1>(content_); }

 private:
  std::variant<T, Error> content_;
};

/// Success without a value.
struct Done {};
using Status = Result<Done>;

}  // namespace patina
