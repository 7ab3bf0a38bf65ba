#include <kfstab/properties/data.hpp>

#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include <boost/random/mersenne_twister.hpp>
#include <boost/random/normal_distribution.hpp>

namespace kfstab::properties {

namespace {

void require_step(Index k, const Matrix<double>& u) {
  if (k >= u.cols()) throw std::out_of_range("the data end after step " + std::to_string(k - 1));
}

class RecordedStream final : public DataStream {
 public:
  RecordedStream(std::shared_ptr<const Matrix<double>> y, std::shared_ptr<const Matrix<double>> u)
      : y_(std::move(y)), u_(std::move(u)) {}

  const StepData& next() override {
    require_step(k_, *y_);
    step_.y = y_->col(k_);
    if (u_->rows() > 0) step_.u = u_->col(k_);
    ++k_;
    return step_;
  }

 private:
  std::shared_ptr<const Matrix<double>> y_, u_;
  StepData step_;
  Index k_ = 0;
};

class SimulatedStream final : public DataStream {
 public:
  SimulatedStream(std::shared_ptr<const Problem<RootModel<double>>> problem, std::shared_ptr<const Matrix<double>> u,
                  std::uint64_t seed)
      : problem_(std::move(problem)), u_(std::move(u)), engine_(seed) {
    draw(problem_->initial.rows());
    x_ = problem_->x0 + problem_->initial.triangularView<Eigen::Lower>() * normal_;
  }

  const StepData& next() override {
    const RootModel<double>& model = problem_->model(k_);
    if (model.D.cols() > 0) {
      require_step(static_cast<Index>(k_), *u_);
      step_.u = u_->col(static_cast<Index>(k_));
    }
    draw(model.R_root.rows());
    noise_.noalias() = model.R_root.triangularView<Eigen::Lower>() * normal_;
    step_.y.noalias() = model.C * x_;
    step_.y += noise_;

    draw(model.Q_root.rows());
    noise_.noalias() = model.Q_root.triangularView<Eigen::Lower>() * normal_;
    after_.noalias() = model.A * x_;
    after_.noalias() += model.B * noise_;
    if (model.D.cols() > 0) after_.noalias() += model.D * step_.u;
    x_.swap(after_);
    ++k_;
    return step_;
  }

 private:
  void draw(Index size) {
    normal_.resize(size);
    for (Index i = 0; i < size; ++i) normal_(i) = distribution_(engine_);
  }

