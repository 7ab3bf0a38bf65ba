#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <memory>

#include <string>

#include <kfstab/reference/detail/numbers.hpp>
#include <kfstab/reference/trajectory.hpp>

namespace kfstab::reference::detail {

/// How a recursion is written, and what for.
enum class Form {
  /// The truth: P_{k|k} by Joseph's form (2.2), gains by Re^{-1}.
  joseph,
  /// The witness: P_{k|k} by the conventional form (2.1), gains by triangular solves, x_{k+1|k} by the predictor gain.
  /// Each intermediate result is moved by 1 to 1024 units in its last place, at random but always the same. That many,
  /// so that sums and differences of moved numbers do not cancel the moves: three digits, for a chance of 1e-3.
  conventional,
};

/// The recursion of Trajectory's comment in one precision and one form.
template <class T, Form form>
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

  Recursion(const Source& source, bool with_data) : source_(source), with_data_(with_data) {
    P_next = read_initial<T>(source);
    perturb_symmetric(P_next);
    if (with_data) x_next = visit_source(source, [](const auto& p) { return read<T>(p.x0); });
  }

  End advance(const SourceData& data) {
    ++k_;
    load();
    const Numbers<T>& m = *numbers_;
    const Index n = m.A.rows(), p = m.C.rows();
    P_predicted.swap(P_next);
    x_predicted.swap(x_next);

    const Matrix<T> PC = product_transposed(P_predicted, m.C);
    Re = m.R;
    add_symmetric_product(Re, m.C, transposed(PC));
    perturb_symmetric(Re);
    if (const auto end = cholesky(Re, L_); !end.done) return {false, end.column, end.pivot, false};

    // Re = C P C' is positive definite, so C is invertible and P C' Re^{-1} C P = P: nothing is left. Rounding would
    // never say so.
    const bool nothing_left = m.R_is_zero && p == n && n > 0;
    if (nothing_left) P_filtered = zeros<T>(n, n);
    if constexpr (form == Form::joseph) {
      L_inverse_ = lower_inverse(L_);
      Re_inverse = inverse_from_root_inverse(L_inverse_);
      Kf = product(PC, Re_inverse);
      J_ = identity<T>(n);
      subtract(J_, product(Kf, m.C));
      if (!nothing_left) {
        P_filtered = congruence(J_, P_predicted);
        add_symmetric_product(P_filtered, product(Kf, m.R), Kf);
      }
    } else {
      W_ = PC;
      solve_right_transposed(L_, W_);
      perturb(W_);
      Kf = W_;
      solve_right(L_, Kf);
      perturb(Kf);
      if (!nothing_left) {
        P_filtered = P_predicted;
        subtract(P_filtered, symmetric_product(W_, W_));
        perturb_symmetric(P_filtered);
      }
    }
    K = product(m.A, Kf);
    P_next = congruence(m.A, P_filtered);
    for (Index j = 0; j < n; ++j)
      for (Index i = 0; i < n; ++i) P_next(i, j) += m.BQB(i, j);
    perturb_symmetric(P_next);
    F = m.A;
    subtract(F, product(K, m.C));

    const double P_size = magnitude(P_predicted);
    Re_scale = std::max(magnitude(m.R), 2 * magnitude(m.C) + P_size) + 1;
    P_filtered_scale = P_size + 1;
    P_next_scale = std::max(magnitude(m.BQB), 2 * magnitude(m.A) + P_size) + 1;
    const double Kf_terms = magnitude(P_predicted) + magnitude(m.C) + inverse_magnitude(p);
    Kf_scale = Kf_terms;
    K_scale = magnitude(m.A) + Kf_terms;
    F_scale = std::max(magnitude(m.A), K_scale + magnitude(m.C)) + 1;

    if (with_data_) std::visit([&](const auto* step) { advance_state(m, read<T>(step->y), read<T>(step->u)); }, data);
    if (is_information(source_)) {
      Y_previous_ = Y;
      Matrix<T> root;
      if (!cholesky(P_filtered, root).done) return {false, 0, 0, true};
      Y = inverse_from_root_inverse(lower_inverse(root));
    }
    return {};
  }

