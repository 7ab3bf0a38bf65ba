#include <kfstab/experiments/fingerprint.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <utility>

#include <fmt/core.h>

#include <kfstab/experiments/asymmetry.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/ladder.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/properties/bench.hpp>
#include <kfstab/properties/data.hpp>
#include <kfstab/properties/law.hpp>
#include <kfstab/properties/precise.hpp>

namespace kfstab::experiments {
namespace {

using properties::Bench;
using properties::Ending;
using properties::Precise;
using properties::Subject;
using properties::System;

// --- the ladders --------------------------------------------------------------------------------------------------------

struct Rung {
  double difficulty;
  std::vector<System> systems;
};

struct Rungs {
  Climb blank;  ///< what the ladder is called
  std::vector<Rung> rungs;
  bool by_determinant = false;  ///< the error of P is that of ln det P
};

/// The root of a covariance that is to be exact in double too: a power of two.
double power_of_two(double near) { return std::exp2(std::round(std::log2(near))); }

/// Nearly dependent measurements, C8; A = I and no noise, so that it matters to nobody whether a step ends with its time
/// update or with its measurement update. One step.
Rungs innovation() {
  Rungs ladder{{.id = "innovation",
                .difficulty = "condition number of Re^1/2",
                .symbol = "k(Re^1/2)",
                .theory = "theory (4.1), (4.2)"},
               {}};
  const Index n = 5, p = 3;
  const int frames = 5;
  Random random(8);
  for (int half_decades = 0; half_decades <= 14; ++half_decades) {
    const double k = std::pow(10., half_decades / 2.);
    Rung& rung = ladder.rungs.emplace_back(Rung{k, {}});
    for (int f = 0; f < frames; ++f) {
      Matrix<double> spectrum = Matrix<double>::Zero(p, n);
      for (Index i = 0; i < p; ++i) spectrum(i, i) = std::pow(k, -.5 * static_cast<double>(i));
      const Matrix<double> C = random_orthogonal(random, p) * spectrum * random_orthogonal(random, n).transpose(),
                           I = Matrix<double>::Identity(n, n);
      rung.systems.push_back(system_of("innovation", I, Matrix<double>::Zero(n, 1), C,
                                       power_of_two(.5 / k) * Matrix<double>::Identity(p, p), I, 1));
    }
  }
  return ladder;
}

/// C14.
Rungs prior() {
  Rungs ladder{{.id = "prior",
                .difficulty = "variance of the prior",
                .symbol = "the prior's variance",
                .theory = "theory (4.1)-(4.3)"},
               {}};
  const Matrix<double> A = round_to(Matrix<double>{{1., .5, .125}, {0., 1., .5}, {0., 0., .9}}, 20);
  for (int j = 0; j <= 40; j += 2)
    ladder.rungs.push_back({std::exp2(2 * j),
                            {system_of("weak-prior", A, Matrix<double>{{0.}, {0.}, {.25}}, Matrix<double>{{1., 0., 0.}},
                                       Matrix<double>{{1.}}, std::exp2(j) * Matrix<double>::Identity(3, 3), 6)}});
  return ladder;
}

/// Dyer and McReynolds, C11.
Rungs accurate() {
  Rungs ladder{{.id = "accurate",
                .difficulty = "1/d, d the noise of two measurements and their difference",
                .symbol = "1/d",
                .theory = "theory (6.1)"},
               {}};
  const auto I = Matrix<double>::Identity(3, 3);
  for (int j = 4; j <= 52; j += 2) {
    const double d = std::exp2(-j);
    ladder.rungs.push_back(
        {1 / d,
         {system_of("dyer-mcreynolds", I, Matrix<double>::Zero(3, 1), Matrix<double>{{1., 1., 1.}, {1., 1., 1 + d}},
                    d * Matrix<double>::Identity(2, 2), I, 4)}});
  }
  return ladder;
}

/// P0 = diag(g^2, g, 1), and A that spreads the largest variance over all states, no noise: what is lost of the small ones
/// shows in the volume det P, which is known, C32.
Rungs graded() {
  Rungs ladder{
      {.id = "graded", .difficulty = "condition number of P0", .symbol = "k(P0)", .theory = "theory (4.1), (4.2)"},
      {},
      true};
  // Of bits enough that no product is exact by chance.
  const Matrix<double> A = round_to(Matrix<double>{{1., .7, .3}, {0., 1., .6}, {0., 0., 1.}}, 20),
                       C = round_to(Matrix<double>{{1., .8, .4}}, 20);
  for (int j = 0; j <= 24; j += 2) {
    const Vector<double> root{{std::exp2(-2 * j), std::exp2(-j), 1.}};
    ladder.rungs.push_back({std::exp2(4 * j),
                            {system_of("graded", A, Matrix<double>::Zero(3, 1), C, Matrix<double>{{1.}},
                                       Matrix<double>(root.asDiagonal()), 4)}});
  }
  return ladder;
}

/// C13.
Rungs dynamics() {
  Rungs ladder{{.id = "dynamics", .difficulty = "condition number of A", .symbol = "k(A)", .theory = "theory (4.3)"},
               {}};
  const Index n = 4;
  const int frames = 5;
  Random random(13);
  for (int decades = 0; decades <= 14; ++decades) {
    const double k = std::pow(10., decades);
    Rung& rung = ladder.rungs.emplace_back(Rung{k, {}});
    for (int f = 0; f < frames; ++f) {
      const Matrix<double> U = random_orthogonal(random, n), V = random_orthogonal(random, n),
                           I = Matrix<double>::Identity(n, n);
      const Vector<double> singular_values{{1., 1., 1., 1 / k}};
      rung.systems.push_back(system_of("nearly-singular", U * singular_values.asDiagonal() * V.transpose(),
                                       round_to(U.rightCols(2), 18), round_to(random_normal(random, 2, n), 18),
                                       Matrix<double>::Identity(2, 2), I, 2));
    }
  }
  return ladder;
}

/// Nothing is difficult here: what is lost is the arithmetic's. With data, so that a filter that shows no gain shows it in x.
std::vector<System> ordinary() {
  Random random(24);
  std::vector<System> systems;
  for (int i = 0; i < 9; ++i) {
    System system = system_of("ordinary", round_to(.9 * random_orthogonal(random, 4), 18),
                              round_to(random_normal(random, 4, 2), 18), round_to(random_normal(random, 2, 4), 18),
                              Matrix<double>{{.5, 0.}, {0., 2.}}, Matrix<double>::Identity(4, 4), 4);
    system.data =
        std::make_shared<properties::Recorded>(random_normal(random, 2, system.steps), Matrix<double>(0, system.steps));
    systems.push_back(std::move(system));
  }
  return systems;
}

struct LongRun {
  std::string_view id;
  System system;
};

/// C3: unstable with one output, where the asymmetry of three codings grows by |l1 l2|; stable with two outputs, where
/// that of two of them grows all the same. C23: unstable with two outputs, where that of coding (i) grows if one triangle of Re is
/// factored, and is forgotten if Re is solved with as computed.
std::vector<LongRun> long_runs() {
  const Matrix<double> plane = Matrix<double>::Identity(2, 2);
  return {{"one-output",
           system_of("pair", round_to(rotation(1.05, .7), 20), Matrix<double>{{1.}, {.5}}, Matrix<double>{{1., .25}},
                     Matrix<double>{{1.}}, Matrix<double>{{2., 0.}, {0., 1.}}, 300)},
          {"two-outputs", system_of("pair", round_to(rotation(.9, .7), 20), Matrix<double>{{1., 0.}, {.5, .25}}, plane,
                                    .125 * plane, plane, 120)},
          {"unstable-two-outputs", system_of("pair", round_to(rotation(1.1, .7), 20),
                                             Matrix<double>{{1., 0.}, {.5, .25}}, plane, .03125 * plane, plane, 400)}};
}

/// All that a subject is run on.
struct Systems {
  std::vector<System> ordinary = experiments::ordinary();
  std::vector<Rungs> ladders = {innovation(), prior(), accurate(), graded(), dynamics()};
  std::vector<LongRun> long_runs = experiments::long_runs();
};

const Systems& systems() {
  static const Systems all;
  return all;
}

// --- one subject --------------------------------------------------------------------------------------------------------

/// The worst of a run.
struct Worst {
  double P = NaN, K = NaN, x = NaN;  ///< NaN where nothing was answered
  bool indefinite = false;           ///< not positive semidefinite at some step
  bool broken = false;               ///< broke down, or did not answer
  std::optional<std::string> refused;
};

void widen(double& worst, double error) {
  if (std::isnan(worst) || !(error <= worst)) worst = std::isnan(error) ? infinity : error;
}

double relative(double error, double scale) { return error == 0 ? 0 : error / scale; }

Precise symmetric(const Precise& P) { return P + P.transposed(); }

/// ln det of 2^-n (P + P'), by the diagonal of its root; nothing if it is not positive definite.
std::optional<double> log_determinant(const Precise& P) {
  const auto L = symmetric(P).lower_root();
  if (!L) return std::nullopt;
  const Matrix<double> root = L->rounded();
  double sum = 0;
  for (Index i = 0; i < root.rows(); ++i) sum += 2 * std::log(root(i, i));
  return sum - static_cast<double>(P.rows()) * std::log(2.);
}

bool all_floats(const Matrix<double>& X) {
  return std::all_of(X.reshaped().begin(), X.reshaped().end(), [](double x) { return x == static_cast<float>(x); });
}

class Measurement {
 public:
  Measurement(Subject& subject, properties::Truths& truths, const std::function<bool()>& stop)
      : subject_(subject), truths_(truths), stop_(stop) {}

