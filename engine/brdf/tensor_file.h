#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "engine/base/result.h"

namespace patina {

/// One array of a tensor file, still as bytes of the file.
struct TensorField {
  enum class Type : std::uint8_t {
    UInt8 = 1,
    Int8,
    UInt16,
    Int16,
    UInt32,
    Int32,
    UInt64,
    Int64,
    Float16,
    Float32,
    Float64
  };
  Type type = Type::UInt8;
  std::vector<std::size_t> shape;
  std::string_view bytes;  ///< exactly the product of `shape` times the size of `type`

  std::size_t count() const;
};

/// The fields of a tensor file by name; they point into `bytes`. Format (Dupuy and Jakob 2018,
/// little-endian): "tensor_file\0", version 1.0 as two bytes, number of fields (u32); each field: length of
/// its name (u16), name, rank (u16), type (u8), offset of the data in the file (u64), sizes (u64 each).
/// Errors: Malformed with what is wrong (no such header, truncated, an offset or a size that leaves the file,
/// two fields of one name), Unsupported (another version). Nothing is allocated beyond the list of fields.
Result<std::map<std::string, TensorField, std::less<>>> parseTensorFile(std::string_view bytes,
                                                                        const std::string& where);

}  // namespace patina