  /// Throws ReferenceError, naming it, if a result is beyond the range of double.
  void require_range() const {
    in_range(P_filtered, "P_{k|k}");
    in_range(P_next, "P_{k+1|k}");
    in_range(Y, "P_{k|k}^{-1}");
    in_range(Re, "Re");
    in_range(K, "K");
    in_range(Kf, "Kf");
    in_range(F, "F");
    in_range(x_filtered, "x_{k|k}");
    in_range(x_next, "x_{k+1|k}");
  }

  /// What only the run that is read needs. Throws ReferenceError if a result does not fit a double.
  void round_into(Truth& truth) const
    requires(form == Form::joseph)
  {
    Matrix<T> Ff = J_;
    if (previous_) {
      Ff = previous_->A;
      subtract(Ff, product(Kf, product(numbers_->C, previous_->A)));
    }
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
    truth.log_likelihood = with_data_ ? reference::round_to_double(log_likelihood(0, 0))
                                      : std::numeric_limits<double>::quiet_NaN();
    truth.innovation_condition = Re.rows() == 1 ? 1 : condition(Re, Re_inverse);
    truth.cosine = cosine();
    truth.information_loss = is_information(source_) ? information_loss() : InformationLoss();
  }

  std::int64_t k() const { return k_; }

  Matrix<T> P_predicted, P_filtered, P_next, Y, Re, Re_inverse, K, Kf, F;
  Vector<T> x_predicted, x_filtered, x_next;
  Matrix<T> log_likelihood;  ///< 1 x 1; empty in a run without data
  /// Of what magnitude the terms are whose sum each is (binary exponents): a sum far below is rounding, and stands
  /// for 0.
  double Re_scale = 0, P_filtered_scale = 0, P_next_scale = 0, K_scale = 0, Kf_scale = 0, F_scale = 0, x_filtered_scale = 0, x_next_scale = 0, log_likelihood_scale = 0;

 private:
  void load() {
    previous_ = numbers_;
    const bool invariant = visit_source(source_, [](const auto& p) { return p.time_invariant(); });
    if (!numbers_ || !invariant) numbers_ = std::make_shared<const Numbers<T>>(read<T>(source_, k_));
  }

  /// Of Re^{-1}.
  double inverse_magnitude(Index p) const {
    if constexpr (form == Form::joseph) return magnitude(Re_inverse);
    // Of L^{-1} L^{-T}: an exponent or two more than it is do no harm.
    double least = std::numeric_limits<double>::infinity();
    for (Index i = 0; i < p; ++i)
      least = std::min(least, static_cast<double>(mpfr_get_exp(L_(i, i).backend().data())));
    return p == 0 ? -std::numeric_limits<double>::infinity() : -2 * least + 2;
  }

  void advance_state(const Numbers<T>& m, const Vector<T>& y, const Vector<T>& u) {
    const Index n = m.A.rows();
    T scratch;
    Vector<T> innovation = product(m.C, x_predicted);
    for (Index i = 0; i < y.size(); ++i) innovation(i) = y(i) - innovation(i);
    perturb(innovation);
    x_filtered = product(Kf, innovation);
    for (Index i = 0; i < n; ++i) x_filtered(i) += x_predicted(i);
    perturb(x_filtered);
    x_filtered_scale = std::max(magnitude(x_predicted),
                                magnitude(Kf) + std::max(magnitude(y), magnitude(m.C) + magnitude(x_predicted))) +
                       2;
    if constexpr (form == Form::joseph) {
      x_next = product(m.A, x_filtered);
    } else {
      x_next = product(m.A, x_predicted);
      const Vector<T> correction = product(K, innovation);
      for (Index i = 0; i < n; ++i) x_next(i) += correction(i);
    }
    x_next_scale = magnitude(m.A) + x_filtered_scale;
    for (Index i = 0; i < n; ++i) {
      for (Index j = 0; j < u.size(); ++j) add_product(x_next(i), m.D(i, j), u(j), scratch);
      if (m.Bw.size() > 0) x_next(i) += m.Bw(i);
    }
    x_next_scale = std::max({x_next_scale, magnitude(m.D) + magnitude(u), magnitude(m.Bw)}) + 2;
    perturb(x_next);
    advance_likelihood(innovation);
  }