  /// Nothing if it was stopped.
  std::optional<Fingerprint> all() {
    const auto begin = std::chrono::steady_clock::now();
    Fingerprint result;
    result.subject = subject_.traits();
    std::vector<double> errors;
    for (const System& system : systems().ordinary) {
      if (stopped()) return std::nullopt;
      const Worst one = worst(system, false);
      if (one.refused) continue;
      errors.push_back(0);
      for (const double error : {one.P, one.K, one.x})
        if (!std::isnan(error)) errors.back() = std::max(errors.back(), error);
      if (one.broken) errors.back() = infinity;
    }
    result.ordinary_error = median(errors);
    result.answers_floats = steps_ > 0 && floats_;
    difficult_ = true;
    for (const Rungs& ladder : systems().ladders) {
      const auto climbed = climb(ladder);
      if (!climbed) return std::nullopt;
      result.climbs.push_back(*climbed);
    }
    for (const LongRun& run : systems().long_runs) {
      if (stopped()) return std::nullopt;
      result.asymmetries.push_back(asymmetry(run));
    }
    difficult_ = false;
    result.steps = steps_;
    result.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    return result;
  }

 private:
  bool stopped() const { return stop_ && stop_(); }

  Worst worst(const System& system, bool by_determinant) {
    Bench bench(subject_, truths_);
    const properties::Run run = run_of(bench, system);
    const properties::Course& truth = bench.course(system);
    steps_ += static_cast<std::int64_t>(run.answers.size());
    Worst result;
    double volume = 0;  // ln det P, of a system without noise
    if (by_determinant)
      volume = *log_determinant(Precise(system.P0.value.at(0)) * Precise(system.P0.value.at(0)).transposed());
    for (std::size_t i = 0; i < run.answers.size(); ++i) {
      const auto k = static_cast<std::int64_t>(i);
      if (k >= truth.steps()) break;
      const properties::Answer& answer = run.answers[i];
      floats_ = floats_ && all_floats(answer.held) && (!answer.gain || all_floats(*answer.gain)) &&
                (!answer.state || all_floats(*answer.state));
      if (answer.gain && truth.K(k).size() > 0)
        widen(result.K, relative((*answer.gain - truth.K(k)).norm(), truth.K(k).norm()));
      if (answer.state && truth.x(k).size() > 0)
        widen(result.x, relative((*answer.state - truth.x(k)).norm(), truth.x(k).norm()));
      if (answer.holds == Held::gain) continue;
      const auto P = properties::covariance(answer);
      if (!P || (answer.holds == Held::covariance && !symmetric(*P).lower_root())) result.indefinite = true;
      if (by_determinant) {
        const Matrix<double>& Re = truth.truth(k).innovation;
        volume -= std::log(Re(0, 0));  // det A = R = 1
        const auto found = P ? log_determinant(*P) : std::nullopt;
        widen(result.P, found ? std::abs(*found - volume) : infinity);
      } else {
        widen(result.P, P ? relative((*P - Precise(truth.P(k))).norm(), truth.P(k).norm()) : infinity);
      }
    }
    if (run.ending.kind == Ending::Kind::done) return result;
    if (run.ending.step < 0 && run.ending.kind == Ending::Kind::refused) {
      result.refused = run.ending.reason;
      return result;
    }
    result.broken = true;
    if (subject_.traits().holds != Held::gain) result.P = infinity;
    if (subject_.traits().gain) result.K = infinity;
    return result;
  }