  std::shared_ptr<const Problem<RootModel<double>>> problem_;
  std::shared_ptr<const Matrix<double>> u_;
  boost::random::mt19937_64 engine_;
  boost::random::normal_distribution<double> distribution_;
  Vector<double> x_, after_, normal_, noise_;
  StepData step_;
  std::int64_t k_ = 0;
};

// --- missing measurements -----------------------------------------------------------------------------------------------

using Missing = Eigen::Array<bool, Dynamic, Dynamic>;

/// Whether a lower root of R with e_i for each row i that is missing is one of R without what is missing: where no entry that
/// is there has a part in the column of a missing one.
bool stays_root(const Matrix<double>& root, const Missing& missing, Index k) {
  for (Index i = 0; i < root.rows(); ++i)
    for (Index j = 0; j < i; ++j)
      if (missing(j, k) && !missing(i, k) && root(i, j) != 0) return false;
  return true;
}

/// R as covariances, rounded once.
Sequence multiplied_out(const System& system) {
  const auto converted = problem(system, Parametrisation::covariance);
  if (const auto* why = std::get_if<Refusal>(&converted)) throw std::invalid_argument(why->reason);
  const auto& numbers = std::get<Problem<CovarianceModel<double>>>(std::get<AnyProblem<double>>(converted));
  Sequence R(Sequence::Kind::list, {});
  for (std::int64_t k = 0; k < system.steps; ++k) R.matrices.push_back(numbers.model(k).R);
  return R;
}

}  // namespace

Matrix<double> congruence(const Matrix<double>& X, const Matrix<double>& Y) {
  const Matrix<double> XY = X.lazyProduct(Y);
  return XY.lazyProduct(X.transpose());
}

Measured::Measured(const Matrix<double>& all_C, const Matrix<double>& all_R, const Vector<double>& all_y)
    : outputs(all_y.size()) {
  for (Index i = 0; i < all_y.size(); ++i)
    if (!std::isnan(all_y(i))) entries.push_back(i);
  const auto p = std::ssize(entries);
  C.resize(p, all_C.cols());
  R.resize(p, p);
  y.resize(p);
  for (Index i = 0; i < p; ++i) {
    const Index row = entries[static_cast<std::size_t>(i)];
    C.row(i) = all_C.row(row);
    y(i) = all_y(row);
    for (Index j = 0; j < p; ++j) R(i, j) = all_R(row, entries[static_cast<std::size_t>(j)]);
  }
}

Matrix<double> Measured::of_all(const Matrix<double>& K) const {
  Matrix<double> all = Matrix<double>::Zero(K.rows(), outputs);
  for (Index j = 0; j < K.cols(); ++j) all.col(entries[static_cast<std::size_t>(j)]) = K.col(j);
  return all;
}

bool measurements_missing(const System& system) {
  if (!system.data || dynamic_cast<const Simulated*>(system.data.get())) return false;
  const auto stream = system.data->open();
  for (std::int64_t k = 0; k < system.steps; ++k)
    if (stream->next().y.hasNaN()) return true;
  return false;
}

System with_every_measurement(const System& system) {
  if (!measurements_missing(system)) return system;
  const Index p = system.C.rows();
  Matrix<double> y(p, system.steps), u(system.inputs(), system.steps);
  const auto stream = system.data->open();
  for (Index k = 0; k < system.steps; ++k) {
    const StepData& step = stream->next();
    y.col(k) = step.y;
    if (step.u.size() > 0) u.col(k) = step.u;
  }
  const Missing missing = y.array().isNaN();
  y = missing.select(0, y);

  System complete = system;
  complete.C = system.C.unrolled(system.steps);
  Sequence R = system.R.value.unrolled(system.steps);
  for (Index k = 0; k < system.steps; ++k)
    if (system.R.written == Covariance::Written::root && complete.R.written == system.R.written &&
        !stays_root(R.matrices[static_cast<std::size_t>(k)], missing, k)) {
      R = multiplied_out(system);
      complete.R.written = Covariance::Written::covariance;
    }
  const bool covariance = complete.R.written == Covariance::Written::covariance;
  for (Index k = 0; k < system.steps; ++k)
    for (Index i = 0; i < p; ++i) {
      if (!missing(i, k)) continue;
      complete.C.matrices[static_cast<std::size_t>(k)].row(i).setZero();
      Matrix<double>& now = R.matrices[static_cast<std::size_t>(k)];
      // In its own units, so that Re is as well conditioned as ever; of a variance of 0 nobody knows them.
      const double own = now(i, i) != 0 ? now(i, i) : 1;
      now.row(i).setZero();
      if (covariance) now.col(i).setZero();
      now(i, i) = own;
    }
  // What was written exactly and is overwritten now counts as the double that it is: exact_value sees to that.
  complete.R.value = std::move(R);
  const auto* recorded = dynamic_cast<const Recorded*>(system.data.get());
  complete.data =
      std::make_shared<Recorded>(std::move(y), std::move(u), recorded ? recorded->exact_y() : std::vector<ExactEntry>(),
                                 recorded ? recorded->exact_u() : std::vector<ExactEntry>());
  return complete;
}

Recorded::Recorded(Matrix<double> y, Matrix<double> u, std::vector<ExactEntry> exact_y, std::vector<ExactEntry> exact_u)
    : y_(std::make_shared<const Matrix<double>>(std::move(y))),
      u_(std::make_shared<const Matrix<double>>(std::move(u))), exact_y_(std::move(exact_y)),
      exact_u_(std::move(exact_u)) {}

std::unique_ptr<DataStream> Recorded::open() const { return std::make_unique<RecordedStream>(y_, u_); }

Simulated::Simulated(const System& system, std::uint64_t seed, Matrix<double> inputs,
                     std::vector<ExactEntry> exact_inputs)
    : u_(std::make_shared<const Matrix<double>>(std::move(inputs))), exact_u_(std::move(exact_inputs)), seed_(seed) {
  auto roots = properties::problem(system, Parametrisation::root);
  if (const auto* refused = std::get_if<Refusal>(&roots)) throw std::invalid_argument(refused->reason);
  problem_ = std::make_shared<const Problem<RootModel<double>>>(
      std::get<Problem<RootModel<double>>>(std::get<AnyProblem<double>>(std::move(roots))));
}

std::unique_ptr<DataStream> Simulated::open() const { return std::make_unique<SimulatedStream>(problem_, u_, seed_); }

}  // namespace kfstab::properties
