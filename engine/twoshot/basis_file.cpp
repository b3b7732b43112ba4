#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "engine/base/dense.h"
#include "engine/base/text.h"
#include "engine/twoshot/basis.h"
#include "engine/twoshot/basis_format.h"
#include "engine/twoshot/mapping.h"
#include "engine/twoshot/quantised_rows.h"

namespace patina {
namespace {

namespace fs = std::filesystem;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

static_assert(std::endian::native == std::endian::little, "basis files are little-endian");

/// A whole file in the address space, read-only.
class FileMapping {
 public:
  static Result<std::shared_ptr<const FileMapping>> open(const fs::path& file) {
    const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (descriptor < 0) {
      return Error{ErrorCode::NotFound, std::string("The basis can't be opened: ") + std::strerror(errno),
                   file.string(), "check the path, or build one: patina-cli basis build FOLDER --out FILE"};
    }
    struct stat info {};
    if (::fstat(descriptor, &info) != 0 || !S_ISREG(info.st_mode)) {
      ::close(descriptor);
      return Error{ErrorCode::Malformed, "A basis is a plain file", file.string(),
                   "name the file that 'patina-cli basis build' wrote"};
    }
    if (info.st_size < 64) {
      ::close(descriptor);
      return Error{ErrorCode::Malformed, "This file is too short for a basis", file.string(), {}};
    }
    void* bytes = ::mmap(nullptr, info.st_size, PROT_READ, MAP_PRIVATE, descriptor, 0);
    ::close(descriptor);
    if (bytes == MAP_FAILED) {
      return Error{ErrorCode::NotFound, std::string("The basis can't be mapped: ") + std::strerror(errno),
                   file.string(), "free some memory, or limits on it (ulimit -v)"};
    }
    return std::shared_ptr<const FileMapping>(new FileMapping(bytes, info.st_size));
  }
  ~FileMapping() { ::munmap(bytes_, size_); }
  FileMapping(const FileMapping&) = delete;
  FileMapping& operator=(const FileMapping&) = delete;

  std::string_view content() const { return {static_cast<const char*>(bytes_), size_}; }
  template <typename T>
  const T* at(std::size_t offset) const {
    return reinterpret_cast<const T*>(static_cast<const char*>(bytes_) + offset);
  }

 private:
  FileMapping(void* bytes, std::size_t size) : bytes_(bytes), size_(size) {}
  void* bytes_;
  std::size_t size_;
};

/// Rows of cells at a time: 4096 x 300 floats are 5 MB, which caches share.
constexpr std::size_t kSlab = 4096;

class BasisFile : public Basis {
 public:
  BasisFile(std::shared_ptr<const FileMapping> mapping, BasisHeader header, const BasisLayout& layout)
      : mapping_(std::move(mapping)), header_(std::move(header)) {
    const Index k = header_.components, m = header_.columns;
    singular_ = Eigen::Map<const VectorXd>(mapping_->at<double>(layout.singularValues), k);
    coefficients_ = Eigen::Map<const MatrixXd>(mapping_->at<double>(layout.coefficients), k, m);
    gram_[0] = singular_.array().square().matrix().asDiagonal();
    root_[0] = singular_.asDiagonal();
    gram_[1] = Eigen::Map<const MatrixXd>(mapping_->at<double>(layout.trustedGram), k, k);
    // The trusted region leaves some components almost unseen: their eigenvalues may come out a rounding
    // below 0.
    const SymmetricEigen eigen = eigenOfSymmetric(gram_[1]);
    root_[1] = eigen.values.cwiseMax(0).cwiseSqrt().asDiagonal() * eigen.vectors.transpose();
    scales_ = mapping_->at<float>(layout.scales);
    cells_ = mapping_->at<std::uint32_t>(layout.cells);
    mean_ = mapping_->at<float>(layout.mean);
    lnReference_ = mapping_->at<float>(layout.lnReference);
    components_ = mapping_->at<std::int16_t>(layout.components);
    rowOf_.assign(kFoldedCells, -1);
    for (std::size_t i = 0; i < header_.cells; ++i) rowOf_[cells_[i]] = static_cast<std::int32_t>(i);
  }

