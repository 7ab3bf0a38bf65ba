#pragma once

#include <algorithm>
#include <array>
#include <limits>
#include <optional>

#include <kfstab/reference/detail/agreement.hpp>
#include <kfstab/reference/detail/decimal.hpp>
#include <kfstab/reference/detail/lockstep.hpp>
#include <kfstab/reference/detail/recursion.hpp>
#include <kfstab/reference/rounded.hpp>

namespace kfstab::reference::detail {

template <unsigned Low, unsigned High>
class LockstepOf final : public Lockstep {
  using L = Real<Low>;
  using H = Real<High>;
  using Witness = Recursion<L, Form::conventional>;
  using TruthRun = Recursion<H, Form::joseph>;

 public:
  LockstepOf(const Source& source, bool with_data)
      : low_(source, with_data), high_(source, with_data), information_(is_information(source)),
        is_exact_(std::holds_alternative<const ExactProblem*>(source)) {}

  bool advance(const SourceData& data, const Request& request) override {
    const auto low_end = low_.advance(data);
    const auto high_end = high_.advance(data);
    if (!low_end.done || !high_end.done) return broken_down(low_end, high_end);
    if (!is_exact_) high_.require_range();

    wanted_ = request.digits;
    each_entry_ = request.each_entry;
    agreed_.fill(static_cast<int>(Low));
    K_is_zero_ = Kf_is_zero_ = F_is_zero_ = x_filtered_is_zero_ = x_next_is_zero_ = false;
    at(Quantity::P_predicted) = P_next_agreed_;
    at(Quantity::x_predicted) = x_next_agreed_;
    if (high_.k() == 0) agree(Quantity::P_predicted, "P_{0|-1}", low_.P_predicted, high_.P_predicted, high_.P_filtered_scale);
    agree(Quantity::innovation, "Re", low_.Re, high_.Re, high_.Re_scale);
    agree(Quantity::P_filtered, "P_{k|k}", low_.P_filtered, high_.P_filtered, high_.P_filtered_scale);
    agree(Quantity::P_next, "P_{k+1|k}", low_.P_next, high_.P_next, high_.P_next_scale);
    agree_or_zero(at(Quantity::filter_gain), "Kf", low_.Kf, high_.Kf, high_.Kf_scale, Kf_is_zero_);
    agree_or_zero(at(Quantity::predictor_gain), "K", low_.K, high_.K, high_.K_scale, K_is_zero_);
    int other = static_cast<int>(Low);
    agree_or_zero(other, "F", low_.F, high_.F, high_.F_scale, F_is_zero_);
    if (information_) record("P_{k|k}^{-1}", agreement(high_.Y, low_.Y, true, static_cast<int>(Low)));
    if (high_.x_next.size() > 0) {
      agree_or_zero(at(Quantity::x_filtered), "x_{k|k}", low_.x_filtered, high_.x_filtered, high_.x_filtered_scale,
                    x_filtered_is_zero_);
      agree_or_zero(at(Quantity::x_next), "x_{k+1|k}", low_.x_next, high_.x_next, high_.x_next_scale, x_next_is_zero_);
      bool is_zero = false;
      agree_or_zero(at(Quantity::log_likelihood), "the log-likelihood", low_.log_likelihood, high_.log_likelihood,
                    high_.log_likelihood_scale, is_zero);
    }
    P_next_agreed_ = at(Quantity::P_next);
    x_next_agreed_ = at(Quantity::x_next);
    return certified_ >= request.digits;
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
    return measure_step(metadata, step);
  }
  Errors measure(const Metadata& metadata, const Step<Rounded>& step) const override {
    return measure_step(metadata, step);
  }

  Matrix<double> entry_errors(const Metadata& metadata, const Step<double>& step) const override {
    if (!step.held) return {};
    const Matrix<double> held = read_part(metadata.holds, *step.held);
    if (!all_finite(held)) return {};
    const auto X = covariance(metadata.holds, held);
    if (!X) return {};
    const bool filtered = metadata.instant == Instant::filtered;
    const Matrix<H>& P = truth_of(filtered);
    const Vector<H> deviation = deviations(filtered);
    Matrix<double> errors = Matrix<double>::Zero(P.rows(), P.cols());
    for (Index j = 0; j < P.cols(); ++j)
      for (Index i = 0; i < P.rows(); ++i)
        if (deviation(i) != 0 && deviation(j) != 0)
          errors(i, j) = ratio(abs(H((*X)(i, j) - P(i, j))), H(deviation(i) * deviation(j)));
    return errors;
  }

