#pragma once

#include <cstdint>
#include <cstring>
#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

namespace patina::test {

/// Builds tensor files (RGL's container) by hand, whole ones and lying ones.
class TensorBuilder {
 public:
  struct Field {
    std::string name;
    std::uint8_t type = 10;  ///< 1: bytes, 10: single precision
    std::vector<std::uint64_t> shape;
    std::string bytes;
  };

  void floats(const std::string& name, std::vector<std::uint64_t> shape, const std::vector<float>& values) {
    Field field{name, 10, std::move(shape), std::string(values.size() * 4, '\0')};
    std::memcpy(field.bytes.data(), values.data(), field.bytes.size());
    fields.push_back(std::move(field));
  }
  void bytes(const std::string& name, const std::string& values) {
    fields.push_back({name, 1, {values.size()}, values});
  }
  Field& field(const std::string& name) {
    for (Field& f : fields) {
      if (f.name == name) return f;
    }
    throw std::logic_error("no such field");
  }
  void remove(const std::string& name) {
    std::erase_if(fields, [&](const Field& f) { return f.name == name; });
  }

  std::string build() const {
    std::string header("tensor_file\0\1\0", 14);
    const auto put = [](std::string& to, auto value) {
      to.append(reinterpret_cast<const char*>(&value), sizeof value);
    };
    put(header, static_cast<std::uint32_t>(fields.size()));
    std::size_t length = header.size();
    for (const Field& f : fields) length += 2 + f.name.size() + 2 + 1 + 8 + 8 * f.shape.size();
    std::string data;
    for (const Field& f : fields) {
      put(header, static_cast<std::uint16_t>(f.name.size()));
      header += f.name;
      put(header, static_cast<std::uint16_t>(f.shape.size()));
      put(header, f.type);
      put(header, static_cast<std::uint64_t>(length + data.size()));
      for (const std::uint64_t size : f.shape) put(header, size);
      data += f.bytes;
    }
    return header + data;
  }

  std::vector<Field> fields;
};

/// A small RGL file: `phis` incident azimuths over [first, last], three incident angles, and a value of
/// rgb(slice, channel) that is constant within a slice; ndf 2 and sigma 0.5, so that f cosO = rgb.
inline TensorBuilder smallRgl(const std::vector<float>& phis,
                              const std::function<float(int phi, int theta, int channel)>& rgb) {
  TensorBuilder file;
  const std::vector<float> thetas = {0.0f, 0.8f, 1.5707964f};
  const std::uint64_t slices = phis.size() * thetas.size();
  file.bytes("description", "made by hand");
  file.floats("phi_i", {phis.size()}, phis);
  file.floats("theta_i", {thetas.size()}, thetas);
  file.floats("sigma", {2, 3}, std::vector<float>(6, 0.5f));
  file.floats("ndf", {2, 3}, std::vector<float>(6, 2.0f));
  file.floats("vndf", {phis.size(), thetas.size(), 4, 5}, std::vector<float>(slices * 20, 1.0f));
  std::vector<float> values;
  for (std::size_t p = 0; p < phis.size(); ++p) {
    for (std::size_t t = 0; t < thetas.size(); ++t) {
      for (int c = 0; c < 3; ++c) {
        values.insert(values.end(), 4, rgb(static_cast<int>(p), static_cast<int>(t), c));
      }
    }
  }
  file.floats("rgb", {phis.size(), thetas.size(), 3, 2, 2}, values);
  file.bytes("jacobian", std::string(1, '\1'));
  return file;
}

}  // namespace patina::test
