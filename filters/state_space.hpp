#pragma once

#include <kfstab/filters/matrix.hpp>
#include <kfstab/filters/products.hpp>

/// One step's model,
///
///     x_{k+1} = A x_k + B w_k + D u_k,    y_k = C x_k + v_k,    E w w' = Q,    E v v' = R,
///
/// in the three parametrisations that filters take. They are three types, so that a covariance can never be taken for
/// its root: that is a compile error here, and the commonest silent mistake elsewhere.
namespace kfstab {

/// What a filter's numbers stand for. Each filter takes one of them, and a Problem holds the numbers of one.
enum class Parametrisation { covariance, root, information };

constexpr const char* name(Parametrisation parametrisation) {
  switch (parametrisation) {
    case Parametrisation::covariance: return "covariance";
    case Parametrisation::root: return "root";
    case Parametrisation::information: return "information";
  }
  return "";
}

/// The dynamics: A (n x n), B (n x m), C (p x n), D (n x inputs; no columns where there is no known input).
template <class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
struct StateSpace {
  using Scalar = S;
  static constexpr int states = N, noises = M, outputs = P;

  Matrix<S, N, N> A;
  Matrix<S, N, M> B;
  Matrix<S, P, N> C;
  Matrix<S, N, Dynamic> D;

  Dimensions dimensions() const { return {A.rows(), B.cols(), C.rows()}; }

 protected:
  bool dynamics_finite() const { return all_finite(A) && all_finite(B) && all_finite(C) && all_finite(D); }
};

/// Noise by its covariances: Q (m x m) and R (p x p), symmetric. Started from P0.
template <class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
struct CovarianceModel : StateSpace<S, N, M, P> {
  static constexpr Parametrisation parametrisation = Parametrisation::covariance;

  Matrix<S, M, M> Q;
  Matrix<S, P, P> R;

  bool finite() const { return this->dynamics_finite() && all_finite(Q) && all_finite(R); }
};

/// Noise by lower roots: Q_root Q_root' = Q, R_root R_root' = R. Their strict upper triangles are never read. A Q_root
/// without rows says that B stands for B Q^{1/2} already (FB01QD's MULTBQ = 'P'); a filter takes that, a Problem does not.
/// Started from S0, lower, S0 S0' = P0.
template <class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
struct RootModel : StateSpace<S, N, M, P> {
  static constexpr Parametrisation parametrisation = Parametrisation::root;

  Matrix<S, M, M> Q_root;
  Matrix<S, P, P> R_root;

  bool finite() const {
    return this->dynamics_finite() && all_finite_lower(Q_root) && all_finite_lower(R_root);
  }

  /// out = B Q^{1/2}, n x m.
  template <class OutType>
  void process_noise_root(OutType&& out) const {
    if (Q_root.rows() == 0)
      out = this->B;
    else
      multiply_lower(this->B, Q_root, out);
  }

  /// Whether the covariances take the same course: every number but D.
  bool same_system(const RootModel& o) const {
    return equal(this->A, o.A) && equal(this->B, o.B) && equal(this->C, o.C) && equal_lower(Q_root, o.Q_root) &&
           equal_lower(R_root, o.R_root);
  }
};

/// The model as a square-root information filter takes it: A^{-1} and A^{-1} B, and upper roots of the inverse noise
/// covariances, (Q^{-1/2})' Q^{-1/2} = Q^{-1}, (R^{-1/2})' R^{-1/2} = R^{-1}: these are not the inverses of the lower
/// roots. Their strict lower triangles are never read. Started from T0, upper, T0'T0 = P0^{-1}.
template <class S, int N = Dynamic, int M = Dynamic, int P = Dynamic>
struct InformationModel {
  using Scalar = S;
  static constexpr int states = N, noises = M, outputs = P;
  static constexpr Parametrisation parametrisation = Parametrisation::information;

  Matrix<S, N, N> A_inverse;
  Matrix<S, N, M> A_inverse_B;
  Matrix<S, P, N> C;
  Matrix<S, N, Dynamic> D;
  Matrix<S, M, M> Q_inverse_root;
  Matrix<S, P, P> R_inverse_root;
  /// E w, the mean of the process noise; no rows means 0. FB01SD's Z is its negative.
  Vector<S> w_mean;

  Dimensions dimensions() const { return {A_inverse.rows(), A_inverse_B.cols(), C.rows()}; }

  bool finite() const {
    return all_finite(A_inverse) && all_finite(A_inverse_B) && all_finite(C) && all_finite(D) &&
           all_finite_upper(Q_inverse_root) && all_finite_upper(R_inverse_root) && all_finite(w_mean);
  }

  /// Whether the covariances take the same course: every number but D and the mean of w.
  bool same_system(const InformationModel& o) const {
    return equal(A_inverse, o.A_inverse) && equal(A_inverse_B, o.A_inverse_B) && equal(C, o.C) &&
           equal_upper(Q_inverse_root, o.Q_inverse_root) && equal_upper(R_inverse_root, o.R_inverse_root);
  }
};

}  // namespace kfstab
