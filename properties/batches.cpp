#include <algorithm>
#include <map>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>

#include <kfstab/filters/batch.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/properties/subject.hpp>

// Filters in batches, as a subject: the systems of one shape that are run at once are each other's company, so that one that
// disturbs its neighbours answers another thing when it is run alone.
namespace kfstab::properties {

namespace {

template <class Filter>
class InBatches final : public Subject {
  using Model = typename Filter::Model;
  static constexpr bool information = Batch<Filter>::information;

 public:
  explicit InBatches(const Metadata& metadata) : traits_(metadata) { traits_.name += "-batch"; }

  const Traits& traits() const override { return traits_; }

  Ending run(const System& system, const std::function<bool(std::int64_t, const Answer&)>& each) override {
    const Run run = std::move(run_all({system}).front());
    for (std::size_t k = 0; k < run.answers.size(); ++k)
      if (!each(static_cast<std::int64_t>(k), run.answers[k])) return {};
    return run.ending;
  }

  std::size_t at_once() const override { return 256; }

  std::vector<Run> run_all(const std::vector<System>& systems) override {
    std::vector<Run> runs;
    for (const System& system : systems) runs.push_back({system, {}, {}});
    // By n, m, p, and whether there are data: a step of a batch is with data for all, or for none.
    std::map<std::tuple<Index, Index, Index, bool>, std::vector<Lane>> batches;
    for (Run& is : runs) {
      if (const auto why = refusal(traits_, is.system)) {
        is.ending = {Ending::Kind::refused, -1, why->reason};
        continue;
      }
      System complete = with_every_measurement(is.system);
      auto converted = problem(complete, traits_.takes);
      if (const auto* why = std::get_if<Refusal>(&converted)) {
        is.ending = {Ending::Kind::refused, -1, why->reason};
        continue;
      }
      auto& numbers = std::get<Problem<Model>>(std::get<AnyProblem<double>>(converted));
      const auto [n, m, p] = numbers.dimensions();
      batches[{n, m, p, complete.data != nullptr}].emplace_back(is, std::move(complete), std::move(numbers));
    }
    for (auto& [shape, lanes] : batches) run_batch(lanes, std::get<bool>(shape));
    return runs;
  }

 private:
  /// One of the filters of a batch.
  struct Lane {
    Run& run;
    System system;  ///< with every measurement
    Problem<Model> problem;
    std::unique_ptr<DataStream> data;
    Vector<double> u = {}, Du = {};  ///< of the last step that had any
    bool goes_on = true;

    Lane(Run& is, System complete, Problem<Model> numbers)
        : run(is), system(std::move(complete)), problem(std::move(numbers)),
          data(system.data ? system.data->open() : nullptr) {}

    void end(std::int64_t k, Status status) {
      run.ending = {Ending::Kind::refused, k, kfstab::name(status)};
      goes_on = false;
    }
  };

  void run_batch(std::vector<Lane>& lanes, bool with_data) {
    const Dimensions d = lanes.front().problem.dimensions();
    Batch<Filter> batch(static_cast<Index>(lanes.size()), d);
    std::int64_t steps = 0;
    for (std::size_t i = 0; i < lanes.size(); ++i) {
      batch.start(static_cast<Index>(i), lanes[i].problem.initial, lanes[i].problem.x0);
      steps = std::max(steps, lanes[i].system.steps);
    }
    for (std::int64_t k = 0; k < steps; ++k) {
      for (std::size_t i = 0; i < lanes.size(); ++i) {
        Lane& lane = lanes[i];
        lane.goes_on = lane.goes_on && k < lane.system.steps;
        if (lane.goes_on) give(batch, static_cast<Index>(i), lane, k);
      }
      if (!information || k > 0) batch.step(with_data);
      for (std::size_t i = 0; i < lanes.size(); ++i)
        if (lanes[i].goes_on && (!information || k > 0)) take(batch, static_cast<Index>(i), lanes[i], k, with_data);
    }
  }

  /// What filter i needs for step k.
  void give(Batch<Filter>& batch, Index i, Lane& lane, std::int64_t k) {
    const StepData* data = lane.data ? &lane.data->next() : nullptr;
    const Vector<double>*y = data ? &data->y : nullptr, *u = data && data->u.size() > 0 ? &data->u : nullptr;
    if (u && !u->allFinite()) return lane.end(k, Status::non_finite_input);
    if constexpr (information) {
      if (k == 0)
        begin(batch, i, lane, y);
      else
        batch.set_model(i, lane.problem.model(k - 1), lane.problem.model(k));
      // Its step k moves by u_{k-1}.
      const bool moved = k > 0 && u;
      if (moved) lane.Du = lane.problem.model(k - 1).D * lane.u;
      if (y && k > 0) batch.set_data(i, *y, moved ? &lane.Du : nullptr);
      if (u) lane.u = *u;
    } else {
      batch.set_model(i, lane.problem.model(k));
      if (u) lane.Du = lane.problem.model(k).D * *u;
      if (y) batch.set_data(i, *y, u ? &lane.Du : nullptr);
    }
  }

  /// A batch of information filters begins with a step; the measurement update before it is done by each alone.
  void begin(Batch<Filter>& batch, Index i, Lane& lane, const Vector<double>* y) requires(information) {
    Filter alone(lane.problem.dimensions());
    alone.start(lane.problem.initial, lane.problem.x0);
    const auto report = alone.measurement_update(lane.problem.model(0), y);
    if (!report) return lane.end(0, report.status);
    batch.start(i, alone.information_factor(), alone.state());
    lane.run.answers.push_back({traits_.holds, alone.information_factor(), alone.filter_gain(),
                                y ? std::optional(alone.state()) : std::nullopt, std::nullopt});
  }

  void take(const Batch<Filter>& batch, Index i, Lane& lane, std::int64_t k, bool with_data) {
    if (!batch.report(i)) return lane.end(k, batch.report(i).status);
    lane.run.answers.push_back({traits_.holds, batch.held(i), batch.gain(i),
                                with_data ? std::optional(batch.state(i)) : std::nullopt, std::nullopt});
  }

  Traits traits_;
};

}  // namespace

std::vector<std::string_view> batched_filters() { return {"ckf", "srcf", "srif"}; }

std::unique_ptr<Subject> in_batches(std::string_view id) {
  if (id == "ckf") return std::make_unique<InBatches<ConventionalFilter<double>>>(*find_filter(id));
  if (id == "srcf") return std::make_unique<InBatches<SquareRootCovarianceFilter<double>>>(*find_filter(id));
  if (id == "srif") return std::make_unique<InBatches<SquareRootInformationFilter<double>>>(*find_filter(id));
  throw std::invalid_argument("there are no batches of '" + std::string(id) + "'");
}

}  // namespace kfstab::properties
