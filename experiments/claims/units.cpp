#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/properties/precise.hpp>

namespace kfstab::experiments::claims::units {
namespace {

// What each of these does to a state's row is the same whatever the row's unit: sums over columns, reflectors of
// columns, scalar updates.
constexpr std::array studied = {"ckf", "ckf-textbook", "joseph", "srcf", "ud", "potter", "carlson"};

/// What a filter holds after each step, in the original units: that is P, or a root, scaled back exactly.
std::vector<Matrix<double>> course(const std::string& id, const properties::System& system,
                                   const Vector<double>& unit) {
  const Vector<double> back = unit.cwiseInverse();
  const auto filter = make_filter<double>(id);
  const auto problem = problem_of(system, filter->metadata().takes);
  filter->start(problem);
  std::vector<Matrix<double>> course;
  for (std::int64_t k = 0; k < system.steps; ++k) {
    const auto step = filter->step(k, nullptr, nullptr);
    if (!step.report) break;
    Matrix<double> held = back.asDiagonal() * *step.held;
    // U D U' with rows in other units: U is D^-1 U D there, and D's entries have two units.
    if (filter->metadata().holds == Held::ud_factors) {
      held = back.asDiagonal() * *step.held * unit.asDiagonal();
      for (Index i = 0; i < held.rows(); ++i) held(i, i) = back(i) * (*step.held)(i, i) * back(i);
    }
    if (filter->metadata().holds == Held::covariance) held = held * back.asDiagonal();
    course.push_back(held);
  }
  return course;
}

Findings measure(const Settings& set) {
  const Index n = 4;
  const double spread = std::round(set("spread"));
  const auto steps = static_cast<std::int64_t>(set("steps"));
  Random random(static_cast<std::uint64_t>(set("seed")));
  const Matrix<double> A = round_to(.5 * random_normal(random, n, n), 18),
                       B = round_to(random_normal(random, n, 2), 18), C = round_to(random_normal(random, 2, n), 18),
                       I = Matrix<double>::Identity(n, n);
  Vector<double> unit(n);
  unit << std::exp2(-spread), 0x1p-13, 0x1p9, std::exp2(spread);
  const Vector<double> back = unit.cwiseInverse(), none = Vector<double>::Ones(n);
  const auto plain = system_of("plain", A, B, C, Matrix<double>::Identity(2, 2), I, steps);
  const auto scaled =
      system_of("scaled", unit.asDiagonal() * A * back.asDiagonal(), unit.asDiagonal() * B, C * back.asDiagonal(),
                Matrix<double>::Identity(2, 2), Matrix<double>(unit.asDiagonal()), steps);

  Findings findings;
  for (const char* id : studied) {
    const auto one = course(id, plain, none), other = course(id, scaled, unit);
    double different = one.size() == other.size() && one.size() == static_cast<std::size_t>(steps) ? 0 : 1;
    for (std::size_t k = 0; k < std::min(one.size(), other.size()); ++k)
      for (Index j = 0; j < n; ++j)
        for (Index i = 0; i < n; ++i) different += one[k](i, j) != other[k](i, j);
    findings.checks.push_back(check_at_most(fmt::format("{}: numbers that differ after scaling back", id), 0, different,
                                            "scaling by powers of two commutes with every rounding"));
  }

  // P in both units: D P D of the first is, by the above, the second, exactly.
  const auto P = course("ckf", plain, none);
  std::vector<double> k, before, after;
  for (std::size_t step = 0; step < P.size(); ++step) {
    const Matrix<double> symmetric = P[step].selfadjointView<Eigen::Lower>();
    k.push_back(static_cast<double>(step + 1));
    before.push_back(properties::Precise(symmetric).condition());
    after.push_back(properties::Precise(unit.asDiagonal() * symmetric * unit.asDiagonal()).condition());
  }
  // k(DPD) lies between k(D)^2 / k(P) and k(D)^2 k(P).
  const double growth = std::log10(after.back() / before.back()), expected = 4 * spread * std::log10(2.);
  findings.checks.push_back(check_within("log10 of the factor by which the units raise k(P)", expected, growth,
                                         2 * std::log10(before.back()) + 1));

  reports::Figure figure;
  figure.id = "units-condition";
  figure.title = fmt::format("Units raise k(P) by {:.0f} decades and change no bit", expected);
  figure.caption = fmt::format(
      "Does an ill-conditioned P cost digits? The states of one random system in units from 2^-{0:g} to 2^{0:g}: k(P) "
      "is as large as it looks, and yet {1} filters compute the same numbers in both units, bit by bit. What costs "
      "digits is k(Re) and the angle of theory (4), which no choice of units changes. Dashed: k(P) in the first units "
      "times 2^{2:g}.",
      spread, studied.size(), 4 * spread);
  figure.x = {"step k", false};
  figure.y = {"condition number of P", true};
  figure.curves.push_back({"plain", "units alike", k, before, reports::CurveRole::measured_line, 0});
  figure.curves.push_back({"scaled", "units far apart", k, after, reports::CurveRole::measured_line, 1});
  std::vector<double> raised;
  for (const double value : before) raised.push_back(value * std::exp2(4 * spread));
  figure.curves.push_back(
      {"theory", fmt::format("units alike x 2^{:g}", 4 * spread), k, raised, reports::CurveRole::theory, -1});
  findings.figures.push_back(std::move(figure));
  return findings;
}

}  // namespace

Claim claim() {
  return {
      .id = "units",
      .number = 29,
      .title = "Units change no bit of the result, whatever they do to the condition number of P",
      .statement =
          "A change of the states' units by powers of two raises k(P) by 48 decades and changes not one bit of what "
          "the conventional and the square-root filters compute, once it is scaled back: k(P) is not the measure of "
          "what a step loses.",
      .source = "derived here, after Verhaegen and Van Dooren (1986), theory (4.1), (4.2): no k(P) occurs there",
      .setup =
          "A random system with n = 4, m = p = 2, and the same with its states multiplied by 2^diag(-40, -13, 9, 40).",
      .prediction = "Bitwise equality of what is held, in every step; k(P) larger by 2^160 = 10^48, within k(P)^2.",
      .meaning =
          "Do not rescale a model for the sake of k(P). Look at the condition number of Re, in the units of the noise.",
      .parameters = {{"spread", 40, "largest power of two of a unit", 14, 40},
                     {"steps", 50, "number of steps", 1, 1000},
                     {"seed", 3, "seed of the random system", 0, 1e15}},
      .measure = measure,
      .mathematics =
          "N = diag(2^-40, 2^-13, 2^9, 2^40):  A -> N A N^{-1},  B -> N B,  C -> C N^{-1}\n"
          "P -> N P N,  S -> N S,  K -> N K,  Re -> Re\n"
          "k(N P N) ~ k(N)^2 k(P),  k(N)^2 = 2^160"};
}

}  // namespace kfstab::experiments::claims::units
