#include <kfstab/experiments/traces.hpp>

#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>

#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/filters/registry.hpp>

namespace kfstab::experiments {

double Trace::worst(double reference::Errors::*error, std::size_t first) const {
  if (end != Status::ok) return infinity;
  double worst = 0;
  for (std::size_t k = first; k < errors.size(); ++k) {
    const double value = errors[k].*error;
    worst = std::max(worst, std::isnan(value) ? infinity : value);
  }
  return worst;
}

bool Trace::lost_definiteness() const {
  return end != Status::ok ||
         std::ranges::any_of(errors, [](const reference::Errors& e) { return !e.positive_semidefinite; });
}

std::map<std::string, Trace> traces(const properties::System& system, const std::vector<std::string>& ids) {
  std::map<std::string, Trace> result;
  for (const auto form : {Parametrisation::covariance, Parametrisation::root, Parametrisation::information}) {
    std::vector<std::unique_ptr<AnyFilter<double>>> running;
    for (const std::string& id : ids) {
      const Metadata* metadata = find_filter(id);
      if (!metadata) throw std::logic_error("no filter is called " + id);
      if (const auto refusal = properties::refusal(*metadata, system)) throw std::logic_error(refusal->reason);
      if (metadata->takes == form) running.push_back(make_filter<double>(id));
    }
    if (running.empty()) continue;
    const auto problem = problem_of(system, form);
    for (auto& filter : running) filter->start(problem);
    reference::Trajectory truth(problem, system.data);
    const auto data = system.data ? system.data->open() : nullptr;
    for (std::int64_t k = 0; k < system.steps; ++k) {
      truth.advance();
      const StepData* now = data ? &data->next() : nullptr;
      for (auto& filter : running) {
        Trace& trace = result[std::string(filter->metadata().id)];
        if (trace.end != Status::ok) continue;
        const auto step = filter->step(k, now ? &now->y : nullptr, now && now->u.size() > 0 ? &now->u : nullptr);
        if (step.report)
          trace.errors.push_back(truth.measure(filter->metadata(), step));
        else
          trace.end = step.report.status;
      }
    }
  }
  return result;
}

std::vector<std::string> filter_ids(const std::function<bool(const Metadata&)>& selects) {
  std::vector<std::string> ids;
  for (const Metadata& metadata : filters())
    if (selects(metadata)) ids.emplace_back(metadata.id);
  return ids;
}

}  // namespace kfstab::experiments