  int componentCount() const override { return header_.components; }
  int columnCount() const override { return header_.columns; }
  std::size_t cellCount(BasisRegion region) const override {
    return 2 * (region == BasisRegion::All ? header_.cells : header_.trustedCells);
  }
  const std::vector<BasisMaterial>& materials() const override { return header_.materials; }
  const std::string& name() const override { return header_.name; }
  const std::string& source() const override { return header_.source; }
  std::uint64_t checksum() const override { return header_.dataChecksum; }
  const VectorXd& singularValues() const override { return singular_; }
  const MatrixXd& columnCoefficients() const override { return coefficients_; }
  const MatrixXd& gram(BasisRegion region) const override { return gram_[region == BasisRegion::Trusted]; }
  const MatrixXd& gramRoot(BasisRegion region) const override {
    return root_[region == BasisRegion::Trusted];
  }

  BasisRows rows(std::span<const HalfDiffAngles> angles, std::vector<int>* kept) const override;
  std::shared_ptr<const TabulatedBrdf> reconstruct(const MatrixXd& c, BrdfOrigin origin,
                                                   const std::stop_token& stop) const override;
  std::vector<float> posteriorSd(const MatrixXd& b, const MatrixXd& w, double scale,
                                 const std::stop_token& stop) const override;

 private:
  /// Calls visit(first, slab) for slabs of rows turned to floats, on all cores. False where it was stopped: a
  /// slab, which takes a few milliseconds, is finished, and no other begun.
  template <typename Visit>
  bool forSlabs(const std::stop_token& stop, const Visit& visit) const {
    std::atomic<bool> stopped = false;
    const std::size_t slabs = (header_.cells + kSlab - 1) / kSlab;
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, slabs, 1), [&](const auto& range) {
      RowMajorMatrixXf slab;
      for (std::size_t s = range.begin(); s < range.end(); ++s) {
        if (stop.stop_requested()) {
          stopped = true;
          return;
        }
        const std::size_t first = s * kSlab, count = std::min(kSlab, header_.cells - first);
        const std::size_t k = header_.components;
        slab.resize(static_cast<Index>(count), static_cast<Index>(k));
        decodeComponents(components_ + first * k, count * k, slab.data());
        visit(first, slab);
      }
    });
    return !stopped;
  }
  Eigen::Map<const Eigen::VectorXf> scales() const { return {scales_, header_.components}; }

  std::shared_ptr<const FileMapping> mapping_;
  BasisHeader header_;
  VectorXd singular_;
  MatrixXd coefficients_;
  MatrixXd gram_[2], root_[2];  ///< all, trusted
  const float* scales_;
  const std::uint32_t* cells_;
  const float *mean_, *lnReference_;
  const std::int16_t* components_;
  std::vector<std::int32_t> rowOf_;  ///< row of a folded cell, -1: not covered
};

struct Corner {
  std::int32_t row;
  double weight;
};

