#pragma once

#include <algorithm>
#include <limits>

#include <kfstab/reference/detail/lockstep.hpp>
#include <kfstab/reference/detail/recursion.hpp>

namespace kfstab::reference::detail {

template <unsigned Low, unsigned High>
class LockstepOf final : public Lockstep {
  using L = Real<Low>;
  using H = Real<High>;

 public:
  LockstepOf(const AnyProblem<double>& problem, bool with_data)
      : low_(problem, with_data, true), high_(problem, with_data, false) {}

  bool advance(const StepData* data, int wanted) override {
    const auto low_end = low_.advance(data);
    const auto high_end = high_.advance(data);
    if (!low_end.done || !high_end.done) return broken_down(low_end, high_end);

    wanted_ = wanted;
    K_is_zero_ = Kf_is_zero_ = F_is_zero_ = x_filtered_is_zero_ = x_next_is_zero_ = false;
    if (high_.k() == 0) agree("P_{0|-1}", low_.P_predicted, high_.P_predicted);
    agree("Re", low_.Re, high_.Re);
    agree("P_{k|k}", low_.P_filtered, high_.P_filtered);
    agree("P_{k+1|k}", low_.P_next, high_.P_next);
    agree_or_zero("Kf", low_.Kf, high_.Kf, high_.Kf_scale, Kf_is_zero_);
    agree_or_zero("K", low_.K, high_.K, high_.K_scale, K_is_zero_);
    agree_or_zero("F", low_.F, high_.F, high_.F_scale, F_is_zero_);
    if (high_.information_problem()) agree("P_{k|k}^{-1}", low_.Y, high_.Y);
    if (high_.x_next.size() > 0) {
      agree_or_zero("x_{k|k}", low_.x_filtered, high_.x_filtered, high_.x_filtered_scale, x_filtered_is_zero_);
      agree_or_zero("x_{k+1|k}", low_.x_next, high_.x_next, high_.x_next_scale, x_next_is_zero_);
    }
    return certified_ >= wanted;
  }

  const std::string& why() const override { return why_; }

  void round_into(Truth& truth) const override {
    high_.round_into(truth);
    if (Kf_is_zero_) truth.filter_gain.setZero();
    if (K_is_zero_) truth.predictor_gain.setZero();
    if (F_is_zero_) truth.closed_loop.setZero();
    if (x_filtered_is_zero_) truth.x_filtered.setZero();
    if (x_next_is_zero_) truth.x_next.setZero();
  }

  Errors measure(const Metadata& metadata, const Step<double>& step) const override {
    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    Errors errors{nan, nan, nan, nan, nan, nan, nan, false, 0};
    const bool filtered = metadata.instant == Instant::filtered;
    if (step.gain) {
      const bool predictor = metadata.gain == GainKind::predictor;
      errors.gain = predictor ? relative_error(*step.gain, high_.K, K_is_zero_)
                              : relative_error(*step.gain, high_.Kf, Kf_is_zero_);
    }
    if (step.state && high_.x_next.size() > 0)
      errors.state = filtered ? relative_error(*step.state, high_.x_filtered, x_filtered_is_zero_)
                              : relative_error(*step.state, high_.x_next, x_next_is_zero_);
    if (!step.held) return errors;
    const Matrix<double>& held = *step.held;
    check_shape(held.rows(), held.cols(), high_.P_next, "what the filter holds");

    const Matrix<H>& P = filtered ? high_.P_filtered : high_.P_next;
    const Matrix<L>& P_low = filtered ? low_.P_filtered : low_.P_next;
    switch (metadata.holds) {
      case Held::covariance: {
        if (!all_finite(held)) return errors;
        const Matrix<H> X = exact<H>(held);
        measure_covariance(X, P, P_low, errors);
        errors.asymmetry = ratio(H(frobenius_distance(X, transposed(X)) / 2), H(frobenius(P)));
        errors.smallest_eigenvalue = smallest_eigenvalue(held);
        errors.positive_semidefinite = is_positive_semidefinite(held);
        break;
      }
      case Held::covariance_factor: {
        const Matrix<double> S = held.triangularView<Eigen::Lower>();
        if (!all_finite(S)) return errors;
        const Matrix<H> exact_S = exact<H>(S);
        measure_covariance(symmetric_product(exact_S, exact_S), P, P_low, errors);
        errors.asymmetry = 0;
        errors.smallest_eigenvalue = smallest_eigenvalue_of_product(S);
        errors.positive_semidefinite = true;
        break;
      }
      case Held::covariance_root: {
        if (!all_finite(held)) return errors;
        const Matrix<H> F = exact<H>(held);
        const Matrix<H> X = symmetric_product(F, F);
        measure_covariance(X, P, P_low, errors);
        errors.asymmetry = 0;
        Matrix<H> F_inverse;
        const H norm = invert(F, F_inverse) ? two_norm(F_inverse) : H(0);
        errors.smallest_eigenvalue = norm > 0 ? reference::round_to_double(H(1 / H(norm * norm))) : 0;
        errors.positive_semidefinite = true;
        break;
      }
      case Held::ud_factors: {
        const Matrix<double> UD = held.triangularView<Eigen::Upper>();
        if (!all_finite(UD)) return errors;
        measure_ud(UD, P, P_low, errors);
        break;
      }
      case Held::information: {
        if (!all_finite(held)) return errors;
        const Matrix<H> X = exact<H>(held);
        Matrix<H> covariance;
        if (invert(X, covariance)) {
          measure_covariance(covariance, P, P_low, errors);
          errors.smallest_eigenvalue = smallest_eigenvalue(round_to_double(covariance));
        } else {
          errors.covariance = errors.entrywise = std::numeric_limits<double>::infinity();
        }
        if (high_.information_problem() && filtered)
          errors.information = ratio(frobenius_distance(X, high_.Y), frobenius(high_.Y));
        errors.asymmetry = ratio(H(frobenius_distance(X, transposed(X)) / 2), H(frobenius(X)));
        errors.positive_semidefinite = is_positive_definite(held);
        break;
      }
      case Held::gain: break;
      case Held::information_factor: {
        const Matrix<double> T_transposed = held.transpose().triangularView<Eigen::Lower>();
        if (!all_finite(T_transposed)) return errors;
        const Matrix<H> exact_T = exact<H>(T_transposed);
        if ((T_transposed.diagonal().array() == 0).any()) {
          errors.covariance = errors.entrywise = std::numeric_limits<double>::infinity();
        } else {
          measure_covariance(covariance_of_information_root(exact_T), P, P_low, errors);
        }
        if (high_.information_problem() && filtered)
          errors.information =
              ratio(frobenius_distance(symmetric_product(exact_T, exact_T), high_.Y), frobenius(high_.Y));
        errors.asymmetry = 0;
        const H norm = two_norm(exact_T);
        errors.smallest_eigenvalue = reference::round_to_double(H(1 / H(norm * norm)));
        errors.positive_semidefinite = true;
        break;
      }
    }
    return errors;
  }

