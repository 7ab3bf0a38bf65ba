#include <kfstab/experiments/stored.hpp>

#include <cerrno>
#include <charconv>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>

#include <fmt/core.h>
#include <nlohmann/json.hpp>

#include <kfstab/experiments/constants.hpp>
#include <kfstab/properties/input_error.hpp>
#include <kfstab/reports/files.hpp>

namespace kfstab::experiments {
namespace {

using json = nlohmann::ordered_json;

/// A value of the file and where it stands, so that a complaint can say so.
class Node {
 public:
  Node(const json& value, std::string origin, std::string pointer = "")
      : value_(&value), origin_(std::move(origin)), pointer_(std::move(pointer)) {}

  [[noreturn]] void refuse(const std::string& expected) const {
    std::string found = value_->dump();
    if (found.size() > 40) found = found.substr(0, 40) + "...";
    properties::Place place;
    place.origin = origin_;
    place.pointer = pointer_;
    throw properties::InputError(place, found, expected);
  }

  bool has(const char* key) const { return value_->is_object() && value_->contains(key); }
  bool is_null() const { return value_->is_null(); }

  Node operator[](const char* key) const {
    if (!value_->is_object()) refuse("an object");
    if (!value_->contains(key)) refuse(fmt::format("an object with '{}'", key));
    return Node(value_->at(key), origin_, pointer_ + "/" + key);
  }

  std::vector<Node> list() const {
    if (!value_->is_array()) refuse("a list");
    std::vector<Node> nodes;
    for (std::size_t i = 0; i < value_->size(); ++i)
      nodes.emplace_back(value_->at(i), origin_, fmt::format("{}/{}", pointer_, i));
    return nodes;
  }
  std::vector<std::pair<std::string, Node>> members() const {
    if (!value_->is_object()) refuse("an object");
    std::vector<std::pair<std::string, Node>> nodes;
    for (const auto& [key, value] : value_->items())
      nodes.emplace_back(key, Node(value, origin_, pointer_ + "/" + key));
    return nodes;
  }

  std::string text() const {
    if (!value_->is_string()) refuse("a text");
    return value_->get<std::string>();
  }
  bool is_text() const { return value_->is_string(); }
  bool truth() const {
    if (!value_->is_boolean()) refuse("true or false");
    return value_->get<bool>();
  }
  /// A number, or one of the words nan, inf and -inf in its place.
  double number() const {
    if (value_->is_number()) return value_->get<double>();
    if (value_->is_string()) {
      const auto word = value_->get<std::string>();
      if (word == "nan") return NaN;
      if (word == "inf") return infinity;
      if (word == "-inf") return -infinity;
    }
    refuse("a number, nan, inf or -inf");
  }
  template <class Integer = std::int64_t>
  Integer integer() const {
    if (!value_->is_number_integer()) refuse("a whole number");
    return value_->get<Integer>();
  }

  /// The number of that key, or the word beside it where there is none.
  double number(const char* key) const {
    const Node node = (*this)[key];
    return node.is_null() ? (*this)[(std::string(key) + "_word").c_str()].number() : node.number();
  }
  std::vector<double> numbers() const {
    std::vector<double> result;
    for (const Node& node : list()) result.push_back(node.number());
    return result;
  }

  // Keys that came later than the schema: files without them are read all the same.
  std::string text_or(const char* key, std::string other) const { return has(key) ? (*this)[key].text() : other; }
  bool truth_or(const char* key, bool other) const { return has(key) ? (*this)[key].truth() : other; }