BasisRows BasisFile::rows(std::span<const HalfDiffAngles> angles, std::vector<int>* kept) const {
  const Index k = header_.components;
  BasisRows found;
  MatrixXd transposed(k, static_cast<Index>(angles.size()));
  std::vector<double> mean, lnReference, weight;
  std::vector<int> answered;
  Eigen::VectorXf sum(k);
  for (std::size_t a = 0; a < angles.size(); ++a) {
    const HalfDiffAngles folded{angles[a].thetaHRad, angles[a].thetaDRad, foldedPhiD(angles[a].phiDRad)};
    const DirectionPair pair = directionsFromHalfDiff(folded);
    if (!(pair.toLight.z() > 0) || !(pair.toView.z() > 0)) continue;
    const Eigen::Vector3d at = MerlGrid::coordinates(folded);
    int low[3], high[3];
    double part[3];
    constexpr int kSize[3] = {MerlGrid::kThetaH, MerlGrid::kThetaD, kFoldedPhiD};
    for (int d = 0; d < 3; ++d) {
      const double inside = std::clamp(at[d], 0.0, kSize[d] - 1.0);
      low[d] = static_cast<int>(inside);
      high[d] = std::min(low[d] + 1, kSize[d] - 1);
      part[d] = inside - low[d];
    }
    Corner corners[8];
    int count = 0;
    double total = 0;
    for (int c = 0; c < 8; ++c) {
      double w = 1;
      int index[3];
      for (int d = 0; d < 3; ++d) {
        const bool upper = (c >> d) & 1;
        index[d] = upper ? high[d] : low[d];
        w *= upper ? part[d] : 1 - part[d];
      }
      if (w <= 0) continue;
      const std::size_t cell =
          (static_cast<std::size_t>(index[0]) * MerlGrid::kThetaD + index[1]) * kFoldedPhiD + index[2];
      if (rowOf_[cell] < 0) continue;
      corners[count++] = {rowOf_[cell], w};
      total += w;
    }
    // A direction that leans on less than a thousandth of a covered cell has none beside it.
    if (total < 1e-3) continue;
    sum.setZero();
    double meanHere = 0, referenceHere = 0;
    for (int c = 0; c < count; ++c) {
      const auto w = static_cast<float>(corners[c].weight / total);
      addComponents(w, components_ + static_cast<std::size_t>(corners[c].row) * k, k, sum.data());
      meanHere += corners[c].weight / total * mean_[corners[c].row];
      referenceHere += corners[c].weight / total * lnReference_[corners[c].row];
    }
    transposed.col(static_cast<Index>(answered.size())) = sum.cwiseProduct(scales()).cast<double>();
    answered.push_back(static_cast<int>(a));
    mean.push_back(meanHere);
    lnReference.push_back(referenceHere);
    weight.push_back(mappingWeight(pair.toLight.z(), pair.toView.z()));
  }
  const auto n = static_cast<Index>(answered.size());
  found.components = transposed.leftCols(n).transpose();
  found.mean = Eigen::Map<const VectorXd>(mean.data(), n);
  found.lnReference = Eigen::Map<const VectorXd>(lnReference.data(), n);
  found.weight = Eigen::Map<const VectorXd>(weight.data(), n);
  if (kept) *kept = std::move(answered);
  return found;
}

std::shared_ptr<const TabulatedBrdf> BasisFile::reconstruct(const MatrixXd& c, BrdfOrigin origin,
                                                            const std::stop_token& stop) const {
  if (c.rows() != header_.components || c.cols() != 3) {
    throw std::invalid_argument("Basis::reconstruct: coefficients are k x 3");
  }
  TabulatedBrdf::Planes planes;
  for (auto& plane : planes) plane.assign(MerlGrid::kCells, -1.0);
  const RowMajorMatrixXf scaled = (scales().asDiagonal() * c.cast<float>()).eval();
  const bool whole = forSlabs(stop, [&](std::size_t first, const RowMajorMatrixXf& slab) {
    RowMajorMatrixXf mapped;
    multiply(slab, scaled, mapped);
    for (Index i = 0; i < slab.rows(); ++i) {
      const std::size_t row = first + i, cell = cells_[row];
      const CellCosines cosines = foldedCosines(cell);
      const double weight = mappingWeight(cosines.light, cosines.view);
      const std::size_t base = cell / kFoldedPhiD * MerlGrid::kPhiD;
      const std::size_t phi = cell % kFoldedPhiD;
      for (int channel = 0; channel < 3; ++channel) {
        const double value =
            unmapBrdf(static_cast<double>(mapped(i, channel)) + mean_[row], weight, lnReference_[row]);
        planes[channel][base + phi] = value;
        planes[channel][base + MerlGrid::kPhiD - 1 - phi] = value;
      }
    }
  });
  if (!whole) return nullptr;
  return std::make_shared<TabulatedBrdf>(std::move(planes), std::move(origin));
}

