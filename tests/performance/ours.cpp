// Our filters as the built library has them.

#include <memory>

#include <kfstab/filters/any_filter.hpp>
#include <kfstab/filters/batch.hpp>
#include <kfstab/filters/hessenberg_square_root_information.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/filters/square_root_information.hpp>

#include "contenders.hpp"

namespace performance {
namespace {

using kfstab::Dynamic, kfstab::Held;
using Matrix = kfstab::Matrix<double>;

template <class To>
void set(To& to, const std::vector<double>& numbers, int rows, int cols) {
  to = Eigen::Map<const Matrix>(numbers.data(), rows, cols);
}

kfstab::AnyProblem<double> problem_for(kfstab::Parametrisation parametrisation, const System& s) {
  const auto [n, m, p] = s.shape;
  const auto dynamics = [&, n = n, m = m, p = p](auto& model) {
    set(model.A, s.A, n, n);
    set(model.B, s.B, n, m);
    set(model.C, s.C, p, n);
    model.D.resize(n, 0);
  };
  const auto problem = [&, n = n](const auto& model, const std::vector<double>& initial) {
    kfstab::Problem<std::decay_t<decltype(model)>> result;
    result.models.push_back(model);
    set(result.initial, initial, n, n);
    set(result.x0, s.x0, n, 1);
    return result;
  };
  switch (parametrisation) {
    case kfstab::Parametrisation::covariance: {
      kfstab::CovarianceModel<double> model;
      dynamics(model);
      set(model.Q, s.Q, m, m);
      set(model.R, s.R, p, p);
      return problem(model, s.P0);
    }
    case kfstab::Parametrisation::root: {
      kfstab::RootModel<double> model;
      dynamics(model);
      set(model.Q_root, s.Q_root, m, m);
      set(model.R_root, s.R_root, p, p);
      return problem(model, s.S0);
    }
    case kfstab::Parametrisation::information: break;
  }
  kfstab::InformationModel<double> model;
  set(model.A_inverse, s.A_inverse, n, n);
  set(model.A_inverse_B, s.A_inverse_B, n, m);
  set(model.C, s.C, p, n);
  model.D.resize(n, 0);
  set(model.Q_inverse_root, s.Q_inverse_root, m, m);
  set(model.R_inverse_root, s.R_inverse_root, p, p);
  return problem(model, s.T0);
}

using Roots = kfstab::Problem<kfstab::RootModel<double>>;

/// By its class: a filter of the registry is asked for everything.
template <class Filter>
Maybe without_gain(const System& system) {
  using Model = typename Filter::Model;
  constexpr bool information = Model::parametrisation == kfstab::Parametrisation::information;
  struct Run {
    kfstab::Problem<Model> problem;
    Filter filter;
    kfstab::Vector<double> y;
  };
  const auto problem = std::get<kfstab::Problem<Model>>(problem_for(Model::parametrisation, system));
  auto run = std::make_shared<Run>(Run{problem, Filter(problem.dimensions()), {}});
  set(run->y, system.y, system.shape.p, 1);
  run->filter.start(problem.initial, problem.x0);
  if constexpr (information) run->filter.measurement_update(problem.models[0], &run->y);
  return Contender{
      [run] {
        const Model& model = run->problem.models[0];
        if constexpr (information)
          return static_cast<bool>(run->filter.step(model, model, &run->y, nullptr, kfstab::Wanted::state));
        else
          return static_cast<bool>(run->filter.step(model, nullptr, nullptr, kfstab::Wanted::factor));
      },
      [run] {
        Matrix product;
        if constexpr (information)
          product = run->filter.information_factor().transpose() * run->filter.information_factor();
        else
          product = run->filter.factor() * run->filter.factor().transpose();
        return std::vector<double>(product.data(), product.data() + product.size());
      }};
}

struct Run {
  kfstab::AnyProblem<double> problem;
  std::unique_ptr<kfstab::AnyFilter<double>> filter;
  kfstab::Vector<double> y;
  std::int64_t k = 0;
  kfstab::Shown<double> held;
};

}  // namespace

Maybe ours_dynamic(const std::string& id, const System& system, bool gain) {
  if (!gain) {
    if (id == "srcf") return without_gain<kfstab::SquareRootCovarianceFilter<double>>(system);
    if (id == "srif") return without_gain<kfstab::SquareRootInformationFilter<double>>(system);
    return without_gain<kfstab::HessenbergSquareRootInformationFilter<double>>(system);
  }
  auto run = std::make_shared<Run>();
  const kfstab::Metadata& metadata = *kfstab::find_filter(id);
  run->problem = problem_for(metadata.takes, system);
  run->filter = kfstab::make_filter<double>(id);
  run->filter->start(run->problem);
  set(run->y, system.y, system.shape.p, 1);
  // An information filter begins with the update by y_0, its peers with the step from 0|0.
  const bool with_data = metadata.takes == kfstab::Parametrisation::information;
  if (with_data) run->filter->step(run->k++, &run->y, nullptr);
  return Contender{[=] {
                     const auto step = run->filter->step(run->k++, with_data ? &run->y : nullptr, nullptr);
                     run->held = step.held;
                     return static_cast<bool>(step.report);
                   },
                   [run, holds = metadata.holds] {
                     const Matrix& X = *run->held;
                     Matrix product = holds == Held::covariance          ? X
                                      : holds == Held::covariance_factor ? Matrix(X * X.transpose())
                                                                         : Matrix(X.transpose() * X);
                     return std::vector<double>(product.data(), product.data() + product.size());
                   }};
}

namespace {

template <class Filter>
Maybe batch_of(kfstab::Parametrisation parametrisation, const System& system, bool gain) {
  using Batch = kfstab::Batch<Filter>;
  using Problem = kfstab::Problem<typename Filter::Model>;
  constexpr int count = 64;
  const auto problem = std::get<Problem>(problem_for(parametrisation, system));
  auto batch = std::make_shared<Batch>(count, problem.dimensions());
  kfstab::Vector<double> y;
  set(y, system.y, system.shape.p, 1);
  Matrix initial = problem.initial;
  // As its peer an information filter begins with the step from 0|0.
  if (Batch::information) set(initial, system.T0_filtered, system.shape.n, system.shape.n);
  for (int i = 0; i < count; ++i) {
    batch->start(i, initial, problem.x0);
    batch->set_model(i, problem.models[0]);
    batch->set_data(i, y);
  }
  const auto wanted = gain                 ? kfstab::Wanted::all
                      : Batch::information ? kfstab::Wanted::state
                                           : kfstab::Wanted::factor;
  return Contender{[=] {
                     batch->step(Batch::information, wanted);
                     return static_cast<bool>(batch->report(0));
                   },
                   [=] {
                     const Matrix X = batch->held(0);
                     const Matrix product = Batch::conventional  ? X
                                            : Batch::information ? Matrix(X.transpose() * X)
                                                                 : Matrix(X * X.transpose());
                     return std::vector<double>(product.data(), product.data() + product.size());
                   },
                   count};
}

}  // namespace

Maybe ours_batch(const std::string& filter, const System& system, bool gain) {
  using kfstab::Parametrisation;
  if (filter == "ckf") return batch_of<kfstab::ConventionalFilter<double>>(Parametrisation::covariance, system, gain);
  if (filter == "srcf")
    return batch_of<kfstab::SquareRootCovarianceFilter<double>>(Parametrisation::root, system, gain);
  if (filter == "srif")
    return batch_of<kfstab::SquareRootInformationFilter<double>>(Parametrisation::information, system, gain);
  return std::nullopt;
}

}  // namespace performance