  /// A filter that dies on a difficult system has broken down there; on ordinary ones it is at fault.
  properties::Run run_of(Bench& bench, const System& system) const {
    try {
      return bench.run(system);
    } catch (const properties::SubjectFault& fault) {
      if (!difficult_ || fault.kind != properties::SubjectFault::Kind::died) throw;
      return {system, {}, {Ending::Kind::no_answer, 0, fault.what()}};
    }
  }

  std::optional<Climb> climb(const Rungs& ladder) {
    Climb result = ladder.blank;
    Ladder P, K;
    for (std::size_t i = 0; i < ladder.rungs.size(); ++i) {
      const auto& [difficulty, systems] = ladder.rungs[i];
      std::size_t indefinite = 0, broken = 0;
      for (const System& system : systems) {
        if (stopped()) return std::nullopt;
        const Worst one = worst(system, ladder.by_determinant);
        if (one.refused) {
          result.refused = one.refused;
          continue;
        }
        P.add(i, difficulty, one.P);
        K.add(i, difficulty, one.K);
        indefinite += one.indefinite;
        broken += one.broken;
      }
      if (!result.indefinite && 2 * indefinite > systems.size()) result.indefinite = difficulty;
      if (!result.broken && 2 * broken > systems.size()) result.broken = difficulty;
    }
    result.at = P.difficulties();
    result.P = P.medians();
    result.K = K.medians();
    return result;
  }

