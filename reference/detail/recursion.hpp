#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>

#include <kfstab/reference/detail/numbers.hpp>
#include <kfstab/reference/trajectory.hpp>

namespace kfstab::reference::detail {

/// The recursion of Trajectory's comment in one precision.
template <class T>
class Recursion {
 public:
  /// What came of a step.
  struct End {
    bool done = true;
    /// The pivot of Re that was not positive, and its row.
    Index row = 0;
    T pivot = 0;
    /// P_{k|k} was not positive definite to this precision, so P_{k|k}^{-1} does not exist.
    bool no_information = false;
  };

  /// perturbed: each intermediate result is moved by 1 to 1024 units in its last place, at random but always the same.
  /// That many, so that sums and differences of moved numbers do not cancel the moves: three digits, for a chance of
  /// 1e-3.
  Recursion(const AnyProblem<double>& problem, bool with_data, bool perturbed)
      : problem_(&problem), with_data_(with_data), perturbed_(perturbed) {
    P_next = read_initial<T>(problem);
    perturb_symmetric(P_next);
    if (with_data) {
      x_next = std::visit([](const auto& p) { return exact<T>(p.x0); }, problem);
    }
  }

  End advance(const StepData* data) {
    ++k_;
    load();
    const Numbers<T>& m = *numbers_;
    const Index n = m.A.rows(), p = m.C.rows();
    P_predicted = P_next;
    x_predicted = x_next;

    const Matrix<T> PC = product_transposed(P_predicted, m.C);
    Re = m.R;
    add_symmetric_product(Re, m.C, transposed(PC));
    perturb_symmetric(Re);
    Matrix<T> L;
    if (const auto end = cholesky(Re, L); !end.done) return {false, end.column, end.pivot, false};
    Re_inverse = inverse_from_root_inverse(lower_inverse(L));
    Kf = product(PC, Re_inverse);
    perturb(Kf);
    K = product(m.A, Kf);

    Matrix<T> J = identity<T>(n);
    subtract(J, product(Kf, m.C));
    if (m.R_is_zero && p == n && n > 0) {
      // Re = C P C' is positive definite, so C is invertible and P C' Re^{-1} C P = P: nothing is left. Rounding would
      // never say so.
      P_filtered = zeros<T>(n, n);
    } else {
      P_filtered = congruence(J, P_predicted);
      add_symmetric_product(P_filtered, product(Kf, m.R), Kf);
      perturb_symmetric(P_filtered);
    }
    P_next = congruence(m.A, P_filtered);
    for (Index j = 0; j < n; ++j)
      for (Index i = 0; i < n; ++i) P_next(i, j) += m.BQB(i, j);
    perturb_symmetric(P_next);
    F = m.A;
    subtract(F, product(K, m.C));
    if (previous_) {
      Ff = previous_->A;
      subtract(Ff, product(Kf, product(m.C, previous_->A)));
    } else {
      Ff = J;
    }

    Kf_scale = magnitude(P_predicted) + magnitude(m.C) + magnitude(Re_inverse);
    K_scale = magnitude(m.A) + Kf_scale;
    F_scale = std::max(magnitude(m.A), K_scale + magnitude(m.C)) + 1;

    if (with_data_) advance_state(m, *data);
    if (information_problem()) {
      Y_previous = Y;
      if (!cholesky(P_filtered, L).done) return {false, 0, 0, true};
      Y = inverse_from_root_inverse(lower_inverse(L));
    }
    return {};
  }

  /// What only the run that is read needs. Throws ReferenceError if a result does not fit a double.
  void round_into(Truth& truth) const {
    truth.P_predicted = rounded(P_predicted, "P_{k|k-1}");
    truth.P_filtered = rounded(P_filtered, "P_{k|k}");
    truth.P_next = rounded(P_next, "P_{k+1|k}");
    truth.information = rounded(Y, "P_{k|k}^{-1}");
    truth.innovation = rounded(Re, "Re");
    truth.predictor_gain = rounded(K, "K");
    truth.filter_gain = rounded(Kf, "Kf");
    truth.closed_loop = rounded(F, "F");
    truth.filtered_closed_loop = rounded(Ff, "(I - Kf C) A");
    truth.x_predicted = rounded(x_predicted, "x_{k|k-1}");
    truth.x_filtered = rounded(x_filtered, "x_{k|k}");
    truth.x_next = rounded(x_next, "x_{k+1|k}");
    truth.innovation_condition = Re.rows() == 1 ? 1 : condition(Re, Re_inverse);
    truth.cosine = cosine();
    truth.information_amplification =
        information_problem() ? information_amplification() : std::numeric_limits<double>::quiet_NaN();
  }

  const Matrix<T>& quantity(Quantity which) const {
    switch (which) {
      case Quantity::P_predicted: return P_predicted;
      case Quantity::P_filtered: return P_filtered;
      case Quantity::innovation: return Re;
      case Quantity::predictor_gain: return K;
      case Quantity::filter_gain: return Kf;
      case Quantity::P_next: break;
    }
    return P_next;
  }

  bool information_problem() const { return parametrisation(*problem_) == Parametrisation::information; }
  std::int64_t k() const { return k_; }

  Matrix<T> P_predicted, P_filtered, P_next, Y, Y_previous, Re, Re_inverse, K, Kf, F, Ff;
  Vector<T> x_predicted, x_filtered, x_next;
  /// Of what magnitude the terms are whose sum each is (binary exponents): a sum far below is rounding, and stands
  /// for 0.
  double K_scale = 0, Kf_scale = 0, F_scale = 0, x_filtered_scale = 0, x_next_scale = 0;