  std::vector<Matrix<double>> expansion(Quantity quantity, int terms) const override {
    Matrix<H> left = high_.quantity(quantity);
    std::vector<Matrix<double>> sum;
    for (int term = 0; term < terms; ++term) {
      sum.push_back(round_to_double(left));
      for (Index j = 0; j < left.cols(); ++j)
        for (Index i = 0; i < left.rows(); ++i) left(i, j) -= sum.back()(i, j);
    }
    return sum;
  }

  int certified_digits() const override { return certified_; }
  int lower_digits() const override { return static_cast<int>(Low); }
  int higher_digits() const override { return static_cast<int>(High); }

 private:
  bool broken_down(const typename Recursion<L>::End& low_end, const typename Recursion<H>::End& high_end) {
    const std::string step = "step " + std::to_string(high_.k()) + ": ";
    if (!low_end.done && !high_end.done && !low_end.no_information && !high_end.no_information) {
      // Both see the same pivot, to three digits: it is there, not made by rounding.
      const H low_pivot(low_end.pivot);
      const H distance = abs(H(low_pivot - high_end.pivot));
      if (low_end.row == high_end.row && distance <= H(abs(high_end.pivot) / 1000)) {
        throw ReferenceError(step + "Re is not positive definite: pivot " + std::to_string(high_end.row) +
                             " of its Cholesky factorisation is " + high_end.pivot.str(6));
      }
    }
    why_ = step + (low_end.no_information || high_end.no_information ? "P_{k|k}" : "Re") +
           " is singular or indefinite as far as " + std::to_string(Low) + " digits can tell";
    return false;
  }

  template <int Cols>
  void agree(const char* name, const Matrix<L, Dynamic, Cols>& low, const Matrix<H, Dynamic, Cols>& high) {
    record(name, agreement(low, high));
  }

  template <int Cols>
  void agree_or_zero(const char* name, const Matrix<L, Dynamic, Cols>& low, const Matrix<H, Dynamic, Cols>& high,
                     double scale, bool& is_zero) {
    const int digits = agreement(low, high);
    if (digits < wanted_) {
      // Rounding of its terms in both precisions, at the level of each: it is zero.
      const double bits_of_a_digit = std::log2(10.0);
      is_zero = magnitude(high) <= scale - 0.8 * High * bits_of_a_digit &&
                magnitude(low) <= scale - 0.8 * Low * bits_of_a_digit;
      if (is_zero) return;
    }
    record(name, digits);
  }

  template <int Cols>
  static int agreement(const Matrix<L, Dynamic, Cols>& low, const Matrix<H, Dynamic, Cols>& high) {
    const H distance = frobenius_distance(high, low);
    if (distance == 0) return static_cast<int>(Low);
    const H norm = frobenius(high);
    if (!(norm > 0) || !is_finite(distance)) return 0;
    return std::clamp(digits_of(H(distance / norm)), 0, static_cast<int>(Low));
  }