  AsymmetryRun asymmetry(const LongRun& run) {
    AsymmetryRun result{.id = run.id};
    const Matrix<double>& A = run.system.A.at(0);
    result.product = std::abs(A(0, 0) * A(1, 1) - A(0, 1) * A(1, 0));
    subject_.run(run.system, [&](std::int64_t, const properties::Answer& answer) {
      ++steps_;
      if (answer.holds == Held::gain) return false;
      const Matrix<double>& P = answer.held;
      const bool symmetric = answer.holds != Held::covariance;
      result.curve.push_back(symmetric ? 0 : relative((P - P.transpose()).norm() / 2, P.norm()));
      return std::isfinite(result.curve.back());
    });
    return result;
  }

  Subject& subject_;
  properties::Truths& truths_;
  const std::function<bool()>& stop_;
  std::int64_t steps_ = 0;
  bool floats_ = true;
  bool difficult_ = false;
};

// --- among the others -----------------------------------------------------------------------------------------------------

/// How far two curves of errors are from one another, in decades, the mean over their points. Errors count in units of
/// u, between what rounding makes of nothing, `least`, and what is no error any more but ruin.
class Decades {
 public:
  Decades(double roundoff_a, double roundoff_b)
      : scale_a_(u / roundoff_a), scale_b_(u / roundoff_b), most_(.1 * std::min(scale_a_, scale_b_)) {}

  void add(const std::vector<double>& a, const std::vector<double>& b, double least) {
    double sum = 0;
    int points = 0;
    for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i) {
      if (std::isnan(a[i]) || std::isnan(b[i])) continue;
      sum += std::abs(level(a[i] * scale_a_, least) - level(b[i] * scale_b_, least));
      ++points;
    }
    if (points == 0) return;
    sum_ += sum / points;
    ++curves_;
  }
  /// NaN where there was nothing in common.
  double mean() const { return curves_ > 0 ? sum_ / curves_ : NaN; }

 private:
  double level(double error, double least) const { return std::log10(std::clamp(error, least, most_)); }

