#pragma once

#include <Eigen/Core>

namespace patina {

/// Dense products and decompositions by OpenBLAS and the LAPACK in it, which picks the instruction set at run
/// time; one thread a call (callers parallelise outside). Column-major, double. Shapes are checked by
/// throwing std::invalid_argument: a mismatch is our own bug.

/// alpha * op(a) * op(b) + beta * out, op the transpose where asked for. With beta 0 `out` is resized.
void multiply(const Eigen::MatrixXd& a, bool transposeA, const Eigen::MatrixXd& b, bool transposeB,
              Eigen::MatrixXd& out, double alpha = 1, double beta = 0);
/// op(a) * op(b).
Eigen::MatrixXd product(const Eigen::MatrixXd& a, bool transposeA, const Eigen::MatrixXd& b, bool transposeB);
/// a * a^T, or a^T * a, whole (both triangles).
Eigen::MatrixXd gramOfRows(const Eigen::MatrixXd& a);
Eigen::MatrixXd gramOfColumns(const Eigen::MatrixXd& a);
/// Adds a^T a to the lower triangle of `sum`.
void addGramOfColumns(const Eigen::MatrixXd& a, Eigen::MatrixXd& sum);

/// Eigenvalues, smallest first, and unit eigenvectors of a symmetric matrix (its lower triangle is read).
struct SymmetricEigen {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;  ///< a column each; empty where not asked for
};
SymmetricEigen eigenOfSymmetric(const Eigen::MatrixXd& a, bool withVectors = true);
/// Largest first.
Eigen::VectorXd singularValues(const Eigen::MatrixXd& a);

/// Overwrites the lower triangle of a symmetric matrix with L, L L^T = a; the upper one is left as it was.
/// False where it is not positive.
bool choleskyInPlace(Eigen::MatrixXd& a);
/// b becomes L^-1 b, or L^-T b, for the lower triangle of `l`.
void solveLowerInPlace(const Eigen::MatrixXd& l, bool transposed, Eigen::MatrixXd& b);

using RowMajorMatrixXf = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
/// a * b in single precision, row-major: n x k by k x r.
void multiply(const RowMajorMatrixXf& a, const RowMajorMatrixXf& b, RowMajorMatrixXf& out);

}  // namespace patina
