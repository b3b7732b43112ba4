#include <fcntl.h>
#include <sys/stat.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <mutex>

#include "engine/base/dense.h"
#include "engine/base/file.h"
#include "engine/base/text.h"
#include "engine/brdf/brdf_file.h"
#include "engine/twoshot/basis.h"
#include "engine/twoshot/basis_format.h"
#include "engine/twoshot/basis_source.h"
#include "engine/twoshot/mapping.h"

namespace patina {
namespace {

namespace fs = std::filesystem;
using Eigen::Index;
using Eigen::MatrixXd;

/// Folded cells at a time. Times 300 columns: 10 MB of doubles, and as much again for the mapped ones.
constexpr std::size_t kSlab = 4096;
/// A material must cover this share of the reachable cells.
constexpr double kLeastCoverage = 0.5;

Error writeFailed(const fs::path& file) {
  return Error{ErrorCode::WriteFailed, std::string("The basis can't be written: ") + std::strerror(errno),
               file.string(),
               "free some space there (a basis of 100 materials takes 0.3 GB, and 0.6 GB beside it while it "
               "is made), or "
               "name another place"};
}

/// A file that is removed unless it is kept, written and read at offsets from any thread.
class ScratchFile {
 public:
  static Result<ScratchFile> create(const fs::path& beside, const char* what) {
    ScratchFile scratch;
    std::string pattern =
        (beside.parent_path() / ("." + beside.filename().string() + "." + what + "-XXXXXX")).string();
    scratch.descriptor_ = ::mkostemp(pattern.data(), O_CLOEXEC);
    if (scratch.descriptor_ < 0) return writeFailed(beside);
    scratch.path_ = pattern;
    return scratch;
  }
  ScratchFile(ScratchFile&& other) noexcept
      : path_(std::exchange(other.path_, {})), descriptor_(std::exchange(other.descriptor_, -1)) {}
  ScratchFile& operator=(ScratchFile&&) = delete;
  ~ScratchFile() {
    if (descriptor_ >= 0) ::close(descriptor_);
    if (!path_.empty()) ::unlink(path_.c_str());
  }

  bool write(const void* bytes, std::size_t count, std::size_t offset) const {
    const char* from = static_cast<const char*>(bytes);
    while (count > 0) {
      const ssize_t done = ::pwrite(descriptor_, from, count, static_cast<off_t>(offset));
      if (done < 0 && errno == EINTR) continue;
      if (done <= 0) return false;
      from += done, offset += done, count -= done;
    }
    return true;
  }
  bool read(void* bytes, std::size_t count, std::size_t offset) const {
    char* to = static_cast<char*>(bytes);
    while (count > 0) {
      const ssize_t done = ::pread(descriptor_, to, count, static_cast<off_t>(offset));
      if (done < 0 && errno == EINTR) continue;
      if (done <= 0) return false;
      to += done, offset += done, count -= done;
    }
    return true;
  }
  /// Flushes and moves it to its final place.
  bool keepAs(const fs::path& file) {
    if (::fchmod(descriptor_, 0644) != 0 || ::fsync(descriptor_) != 0) return false;
    if (::rename(path_.c_str(), file.c_str()) != 0) return false;
    path_.clear();
    return true;
  }