  double scale_a_, scale_b_, most_, sum_ = 0;
  int curves_ = 0;
};

/// u, exactly that of double where it is near it.
double word(const Fingerprint& f) { return f.precision() == "double" ? u : f.roundoff; }

double distance(const Fingerprint& a, const Fingerprint& b) {
  Decades decades(word(a), word(b));
  for (std::size_t i = 0; i < a.climbs.size(); ++i) {
    decades.add(a.climbs[i].P, b.climbs[i].P, 4 * u);
    decades.add(a.climbs[i].K, b.climbs[i].K, 4 * u);
  }
  // A P that is symmetric to the last bit is a decade from one that is so but for rounding.
  for (std::size_t i = 0; i < a.asymmetries.size(); ++i)
    decades.add(a.asymmetries[i].curve, b.asymmetries[i].curve, u / 10);
  return decades.mean();
}

/// The filters of the registry, and the truths that they were measured by, which others share.
class Registry {
 public:
  Registry() {
    std::vector<double> errors;
    for (const Metadata& metadata : filters()) {
      const auto subject = properties::built_in(metadata.id);
      fingerprints_.push_back(*Measurement(*subject, truths_, {}).all());
      errors.push_back(fingerprints_.back().ordinary_error);
    }
    typical_error_ = median(errors);
    for (Fingerprint& one : fingerprints_) fit(one);
  }

  const std::vector<Fingerprint>& fingerprints() const { return fingerprints_; }
  properties::Truths truths() const { return truths_; }

  /// u, the slopes and growths, where errors are above those that u makes.
  void fit(Fingerprint& one) const {
    one.roundoff = std::max(u, u * one.ordinary_error / typical_error_);
    const double r = word(one);
    for (Climb& climb : one.climbs) {
      const auto slope = [&](const std::vector<double>& errors) {
        // ln det is a sum of logarithms as large as some 50, each rounded.
        const double low = climb.id == "graded" && &errors == &climb.P ? 200 * r : 20 * r;
        const Line line = fit_power(climb.at, errors, low, .01);
        return line.points < 3 ? Line{NaN, NaN, line.points, infinity} : line;
      };
      climb.P_slope = slope(climb.P);
      climb.K_slope = slope(climb.K);
    }
    for (AsymmetryRun& run : one.asymmetries) run.growth = growth(run.curve, r);
  }

 private:
  static double growth(const std::vector<double>& curve, double r) {
    if (curve.empty()) return NaN;
    const double most = *std::ranges::max_element(curve), large = 1e-4;
    if (most == 0) return 0;
    return most <= large ? 1 : fit_growth(curve, 20 * r, large).factor;
  }

  properties::Truths truths_;
  std::vector<Fingerprint> fingerprints_;
  double typical_error_ = 0;
};

const Registry& registry() {
  static const Registry measured;
  return measured;
}

// --- in words -----------------------------------------------------------------------------------------------------------

std::string in_words(double digits) {
  constexpr const char* words[] = {"no digit", "one digit", "two digits", "three digits", "four digits"};
  const double whole = std::round(digits);
  if (whole >= 0 && whole <= 4 && std::abs(digits - whole) <= .25) return words[static_cast<int>(whole)];
  return fmt::format("{:.1f} digits", digits);
}

/// Of the gain or of P, whichever is determined better.
const Line& slope_of(const Climb& climb) {
  return climb.P_slope.half_width < climb.K_slope.half_width ? climb.P_slope : climb.K_slope;
}

std::string likeness(const Fingerprint& f) {
  const auto alike = f.alike();
  std::string names;
  for (std::size_t i = 0; i < alike.size(); ++i)
    names += fmt::format("{}{}", i == 0 ? "" : i + 1 == alike.size() ? " or " : ", ", alike[i]->id);
  if (!alike.empty()) return "behaves like " + names;
  std::string text = "behaves like none of the filters here";
  if (!f.neighbours.empty())
    text += fmt::format(" (the nearest is {}, {:.1f} decades away)", f.neighbours.front().filter->id,
                        f.neighbours.front().distance);
  return text;
}

}  // namespace

std::string_view Fingerprint::precision() const {
  const auto near = [&](int bits, int within) { return std::abs(std::log2(roundoff) + bits) <= within; };
  if (!(ordinary_error <= .01)) return "wrong";
  if (near(53, 6)) return "double";
  if (near(24, 6)) return "single";
  if (near(11, 4)) return "half";
  return "other";
}

std::vector<const Metadata*> Fingerprint::alike() const {
  std::vector<const Metadata*> result;
  if (neighbours.empty() || neighbours.front().distance > .5) return result;
  for (const Neighbour& one : neighbours)
    if (one.distance <= 1.5 * neighbours.front().distance) result.push_back(one.filter);
  return result;
}

