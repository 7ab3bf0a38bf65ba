#include <kfstab/reference/enclosure.hpp>

#include <string>
#include <utility>

#include <boost/multiprecision/mpfi.hpp>

#include <kfstab/reference/detail/elimination.hpp>
#include <kfstab/reference/high_precision.hpp>

namespace kfstab::reference {
namespace {

using Interval =
    boost::multiprecision::number<boost::multiprecision::mpfi_float_backend<60>, boost::multiprecision::et_off>;

using detail::difference_of;
using detail::sandwich;
using detail::sum_of;
using detail::times;
using detail::transpose_of;

template <int Cols>
Matrix<Interval, Dynamic, Cols> enclosed(const Matrix<Rational, Dynamic, Cols>& X) {
  Matrix<Interval, Dynamic, Cols> Y(X.rows(), X.cols());
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) mpfi_set_q(Y(i, j).backend().data(), X(i, j).backend().data());
  return Y;
}

/// -(p log 2 pi + log determinant + weighted) / 2
Matrix<Interval> log_likelihood(Index p, const Interval& determinant, const Interval& weighted) {
  Interval two_pi, sum;
  mpfi_const_pi(two_pi.backend().data());
  two_pi *= 2;
  mpfi_log(two_pi.backend().data(), two_pi.backend().data());
  mpfi_log(sum.backend().data(), determinant.backend().data());
  sum += Interval(two_pi * static_cast<int>(p));
  sum += weighted;
  Matrix<Interval> result(1, 1);
  result(0, 0) = Interval(sum / -2);
  return result;
}

bool surely_positive(const Interval& x) { return mpfi_is_strictly_pos(x.backend().data()) != 0; }

}  // namespace

struct Enclosure::Implementation {
  ExactProblem problem;
  std::unique_ptr<DataStreamOf<Rational>> stream;
  std::int64_t k = -1;
  Matrix<Interval> P_predicted, P_filtered, P_next, Re, K, Kf, x_predicted, x_filtered, x_next, log_likelihood;

  const Matrix<Interval>& of(Quantity quantity) const {
    switch (quantity) {
      case Quantity::P_predicted: return P_predicted;
      case Quantity::P_filtered: return P_filtered;
      case Quantity::P_next: return P_next;
      case Quantity::innovation: return Re;
      case Quantity::predictor_gain: return K;
      case Quantity::filter_gain: return Kf;
      case Quantity::x_predicted: return x_predicted;
      case Quantity::x_filtered: return x_filtered;
      case Quantity::x_next: return x_next;
      case Quantity::log_likelihood: break;
    }
    return log_likelihood;
  }
};

Enclosure::Enclosure(const ExactProblem& problem, std::shared_ptr<const ExactData> data)
    : implementation_(std::make_unique<Implementation>()) {
  Implementation& self = *implementation_;
  self.problem = problem;
  self.P_next = enclosed(problem.initial);
  if (!data) return;
  self.stream = data->open();
  self.x_next = enclosed(Matrix<Rational>(problem.x0));
}

Enclosure::~Enclosure() = default;
Enclosure::Enclosure(Enclosure&&) noexcept = default;
Enclosure& Enclosure::operator=(Enclosure&&) noexcept = default;

void Enclosure::advance() {
  Implementation& self = *implementation_;
  const CovarianceModel<Rational>& model = self.problem.model(++self.k);
  const Matrix<Interval> A = enclosed(model.A), C = enclosed(model.C), R = enclosed(model.R);
  self.P_predicted = self.P_next;
  self.x_predicted = self.x_next;

  const Matrix<Interval> CP = times(C, self.P_predicted);
  self.Re = sum_of(R, times(CP, transpose_of(C)));
  Matrix<Interval> solution = CP;
  Interval determinant;
  if (!detail::solve(self.Re, solution, determinant, surely_positive, true))
    throw ReferenceError("step " + std::to_string(self.k) + ": Re is not proven to be positive definite");
  self.Kf = transpose_of(solution);
  self.K = times(A, self.Kf);
  const Matrix<Interval> J = difference_of(detail::unit<Interval>(A.rows()), times(self.Kf, C));
  self.P_filtered = sum_of(sandwich(J, self.P_predicted), sandwich(self.Kf, R));
  self.P_next = sum_of(sandwich(A, self.P_filtered), sandwich(enclosed(model.B), enclosed(model.Q)));

  if (self.stream) {
    const StepDataOf<Rational>& data = self.stream->next();
    const Matrix<Interval> e = difference_of(enclosed(Matrix<Rational>(data.y)), times(C, self.x_predicted));
    Matrix<Interval> weighted = e;
    if (!detail::solve(self.Re, weighted, determinant, surely_positive, true)) return;  // was solved with before
    self.log_likelihood = log_likelihood(C.rows(), determinant, times(transpose_of(e), weighted)(0, 0));
    self.x_filtered = sum_of(self.x_predicted, times(self.Kf, e));
    self.x_next = times(A, self.x_filtered);
    if (data.u.size() > 0)
      self.x_next = sum_of(self.x_next, times(enclosed(model.D), enclosed(Matrix<Rational>(data.u))));
  }
}

std::int64_t Enclosure::k() const { return implementation_->k; }

bool Enclosure::contains(Quantity quantity, const Matrix<Rational>& X) const {
  const Matrix<Interval>& Y = implementation_->of(quantity);
  if (X.rows() != Y.rows() || X.cols() != Y.cols()) return false;
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i)
      if (!mpfi_is_inside_q(X(i, j).backend().data(), Y(i, j).backend().data())) return false;
  return true;
}

double Enclosure::width(Quantity quantity) const {
  const Matrix<Interval>& X = implementation_->of(quantity);
  HighPrecision widest = 0, largest = 0, now;
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i) {
      mpfi_diam_abs(now.backend().data(), X(i, j).backend().data());
      if (now > widest) widest = now;
      mpfi_mag(now.backend().data(), X(i, j).backend().data());
      if (now > largest) largest = now;
    }
  return largest == 0 ? 0 : round_to_double(HighPrecision(widest / largest));
}

}  // namespace kfstab::reference