 private:
  const json* value_;
  std::string origin_, pointer_;
};

Context context_of(const Node& root) {
  Context context;
  for (const auto& [key, value] : root["context"].members())
    if (value.is_text()) context.emplace_back(key, value.text());
  return context;
}

std::map<std::string, double> parameters_of(const Node& node) {
  std::map<std::string, double> values;
  for (const auto& [key, value] : node["parameters"].members()) values[key] = value.number();
  return values;
}

// ---- Runs ----------------------------------------------------------------------------------------------------------

/// Metadata speak of texts that others own.
struct Owner {
  std::deque<std::string> texts;
  std::deque<Metadata> metadata;
  std::string_view keep(std::string text) { return texts.emplace_back(std::move(text)); }
};

/// An enumerator by what a function says of it.
template <class Enum, class Name>
Enum named(const Node& node, Enum last, Name name) {
  const std::string text = node.text();
  for (int i = 0; i <= static_cast<int>(last); ++i)
    if (text == name(static_cast<Enum>(i))) return static_cast<Enum>(i);
  node.refuse("a word of docs/results.md");
}

Series series_of(const Node& curves, const char* key) {
  if (!curves.has(key)) return {};
  const Node node = curves[key];
  const Series::Points points{node["step"].numbers(), node["value"].numbers()};
  if (points.step.size() != points.value.size()) node.refuse("as many values as steps");
  return Series(points, node["count"].integer());
}

FilterRun filter_of(const Node& node, Owner& owner) {
  FilterRun f;
  Metadata& metadata = owner.metadata.emplace_back();
  f.metadata = &metadata;
  metadata.id = owner.keep(node["id"].text());
  metadata.update = owner.keep(node.text_or("update", ""));
  if (node.has("holds")) metadata.holds = named(node["holds"], Held::gain, [](Held h) { return notation(h); });
  if (node.has("refused")) {
    f.refused = node["refused"].text();
    return f;
  }
  metadata.instant = node["instant"].text() == "filtered" ? Instant::filtered : Instant::predicted;
  metadata.gain = node["gain"].text() == "filter" ? GainKind::filter : GainKind::predictor;
  const Node curves = node["curves"];
  f.covariance_error = series_of(curves, "covariance_error");
  f.bound = series_of(curves, "bound");
  f.gain_error = series_of(curves, "gain_error");
  f.gain_bound = series_of(curves, "gain_bound");
  f.state_error = series_of(curves, "state_error");
  f.asymmetry = series_of(curves, "asymmetry");
  f.smallest_eigenvalue = series_of(curves, "smallest_eigenvalue");
  f.correct_digits = node["last"].number("correct_digits");
  if (const Node step = node["first_indefinite"]; !step.is_null()) f.first_indefinite = step.integer();
  if (const Node failure = node["failure"]; !failure.is_null()) {
    f.first_failure = failure["step"].integer();
    if (failure["status"].text() == "no_answer")
      f.stopped = failure["reason"].text();
    else
      f.failure = named(failure["status"], Status::overflow, [](Status s) { return name(s); });
  }
  f.seconds_per_step = node.number("seconds_per_step");
  return f;
}

SystemRun system_of(const Node& node, Owner& owner) {
  SystemRun r;
  r.name = node["name"].text();
  r.description = node["description"].text();
  r.source = node["source"].text();
  r.dimensions = {node["n"].integer<Index>(), node["m"].integer<Index>(), node["p"].integer<Index>()};
  r.parameters = parameters_of(node);
  if (const Node seed = node["seed"]; !seed.is_null()) r.seed = seed.integer<std::uint64_t>();
  r.steps_done = node["steps"].integer();
  r.steps_asked = node["steps_asked"].integer();
  r.interrupted = node["interrupted"].truth();
  const Node reference = node["reference"];
  r.certified_digits = reference["certified_digits"].integer<int>();
  r.working_digits = reference["working_digits"].integer<int>();
  if (reference.has("trajectories")) r.trajectories = reference["trajectories"].integer<int>();
  if (reference.has("error")) r.reference_error = reference["error"].text();
  if (node.has("analysis")) {
    const Node analysis = node["analysis"];
    r.analysis = {series_of(analysis, "gamma"), series_of(analysis, "log10_amplification"),
                  series_of(analysis, "innovation_condition"), series_of(analysis, "cosine"), {}};
    if (analysis.has("information")) {
      const Node of = analysis["information"];
      r.analysis.information = {series_of(of, "A"),      series_of(of, "Q_root"),         series_of(of, "R_root"),
                                series_of(of, "spread"), series_of(of, "inverse_cosine"), series_of(of, "T")};
    }
  }
  for (const Node& filter : node["filters"].list()) r.filters.push_back(filter_of(filter, owner));
  return r;
}

// ---- Claims --------------------------------------------------------------------------------------------------------

reports::Axis axis_of(const Node& node) { return {node["label"].text(), node["log"].truth()}; }

reports::Figure figure_of(const Node& node) {
  reports::Figure figure;
  figure.id = node["id"].text();
  figure.title = node["title"].text();
  figure.caption = node["caption"].text();
  if (node.has("x")) figure.x = axis_of(node["x"]);
  if (node.has("y")) figure.y = axis_of(node["y"]);
  for (const Node& entry : node["curves"].list()) {
    reports::Curve curve{entry["id"].text(), entry["label"].text(), entry["x"].numbers(), entry["y"].numbers()};
    if (curve.x.size() != curve.y.size()) entry.refuse("as many values of y as of x");
    if (entry.has("role"))
      curve.role = named(entry["role"], reports::CurveRole::envelope, [](reports::CurveRole r) { return name(r); });
    if (entry.has("color")) curve.color = entry["color"].integer<int>();
    figure.curves.push_back(std::move(curve));
  }
  if (!node.has("maps")) return figure;
  const Node maps = node["maps"];
  figure.maps = {maps["x"].numbers(),    maps["y"].numbers(),    axis_of(maps["color"]), {},
                 maps["outline"].text(), maps["matrix"].truth(), maps["numbers"].truth()};
  for (const Node& entry : maps["panels"].list()) {
    reports::HeatMap panel{entry["id"].text(), entry["label"].text(), entry["values"].numbers(), {}};
    for (const Node& cell : entry["outlined"].list()) panel.outlined.push_back(cell.truth());
    figure.maps.panels.push_back(std::move(panel));
  }
  return figure;
}

ClaimResult claim_of(const Node& node) {
  ClaimResult r;
  r.claim.id = node["id"].text();
  r.claim.number = node["number"].integer<int>();
  r.claim.title = node["title"].text();
  r.claim.statement = node["statement"].text();
  r.claim.source = node["source"].text();
  r.claim.setup = node["setup"].text();
  r.claim.prediction = node["prediction"].text();
  r.claim.mathematics = node.text_or("mathematics", "");
  r.claim.meaning = node.text_or("meaning", "");
  if (node.has("variable"))
    for (const Node& entry : node["variable"].list())
      r.claim.parameters.push_back({entry["name"].text(), entry.number("default"), entry["meaning"].text(),
                                    entry.number("least"), entry.number("most")});
  r.settings = Settings(parameters_of(node));
  r.seconds = node.number("seconds");
  for (const Node& entry : node["checks"].list())
    r.findings.checks.push_back({entry["name"].text(), entry.number("predicted"), entry.number("measured"),
                                 entry["criterion"].text(), entry["holds"].truth()});
  for (const Node& entry : node["figures"].list()) r.findings.figures.push_back(figure_of(entry));
  return r;
}

/// The number after the stroke of a schema that begins with `name`.
std::optional<int> version_of(std::string_view schema, std::string_view name) {
  if (!schema.starts_with(name) || schema.size() <= name.size() || schema[name.size()] != '/') return std::nullopt;
  schema.remove_prefix(name.size() + 1);
  int version = 0;
  const auto [end, error] = std::from_chars(schema.data(), schema.data() + schema.size(), version);
  if (error != std::errc() || end != schema.data() + schema.size()) return std::nullopt;
  return version;
}

}  // namespace

Stored read_results(std::string_view text, const std::string& origin) {
  json value;
  try {
    value = json::parse(text);
  } catch (const json::parse_error& error) {
    properties::Place place;
    place.origin = origin;
    throw properties::InputError(place, fmt::format("no JSON, from byte {} on", error.byte),
                                 "a results.json, as run and claim write it");
  }
  const Node root(value, origin);
  const Node schema = root["schema"];
  constexpr int known = 1;
  const auto run = version_of(schema.text(), "kfstab.run"), claims = version_of(schema.text(), "kfstab.claims");
  if (!run && !claims) schema.refuse("kfstab.run/1 or kfstab.claims/1");
  if (run.value_or(known) != known || claims.value_or(known) != known)
    schema.refuse(fmt::format("version {}, which is all that this kfstab can read", known));
  if (run) {
    const auto owner = std::make_shared<Owner>();
    StoredRun stored{context_of(root), {}, owner};
    for (const Node& node : root["systems"].list()) stored.systems.push_back(system_of(node, *owner));
    return stored;
  }
  StoredClaims stored{context_of(root), parameters_of(root), {}};
  for (const Node& node : root["claims"].list()) stored.claims.push_back(claim_of(node));
  return stored;
}

Stored read_results_file(const std::string& path) {
  namespace fs = std::filesystem;
  std::error_code unreadable;
  const fs::path file = fs::is_directory(path, unreadable) ? fs::path(path) / "results.json" : fs::path(path);
  std::ifstream stream(file, std::ios::binary);
  if (!stream) throw reports::FileError("read", file, std::strerror(errno));
  const std::string text{std::istreambuf_iterator<char>(stream), {}};
  return read_results(text, file.string());
}

}  // namespace kfstab::experiments