 private:
  ScratchFile() = default;
  std::string path_;
  int descriptor_ = -1;
};

/// The reachable folded cells, in order.
std::vector<std::uint32_t> reachableCells() {
  std::vector<std::uint32_t> cells;
  for (std::size_t cell = 0; cell < kFoldedCells; ++cell) {
    if (foldedCellReachable(cell)) cells.push_back(static_cast<std::uint32_t>(cell));
  }
  return cells;
}

/// Values of one material at folded cells, 3 floats each: the mean over the pairs of directions that symmetry
/// makes equal, NaN where none is known.
void evaluateFolded(const Brdf& brdf, std::span<const std::uint32_t> cells, std::span<Eigen::Array3f> out) {
  const auto unknown = Eigen::Array3f::Constant(std::numeric_limits<float>::quiet_NaN());
  if (const auto* table = dynamic_cast<const TabulatedBrdf*>(&brdf)) {
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const std::size_t base = cells[i] / kFoldedPhiD * MerlGrid::kPhiD, phi = cells[i] % kFoldedPhiD;
      Eigen::Array3d sum = Eigen::Array3d::Zero();
      int count = 0;
      for (const std::size_t cell : {base + phi, base + MerlGrid::kPhiD - 1 - phi}) {
        if (!table->valid(cell)) continue;
        for (int c = 0; c < 3; ++c) sum[c] += table->planes()[c][cell];
        ++count;
      }
      out[i] = count > 0 ? Eigen::Array3f((sum / count).cast<float>()) : Eigen::Array3f(unknown);
    }
    return;
  }
  const bool symmetric = brdf.origin().format == "neural";
  std::vector<HalfDiffAngles> angles(cells.size());
  std::vector<Eigen::Array3f> values(cells.size());
  std::vector<int> counts(cells.size(), 0);
  std::fill(out.begin(), out.end(), Eigen::Array3f::Zero());
  for (int variant = 0; variant < (symmetric ? 1 : 4); ++variant) {
    for (std::size_t i = 0; i < cells.size(); ++i) {
      angles[i] = foldedCentre(cells[i]);
      const double phi = angles[i].phiDRad;
      angles[i].phiDRad = variant == 0 ? phi : variant == 1 ? -phi : variant == 2 ? M_PI - phi : phi - M_PI;
    }
    brdf.evaluateMany(angles, values);
    for (std::size_t i = 0; i < cells.size(); ++i) {
      if (!values[i].allFinite() || (values[i] < 0).any()) continue;
      out[i] += values[i];
      ++counts[i];
    }
  }
  for (std::size_t i = 0; i < cells.size(); ++i) {
    out[i] = counts[i] > 0 ? Eigen::Array3f(out[i] / static_cast<float>(counts[i])) : Eigen::Array3f(unknown);
  }
}

float medianOf(std::span<float> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 == 1) return *middle;
  return (*middle + *std::max_element(values.begin(), middle)) / 2;
}

/// Everything between the evaluated materials and the file.
class Builder {
 public:
  Builder(const BasisSource& source, const fs::path& out, const BasisBuildOptions& options,
          const JobContext& job)
      : source_(source), out_(out), options_(options), job_(job) {}

  Result<BasisPtr> build() {
    reachable_ = reachableCells();
    Result<ScratchFile> raw = ScratchFile::create(out_, "columns");
    if (!raw) return raw.error();
    raw_ = &*raw;
    for (Status (Builder::*step)() : {&Builder::evaluate, &Builder::map, &Builder::decompose}) {
      Status done = (this->*step)();
      if (!done) return done.error();
      if (job_.cancelled()) return cancelled();
    }
    Status written = writeComponents();
    if (!written) return written.error();
    return openBasis(out_, job_);
  }

 private:
  Error cancelled() const {
    return Error{ErrorCode::Cancelled, "Building the basis was cancelled", out_.string(), {}};
  }
  Index columns() const { return static_cast<Index>(3 * source_.count()); }
  /// Columns of a slab, as they lie in the scratch file: material after material, 3 floats a cell.
  std::size_t rawOffset(std::size_t material, std::size_t cell) const {
    return (material * reachable_.size() + cell) * sizeof(Eigen::Array3f);
  }

