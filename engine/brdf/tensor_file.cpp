#include "engine/brdf/tensor_file.h"

#include <cstring>

#include "engine/base/text.h"

namespace patina {
namespace {

constexpr std::string_view kMagic("tensor_file\0", 12);
constexpr std::uint32_t kMostFields = 64;  // published files have 11 or 12
constexpr std::size_t kLongestName = 256;
constexpr std::size_t kMostDimensions = 8;

std::size_t bytesOf(TensorField::Type type) {
  switch (type) {
    case TensorField::Type::UInt8:
    case TensorField::Type::Int8:
      return 1;
    case TensorField::Type::UInt16:
    case TensorField::Type::Int16:
    case TensorField::Type::Float16:
      return 2;
    case TensorField::Type::UInt32:
    case TensorField::Type::Int32:
    case TensorField::Type::Float32:
      return 4;
    case TensorField::Type::UInt64:
    case TensorField::Type::Int64:
    case TensorField::Type::Float64:
      return 8;
  }
  return 0;
}

/// Walks through bytes and never beyond them.
class Cursor {
 public:
  explicit Cursor(std::string_view bytes) : bytes_(bytes) {}
  template <typename T>
  bool read(T& value) {
    if (bytes_.size() - at_ < sizeof value) return false;
    std::memcpy(&value, bytes_.data() + at_, sizeof value);
    at_ += sizeof value;
    return true;
  }
  bool read(std::size_t count, std::string_view& text) {
    if (bytes_.size() - at_ < count) return false;
    text = bytes_.substr(at_, count);
    at_ += count;
    return true;
  }

 private:
  std::string_view bytes_;
  std::size_t at_ = 0;
};

}  // namespace

std::size_t TensorField::count() const {
  return bytes.size() / bytesOf(type);
}

Result<std::map<std::string, TensorField, std::less<>>> parseTensorFile(std::string_view bytes,
                                                                        const std::string& where) {
  const auto malformed = [&](std::string what) {
    return Error{ErrorCode::Malformed, std::move(what), where, "fetch or copy the file again"};
  };
  const Error truncated = malformed("the list of fields is cut off");

  Cursor cursor(bytes);
  std::string_view magic;
  std::uint8_t major = 0, minor = 0;
  std::uint32_t fieldCount = 0;
  if (!cursor.read(kMagic.size(), magic) || magic != kMagic) {
    return malformed("this is not a tensor file: it doesn't begin with \"tensor_file\"");
  }
  if (!cursor.read(major) || !cursor.read(minor) || !cursor.read(fieldCount)) return truncated;
  if (major != 1) {
    return Error{ErrorCode::Unsupported,
                 "the tensor file is of version " + std::to_string(major) + "." + std::to_string(minor) +
                     ", and only 1.x is known",
                 where, "convert it to version 1.0"};
  }
  if (fieldCount > kMostFields) {
    return malformed("a tensor file of " + std::to_string(fieldCount) + " fields makes no sense");
  }

  std::map<std::string, TensorField, std::less<>> fields;
  for (std::uint32_t i = 0; i < fieldCount; ++i) {
    std::uint16_t nameLength = 0, rank = 0;
    std::uint8_t type = 0;
    std::uint64_t offset = 0;
    std::string_view name;
    if (!cursor.read(nameLength) || nameLength > kLongestName || !cursor.read(nameLength, name) ||
        !cursor.read(rank) || !cursor.read(type) || !cursor.read(offset)) {
      return truncated;
    }
    const std::string named = "field " + inQuotes(name);
    if (type < 1 || type > static_cast<std::uint8_t>(TensorField::Type::Float64)) {
      return malformed(named + " is of the unknown type " + std::to_string(type));
    }
    if (rank > kMostDimensions) {
      return malformed(named + " claims " + std::to_string(rank) + " dimensions");
    }
    TensorField field;
    field.type = static_cast<TensorField::Type>(type);
    const std::size_t available = offset <= bytes.size() ? bytes.size() - offset : 0;
    std::size_t needed = bytesOf(field.type);
    for (int d = 0; d < rank; ++d) {
      std::uint64_t size = 0;
      if (!cursor.read(size)) return truncated;
      // Checked before each product: it can't overflow, as neither factor is larger than the file.
      if (size == 0 || size > bytes.size() || needed > bytes.size()) {
        return malformed("the sizes of " + named + " don't fit into the file");
      }
      field.shape.push_back(static_cast<std::size_t>(size));
      needed *= static_cast<std::size_t>(size);
    }
    if (needed > available) {
      return malformed(named + " needs " + std::to_string(needed) + " bytes from " + std::to_string(offset) +
                       " on, but the file ends at " + std::to_string(bytes.size()));
    }
    field.bytes = bytes.substr(static_cast<std::size_t>(offset), needed);
    if (!fields.emplace(std::string(name), std::move(field)).second) {
      return malformed(named + " is there twice");
    }
  }
  return fields;
}

}  // namespace patina
