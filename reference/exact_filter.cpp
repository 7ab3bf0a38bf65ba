#include <kfstab/reference/exact_filter.hpp>

#include <string>
#include <utility>

#include <kfstab/reference/detail/check.hpp>
#include <kfstab/reference/detail/elimination.hpp>

namespace kfstab::reference {
namespace {

using detail::difference_of;
using detail::sandwich;
using detail::sum_of;
using detail::times;
using detail::transpose_of;

Vector<Rational> rational_vector(const Vector<double>& x) { return rational(Matrix<double>(x)); }

Matrix<Rational> inverse(const Matrix<Rational>& X) {
  Matrix<Rational> Y = detail::unit<Rational>(X.rows());
  Rational determinant;
  detail::solve(
      X, Y, determinant, [](const Rational& x) { return x != 0; }, false);
  return Y;
}

/// L L', of the lower triangle.
Matrix<Rational> square_of_lower(const Matrix<double>& L) {
  return product_of_root(rational(Matrix<double>(L.triangularView<Eigen::Lower>())));
}

/// (U'U)^{-1}, of the upper triangle.
Matrix<Rational> inverse_square_of_upper(const Matrix<double>& U) {
  return inverse(square_of_lower(Matrix<double>(U.transpose())));
}

CovarianceModel<Rational> exact_model(const CovarianceModel<double>& from, bool) {
  CovarianceModel<Rational> to;
  to.A = rational(from.A);
  to.B = rational(from.B);
  to.C = rational(from.C);
  to.D = rational(from.D);
  to.Q = rational(from.Q);
  to.R = rational(from.R);
  return to;
}

CovarianceModel<Rational> exact_model(const RootModel<double>& from, bool) {
  CovarianceModel<Rational> to;
  to.A = rational(from.A);
  to.B = rational(from.B);
  to.C = rational(from.C);
  to.D = rational(from.D);
  to.Q = square_of_lower(from.Q_root);
  to.R = square_of_lower(from.R_root);
  return to;
}

CovarianceModel<Rational> exact_model(const InformationModel<double>& from, bool has_mean) {
  CovarianceModel<Rational> to;
  to.A = inverse(rational(from.A_inverse));
  to.B = times(to.A, rational(from.A_inverse_B));
  to.C = rational(from.C);
  to.Q = inverse_square_of_upper(from.Q_inverse_root);
  to.R = inverse_square_of_upper(from.R_inverse_root);
  const Index n = from.A_inverse.rows(), inputs = from.D.cols();
  to.D = Matrix<Rational>(n, inputs + (has_mean ? 1 : 0));
  for (Index j = 0; j < inputs; ++j)
    for (Index i = 0; i < n; ++i) to.D(i, j) = Rational(from.D(i, j));
  if (has_mean) {
    Vector<Rational> drift(n);
    for (Index i = 0; i < n; ++i) drift(i) = 0;
    if (from.w_mean.size() > 0) drift = times(to.B, rational_vector(from.w_mean));
    for (Index i = 0; i < n; ++i) to.D(i, inputs) = drift(i);
  }
  return to;
}

Matrix<Rational> exact_initial(const Problem<CovarianceModel<double>>& problem) { return rational(problem.initial); }
Matrix<Rational> exact_initial(const Problem<RootModel<double>>& problem) { return square_of_lower(problem.initial); }
Matrix<Rational> exact_initial(const Problem<InformationModel<double>>& problem) {
  return inverse_square_of_upper(problem.initial);
}

bool noise_has_mean(const AnyProblem<double>& problem) {
  const auto* information = std::get_if<Problem<InformationModel<double>>>(&problem);
  if (!information) return false;
  for (const auto& model : information->models)
    if (model.w_mean.size() > 0) return true;
  return false;
}

class ConvertedData final : public ExactData {
 public:
  ConvertedData(std::shared_ptr<const Data> data, bool has_mean) : data_(std::move(data)), has_mean_(has_mean) {}
  std::unique_ptr<DataStreamOf<Rational>> open() const override {
    return std::make_unique<Stream>(data_->open(), has_mean_);
  }