  // First pass: every material on every reachable cell, to the scratch file.
  Status evaluate() {
    std::atomic<std::size_t> done{0};
    std::mutex mutex;
    Status outcome = Done{};
    header_.materials.resize(source_.count());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, source_.count(), 1), [&](const auto& range) {
      std::vector<Eigen::Array3f> values(kSlab);
      for (std::size_t i = range.begin(); i < range.end() && !job_.cancelled(); ++i) {
        {
          const std::lock_guard lock(mutex);
          if (!outcome) return;
        }
        const auto failed = [&](Error error) {
          const std::lock_guard lock(mutex);
          if (outcome) outcome = std::move(error);
        };
        Result<BrdfPtr> brdf = source_.open(i, header_.materials[i]);
        if (!brdf) return failed(brdf.error());
        std::size_t covered = 0;
        ContentChecksum sum;
        for (std::size_t first = 0; first < reachable_.size() && !job_.cancelled(); first += kSlab) {
          const std::size_t count = std::min(kSlab, reachable_.size() - first);
          const std::span slab(values.data(), count);
          evaluateFolded(**brdf, std::span(reachable_).subspan(first, count), slab);
          for (const Eigen::Array3f& value : slab) covered += std::isfinite(value[0]);
          sum.add(slab.data(), slab.size_bytes());
          if (!raw_->write(slab.data(), slab.size_bytes(), rawOffset(i, first)))
            return failed(writeFailed(out_));
        }
        if (header_.materials[i].bytes == 0) header_.materials[i].checksum = sum.value();
        if (!job_.cancelled() && covered < kLeastCoverage * reachable_.size()) {
          return failed(Error{ErrorCode::Invalid,
                              header_.materials[i].name + " covers only " +
                                  std::to_string(static_cast<int>(100.0 * covered / reachable_.size())) +
                                  " % of the directions: too few for a column of a basis",
                              header_.materials[i].name, "leave it out"});
        }
        job_.progress("map", static_cast<std::int64_t>(++done), static_cast<std::int64_t>(source_.count()),
                      "materials");
      }
    });
    return outcome;
  }

  // Second pass: mapped and mean-free columns, slab by slab, in place of the raw ones; and their Gram
  // matrices.
  Status map() {
    const Index m = columns();
    const std::size_t slabs = (reachable_.size() + kSlab - 1) / kSlab;
    // Fixed stripes of slabs, summed in order: the same basis whatever the number of threads.
    struct Sums {
      MatrixXd all, trusted;
    };
    constexpr std::size_t kStripes = 16;
    std::vector<Sums> sums(kStripes, Sums{MatrixXd::Zero(m, m), MatrixXd::Zero(m, m)});
    mean_.assign(reachable_.size(), 0);
    lnReference_.assign(reachable_.size(), 0);
    usable_.assign(reachable_.size(), 0);
    std::atomic<bool> broken{false};
    tbb::parallel_for(std::size_t{0}, kStripes, [&](std::size_t stripe) {
      RowMajorMatrixXf raw;
      MatrixXd all, trusted;
      std::vector<float> sorted(m);
      for (std::size_t s = stripe; s < slabs && !job_.cancelled() && !broken; s += kStripes) {
        const std::size_t first = s * kSlab, count = std::min(kSlab, reachable_.size() - first);
        if (!readSlab(first, count, raw)) {
          broken = true;
          return;
        }
        Index usable = 0, safe = 0;
        all.resize(static_cast<Index>(count), m);
        trusted.resize(static_cast<Index>(count), m);
        for (std::size_t i = 0; i < count; ++i) {
          auto row = raw.row(static_cast<Index>(i));
          if (!row.allFinite()) continue;
          const std::size_t cell = reachable_[first + i];
          const CellCosines cosines = foldedCosines(cell);
          const double weight = mappingWeight(cosines.light, cosines.view);
          std::copy(row.data(), row.data() + m, sorted.begin());
          const double lnReference = std::log(medianOf(sorted) * weight + kMappingEpsilon);
          Eigen::RowVectorXd mapped(m);
          for (Index j = 0; j < m; ++j) mapped[j] = mapBrdf(row[j], weight, lnReference);
          const double mean = mapped.mean();
          mapped.array() -= mean;
          row = mapped.cast<float>();
          mean_[first + i] = static_cast<float>(mean);
          lnReference_[first + i] = static_cast<float>(lnReference);
          usable_[first + i] = foldedCellTrusted(cell) ? 2 : 1;
          all.row(usable++) = mapped;
          if (usable_[first + i] == 2) trusted.row(safe++) = mapped;
        }
        Sums& mine = sums[stripe];
        // Both halves of phiD.
        addGramOfColumns(MatrixXd(all.topRows(usable)), mine.all);
        addGramOfColumns(MatrixXd(trusted.topRows(safe)), mine.trusted);
        if (!writeSlab(first, count, raw)) broken = true;
      }
    });
    if (broken) return writeFailed(out_);
    gram_ = trustedGram_ = MatrixXd::Zero(m, m);
    for (const Sums& part : sums) {
      gram_ += 2 * part.all;
      trustedGram_ += 2 * part.trusted;
    }
    header_.cells =
        static_cast<std::size_t>(std::count_if(usable_.begin(), usable_.end(), [](auto u) { return u > 0; }));
    header_.trustedCells = static_cast<std::size_t>(std::count(usable_.begin(), usable_.end(), 2));
    if (header_.cells < kLeastCoverage * reachable_.size()) {
      return Error{ErrorCode::Invalid,
                   "The materials have only " + std::to_string(100 * header_.cells / reachable_.size()) +
                       " % of the directions in common",
                   out_.string(),
                   "leave out the materials with the least coverage ('patina-cli brdf info' shows it)"};
    }
    return Done{};
  }

  // Eigenvectors of the Gram matrix: its columns' coefficients.
  Status decompose() {
    const Index m = columns();
    const SymmetricEigen eigen = eigenOfSymmetric(gram_);
    const Eigen::VectorXd values = eigen.values.reverse().cwiseMax(0);
    const MatrixXd vectors = eigen.vectors.rowwise().reverse();
    // The mean was taken out, so one value is zero to rounding; below 1e-7 of the first nothing but rounding
    // is left (1e-14 of the Gram matrix).
    Index k = 0;
    while (k < m - 1 && values[k] > 1e-14 * values[0]) ++k;
    if (options_.components > 0) k = std::min<Index>(k, options_.components);
    if (k < 1) {
      return Error{ErrorCode::Invalid,
                   "The materials are all the same: there is nothing to build a basis from", out_.string(),
                   "add different materials"};
    }
    header_.components = static_cast<int>(k);
    header_.columns = static_cast<int>(m);
    singular_ = values.head(k).cwiseSqrt();
    vectors_ = vectors.leftCols(k);
    const MatrixXd whole = trustedGram_.selfadjointView<Eigen::Lower>();
    trustedGram_ = product(vectors_, true, product(whole, false, vectors_, false), false);
    return Done{};
  }

  // Third pass: Q = Y U, rounded to 16 bits of each component's range.
  Status writeComponents() {
    const Index k = header_.components;
    const std::size_t slabs = (reachable_.size() + kSlab - 1) / kSlab;
    const RowMajorMatrixXf turn = vectors_.cast<float>();
    // |component j of a row| is at most its row's norm: the ranges need a pass of their own.
    std::vector<std::size_t> firstRow(slabs + 1, 0);
    for (std::size_t s = 0; s < slabs; ++s) {
      const std::size_t first = s * kSlab, last = std::min(first + kSlab, reachable_.size());
      firstRow[s + 1] = firstRow[s] + std::count_if(usable_.begin() + first, usable_.begin() + last,
                                                    [](auto u) { return u > 0; });
    }
    std::mutex mutex;
    std::atomic<bool> broken{false};
    std::atomic<std::size_t> done{0};
    const auto forSlabs = [&](const auto& visit) {
      tbb::parallel_for(tbb::blocked_range<std::size_t>(0, slabs, 1), [&](const auto& range) {
        RowMajorMatrixXf raw, rows, turned;
        for (std::size_t s = range.begin(); s < range.end() && !job_.cancelled() && !broken; ++s) {
          const std::size_t first = s * kSlab, count = std::min(kSlab, reachable_.size() - first);
          if (!readSlab(first, count, raw)) {
            broken = true;
            return;
          }
          rows.resize(static_cast<Index>(firstRow[s + 1] - firstRow[s]), columns());
          Index at = 0;
          for (std::size_t i = 0; i < count; ++i) {
            if (usable_[first + i]) rows.row(at++) = raw.row(static_cast<Index>(i));
          }
          multiply(rows, turn, turned);
          visit(firstRow[s], turned);
          job_.progress("components", static_cast<std::int64_t>(++done), static_cast<std::int64_t>(2 * slabs),
                        "slabs");
        }
      });
    };
    Eigen::RowVectorXf largest = Eigen::RowVectorXf::Zero(k);
    forSlabs([&](std::size_t, const RowMajorMatrixXf& q) {
      if (q.rows() == 0) return;
      const Eigen::RowVectorXf here = q.cwiseAbs().colwise().maxCoeff();
      const std::lock_guard lock(mutex);
      largest = largest.cwiseMax(here);
    });
    if (broken) return writeFailed(out_);
    if (job_.cancelled()) return cancelled();
    const Eigen::RowVectorXf scales = (largest / 32767.0f).cwiseMax(1e-30f);

    // The arrays' places depend on the header's length, the header holds the arrays' checksum: written with
    // zeros first, whose text has the same length.
    header_.name = options_.name.empty() ? out_.stem().string() : options_.name;
    header_.source = source_.description();
    const std::size_t dataStart = 32 + basisHeaderJson(header_).size();
    const BasisLayout layout = basisLayout(header_, dataStart);
    Result<ScratchFile> file = ScratchFile::create(out_, "new");
    if (!file) return file.error();
    std::vector<std::uint32_t> cells;
    std::vector<float> mean, lnReference;
    for (std::size_t i = 0; i < reachable_.size(); ++i) {
      if (!usable_[i]) continue;
      cells.push_back(reachable_[i]);
      mean.push_back(mean_[i]);
      lnReference.push_back(lnReference_[i]);
    }
    const MatrixXd coefficients = vectors_.transpose();
    bool ok = file->write(singular_.data(), k * sizeof(double), layout.singularValues) &&
              file->write(coefficients.data(), coefficients.size() * sizeof(double), layout.coefficients) &&
              file->write(trustedGram_.data(), trustedGram_.size() * sizeof(double), layout.trustedGram) &&
              file->write(scales.data(), k * sizeof(float), layout.scales) &&
              file->write(cells.data(), cells.size() * sizeof(std::uint32_t), layout.cells) &&
              file->write(mean.data(), mean.size() * sizeof(float), layout.mean) &&
              file->write(lnReference.data(), lnReference.size() * sizeof(float), layout.lnReference);
    forSlabs([&](std::size_t row, const RowMajorMatrixXf& q) {
      Eigen::Matrix<std::int16_t, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> rounded =
          (q.array().rowwise() / scales.array()).round().cast<std::int16_t>();
      if (!file->write(rounded.data(), rounded.size() * sizeof(std::int16_t),
                       layout.components + row * k * sizeof(std::int16_t))) {
        broken = true;
      }
    });
    if (job_.cancelled()) return cancelled();
    if (!ok || broken) return writeFailed(out_);
    return seal(*file, dataStart, layout);
  }

  // Checksums and the header, then the file's final name.
  Status seal(ScratchFile& file, std::size_t dataStart, const BasisLayout& layout) {
    ContentChecksum sum;
    std::vector<char> piece(1 << 22);
    for (std::size_t at = dataStart; at < layout.end; at += piece.size()) {
      const std::size_t count = std::min(piece.size(), layout.end - at);
      if (!file.read(piece.data(), count, at)) return writeFailed(out_);
      sum.add(piece.data(), count);
    }
    header_.dataChecksum = sum.value();
    const std::string text = basisHeaderJson(header_);
    const std::uint64_t length = text.size(), checksum = contentChecksum(text);
    const bool ok = file.write(kBasisMagic, 16, 0) && file.write(&length, 8, 16) &&
                    file.write(text.data(), text.size(), 24) && file.write(&checksum, 8, 24 + text.size()) &&
                    file.keepAs(out_);
    if (!ok) return writeFailed(out_);
    return Done{};
  }

  bool readSlab(std::size_t first, std::size_t count, RowMajorMatrixXf& raw) const {
    raw.resize(static_cast<Index>(count), columns());
    std::vector<Eigen::Array3f> values(count);
    for (std::size_t material = 0; material < source_.count(); ++material) {
      if (!raw_->read(values.data(), count * sizeof(Eigen::Array3f), rawOffset(material, first)))
        return false;
      for (std::size_t i = 0; i < count; ++i) {
        raw.block<1, 3>(static_cast<Index>(i), static_cast<Index>(3 * material)) =
            values[i].matrix().transpose();
      }
    }
    return true;
  }
  bool writeSlab(std::size_t first, std::size_t count, const RowMajorMatrixXf& raw) const {
    std::vector<Eigen::Array3f> values(count);
    for (std::size_t material = 0; material < source_.count(); ++material) {
      for (std::size_t i = 0; i < count; ++i) {
        values[i] =
            raw.block<1, 3>(static_cast<Index>(i), static_cast<Index>(3 * material)).transpose().array();
      }
      if (!raw_->write(values.data(), count * sizeof(Eigen::Array3f), rawOffset(material, first)))
        return false;
    }
    return true;
  }

  const BasisSource& source_;
  const fs::path out_;
  const BasisBuildOptions& options_;
  const JobContext& job_;
  const ScratchFile* raw_ = nullptr;
  BasisHeader header_;
  std::vector<std::uint32_t> reachable_;
  std::vector<float> mean_, lnReference_;
  std::vector<std::uint8_t> usable_;  ///< 0: some material lacks it; 1: used; 2: used and trusted
  MatrixXd gram_, trustedGram_, vectors_;
  Eigen::VectorXd singular_;
};

