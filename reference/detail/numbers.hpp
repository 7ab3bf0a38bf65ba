#pragma once

#include <string>

#include <kfstab/filters/problem.hpp>
#include <kfstab/reference/detail/dense.hpp>
#include <kfstab/reference/detail/lockstep.hpp>
#include <kfstab/reference/error.hpp>
#include <kfstab/reference/rational.hpp>

/// What the recursion takes, computed from the very numbers of a problem.
namespace kfstab::reference::detail {

template <class T, int Rows, int Cols>
Matrix<T, Rows, Cols> nearest(const Matrix<Rational, Rows, Cols>& X) {
  Matrix<T, Rows, Cols> Y(X.rows(), X.cols());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) Y(i, j) = reference::nearest<T>(X(i, j));
  return Y;
}

/// Doubles fit exactly, rationals are rounded to T.
template <class T, int Rows, int Cols>
Matrix<T, Rows, Cols> read(const Matrix<double, Rows, Cols>& X) {
  return exact<T>(X);
}
template <class T, int Rows, int Cols>
Matrix<T, Rows, Cols> read(const Matrix<Rational, Rows, Cols>& X) {
  return nearest<T>(X);
}

/// One step's model.
template <class T>
struct Numbers {
  Matrix<T> A, C, D;
  Matrix<T> BQB;  ///< B Q B'
  Matrix<T> R;
  Vector<T> Bw;  ///< B E w; empty where there is none
  bool R_is_zero = true;

  // Of an information problem alone: what the amplification of its errors is made of.
  Matrix<T> A_inverse, A_inverse_B;
  Matrix<T> Q_inverse;  ///< Q^{-1}
  Matrix<T> CRC;        ///< C' R^{-1} C
  double k_A = 1, k_Q_root = 1, k_R_root = 1;
};

template <class T>
Matrix<T> exact_lower(const Matrix<double>& X) {
  Matrix<T> Y = zeros<T>(X.rows(), X.cols());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = j; i < X.rows(); ++i) Y(i, j) = X(i, j);
  return Y;
}

/// U' as a lower matrix, from the upper triangle of U.
template <class T>
Matrix<T> exact_upper_transposed(const Matrix<double>& U) {
  return exact_lower<T>(U.transpose());
}

/// (U'U)^{-1} = U^{-1} U^{-T} from U', lower. The caller has checked the diagonal of U.
template <class T>
Matrix<T> covariance_of_information_root(const Matrix<T>& U_transposed) {
  return inverse_from_root_inverse(lower_inverse(U_transposed));
}

template <class T>
void set_R_is_zero(Numbers<T>& to) {
  for (Index j = 0; j < to.R.cols(); ++j)
    for (Index i = 0; i < to.R.rows(); ++i)
      if (to.R(i, j) != 0) to.R_is_zero = false;
}

template <class T, class S>
Numbers<T> read(const CovarianceModel<S>& model) {
  Numbers<T> to;
  to.A = read<T>(model.A);
  to.C = read<T>(model.C);
  to.D = read<T>(model.D);
  to.BQB = congruence(read<T>(model.B), read<T>(model.Q));
  to.R = read<T>(model.R);
  set_R_is_zero(to);
  return to;
}

template <class T>
Numbers<T> read(const RootModel<double>& model) {
  Numbers<T> to;
  to.A = exact<T>(model.A);
  to.C = exact<T>(model.C);
  to.D = exact<T>(model.D);
  const Matrix<T> BQ = product(exact<T>(model.B), exact_lower<T>(model.Q_root));
  to.BQB = symmetric_product(BQ, BQ);
  const Matrix<T> R_root = exact_lower<T>(model.R_root);
  to.R = symmetric_product(R_root, R_root);
  set_R_is_zero(to);
  return to;
}

template <class T>
Numbers<T> read(const InformationModel<double>& model) {
  Numbers<T> to;
  to.A_inverse = exact<T>(model.A_inverse);
  to.A_inverse_B = exact<T>(model.A_inverse_B);
  to.C = exact<T>(model.C);
  to.D = exact<T>(model.D);
  if (!invert(to.A_inverse, to.A)) throw ReferenceError("A^{-1} is singular");
  const Matrix<T> B = product(to.A, to.A_inverse_B);

  const Matrix<T> Q_root = exact_upper_transposed<T>(model.Q_inverse_root);
  const Matrix<T> Q_root_inverse = lower_inverse(Q_root);
  const Matrix<T> BQ = product_transposed(B, Q_root_inverse);
  to.BQB = symmetric_product(BQ, BQ);
  to.Q_inverse = symmetric_product(Q_root, Q_root);

  const Matrix<T> R_root = exact_upper_transposed<T>(model.R_inverse_root);
  const Matrix<T> R_root_inverse = lower_inverse(R_root);
  to.R = inverse_from_root_inverse(R_root_inverse);
  set_R_is_zero(to);
  const Matrix<T> CR = product(transposed(to.C), R_root);
  to.CRC = symmetric_product(CR, CR);

  if (model.w_mean.size() > 0) {
    const Vector<T> w = exact<T>(model.w_mean);
    to.Bw = product(B, w);
  }
  to.k_A = condition(to.A, to.A_inverse);
  to.k_Q_root = condition(Q_root, Q_root_inverse);
  to.k_R_root = condition(R_root, R_root_inverse);
  return to;
}

template <class T>
Numbers<T> read(const Source& source, std::int64_t k) {
  return visit_source(source, [&](const auto& p) { return read<T>(p.model(k)); });
}
template <class T>
Numbers<T> read(const AnyProblem<double>& problem, std::int64_t k) {
  return read<T>(Source(&problem), k);
}

/// P_{0|-1}
template <class T>
Matrix<T> read_initial(const Source& source) {
  return visit_source(
      source, [](const auto& p) -> Matrix<T> {
        using Model = typename std::decay_t<decltype(p)>::Model;
        if constexpr (Model::parametrisation == Parametrisation::covariance) {
          return read<T>(p.initial);
        } else if constexpr (Model::parametrisation == Parametrisation::root) {
          const Matrix<T> S = exact_lower<T>(p.initial);
          return symmetric_product(S, S);
        } else {
          return covariance_of_information_root(exact_upper_transposed<T>(p.initial));
        }
      });
}

}  // namespace kfstab::reference::detail