const Climb& Fingerprint::climb(std::string_view ladder) const {
  return *std::ranges::find(climbs, ladder, &Climb::id);
}

const AsymmetryRun& Fingerprint::asymmetry(std::string_view run) const {
  return *std::ranges::find(asymmetries, run, &AsymmetryRun::id);
}

const std::vector<Fingerprint>& registry_fingerprints() { return registry().fingerprints(); }

const Fingerprint& registry_fingerprint(std::string_view id) {
  return *std::ranges::find(registry().fingerprints(), id, [](const Fingerprint& f) { return f.subject.name; });
}

std::optional<Fingerprint> fingerprint(Subject& subject, const std::function<bool()>& stop) {
  properties::Truths truths = registry().truths();
  auto result = Measurement(subject, truths, stop).all();
  if (!result) return std::nullopt;
  registry().fit(*result);
  if (result->precision() == "wrong") return result;
  for (const Fingerprint& other : registry().fingerprints()) {
    // By its gain alone nobody is told from a filter that shows more.
    if (other.subject.holds == Held::gain && result->subject.holds != Held::gain) continue;
    if (const double far = distance(*result, other); !std::isnan(far))
      result->neighbours.push_back({find_filter(other.subject.name), far});
  }
  std::ranges::stable_sort(result->neighbours, {}, &Neighbour::distance);
  return result;
}

std::string sentence(const Fingerprint& f) {
  const auto precision = f.precision();
  if (precision == "wrong")
    return fmt::format("is wrong on ordinary systems, by {:.1g}: that is no matter of rounding", f.ordinary_error);
  std::string text;
  if (precision == "single" || precision == "half")
    text = f.answers_floats
               ? fmt::format("computes in {} precision, ", precision)
               : fmt::format("computes in {} precision somewhere, though it answers in double, ", precision);
  else if (precision == "other")
    text = fmt::format("errs by {:.1g} on ordinary systems, more than double precision explains, ", f.ordinary_error);
  text += likeness(f);

  std::vector<std::string> parts;
  const Climb& innovation = f.climb("innovation");
  if (const double lost = slope_of(innovation).slope; !std::isnan(lost)) {
    parts.push_back(fmt::format("loses {} per decade of {}", in_words(lost), innovation.symbol));
    const double root = slope_of(registry_fingerprint("srcf").climb("innovation")).slope;
    if (lost > root + .5) {
      const std::string words = in_words(root);
      parts.back() += fmt::format(" (srcf would lose {})", words.substr(0, words.find(' ')));
    }
  }
  const Climb& dynamics = f.climb("dynamics");
  if (const double lost = slope_of(dynamics).slope; lost > .5)
    parts.push_back(fmt::format("loses {} per decade of {}", in_words(lost), dynamics.symbol));
  const AsymmetryRun& pair = f.asymmetry("one-output");
  if (f.subject.holds == Held::covariance && !pair.curve.empty()) {
    if (pair.growth == 0)
      parts.push_back("P stays symmetric");
    else if (pair.growth == 1)
      parts.push_back("an asymmetry of P does not grow");
    else if (std::isnan(pair.growth))
      parts.push_back("P is not symmetric");
    else if (std::abs(pair.growth / pair.product - 1) <= .01)
      parts.push_back(fmt::format("its asymmetry grows by |l1 l2| = {:.2f} a step", pair.product));
    else
      parts.push_back(fmt::format("its asymmetry grows by {:.2f} a step", pair.growth));
  }
  const Climb& accurate = f.climb("accurate");
  if (accurate.indefinite && !(accurate.broken && *accurate.broken < *accurate.indefinite))
    parts.push_back(fmt::format("definiteness is lost at d = {:.1e}", 1 / *accurate.indefinite));
  else if (accurate.broken)
    parts.push_back(fmt::format("breaks down at d = {:.1e}", 1 / *accurate.broken));
  else if (!accurate.at.empty())
    parts.push_back(fmt::format("holds to d = {:.1e}", 1 / accurate.at.back()));
  for (std::size_t i = 0; i < parts.size(); ++i) text += (i == 0 ? ": " : ", ") + parts[i];
  return text;
}

}  // namespace kfstab::experiments