class BrdfSource : public BasisSource {
 public:
  BrdfSource(const std::vector<BrdfPtr>& brdfs, std::string description)
      : brdfs_(brdfs), description_(std::move(description)) {}
  std::size_t count() const override { return brdfs_.size(); }
  Result<BrdfPtr> open(std::size_t i, BasisMaterial& material) const override {
    const BrdfOrigin& origin = brdfs_[i]->origin();
    material = {origin.name, origin.format, origin.note, 0, 0};
    return brdfs_[i];
  }
  std::string description() const override { return description_; }

 private:
  const std::vector<BrdfPtr>& brdfs_;
  std::string description_;
};

class FileSource : public BasisSource {
 public:
  FileSource(const std::vector<fs::path>& files, bool withBuiltIn) : files_(files) {
    if (withBuiltIn) builtIn_ = &builtInMaterials();
  }
  std::size_t count() const override { return files_.size() + (builtIn_ ? builtIn_->size() : 0); }
  Result<BrdfPtr> open(std::size_t i, BasisMaterial& material) const override {
    if (i >= files_.size()) {
      const BrdfPtr& brdf = (*builtIn_)[i - files_.size()];
      const BrdfOrigin& origin = brdf->origin();
      material = {origin.name, origin.format, origin.note, 0, 0};
      return brdf;
    }
    Result<BrdfPtr> brdf = readBrdf(files_[i]);
    if (!brdf) return brdf.error();
    const BrdfOrigin& origin = (*brdf)->origin();
    // Read once more for the checksum: files of 35 MB at most, which the system still has in memory.
    Result<std::string> bytes = readFile(files_[i], std::uint64_t{4} << 30);
    if (!bytes) return bytes.error();
    material = {origin.name, origin.format, origin.note, contentChecksum(*bytes), bytes->size()};
    return brdf;
  }
  std::string description() const override {
    std::string text = counted(files_.size(), "measured BRDF") + " of the user's";
    if (builtIn_) text += "; and " + builtInSource();
    return text;
  }