std::vector<float> BasisFile::posteriorSd(const MatrixXd& b, const MatrixXd& w, double scale,
                                          const std::stop_token& stop) const {
  const Index k = header_.components;
  if (b.cols() != k || w.rows() != b.rows() || w.cols() != b.rows()) {
    throw std::invalid_argument("Basis::posteriorSd: B is r x k, W is r x r");
  }
  // q^T B^T W B q = |root(W) B q|^2.
  MatrixXd reduced(0, k);
  if (w.rows() > 0) {
    const SymmetricEigen eigen = eigenOfSymmetric(w);
    reduced = eigen.values.cwiseMax(0).cwiseSqrt().asDiagonal() * product(eigen.vectors, true, b, false);
  }
  const RowMajorMatrixXf turned =
      (scales().asDiagonal() * reduced.transpose().cast<float>()).eval();  // k x r
  const Eigen::ArrayXf squares = scales().array().square();
  std::vector<float> sd(MerlGrid::kCells, -1.0f);
  const bool whole = forSlabs(stop, [&](std::size_t first, const RowMajorMatrixXf& slab) {
    RowMajorMatrixXf seen;
    multiply(slab, turned, seen);
    for (Index i = 0; i < slab.rows(); ++i) {
      const float prior = weightedSquares(slab.row(i).data(), squares.data(), k);
      const float variance = std::max(prior - seen.row(i).squaredNorm(), 0.0f);
      const auto value = static_cast<float>(std::sqrt(scale * variance));
      const std::size_t cell = cells_[first + i];
      const std::size_t base = cell / kFoldedPhiD * MerlGrid::kPhiD, phi = cell % kFoldedPhiD;
      sd[base + phi] = value;
      sd[base + MerlGrid::kPhiD - 1 - phi] = value;
    }
  });
  if (!whole) return {};
  return sd;
}

}  // namespace

Result<BasisPtr> openBasis(const fs::path& file, const JobContext& job) {
  Result<std::shared_ptr<const FileMapping>> mapping = FileMapping::open(file);
  if (!mapping) return mapping.error();
  const std::string_view content = (*mapping)->content();
  const std::string where = file.string();
  const auto malformed = [&](const std::string& what) {
    return Error{ErrorCode::Malformed, what, where, "build the basis again: patina-cli basis build"};
  };
  if (content.substr(0, 16) != std::string_view(kBasisMagic, 16)) {
    return Error{
        ErrorCode::Malformed, "This file is not a basis of Patina's", where,
        "name a file that 'patina-cli basis build' wrote; measured BRDFs themselves go to basis build"};
  }
  std::uint64_t headerBytes = 0, headerChecksum = 0;
  std::memcpy(&headerBytes, content.data() + 16, 8);
  if (headerBytes > 64u << 20 || content.size() < 32 + headerBytes) {
    return malformed("The basis is cut off inside its header");
  }
  const std::string_view text = content.substr(24, headerBytes);
  std::memcpy(&headerChecksum, content.data() + 24 + headerBytes, 8);
  if (contentChecksum(text) != headerChecksum)
    return malformed("The basis' header doesn't match its checksum");
  Result<BasisHeader> header = parseBasisHeader(text, where);
  if (!header) return header.error();
  const std::size_t dataStart = 32 + headerBytes;
  const BasisLayout layout = basisLayout(*header, dataStart);
  if (layout.end != content.size()) {
    return malformed("The basis should have " + std::to_string(layout.end) + " bytes and has " +
                     std::to_string(content.size()));
  }
  if (job.cancelled()) return Error{ErrorCode::Cancelled, "Cancelled", where, {}};
  if (contentChecksum(content.substr(dataStart)) != header->dataChecksum) {
    return malformed("The basis' content doesn't match its checksum: the file was damaged");
  }
  const auto* cells = (*mapping)->at<std::uint32_t>(layout.cells);
  for (std::size_t i = 0; i < header->cells; ++i) {
    if (cells[i] >= kFoldedCells || (i > 0 && cells[i] <= cells[i - 1])) {
      return malformed("The basis' list of cells is out of order");
    }
  }
  // The large arrays are covered by the checksum; of the small ones a NaN would spread everywhere.
  const std::size_t k = header->components, m = header->columns;
  for (const auto& [offset, count] :
       {std::pair{layout.singularValues, k}, std::pair{layout.coefficients, k * m},
        std::pair{layout.trustedGram, k * k}}) {
    const auto* values = (*mapping)->at<double>(offset);
    if (!std::all_of(values, values + count, [](double value) { return std::isfinite(value); })) {
      return malformed("The basis holds numbers that are not finite");
    }
  }
  return BasisPtr(std::make_shared<BasisFile>(*mapping, *header, layout));
}

}  // namespace patina