 private:
  void load() {
    previous_ = numbers_;
    const bool invariant = std::visit([](const auto& p) { return p.time_invariant(); }, *problem_);
    if (!numbers_ || !invariant) numbers_ = std::make_shared<const Numbers<T>>(read<T>(*problem_, k_));
  }

  void advance_state(const Numbers<T>& m, const StepData& data) {
    const Index n = m.A.rows();
    T scratch;
    const Vector<T> y = exact<T>(data.y), u = exact<T>(data.u);
    Vector<T> innovation = product(m.C, x_predicted);
    for (Index i = 0; i < y.size(); ++i) innovation(i) = y(i) - innovation(i);
    perturb(innovation);
    x_filtered = product(Kf, innovation);
    for (Index i = 0; i < n; ++i) x_filtered(i) += x_predicted(i);
    perturb(x_filtered);
    x_filtered_scale = std::max(magnitude(x_predicted),
                                magnitude(Kf) + std::max(magnitude(y), magnitude(m.C) + magnitude(x_predicted))) +
                       2;
    x_next = product(m.A, x_filtered);
    x_next_scale = magnitude(m.A) + x_filtered_scale;
    for (Index i = 0; i < n; ++i) {
      for (Index j = 0; j < u.size(); ++j) add_product(x_next(i), m.D(i, j), u(j), scratch);
      if (m.Bw.size() > 0) x_next(i) += m.Bw(i);
    }
    x_next_scale = std::max({x_next_scale, magnitude(m.D) + magnitude(u), magnitude(m.Bw)}) + 2;
    perturb(x_next);
  }

  double cosine() const {
    // ||A P A' + B Q B'|| as ||P+ + K Re K'||: sums of semidefinite terms, good to all digits of a double
    Matrix<T> before = P_next;
    add_symmetric_product(before, product(K, Re), K);
    const T norm = two_norm(before);
    return norm == 0 ? 1 : std::min(1.0, reference::round_to_double(T(sqrt(T(two_norm(P_next) / norm)))));
  }

  double information_amplification() const {
    const Numbers<T>& m = *numbers_;
    double bracket = 1 + m.k_R_root;
    Matrix<T> annexed = m.CRC;
    if (previous_) {
      // Q and A carried x_{k-1} to x_k
      const Matrix<T> AY = product(transposed(previous_->A_inverse), Y_previous);
      add_symmetric_product(annexed, AY, transposed(previous_->A_inverse));
      Matrix<T> Qe_inverse = previous_->Q_inverse;
      const Matrix<T> BT = transposed(previous_->A_inverse_B);
      add_symmetric_product(Qe_inverse, product(BT, Y_previous), BT);
      Matrix<T> L;
      double ratio = 1;
      if (Qe_inverse.rows() > 1 && cholesky(Qe_inverse, L).done)
        ratio = std::sqrt(condition(Qe_inverse, inverse_from_root_inverse(lower_inverse(L))));
      bracket = previous_->k_A + m.k_R_root;
      if (Qe_inverse.rows() > 0) bracket += ratio * (previous_->k_Q_root + previous_->k_A);
    } else {
      const Matrix<T> Y0 = information_of_start();
      for (Index j = 0; j < annexed.cols(); ++j)
        for (Index i = 0; i < annexed.rows(); ++i) annexed(i, j) += Y0(i, j);
    }
    const T left = two_norm(Y);
    if (left == 0) return bracket;
    const double inverse_cosine = reference::round_to_double(T(sqrt(T(two_norm(annexed) / left))));
    return bracket * std::max(1.0, inverse_cosine);
  }

  Matrix<T> information_of_start() const {
    const auto& p = std::get<Problem<InformationModel<double>>>(*problem_);
    const Matrix<T> T0 = exact_upper_transposed<T>(p.initial);
    return symmetric_product(T0, T0);
  }

  template <int Cols>
  Matrix<double, Dynamic, Cols> rounded(const Matrix<T, Dynamic, Cols>& X, const char* name) const {
    Matrix<double, Dynamic, Cols> Y_rounded = round_to_double(X);
    if (!all_finite(Y_rounded))
      throw ReferenceError("step " + std::to_string(k_) + ": " + name + " does not fit a double (overflow)");
    return Y_rounded;
  }

  static void subtract(Matrix<T>& X, const Matrix<T>& Y) {
    for (Index j = 0; j < X.cols(); ++j)
      for (Index i = 0; i < X.rows(); ++i) X(i, j) -= Y(i, j);
  }

  void perturb_number(T& x) {
    if (x == 0) return;
    // a bit of splitmix64: deterministic, the same on every machine
    std::uint64_t z = (counter_ += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    z ^= z >> 31;
    const int units = 1 + static_cast<int>(z >> 1 & 1023);
    const auto last_place = mpfr_get_exp(x.backend().data()) - mpfr_get_prec(x.backend().data());
    x += ldexp(T(z & 1 ? units : -units), static_cast<int>(last_place));
  }
  template <int Cols>
  void perturb(Matrix<T, Dynamic, Cols>& X) {
    if (!perturbed_) return;
    for (Index j = 0; j < X.cols(); ++j)
      for (Index i = 0; i < X.rows(); ++i) perturb_number(X(i, j));
  }
  void perturb_symmetric(Matrix<T>& X) {
    if (!perturbed_) return;
    for (Index j = 0; j < X.cols(); ++j)
      for (Index i = j; i < X.rows(); ++i) {
        perturb_number(X(i, j));
        X(j, i) = X(i, j);
      }
  }

  const AnyProblem<double>* problem_;
  bool with_data_;
  bool perturbed_;
  std::uint64_t counter_ = 0;
  std::int64_t k_ = -1;
  std::shared_ptr<const Numbers<T>> numbers_, previous_;
};

}  // namespace kfstab::reference::detail