  /// -1/2 (p log 2 pi + log det Re + e' Re^{-1} e)
  void advance_likelihood(const Vector<T>& innovation) {
    const Index p = Re.rows();
    T determinant = 1, square = 0, scratch;
    if constexpr (form == Form::joseph) {
      for (Index i = 0; i < p; ++i) determinant *= L_(i, i) * L_(i, i);
      const Vector<T> weighted = product(Re_inverse, innovation);
      for (Index i = 0; i < p; ++i) add_product(square, innovation(i), weighted(i), scratch);
    } else {
      for (Index i = 0; i < p; ++i) determinant *= L_(i, i);
      determinant *= determinant;
      Vector<T> whitened = innovation;
      for (Index i = 0; i < p; ++i) {
        for (Index j = 0; j < i; ++j) subtract_product(whitened(i), L_(i, j), whitened(j), scratch);
        whitened(i) /= L_(i, i);
        add_product(square, whitened(i), whitened(i), scratch);
      }
    }
    T pi;
    mpfr_const_pi(pi.backend().data(), MPFR_RNDN);
    const T log_determinant = log(determinant), constant = p * log(T(2 * pi));
    log_likelihood.resize(1, 1);
    log_likelihood(0, 0) = -(constant + log_determinant + square) / 2;
    perturb(log_likelihood);
    Matrix<T> terms(3, 1);
    terms(0, 0) = constant;
    terms(1, 0) = log_determinant;
    terms(2, 0) = square;
    log_likelihood_scale = magnitude(terms);
  }

  double cosine() const {
    // ||A P A' + B Q B'|| as ||P+ + K Re K'||: sums of semidefinite terms, good to all digits of a double
    Matrix<T> before = P_next;
    add_symmetric_product(before, product(K, Re), K);
    const T norm = two_norm(before);
    return norm == 0 ? 1 : std::min(1.0, reference::round_to_double(T(sqrt(T(two_norm(P_next) / norm)))));
  }

  InformationLoss information_loss() const {
    const Numbers<T>& m = *numbers_;
    InformationLoss loss{.A = 1, .Q_root = 1, .R_root = m.k_R_root, .spread = 0, .inverse_cosine = 1,
                         .T = std::sqrt(condition(P_filtered, Y))};
    Matrix<T> annexed = m.CRC;
    if (previous_) {
      // Q and A carried x_{k-1} to x_k
      const Matrix<T> AY = product(transposed(previous_->A_inverse), Y_previous_);
      add_symmetric_product(annexed, AY, transposed(previous_->A_inverse));
      Matrix<T> Qe_inverse = previous_->Q_inverse;
      const Matrix<T> BT = transposed(previous_->A_inverse_B);
      add_symmetric_product(Qe_inverse, product(BT, Y_previous_), BT);
      Matrix<T> root;
      loss.A = previous_->k_A;
      if (Qe_inverse.rows() > 0) {
        loss.spread = 1;
        loss.Q_root = previous_->k_Q_root;
      }
      if (Qe_inverse.rows() > 1 && cholesky(Qe_inverse, root).done)
        loss.spread = std::sqrt(condition(Qe_inverse, inverse_from_root_inverse(lower_inverse(root))));
    } else {
      const Matrix<T> Y0 = information_of_start();
      for (Index j = 0; j < annexed.cols(); ++j)
        for (Index i = 0; i < annexed.rows(); ++i) annexed(i, j) += Y0(i, j);
    }
    const T left = two_norm(Y);
    if (left > 0)
      loss.inverse_cosine = std::max(1.0, reference::round_to_double(T(sqrt(T(two_norm(annexed) / left)))));
    return loss;
  }

