#include <sys/mman.h>
#include <unistd.h>

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string>
#include <string_view>

#include "engine/brdf/merl_grid.h"
#include "engine/twoshot/basis.h"
#include "engine/twoshot/basis_format.h"

namespace {

using namespace patina;

/// The same file with checksums that fit its content, as far as its header can be read: else hardly an input
/// would get past them.
std::string withChecksums(std::string file) {
  std::uint64_t headerBytes = 0;
  if (file.size() < 32) return file;
  std::memcpy(&headerBytes, file.data() + 16, 8);
  if (headerBytes > file.size() - 32) return file;
  auto header = parseBasisHeader(std::string_view(file).substr(24, headerBytes), "basis");
  if (!header) return file;
  // The arrays lie at multiples of 64 from the file's start: the padding before them changes with the
  // header's length. A checksum has 16 digits whatever it is, so that the length is known before.
  const std::string data = file.substr(32 + headerBytes);
  const auto padding = [](std::size_t start) {
    return (kBasisAlignment - start % kBasisAlignment) % kBasisAlignment;
  };
  const std::uint64_t length = basisHeaderJson(*header).size();
  const std::size_t before = padding(32 + headerBytes), after = padding(32 + length);
  const std::string arrays = data.size() >= before ? std::string(after, '\0') + data.substr(before) : data;
  header->dataChecksum = contentChecksum(arrays);
  const std::string text = basisHeaderJson(*header);
  const std::uint64_t checksum = contentChecksum(text);
  std::string out = file.substr(0, 16);
  out.append(reinterpret_cast<const char*>(&length), 8);
  out += text;
  out.append(reinterpret_cast<const char*>(&checksum), 8);
  return out + arrays;
}

/// Opens the bytes as a file and asks it everything.
void open(const std::string& bytes, bool whole) {
  const int file = ::memfd_create("basis", MFD_CLOEXEC);
  if (file < 0) std::abort();
  if (::write(file, bytes.data(), bytes.size()) != static_cast<ssize_t>(bytes.size())) std::abort();
  const auto basis = openBasis("/proc/self/fd/" + std::to_string(file));
  ::close(file);
  if (!basis) {
    if (basis.error().what.empty() || basis.error().sentence().size() > 4000) std::abort();
    return;
  }
  const Basis& found = **basis;
  std::vector<HalfDiffAngles> angles;
  for (std::size_t cell = 0; cell < MerlGrid::kCells; cell += 9973) angles.push_back(MerlGrid::centre(cell));
  std::vector<int> kept;
  const BasisRows rows = found.rows(angles, &kept);
  if (rows.size() > static_cast<Eigen::Index>(angles.size()) ||
      kept.size() != static_cast<std::size_t>(rows.size()) ||
      rows.components.cols() != found.componentCount())
    std::abort();
  if (!whole) return;
  const Eigen::Index k = found.componentCount();
  if (!found.reconstruct(Eigen::MatrixXd::Ones(k, 3), {}, {})) std::abort();
  if (found.posteriorSd(Eigen::MatrixXd::Identity(k, k), 0.5 * Eigen::MatrixXd::Identity(k, k), 1, {})
          .size() != MerlGrid::kCells)
    std::abort();
}

}  // namespace

/// Any bytes as a basis file, as they are and with checksums that fit. Tables of the whole grid, 100 MB a
/// time, only for every 256th.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static unsigned counter = 0;
  const std::string bytes(reinterpret_cast<const char*>(data), size);
  open(bytes, false);
  const std::string fitting = withChecksums(bytes);
  if (fitting != bytes) open(fitting, counter++ % 256 == 0);
  return 0;
}