  std::vector<Matrix<double>> expansion(Quantity quantity, int terms) const override {
    return with_matrix(high_, quantity, [&](const auto& X) {
      Matrix<H> left = X;
      std::vector<Matrix<double>> sum;
      for (int term = 0; term < terms; ++term) {
        sum.push_back(round_to_double(left));
        for (Index j = 0; j < left.cols(); ++j)
          for (Index i = 0; i < left.rows(); ++i) left(i, j) -= sum.back()(i, j);
      }
      return sum;
    });
  }

  std::vector<std::vector<std::string>> decimals(Quantity quantity, int most_digits) const override {
    return with_matrix(high_, quantity, [&](const auto& X) {
      return with_matrix(low_, quantity, [&](const auto& Y) {
        std::vector<std::vector<std::string>> text(static_cast<std::size_t>(X.rows()));
        for (Index i = 0; i < X.rows(); ++i)
          for (Index j = 0; j < X.cols(); ++j)
            text[static_cast<std::size_t>(i)].push_back(decimal(X(i, j), Y(i, j), most_digits, static_cast<int>(Low)));
        return text;
      });
    });
  }

  int certified_digits() const override { return certified_; }
  int certified_digits(Quantity quantity) const override { return agreed_[static_cast<std::size_t>(quantity)]; }
  int lower_digits() const override { return static_cast<int>(Low); }
  int higher_digits() const override { return static_cast<int>(High); }

 private:
  template <class Number>
  Errors measure_step(const Metadata& metadata, const Step<Number>& step) const {
    constexpr double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
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
    const Matrix<Number> held = read_part(metadata.holds, *step.held);
    if (!all_finite(held)) return errors;
    const auto X = covariance(metadata.holds, held);
    if (X) {
      measure_covariance(*X, filtered, precision(held), errors);
    } else {
      errors.covariance = errors.entrywise = infinity;
    }
    errors.asymmetry = 0;
    errors.positive_semidefinite = true;
    switch (metadata.holds) {
      case Held::covariance:
        errors.asymmetry = ratio(H(frobenius_distance(*X, transposed(*X)) / 2), H(frobenius(truth_of(filtered))));
        errors.smallest_eigenvalue = smallest_eigenvalue(held);
        errors.positive_semidefinite = is_positive_semidefinite(held);
        break;
      case Held::covariance_factor: errors.smallest_eigenvalue = least_eigenvalue_of_product(held); break;
      case Held::covariance_root: {
        Matrix<H> inverse;
        errors.smallest_eigenvalue = invert(exact<H>(held), inverse) ? least_eigenvalue(inverse) : 0;
        break;
      }
      case Held::ud_factors: measure_signs(held, *X, errors); break;
      case Held::information: {
        const Matrix<H> Y = exact<H>(held);
        if (X) errors.smallest_eigenvalue = smallest_eigenvalue(round_to_double(*X));
        if (information_ && filtered) errors.information = ratio(frobenius_distance(Y, high_.Y), frobenius(high_.Y));
        errors.asymmetry = ratio(H(frobenius_distance(Y, transposed(Y)) / 2), H(frobenius(Y)));
        errors.positive_semidefinite = is_positive_definite(held);
        break;
      }
      case Held::information_factor: {
        const Matrix<H> T_transposed = exact<H>(held);
        if (information_ && filtered)
          errors.information =
              ratio(frobenius_distance(symmetric_product(T_transposed, T_transposed), high_.Y), frobenius(high_.Y));
        errors.smallest_eigenvalue = least_eigenvalue(T_transposed);
        break;
      }
      case Held::gain: break;
    }
    return errors;
  }

