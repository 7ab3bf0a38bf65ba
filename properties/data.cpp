#include <kfstab/properties/data.hpp>

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

}  // namespace

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

std::unique_ptr<DataStream> Simulated::open() const {
  return std::make_unique<SimulatedStream>(problem_, u_, seed_);
}

}  // namespace kfstab::properties
