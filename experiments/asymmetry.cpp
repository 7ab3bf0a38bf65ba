#include <kfstab/experiments/asymmetry.hpp>

#include <kfstab/filters/registry.hpp>

namespace kfstab::experiments {

std::string coding_of(const Metadata& metadata) {
  switch (metadata.asymmetry) {
    case Asymmetry::textbook: return "(i)";
    case Asymmetry::mixed: return "(ii)";
    case Asymmetry::gain: return "(iii)";
    case Asymmetry::cp: return "(iv)";
    case Asymmetry::downdate: return "(v)";
    case Asymmetry::none: break;
  }
  return "symmetric";
}

std::vector<const Metadata*> codings() {
  std::vector<const Metadata*> selected;
  for (const Metadata& metadata : filters())
    if (metadata.asymmetry != Asymmetry::none) selected.push_back(&metadata);
  return selected;
}

std::vector<Matrix<double>> asymmetries(const Metadata& metadata, const AnyProblem<double>& problem, int steps,
                                        double limit) {
  const auto filter = make_filter<double>(metadata.id);
  filter->start(problem);
  std::vector<Matrix<double>> curve;
  for (int k = 0; k < steps; ++k) {
    const auto step = filter->step(k, nullptr, nullptr);
    if (!step.report) break;
    curve.push_back(*step.held - step.held->transpose());
    if (!(curve.back().norm() <= limit)) break;
  }
  return curve;
}

std::vector<double> norms(const std::vector<Matrix<double>>& curve) {
  std::vector<double> result;
  for (const auto& D : curve) result.push_back(D.norm() / 2);
  return result;
}

bool follows_A(Asymmetry coding) {
  return coding == Asymmetry::gain || coding == Asymmetry::cp || coding == Asymmetry::downdate;
}

}  // namespace kfstab::experiments
