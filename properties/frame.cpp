#include <kfstab/properties/frame.hpp>

#include <algorithm>

#include <Eigen/QR>

namespace kfstab::properties {

Matrix<double> orthonormal_frame(const Matrix<double>& X) {
  const Eigen::HouseholderQR<Matrix<double>> qr(X);
  Matrix<double> Q = qr.householderQ() * Matrix<double>::Identity(X.rows(), X.cols());
  for (Index j = 0; j < X.cols(); ++j)
    if (qr.matrixQR()(j, j) < 0) Q.col(j) *= -1;
  return Q;
}

Matrix<double> lower_root_of_gram(const Matrix<double>& X) {
  const Eigen::HouseholderQR<Matrix<double>> qr(X);
  const Index rank = std::min(X.rows(), X.cols());
  Matrix<double> L = Matrix<double>::Zero(X.cols(), rank);
  for (Index j = 0; j < rank; ++j)
    for (Index i = j; i < X.cols(); ++i) L(i, j) = qr.matrixQR()(j, i) * (qr.matrixQR()(j, j) < 0 ? -1 : 1);
  return L;
}

}  // namespace kfstab::properties
