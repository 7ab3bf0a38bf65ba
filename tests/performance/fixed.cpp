// Our filters with sizes that the compiler knows.

#include <memory>
#include <type_traits>

#include <kfstab/filters/batch.hpp>
#include <kfstab/filters/conventional.hpp>
#include <kfstab/filters/hessenberg_square_root_covariance.hpp>
#include <kfstab/filters/hessenberg_square_root_information.hpp>
#include <kfstab/filters/square_root_covariance.hpp>
#include <kfstab/filters/square_root_information.hpp>

#include "contenders.hpp"

namespace performance {
namespace {

using kfstab::Parametrisation;

template <class To>
void set(To& to, const std::vector<double>& numbers) {
  to = Eigen::Map<const To>(numbers.data());
}

/// The model, and what a filter starts from.
template <class Model>
void set_up(const System& s, Model& model, kfstab::Matrix<double, Model::states, Model::states>& initial,
            kfstab::Vector<double, Model::states>& x0) {
  constexpr auto parametrisation = Model::parametrisation;
  set(model.C, s.C);
  model.D.resize(Model::states, 0);
  set(x0, s.x0);
  if constexpr (parametrisation == Parametrisation::information) {
    set(model.A_inverse, s.A_inverse);
    set(model.A_inverse_B, s.A_inverse_B);
    set(model.Q_inverse_root, s.Q_inverse_root);
    set(model.R_inverse_root, s.R_inverse_root);
    set(initial, s.T0);
  } else {
    set(model.A, s.A);
    set(model.B, s.B);
    if constexpr (parametrisation == Parametrisation::root) {
      set(model.Q_root, s.Q_root);
      set(model.R_root, s.R_root);
      set(initial, s.S0);
    } else {
      set(model.Q, s.Q);
      set(model.R, s.R);
      set(initial, s.P0);
    }
  }
}

template <class Filter>
Maybe started(const System& s, bool gain) {
  using Model = typename Filter::Model;
  constexpr auto parametrisation = Model::parametrisation;
  struct Run {
    Filter filter;
    Model model;
    typename Filter::Output y;
  };
  auto run = std::make_shared<Run>();
  Model& model = run->model;
  set(run->y, s.y);
  kfstab::Matrix<double, Model::states, Model::states> initial;
  kfstab::Vector<double, Model::states> x0;
  set_up(s, model, initial, x0);
  run->filter.start(initial, x0);
  if constexpr (parametrisation == Parametrisation::information) run->filter.measurement_update(model, &run->y);
  const auto wanted = gain ? kfstab::Wanted::all
                      : parametrisation == Parametrisation::information ? kfstab::Wanted::state
                                                                        : kfstab::Wanted::factor;
  return Contender{[run, wanted] {
                     if constexpr (parametrisation == Parametrisation::information)
                       return static_cast<bool>(run->filter.step(run->model, run->model, &run->y, nullptr, wanted));
                     else if constexpr (parametrisation == Parametrisation::root)
                       return static_cast<bool>(run->filter.step(run->model, nullptr, nullptr, wanted));
                     else
                       return static_cast<bool>(run->filter.step(run->model));
                   },
                   [run] {
                     kfstab::Matrix<double> product;
                     if constexpr (parametrisation == Parametrisation::covariance)
                       product = run->filter.covariance();
                     else if constexpr (parametrisation == Parametrisation::root)
                       product = run->filter.factor() * run->filter.factor().transpose();
                     else
                       product = run->filter.information_factor().transpose() * run->filter.information_factor();
                     return std::vector<double>(product.data(), product.data() + product.size());
                   }};
}

template <class Filter>
Maybe batch_of(const System& s, bool gain) {
  using Model = typename Filter::Model;
  using Batch = kfstab::Batch<Filter>;
  constexpr int count = 64;
  auto batch = std::make_shared<Batch>(count);
  Model model;
  typename Filter::Output y;
  kfstab::Matrix<double, Model::states, Model::states> initial;
  kfstab::Vector<double, Model::states> x0;
  set(y, s.y);
  set_up(s, model, initial, x0);
  // As its peer an information filter begins with the step from 0|0.
  if (Batch::information) set(initial, s.T0_filtered);
  for (int i = 0; i < count; ++i) {
    batch->start(i, initial, x0);
    batch->set_model(i, model);
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
                     const kfstab::Matrix<double> X = batch->held(0);
                     kfstab::Matrix<double> product = X;
                     if (Batch::covariance_root) product = X * X.transpose();
                     if (Batch::information) product = X.transpose() * X;
                     return std::vector<double>(product.data(), product.data() + product.size());
                   },
                   count};
}

template <int n, int half>
Maybe batch_of_size(const std::string& filter, const System& system, bool gain) {
  if (filter == "ckf") return batch_of<kfstab::ConventionalFilter<double, n, half, half>>(system, gain);
  if (filter == "srcf") return batch_of<kfstab::SquareRootCovarianceFilter<double, n, half, half>>(system, gain);
  if (filter == "srif") return batch_of<kfstab::SquareRootInformationFilter<double, n, half, half>>(system, gain);
  return std::nullopt;
}

template <int n, int half>
Maybe of_size(const std::string& filter, const System& system, bool gain) {
  if (filter == "ckf") return started<kfstab::ConventionalFilter<double, n, half, half>>(system, gain);
  if (filter == "srcf") return started<kfstab::SquareRootCovarianceFilter<double, n, half, half>>(system, gain);
  if (filter == "srif") return started<kfstab::SquareRootInformationFilter<double, n, half, half>>(system, gain);
  if (filter == "srcf-hessenberg")
    return started<kfstab::HessenbergSquareRootCovarianceFilter<double, n, half, half>>(system, gain);
  if (filter == "srif-hessenberg")
    return started<kfstab::HessenbergSquareRootInformationFilter<double, n, half, half>>(system, gain);
  return std::nullopt;
}

}  // namespace

Maybe ours_fixed(const std::string& filter, const System& system, bool gain) {
  const auto [n, m, p] = system.shape;
  if (m != n / 2 || p != n / 2) return std::nullopt;
  switch (n) {
    case 2: return of_size<2, 1>(filter, system, gain);
    case 4: return of_size<4, 2>(filter, system, gain);
    case 8: return of_size<8, 4>(filter, system, gain);
    case 16: return of_size<16, 8>(filter, system, gain);
    default: return std::nullopt;
  }
}

Contender multiply_adds() {
  return {[] {
    namespace k = kfstab::kernels::KFSTAB_KERNELS;
    constexpr int chains = 12, times = dgemm_order * dgemm_order * dgemm_order / (k::width * chains);
    k::V sums[chains] = {}, x = k::splat(1);
    for (int i = 0; i < times; ++i)
      k::each(k::zero, k::Constant<chains>{}, [&](auto c) KFSTAB_INLINED {
        sums[c] = k::fma(x, x, sums[c]);
        asm volatile("" : "+x"(sums[c]));  // as if it were of use
      });
    return true;
  }};
}

Maybe ours_batch_fixed(const std::string& filter, const System& system, bool gain) {
  const auto [n, m, p] = system.shape;
  if (m != n / 2 || p != n / 2) return std::nullopt;
  switch (n) {
    case 2: return batch_of_size<2, 1>(filter, system, gain);
    case 4: return batch_of_size<4, 2>(filter, system, gain);
    case 8: return batch_of_size<8, 4>(filter, system, gain);
    default: return std::nullopt;
  }
}

}  // namespace performance