  void record(const char* name, int digits) {
    if (digits >= certified_) return;
    certified_ = digits;
    why_ = "step " + std::to_string(high_.k()) + ": " + name + " agrees to " + std::to_string(digits) + " digits at " +
           std::to_string(Low) + " and " + std::to_string(High);
  }

  /// error / size, where 0 / 0 is 0.
  static double ratio(const H& error, const H& size) {
    if (error == 0) return 0;
    if (size == 0) return std::numeric_limits<double>::infinity();
    return reference::round_to_double(H(error / size));
  }

  template <int Cols>
  static void check_shape(Index rows, Index cols, const Matrix<H, Dynamic, Cols>& truth, const char* name) {
    if (rows != truth.rows() || cols != truth.cols())
      throw ReferenceError(std::string(name) + " is " + std::to_string(rows) + " x " + std::to_string(cols) +
                           ", expected " + std::to_string(truth.rows()) + " x " + std::to_string(truth.cols()));
  }

  template <int Cols>
  static double relative_error(const Matrix<double, Dynamic, Cols>& computed, const Matrix<H, Dynamic, Cols>& truth,
                               bool truth_is_zero) {
    check_shape(computed.rows(), computed.cols(), truth, Cols == 1 ? "the filter's state" : "the filter's gain");
    if (!all_finite(computed)) return std::numeric_limits<double>::quiet_NaN();
    const Matrix<H, Dynamic, Cols> X = exact<H>(computed);
    if (truth_is_zero) return ratio(frobenius(X), H(0));
    return ratio(frobenius_distance(X, truth), frobenius(truth));
  }

  /// The signs of D are those of P = U D U', by Sylvester's law.
  void measure_ud(const Matrix<double>& UD, const Matrix<H>& P, const Matrix<L>& P_low, Errors& errors) const {
    const Index n = UD.rows();
    Matrix<H> U = exact<H>(UD), U_D = U;
    bool definite = true;
    errors.positive_semidefinite = true;
    for (Index j = 0; j < n; ++j) {
      const double d = UD(j, j);
      U(j, j) = 1;
      for (Index i = 0; i <= j; ++i) U_D(i, j) = U(i, j) * d;
      definite = definite && d > 0;
      errors.positive_semidefinite = errors.positive_semidefinite && d >= 0;
    }
    const Matrix<H> X = symmetric_product(U_D, U);
    measure_covariance(X, P, P_low, errors);
    errors.asymmetry = 0;
    if (definite) {
      // P = (U D^{1/2}) (U D^{1/2})', and the inverse of that root is as robust as any triangle's.
      Matrix<H> root_transposed = zeros<H>(n, n);
      for (Index j = 0; j < n; ++j)
        for (Index i = 0; i <= j; ++i) root_transposed(j, i) = U(i, j) * sqrt(H(UD(j, j)));
      const H norm = two_norm(lower_inverse(root_transposed));
      errors.smallest_eigenvalue = n == 0 ? std::numeric_limits<double>::infinity()
                                          : reference::round_to_double(H(1 / H(norm * norm)));
    } else {
      errors.smallest_eigenvalue = errors.positive_semidefinite ? 0 : std::min(0.0, smallest_eigenvalue(round_to_double(X)));
    }
  }

  void measure_covariance(const Matrix<H>& X, const Matrix<H>& P, const Matrix<L>& P_low, Errors& errors) const {
    errors.covariance = ratio(frobenius_distance(X, P), frobenius(P));
    const double most = 53 * std::log10(2.0);
    errors.correct_digits = errors.covariance > 0 ? std::clamp(-std::log10(errors.covariance), 0.0, most) : most;

    // A variance that the two runs do not share to these digits is rounding of something larger: as good as zero.
    const H tolerance = power_of_ten<H>(-std::min(20, wanted_));
    const Index n = P.rows();
    Vector<H> deviation(n);
    for (Index i = 0; i < n; ++i) {
      const bool certain = P(i, i) > 0 && abs(H(H(P_low(i, i)) - P(i, i))) <= H(tolerance * P(i, i));
      deviation(i) = certain ? H(sqrt(P(i, i))) : H(0);
    }
    errors.entrywise = 0;
    for (Index j = 0; j < n; ++j)
      for (Index i = 0; i < n; ++i)
        if (deviation(i) != 0 && deviation(j) != 0)
          errors.entrywise =
              std::max(errors.entrywise, ratio(abs(H(X(i, j) - P(i, j))), H(deviation(i) * deviation(j))));
  }

  Recursion<L> low_;
  Recursion<H> high_;
  int wanted_ = 0;
  int certified_ = static_cast<int>(Low);
  std::string why_;
  bool K_is_zero_ = false, Kf_is_zero_ = false, F_is_zero_ = false, x_filtered_is_zero_ = false,
       x_next_is_zero_ = false;
};

}  // namespace kfstab::reference::detail