  bool broken_down(const typename Witness::End& low_end, const typename TruthRun::End& high_end) {
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

  int& at(Quantity quantity) { return agreed_[static_cast<std::size_t>(quantity)]; }

  /// Rounding of its terms in both precisions, at the level of each (that fraction of its digits below them): it is zero.
  template <class X, class Y>
  static bool no_more_than_rounding(const X& high, const Y& low, double scale, double level) {
    const double bits_of_a_digit = std::log2(10.0);
    return magnitude(high) <= scale - level * High * bits_of_a_digit &&
           magnitude(low) <= scale - level * Low * bits_of_a_digit;
  }

  /// The least agreement of an entry, but for those that are zero. Small entries are common, small norms are not: it
  /// takes more to be taken for zero.
  template <int Cols>
  static int agreement_of_entries(const Matrix<H, Dynamic, Cols>& high, const Matrix<L, Dynamic, Cols>& low, double scale) {
    int least = static_cast<int>(Low);
    for (Index j = 0; j < high.cols(); ++j)
      for (Index i = 0; i < high.rows(); ++i) {
        const int digits = digits_of(distance(high(i, j), low(i, j)), distance(high(i, j), L(0)), static_cast<int>(Low));
        if (digits < least && !no_more_than_rounding(high.block(i, j, 1, 1), low.block(i, j, 1, 1), scale, 0.9))
          least = digits;
      }
    return least;
  }

  void agree(Quantity quantity, const char* name, const Matrix<L>& low, const Matrix<H>& high, double scale) {
    record(name, at(quantity) = each_entry_ ? agreement_of_entries(high, low, scale)
                                            : agreement(high, low, true, static_cast<int>(Low)));
  }

  template <int Cols>
  void agree_or_zero(int& digits, const char* name, const Matrix<L, Dynamic, Cols>& low,
                     const Matrix<H, Dynamic, Cols>& high, double scale, bool& is_zero) {
    digits = agreement(high, low, false, static_cast<int>(Low));
    is_zero = digits < wanted_ && no_more_than_rounding(high, low, scale, 0.8);
    if (is_zero) return;
    if (each_entry_) digits = agreement_of_entries(high, low, scale);
    record(name, digits);
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

  template <class Number, int Cols>
  static double relative_error(const Matrix<Number, Dynamic, Cols>& computed, const Matrix<H, Dynamic, Cols>& truth,
                               bool truth_is_zero) {
    check_shape(computed.rows(), computed.cols(), truth, Cols == 1 ? "the filter's state" : "the filter's gain");
    if (!all_finite(computed)) return std::numeric_limits<double>::quiet_NaN();
    const Matrix<H, Dynamic, Cols> X = exact<H>(computed);
    if (truth_is_zero) return ratio(frobenius(X), H(0));
    return ratio(frobenius_distance(X, truth), frobenius(truth));
  }

  const Matrix<H>& truth_of(bool filtered) const { return filtered ? high_.P_filtered : high_.P_next; }

  /// Of what is held, the triangle that counts and zeros: lower S and T', upper U D.
  template <class Number>
  Matrix<Number> read_part(Held holds, const Matrix<Number>& held) const {
    check_shape(held.rows(), held.cols(), high_.P_next, "what the filter holds");
    const bool lower = holds == Held::covariance_factor, upper = holds == Held::ud_factors,
               transpose = holds == Held::information_factor;
    Matrix<Number> part = transpose ? Matrix<Number>(held.transpose()) : held;
    for (Index j = 0; j < part.cols(); ++j)
      for (Index i = 0; i < part.rows(); ++i)
        if (i < j ? lower || transpose : i > j && upper) part(i, j) = 0;
    return part;
  }

  /// The P that is meant, formed in H from the exact numbers; nothing where it is infinite.
  template <class Number>
  std::optional<Matrix<H>> covariance(Held holds, const Matrix<Number>& held) const {
    Matrix<H> X = exact<H>(held);
    switch (holds) {
      case Held::covariance: return X;
      case Held::covariance_factor:
      case Held::covariance_root: return symmetric_product(X, X);
      case Held::ud_factors: {
        Matrix<H> X_D = X;
        for (Index j = 0; j < X.cols(); ++j) {
          X(j, j) = 1;
          for (Index i = 0; i < j; ++i) X_D(i, j) = X(i, j) * X_D(j, j);
        }
        return symmetric_product(X_D, X);
      }
      case Held::information_factor:
        if (has_zero_on_diagonal(X)) return {};
        return covariance_of_information_root(X);
      case Held::information: {
        Matrix<H> inverse;
        if (!invert(X, inverse)) return {};
        return inverse;
      }
      case Held::gain: break;
    }
    return {};
  }

  static bool has_zero_on_diagonal(const Matrix<H>& X) {
    for (Index i = 0; i < X.rows(); ++i)
      if (X(i, i) == 0) return true;
    return false;
  }

  static double least_eigenvalue_of_product(const Matrix<double>& S) { return smallest_eigenvalue_of_product(S); }
  static double least_eigenvalue_of_product(const Matrix<Rounded>& S) {
    const Matrix<H> L = exact<H>(S);
    return has_zero_on_diagonal(L) ? 0 : least_eigenvalue(lower_inverse(L));
  }

  /// Bits of what the filter computes in.
  static int precision(const Matrix<double>&) { return std::numeric_limits<double>::digits; }
  static int precision(const Matrix<Rounded>& held) { return held.size() > 0 ? held(0, 0).precision() : 0; }

  /// 1 / ||X||_2^2: of X X' inverted, or X'X.
  static double least_eigenvalue(const Matrix<H>& X) {
    if (X.size() == 0) return std::numeric_limits<double>::infinity();
    const H norm = two_norm(X);
    return reference::round_to_double(H(1 / H(norm * norm)));
  }

  /// The signs of D are those of P = U D U', by Sylvester's law.
  template <class Number>
  static void measure_signs(const Matrix<Number>& held, const Matrix<H>& X, Errors& errors) {
    const Matrix<H> UD = exact<H>(held);
    const Index n = UD.rows();
    bool positive = true;
    for (Index i = 0; i < n; ++i) {
      errors.positive_semidefinite = errors.positive_semidefinite && UD(i, i) >= 0;
      positive = positive && UD(i, i) > 0;
    }
    if (positive) {
      // P = (U D^{1/2}) (U D^{1/2})', and the inverse of that root is as robust as any triangle's.
      Matrix<H> root_transposed = zeros<H>(n, n);
      for (Index j = 0; j < n; ++j) {
        const H d = sqrt(UD(j, j));
        for (Index i = 0; i < j; ++i) root_transposed(j, i) = d * UD(i, j);
        root_transposed(j, j) = d;
      }
      errors.smallest_eigenvalue = least_eigenvalue(lower_inverse(root_transposed));
    } else {
      errors.smallest_eigenvalue = errors.positive_semidefinite ? 0 : std::min(0.0, smallest_eigenvalue(round_to_double(X)));
    }
  }

  /// p_ii^{1/2} of the truth. A variance that the two runs do not share to some digits is rounding of something larger:
  /// as good as zero.
  Vector<H> deviations(bool filtered) const {
    const Matrix<H>& P = truth_of(filtered);
    const Matrix<L>& P_low = filtered ? low_.P_filtered : low_.P_next;
    const H tolerance = power_of_ten<H>(-std::min(20, wanted_));
    Vector<H> deviation(P.rows());
    for (Index i = 0; i < P.rows(); ++i) {
      const bool certain = P(i, i) > 0 && abs(H(H(P_low(i, i)) - P(i, i))) <= H(tolerance * P(i, i));
      deviation(i) = certain ? H(sqrt(P(i, i))) : H(0);
    }
    return deviation;
  }

  void measure_covariance(const Matrix<H>& X, bool filtered, int bits, Errors& errors) const {
    const Matrix<H>& P = truth_of(filtered);
    errors.covariance = ratio(frobenius_distance(X, P), frobenius(P));
    const double most = bits * std::log10(2.0);
    errors.correct_digits = errors.covariance > 0 ? std::clamp(-std::log10(errors.covariance), 0.0, most) : most;
    const Vector<H> deviation = deviations(filtered);
    errors.entrywise = 0;
    for (Index j = 0; j < P.cols(); ++j)
      for (Index i = 0; i < P.rows(); ++i)
        if (deviation(i) != 0 && deviation(j) != 0)
          errors.entrywise =
              std::max(errors.entrywise, ratio(abs(H(X(i, j) - P(i, j))), H(deviation(i) * deviation(j))));
  }

  /// f(X) of a run's quantity, a matrix or a vector.
  template <class Run, class F>
  static auto with_matrix(const Run& run, Quantity which, F&& f) {
    switch (which) {
      case Quantity::P_predicted: return f(run.P_predicted);
      case Quantity::P_filtered: return f(run.P_filtered);
      case Quantity::P_next: return f(run.P_next);
      case Quantity::innovation: return f(run.Re);
      case Quantity::predictor_gain: return f(run.K);
      case Quantity::filter_gain: return f(run.Kf);
      case Quantity::x_predicted: return f(run.x_predicted);
      case Quantity::x_filtered: return f(run.x_filtered);
      case Quantity::x_next: return f(run.x_next);
      case Quantity::log_likelihood: break;
    }
    return f(run.log_likelihood);
  }

  Witness low_;
  TruthRun high_;
  bool information_, is_exact_;
  /// Of this step, by Quantity.
  std::array<int, quantities> agreed_{};
  int P_next_agreed_ = static_cast<int>(Low), x_next_agreed_ = static_cast<int>(Low);
  int wanted_ = 0;
  bool each_entry_ = false;
  int certified_ = static_cast<int>(Low);
  std::string why_;
  bool K_is_zero_ = false, Kf_is_zero_ = false, F_is_zero_ = false, x_filtered_is_zero_ = false,
       x_next_is_zero_ = false;
};

}  // namespace kfstab::reference::detail
