#include <kfstab/experiments/results.hpp>

#include <algorithm>
#include <cmath>

#include <nlohmann/json.hpp>

#include <kfstab/experiments/catalogue.hpp>
#include <kfstab/experiments/context.hpp>
#include <kfstab/experiments/cost.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/filters/step_report.hpp>
#include <kfstab/properties/law.hpp>
#include <kfstab/properties/data.hpp>
#include <kfstab/reports/number.hpp>
#include <kfstab/reports/plot.hpp>

namespace kfstab::experiments {
namespace {

using json = nlohmann::ordered_json;

/// A number under its name; null and its word where JSON has no number for it.
void put(json& object, const std::string& key, double value) {
  if (std::isfinite(value)) {
    object[key] = value;
  } else {
    object[key] = nullptr;
    object[key + "_word"] = reports::exact_number(value);
  }
}

json context_json(const Context& made) {
  json object = json::object();
  for (const auto& [name, value] : made) object[name] = value;
  return object;
}

/// A curve's values; non-finite ones as words, since an array has no room beside.
json values(const std::vector<double>& numbers) {
  json array = json::array();
  for (const double x : numbers) {
    if (std::isfinite(x))
      array.push_back(x);
    else
      array.push_back(reports::exact_number(x));
  }
  return array;
}

json series(const Series& s) {
  const auto points = s.points();
  return {{"step", values(points.step)}, {"value", values(points.value)}, {"count", s.count()}};
}

json failure_json(const std::optional<std::int64_t>& step, Status status, const std::string& stopped) {
  if (!step) return json();
  json failure{{"step", *step}, {"status", failure_name(status, stopped)}};
  if (!stopped.empty()) failure["reason"] = stopped;
  return failure;
}

json filter_json(const FilterRun& f) {
  json object{{"id", f.metadata->id}, {"holds", notation(f.metadata->holds)}, {"update", f.metadata->update}};
  if (f.refused) {
    object["refused"] = *f.refused;
    return object;
  }
  json worst, last;
  put(worst, "covariance_error", f.covariance_error.largest());
  put(worst, "gain_error", f.gain_error.largest());
  put(worst, "asymmetry", f.asymmetry.largest());
  put(worst, "smallest_eigenvalue", f.smallest_eigenvalue.smallest());
  put(last, "covariance_error", f.covariance_error.last());
  put(last, "gain_error", f.gain_error.last());
  put(last, "asymmetry", f.asymmetry.last());
  put(last, "smallest_eigenvalue", f.smallest_eigenvalue.last());
  put(last, "correct_digits", f.correct_digits);
  if (f.state_error.count() > 0) {
    put(worst, "state_error", f.state_error.largest());
    put(last, "state_error", f.state_error.last());
  }
  object["instant"] = f.metadata->instant == Instant::predicted ? "predicted" : "filtered";
  object["gain"] = f.metadata->gain == GainKind::predictor ? "predictor" : "filter";
  object["worst"] = worst;
  object["last"] = last;
  object["first_indefinite"] = f.first_indefinite ? json(*f.first_indefinite) : json();
  object["failure"] = failure_json(f.first_failure, f.failure, f.stopped);
  put(object, "seconds_per_step", f.seconds_per_step);
  object["curves"] = {{"covariance_error", series(f.covariance_error)},
                      {"bound", series(f.bound)},
                      {"gain_error", series(f.gain_error)},
                      {"gain_bound", series(f.gain_bound)},
                      {"asymmetry", series(f.asymmetry)},
                      {"smallest_eigenvalue", series(f.smallest_eigenvalue)}};
  if (f.state_error.count() > 0) object["curves"]["state_error"] = series(f.state_error);
  return object;
}

json axis_json(const reports::Axis& axis) { return {{"label", axis.label}, {"log", axis.log}}; }

json figure_json(const reports::Figure& figure) {
  json object{{"id", figure.id}, {"title", figure.title}, {"caption", figure.caption}};
  object["files"] = reports::files_of(figure);
  object["x"] = axis_json(figure.x);
  object["y"] = axis_json(figure.y);
  object["curves"] = json::array();
  for (const reports::Curve& curve : figure.curves)
    object["curves"].push_back({{"id", curve.id},
                                {"label", curve.label},
                                {"role", name(curve.role)},
                                {"color", curve.color},
                                {"x", values(curve.x)},
                                {"y", values(curve.y)}});
  if (figure.maps.panels.empty()) return object;
  const reports::HeatMaps& maps = figure.maps;
  object["maps"] = {{"x", values(maps.x)},           {"y", values(maps.y)},     {"color", axis_json(maps.color)},
                    {"outline", maps.outline},       {"matrix", maps.matrix},   {"numbers", maps.numbers},
                    {"panels", json::array()}};
  for (const reports::HeatMap& panel : maps.panels)
    object["maps"]["panels"].push_back(
        {{"id", panel.id}, {"label", panel.label}, {"values", values(panel.values)}, {"outlined", panel.outlined}});
  return object;
}

json digits_json(const Digits& digits) {
  json object;
  put(object, "end", digits.end);
  put(object, "worst", digits.worst);
  return object;
}

json point_json(const Comparison& c, const Point& point) {
  json object{{"at", json::object()}, {"bits", point.bits}};
  for (std::size_t i = 0; i < point.at.size(); ++i) object["at"][c.scans[i].name] = point.at[i];
  if (point.error) object["error"] = *point.error;
  put(object, "forgetting", point.forgetting);
  object["filters"] = json::array();
  for (std::size_t i = 0; i < point.filters.size(); ++i) {
    const Fare& own = point.filters[i];
    json entry{{"id", c.filters[i]->id}};
    if (own.refused) {
      entry["refused"] = *own.refused;
    } else {
      entry["digits"] = {{"P", digits_json(own.P)}, {"K", digits_json(own.K)}, {"x", digits_json(own.x)}};
      put(entry, "bound", own.bound);
      put(entry, "asymmetry", own.asymmetry);
      entry["first_indefinite"] = own.first_indefinite ? json(*own.first_indefinite) : json();
      entry["failure"] = failure_json(own.first_failure, own.failure, own.stopped);
      entry["sound"] = own.sound();
      entry["kept"] = own.kept();
    }
    object["filters"].push_back(std::move(entry));
  }
  return object;
}

json system_json(const SystemRun& r) {
  json object{{"name", r.name}, {"description", r.description}, {"source", r.source}};
  object["n"] = r.dimensions.n;
  object["m"] = r.dimensions.m;
  object["p"] = r.dimensions.p;
  object["parameters"] = r.parameters;
  object["seed"] = r.seed ? json(*r.seed) : json();
  object["steps"] = r.steps_done;
  object["steps_asked"] = r.steps_asked;
  object["interrupted"] = r.interrupted;
  return object;
}

}  // namespace

std::string compare_json(const Comparison& c, const Context& made) {
  json root{{"schema", "kfstab.compare/1"}, {"context", context_json(made)}};
  root["system"] = system_json(c.as_written);
  root["interrupted"] = c.interrupted;
  put(root, "accurate", c.accurate);
  root["scans"] = json::array();
  for (const Scan& scan : c.scans)
    root["scans"].push_back({{"name", scan.name}, {"log", scan.log}, {"values", values(scan.values)}});
  root["filters"] = json::array();
  for (std::size_t i = 0; i < c.filters.size(); ++i) {
    json entry{{"id", c.filters[i]->id}};
    put(entry, "operations", operations(*c.filters[i], c.as_written.dimensions));
    put(entry, "seconds_per_step", c.as_written.filters[i].seconds_per_step);
    if (std::ranges::any_of(c.scans, [](const Scan& scan) { return scan.of == Scan::Of::bits; })) {
      const auto bits = fewest_bits(c, i);
      entry["fewest_bits"] = bits ? json(*bits) : json();
    }
    root["filters"].push_back(std::move(entry));
  }
  root["as_written"] = point_json(c, c.base);
  root["points"] = json::array();
  for (const Point& point : c.points)
    if (point.done) root["points"].push_back(point_json(c, point));
  root["recommendation"] = {{"filter", c.recommendation.filter ? json(c.recommendation.filter->id) : json()},
                            {"sentences", c.recommendation.sentences}};
  return root.dump(1) + "\n";
}

std::string explain_json(const std::vector<Explained>& explained, const Context& made) {
  json root{{"schema", "kfstab.explain/1"}, {"context", context_json(made)}};
  root["systems"] = json::array();
  for (const Explained& one : explained) {
    json object = system_json(one.run);
    object["filters"] = json::array();
    for (const Explanation& e : one.filters) {
      json entry{{"id", e.filter->id}, {"sentences", e.sentences}};
      if (e.refused) {
        entry["refused"] = *e.refused;
        object["filters"].push_back(std::move(entry));
        continue;
      }
      entry["of"] = std::string(1, e.of);
      put(entry, "digits_lost", e.lost);
      entry["worst_step"] = e.worst;
      put(entry, "asymmetry", e.asymmetry);
      entry["first_indefinite"] = e.first_indefinite ? json(*e.first_indefinite) : json();
      entry["failure"] = failure_json(e.first_failure, e.failure, e.stopped);
      entry["losses"] = json::array();
      for (const Loss& loss : e.losses) {
        json of_step{{"step", loss.step}};
        put(of_step, "digits", loss.digits);
        put(of_step, "innovation_condition", loss.innovation_condition);
        put(of_step, "cosine", loss.cosine);
        put(of_step, "growth", loss.growth);
        if (is_information(*e.filter) && !std::isnan(loss.information.T)) {
          const reference::InformationLoss& of = loss.information;
          of_step["information"] = {{"A", of.A},           {"Q_root", of.Q_root},
                                    {"R_root", of.R_root}, {"spread", of.spread},
                                    {"inverse_cosine", of.inverse_cosine}, {"T", of.T}};
        }
        entry["losses"].push_back(std::move(of_step));
      }
      if (e.entries.size() > 0) {
        entry["entry_errors"] = json::array();
        for (Index i = 0; i < e.entries.rows(); ++i) {
          std::vector<double> row;
          for (Index j = 0; j < e.entries.cols(); ++j) row.push_back(e.entries(i, j));
          entry["entry_errors"].push_back(values(row));
        }
      }
      if (e.cancellations)
        entry["cancellations"] = {{"additions", e.cancellations->additions},
                                  {"any", e.cancellations->any},
                                  {"half_word", e.cancellations->half_word},
                                  {"step", e.cancellations->step},
                                  {"at_step", e.cancellations->at_step}};
      object["filters"].push_back(std::move(entry));
    }
    root["systems"].push_back(std::move(object));
  }
  return root.dump(1) + "\n";
}

std::string run_json(const std::vector<SystemRun>& runs, const Context& made) {
  json root{{"schema", "kfstab.run/1"}, {"context", context_json(made)}};
  // The context's seed is that of the first system that draws its data; each system states its own.
  root["context"]["seed"] = nullptr;
  for (const SystemRun& r : runs)
    if (r.seed && root["context"]["seed"].is_null()) root["context"]["seed"] = *r.seed;
  root["systems"] = json::array();
  for (const SystemRun& r : runs) {
    json object = system_json(r);
    object["reference"] = {{"trajectories", r.trajectories},
                           {"certified_digits", r.certified_digits},
                           {"working_digits", r.working_digits}};
    if (r.reference_error) object["reference"]["error"] = *r.reference_error;
    object["analysis"] = {{"gamma", series(r.analysis.gamma)},
                          {"log10_amplification", series(r.analysis.log10_amplification)},
                          {"innovation_condition", series(r.analysis.innovation_condition)},
                          {"cosine", series(r.analysis.cosine)}};
    if (const auto& of = r.analysis.information; of.T.count() > 0)
      object["analysis"]["information"] = {{"A", series(of.A)},
                                           {"Q_root", series(of.Q_root)},
                                           {"R_root", series(of.R_root)},
                                           {"spread", series(of.spread)},
                                           {"inverse_cosine", series(of.inverse_cosine)},
                                           {"T", series(of.T)}};
    object["filters"] = json::array();
    for (const FilterRun& f : r.filters) object["filters"].push_back(filter_json(f));
    root["systems"].push_back(std::move(object));
  }
  return root.dump(1) + "\n";
}

std::string claims_json(const std::vector<ClaimResult>& results, const std::map<std::string, double>& parameters,
                        const Context& made) {
  json root{{"schema", "kfstab.claims/1"}, {"context", context_json(made)}};
  root["parameters"] = parameters;
  root["claims"] = json::array();
  for (const ClaimResult& r : results) {
    json object{{"id", r.claim.id},
                {"number", r.claim.number},
                {"title", r.claim.title},
                {"statement", r.claim.statement},
                {"source", r.claim.source},
                {"setup", r.claim.setup},
                {"mathematics", r.claim.mathematics},
                {"prediction", r.claim.prediction},
                {"meaning", r.claim.meaning},
                {"verdict", name(r.verdict())},
                {"seconds", r.seconds}};
    object["parameters"] = r.settings.values();
    object["variable"] = json::array();
    for (const Parameter& parameter : r.claim.parameters) {
      json entry{{"name", parameter.name}, {"meaning", parameter.meaning}};
      put(entry, "default", parameter.value);
      put(entry, "least", parameter.least);
      put(entry, "most", parameter.most);
      object["variable"].push_back(std::move(entry));
    }
    object["checks"] = json::array();
    for (const reports::Check& check : r.findings.checks) {
      json entry{{"name", check.name}};
      put(entry, "predicted", check.predicted);
      put(entry, "measured", check.measured);
      entry["criterion"] = check.criterion;
      entry["holds"] = check.holds;
      object["checks"].push_back(std::move(entry));
    }
    object["figures"] = json::array();
    for (const reports::Figure& figure : r.findings.figures) object["figures"].push_back(figure_json(figure));
    root["claims"].push_back(std::move(object));
  }
  return root.dump(1) + "\n";
}

std::string reference_json_before_steps(const properties::System& system, int digits) {
  const auto* simulated = dynamic_cast<const properties::Simulated*>(system.data.get());
  const auto d = system.dimensions();
  json root{{"schema", "kfstab.reference/1"}, {"context", context_json(context())}};
  root["system"] = {{"name", system.name},
                    {"description", system.description},
                    {"source", system.source},
                    {"n", d.n},
                    {"m", d.m},
                    {"p", d.p},
                    {"parameters", system.parameters},
                    {"seed", simulated ? json(simulated->seed()) : json()}};
  root["digits"] = digits;
  std::string text = root.dump(1);
  text.erase(text.rfind("\n}"));
  return text + ",\n \"steps\": [";
}

std::string reference_json_after_steps(const properties::System& system, const ReferenceOutcome& outcome) {
  json rest{{"steps_asked", system.steps}, {"interrupted", outcome.interrupted}};
  if (outcome.error) rest["error"] = *outcome.error;
  return "\n ],\n" + rest.dump(1).substr(2) + "\n";
}

std::string list_json(const std::string& what) {
  json root{{"schema", "kfstab.list/1"}, {"context", context_json(context())}};
  if (what.empty() || what == "systems") {
    root["systems"] = json::array();
    for (const CatalogueEntry& entry : catalogue()) {
      const auto system = find_system(std::string(entry.name));
      const auto d = system.dimensions();
      root["systems"].push_back({{"name", system.name},
                                 {"n", d.n},
                                 {"m", d.m},
                                 {"p", d.p},
                                 {"steps", system.steps},
                                 {"parameters", system.parameters},
                                 {"description", system.description},
                                 {"source", system.source}});
    }
  }
  if (what.empty() || what == "filters") {
    root["filters"] = json::array();
    for (const Metadata& f : filters()) {
      json statuses = json::array();
      for (int status = 1; status <= static_cast<int>(Status::overflow); ++status)
        if (f.statuses.has(static_cast<Status>(status))) statuses.push_back(name(static_cast<Status>(status)));
      root["filters"].push_back({{"id", f.id},
                                 {"title", f.title},
                                 {"update", f.update},
                                 {"takes", name(f.takes)},
                                 {"holds", notation(f.holds)},
                                 {"instant", f.instant == Instant::predicted ? "k+1|k" : "k|k"},
                                 {"gain", f.gain == GainKind::predictor ? "A P C' Re^-1" : "P C' Re^-1"},
                                 {"needs",
                                  {{"invertible_A", f.needs.invertible_A},
                                   {"positive_definite_Q", f.needs.positive_definite_Q},
                                   {"positive_definite_R", f.needs.positive_definite_R},
                                   {"positive_definite_P0", f.needs.positive_definite_P0},
                                   {"time_invariant", f.needs.time_invariant}}},
                                 {"operations", f.operations},
                                 {"statuses", std::move(statuses)},
                                 {"source", f.source}});
    }
  }
  if (what.empty() || what == "claims") {
    root["claims"] = json::array();
    for (const Claim& claim : all_claims()) {
      json parameters = json::object();
      for (const Parameter& p : claim.parameters) parameters[p.name] = p.value;
      root["claims"].push_back({{"number", claim.number},
                                {"id", claim.id},
                                {"title", claim.title},
                                {"statement", claim.statement},
                                {"source", claim.source},
                                {"parameters", std::move(parameters)}});
    }
  }
  if (what.empty() || what == "laws") {
    root["laws"] = json::array();
    for (const properties::Law& law : properties::all_laws()) {
      root["laws"].push_back({{"id", law.id},
                              {"statement", law.statement},
                              {"assumptions", law.assumptions},
                              {"source", law.source},
                              {"tolerance", law.tolerance},
                              {"failure", law.failure},
                              {"reference", law.reference}});
    }
  }
  return root.dump(1) + "\n";
}

}  // namespace kfstab::experiments