 private:
  class Stream final : public DataStreamOf<Rational> {
   public:
    Stream(std::unique_ptr<DataStream> stream, bool has_mean) : stream_(std::move(stream)), has_mean_(has_mean) {}
    const StepDataOf<Rational>& next() override {
      const StepData& from = stream_->next();
      now_.y = rational_vector(from.y);
      const Index inputs = from.u.size();
      now_.u.resize(inputs + (has_mean_ ? 1 : 0));
      for (Index i = 0; i < inputs; ++i) now_.u(i) = Rational(from.u(i));
      if (has_mean_) now_.u(inputs) = 1;
      return now_;
    }

   private:
    std::unique_ptr<DataStream> stream_;
    bool has_mean_;
    StepDataOf<Rational> now_;
  };

  std::shared_ptr<const Data> data_;
  bool has_mean_;
};

}  // namespace

ExactProblem exact_problem(const AnyProblem<double>& any) {
  detail::check(detail::Source(&any), false);
  const bool has_mean = noise_has_mean(any);
  return std::visit(
      [&](const auto& problem) {
        ExactProblem to;
        for (const auto& model : problem.models) to.models.push_back(exact_model(model, has_mean));
        to.initial = exact_initial(problem);
        to.x0 = rational_vector(problem.x0);
        return to;
      },
      any);
}

std::shared_ptr<const ExactData> exact_data(const AnyProblem<double>& problem, std::shared_ptr<const Data> data) {
  if (!data) return nullptr;
  return std::make_shared<ConvertedData>(std::move(data), noise_has_mean(problem));
}

ExactFilter::ExactFilter(ExactProblem problem, std::shared_ptr<const ExactData> data)
    : problem_(std::move(problem)), data_(std::move(data)), stream_(data_ ? data_->open() : nullptr) {
  detail::check(detail::Source(&problem_), data_ != nullptr);
  step_.P_next = problem_.initial;
  if (stream_) step_.x_next = problem_.x0;
}

void ExactFilter::advance() {
  const CovarianceModel<Rational>& model = problem_.model(++k_);
  ExactStep now;
  now.P_predicted = std::move(step_.P_next);
  now.x_predicted = std::move(step_.x_next);

  const Matrix<Rational> CP = times(model.C, now.P_predicted);
  now.innovation = sum_of(model.R, times(CP, transpose_of(model.C)));
  Matrix<Rational> solution = CP;
  const auto positive = [](const Rational& pivot) { return pivot > 0; };
  if (!detail::solve(now.innovation, solution, now.innovation_determinant, positive, true))
    throw ReferenceError("step " + std::to_string(k_) + ": Re is not positive definite");
  now.filter_gain = transpose_of(solution);
  now.predictor_gain = times(model.A, now.filter_gain);
  now.P_filtered = difference_of(now.P_predicted, times(now.filter_gain, CP));
  now.P_next = sum_of(sandwich(model.A, now.P_filtered), sandwich(model.B, model.Q));

  if (stream_) {
    const StepDataOf<Rational>& data = stream_->next();
    const Vector<Rational> e = difference_of(data.y, times(model.C, now.x_predicted));
    Matrix<Rational> weighted = e;
    Rational determinant;
    detail::solve(now.innovation, weighted, determinant, positive, true);
    for (Index i = 0; i < e.size(); ++i) now.weighted_innovation += Rational(e(i) * weighted(i, 0));
    now.x_filtered = sum_of(now.x_predicted, times(now.filter_gain, e));
    now.x_next = times(model.A, now.x_filtered);
    if (data.u.size() > 0) now.x_next = sum_of(now.x_next, times(model.D, data.u));
  }
  step_ = std::move(now);
}

}  // namespace kfstab::reference
