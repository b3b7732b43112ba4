#include "engine/base/dense.h"

#include <cblas.h>

#include <algorithm>
#include <stdexcept>
#include <vector>

// LAPACK's own interface: every argument by address, matrices column-major and overwritten.
extern "C" {
void dsyevd_(const char* job, const char* triangle, const int* n, double* a, const int* rows, double* values,
             double* work, const int* workSize, int* intWork, const int* intWorkSize, int* info);
void dgesdd_(const char* job, const int* m, const int* n, double* a, const int* rows, double* values,
             double* u, const int* uRows, double* v, const int* vRows, double* work, const int* workSize,
             int* intWork, int* info);
void dpotrf_(const char* triangle, const int* n, double* a, const int* rows, int* info);
}

namespace patina {
namespace {

// OpenBLAS' own threads would fight with TBB's; one a call, whoever calls first.
void useOneThread() {
  static const bool done = [] {
    openblas_set_num_threads(1);
    return true;
  }();
  static_cast<void>(done);
}

void require(bool fits, const char* what) {
  if (!fits) throw std::invalid_argument(what);
}

}  // namespace

void multiply(const Eigen::MatrixXd& a, bool transposeA, const Eigen::MatrixXd& b, bool transposeB,
              Eigen::MatrixXd& out, double alpha, double beta) {
  useOneThread();
  const auto m = transposeA ? a.cols() : a.rows(), inner = transposeA ? a.rows() : a.cols();
  const auto n = transposeB ? b.rows() : b.cols();
  require(inner == (transposeB ? b.cols() : b.rows()), "multiply: inner sizes differ");
  if (beta == 0) out.resize(m, n);
  require(out.rows() == m && out.cols() == n, "multiply: the sum has another size");
  if (m == 0 || n == 0) return;
  if (inner == 0) {
    if (beta == 0) out.setZero();
    return;
  }
  cblas_dgemm(CblasColMajor, transposeA ? CblasTrans : CblasNoTrans, transposeB ? CblasTrans : CblasNoTrans,
              static_cast<int>(m), static_cast<int>(n), static_cast<int>(inner), alpha, a.data(),
              static_cast<int>(a.rows()), b.data(), static_cast<int>(b.rows()), beta, out.data(),
              static_cast<int>(m));
}

Eigen::MatrixXd product(const Eigen::MatrixXd& a, bool transposeA, const Eigen::MatrixXd& b,
                        bool transposeB) {
  Eigen::MatrixXd out;
  multiply(a, transposeA, b, transposeB, out);
  return out;
}

namespace {

Eigen::MatrixXd gram(const Eigen::MatrixXd& a, bool ofRows) {
  useOneThread();
  const auto n = ofRows ? a.rows() : a.cols(), inner = ofRows ? a.cols() : a.rows();
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(n, n);
  if (n == 0 || inner == 0) return out;
  cblas_dsyrk(CblasColMajor, CblasLower, ofRows ? CblasNoTrans : CblasTrans, static_cast<int>(n),
              static_cast<int>(inner), 1.0, a.data(), static_cast<int>(a.rows()), 0.0, out.data(),
              static_cast<int>(n));
  out.triangularView<Eigen::StrictlyUpper>() = out.transpose();
  return out;
}

}  // namespace

Eigen::MatrixXd gramOfRows(const Eigen::MatrixXd& a) {
  return gram(a, true);
}
Eigen::MatrixXd gramOfColumns(const Eigen::MatrixXd& a) {
  return gram(a, false);
}

void addGramOfColumns(const Eigen::MatrixXd& a, Eigen::MatrixXd& sum) {
  useOneThread();
  require(sum.rows() == a.cols() && sum.cols() == a.cols(), "addGramOfColumns: the sum has another size");
  if (a.rows() == 0 || a.cols() == 0) return;
  cblas_dsyrk(CblasColMajor, CblasLower, CblasTrans, static_cast<int>(a.cols()), static_cast<int>(a.rows()),
              1.0, a.data(), static_cast<int>(a.rows()), 1.0, sum.data(), static_cast<int>(sum.rows()));
}

SymmetricEigen eigenOfSymmetric(const Eigen::MatrixXd& a, bool withVectors) {
  useOneThread();
  require(a.rows() == a.cols(), "eigenOfSymmetric: the matrix is not square");
  SymmetricEigen eigen{Eigen::VectorXd(a.rows()), a};
  if (a.rows() > 0) {
    const int n = static_cast<int>(a.rows()), ask = -1;
    const char* job = withVectors ? "V" : "N";
    int info = 0, intSize = 0;
    double size = 0;
    dsyevd_(job, "L", &n, eigen.vectors.data(), &n, eigen.values.data(), &size, &ask, &intSize, &ask, &info);
    std::vector<double> work(static_cast<std::size_t>(size));
    std::vector<int> intWork(static_cast<std::size_t>(intSize));
    const int workSize = static_cast<int>(work.size());
    dsyevd_(job, "L", &n, eigen.vectors.data(), &n, eigen.values.data(), work.data(), &workSize,
            intWork.data(), &intSize, &info);
    // Only for a matrix that is not finite.
    if (info != 0) throw std::runtime_error("eigenOfSymmetric: no convergence");
  }
  if (!withVectors) eigen.vectors.resize(0, 0);
  return eigen;
}

bool choleskyInPlace(Eigen::MatrixXd& a) {
  useOneThread();
  require(a.rows() == a.cols(), "choleskyInPlace: not square");
  const int n = static_cast<int>(a.rows());
  if (n == 0) return true;
  int info = 0;
  dpotrf_("L", &n, a.data(), &n, &info);
  return info == 0;
}

void solveLowerInPlace(const Eigen::MatrixXd& l, bool transposed, Eigen::MatrixXd& b) {
  useOneThread();
  require(l.rows() == l.cols() && l.rows() == b.rows(), "solveLowerInPlace: sizes differ");
  if (b.size() == 0) return;
  cblas_dtrsm(CblasColMajor, CblasLeft, CblasLower, transposed ? CblasTrans : CblasNoTrans, CblasNonUnit,
              static_cast<int>(b.rows()), static_cast<int>(b.cols()), 1.0, l.data(),
              static_cast<int>(l.rows()), b.data(), static_cast<int>(b.rows()));
}

Eigen::VectorXd singularValues(const Eigen::MatrixXd& a) {
  useOneThread();
  Eigen::VectorXd values(std::min(a.rows(), a.cols()));
  if (values.size() == 0) return values;
  Eigen::MatrixXd copy = a;
  const int m = static_cast<int>(a.rows()), n = static_cast<int>(a.cols()), one = 1, ask = -1;
  std::vector<int> intWork(8 * static_cast<std::size_t>(values.size()));
  int info = 0;
  double size = 0;
  dgesdd_("N", &m, &n, copy.data(), &m, values.data(), nullptr, &one, nullptr, &one, &size, &ask,
          intWork.data(), &info);
  std::vector<double> work(static_cast<std::size_t>(size));
  const int workSize = static_cast<int>(work.size());
  dgesdd_("N", &m, &n, copy.data(), &m, values.data(), nullptr, &one, nullptr, &one, work.data(), &workSize,
          intWork.data(), &info);
  if (info != 0) throw std::runtime_error("singularValues: no convergence");
  return values;
}

void multiply(const RowMajorMatrixXf& a, const RowMajorMatrixXf& b, RowMajorMatrixXf& out) {
  useOneThread();
  require(a.cols() == b.rows(), "multiply: inner sizes differ");
  out.resize(a.rows(), b.cols());
  if (out.size() == 0) return;
  if (a.cols() == 0) {
    out.setZero();
    return;
  }
  cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, static_cast<int>(a.rows()),
              static_cast<int>(b.cols()), static_cast<int>(a.cols()), 1.0f, a.data(),
              static_cast<int>(a.cols()), b.data(), static_cast<int>(b.cols()), 0.0f, out.data(),
              static_cast<int>(b.cols()));
}

}  // namespace patina
