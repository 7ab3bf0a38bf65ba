// A project of somebody else's: a filter of the registry beside the reference.
#include <cstdio>

#include <kfstab/filters/registry.hpp>
#include <kfstab/reference/trajectory.hpp>

int main() {
  kfstab::CovarianceModel<double> model;
  model.A = kfstab::Matrix<double>::Identity(2, 2);
  model.A(0, 1) = 0.5;
  model.B = kfstab::Matrix<double>::Identity(2, 2);
  model.C = kfstab::Matrix<double>::Constant(1, 2, 1.0);
  model.D.resize(2, 0);
  model.Q = kfstab::Matrix<double>::Identity(2, 2);
  model.R = kfstab::Matrix<double>::Identity(1, 1);
  const kfstab::AnyProblem<double> problem = kfstab::Problem<kfstab::CovarianceModel<double>>{
      {model}, kfstab::Matrix<double>::Identity(2, 2), kfstab::Vector<double>::Zero(2)};

  kfstab::reference::Trajectory truth(problem, nullptr);
  const auto filter = kfstab::make_filter<double>("ckf");
  filter->start(problem);
  truth.advance();
  const auto errors = truth.measure(filter->metadata(), filter->step(0, nullptr, nullptr));
  std::printf("error of P %g, %d digits certified\n", errors.covariance, truth.certified_digits());
  // One step: u (n + m + p) k(Re), with p = 1 and hence k(Re) = 1, over cos^2; 30 as in every test.
  const double cosine = truth.truth().cosine;
  return errors.covariance <= 30 * 5 * 0x1p-53 / (cosine * cosine) && truth.certified_digits() >= 30 ? 0 : 1;
}