  Matrix<T> information_of_start() const {
    const auto& any = *std::get<const AnyProblem<double>*>(source_);
    const Matrix<T> T0 = exact_upper_transposed<T>(std::get<Problem<InformationModel<double>>>(any).initial);
    return symmetric_product(T0, T0);
  }

  [[noreturn]] void overflow(const char* name) const {
    throw ReferenceError("step " + std::to_string(k_) + ": " + name + " does not fit a double (overflow)");
  }

  template <int Cols>
  void in_range(const Matrix<T, Dynamic, Cols>& X, const char* name) const {
    for (Index j = 0; j < X.cols(); ++j)
      for (Index i = 0; i < X.rows(); ++i)
        if (!mpfr_number_p(X(i, j).backend().data()) ||
            (X(i, j) != 0 && mpfr_get_exp(X(i, j).backend().data()) > std::numeric_limits<double>::max_exponent))
          overflow(name);
  }

  template <int Cols>
  Matrix<double, Dynamic, Cols> rounded(const Matrix<T, Dynamic, Cols>& X, const char* name) const {
    Matrix<double, Dynamic, Cols> X_rounded = round_to_double(X);
    if (!all_finite(X_rounded)) overflow(name);
    return X_rounded;
  }

  static void subtract(Matrix<T>& X, const Matrix<T>& Y) {
    for (Index j = 0; j < X.cols(); ++j)
      for (Index i = 0; i < X.rows(); ++i) X(i, j) -= Y(i, j);
  }

  /// X := X L^{-T}, L lower.
  static void solve_right_transposed(const Matrix<T>& L, Matrix<T>& X) {
    const Entries xs = entries(X), ls = entries(L);
    for (Index j = 0; j < L.cols(); ++j)
      for (Index r = 0; r < X.rows(); ++r) {
        fused_dot(*X(r, j).backend().data(), Into::subtract, xs.row(r), ls.row(j), j);
        X(r, j) /= L(j, j);
      }
  }
  /// X := X L^{-1}, L lower.
  static void solve_right(const Matrix<T>& L, Matrix<T>& X) {
    const Entries xs = entries(X), ls = entries(L);
    for (Index j = L.cols() - 1; j >= 0; --j)
      for (Index r = 0; r < X.rows(); ++r) {
        fused_dot(*X(r, j).backend().data(), Into::subtract, xs.row(r, j + 1), ls.column(j, j + 1), L.cols() - 1 - j);
        X(r, j) /= L(j, j);
      }
  }

  void perturb_number(T& x) {
    if (x == 0) return;
    // a bit of splitmix64: deterministic, the same on every machine
    std::uint64_t z = (counter_ += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    z ^= z >> 31;
    const long units = 1 + static_cast<long>(z >> 1 & 1023);
    const auto last_place = mpfr_get_exp(x.backend().data()) - mpfr_get_prec(x.backend().data());
    T move;
    mpfr_set_si_2exp(move.backend().data(), z & 1 ? units : -units, last_place, MPFR_RNDN);
    mpfr_add(x.backend().data(), x.backend().data(), move.backend().data(), MPFR_RNDN);
  }
  template <int Cols>
  void perturb(Matrix<T, Dynamic, Cols>& X) {
    if constexpr (form == Form::joseph) return;
    for (Index j = 0; j < X.cols(); ++j)
      for (Index i = 0; i < X.rows(); ++i) perturb_number(X(i, j));
  }
  void perturb_symmetric(Matrix<T>& X) {
    if constexpr (form == Form::joseph) return;
    for (Index j = 0; j < X.cols(); ++j)
      for (Index i = j; i < X.rows(); ++i) {
        perturb_number(X(i, j));
        X(j, i) = X(i, j);
      }
  }

  Source source_;
  bool with_data_;
  std::uint64_t counter_ = 0;
  std::int64_t k_ = -1;
  std::shared_ptr<const Numbers<T>> numbers_, previous_;
  Matrix<T> L_, L_inverse_, J_, W_, Y_previous_;
};

}  // namespace kfstab::reference::detail