 private:
  const std::vector<fs::path>& files_;
  const std::vector<BrdfPtr>* builtIn_ = nullptr;
};

}  // namespace

Result<BasisPtr> buildBasisFrom(const BasisSource& source, const fs::path& out,
                                const BasisBuildOptions& options, const JobContext& job) {
  if (source.count() < 2) {
    return Error{ErrorCode::Invalid,
                 "A basis needs at least two materials, and there " +
                     std::string(source.count() == 1 ? "is one" : "are none"),
                 out.string(), "add measured BRDFs (.binary, .bsdf), or the built-in ones"};
  }
  return Builder(source, fs::absolute(out), options, job).build();
}

Result<BasisPtr> buildBasis(const std::vector<fs::path>& files, const fs::path& out,
                            const BasisBuildOptions& options, const JobContext& job) {
  return buildBasisFrom(FileSource(files, options.withBuiltIn), out, options, job);
}

Result<BasisPtr> buildBasis(const std::vector<BrdfPtr>& brdfs, const fs::path& out,
                            const BasisBuildOptions& options, const JobContext& job) {
  if (!options.withBuiltIn)
    return buildBasisFrom(BrdfSource(brdfs, "materials from memory"), out, options, job);
  std::vector<BrdfPtr> all = brdfs;
  all.insert(all.end(), builtInMaterials().begin(), builtInMaterials().end());
  return buildBasisFrom(BrdfSource(all, "materials from memory; and " + builtInSource()), out, options, job);
}

}  // namespace patina
