#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <tuple>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/ladder.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/filters/chandrasekhar.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/filters/square_root_covariance.hpp>
#include <kfstab/properties/precise.hpp>
#include <kfstab/reference/steady_state.hpp>

namespace kfstab::experiments::claims::chandrasekhar_memory {
namespace {

using Chandrasekhar = ChandrasekharFilter<double>;
using SquareRoot = SquareRootCovarianceFilter<double>;
using Roots = Problem<RootModel<double>>;

constexpr double disturbance = 1e-6;
constexpr int disturbed_at = 5, early = 50, late = 299;

/// A random system whose filter forgets: rho(F) <= .9.
struct Drawn {
  properties::System system;
  RootModel<double> model;
  reference::SteadyState limit;
};
std::optional<Drawn> draw(Random& random, Dimensions dimensions, double radius) {
  for (int attempt = 0; attempt < 1000; ++attempt) {
    auto system = random_system(random, dimensions, radius, 1);
    auto limit = reference::steady_state(problem_of(system, Parametrisation::covariance));
    if (!(limit.spectral_radius <= .9)) continue;
    auto model = std::get<Roots>(problem_of(system, Parametrisation::root)).models.front();
    return Drawn{std::move(system), std::move(model), std::move(limit)};
  }
  return std::nullopt;
}

/// X with a random relative error in Frobenius norm.
Matrix<double> disturbed(Random& random, const Matrix<double>& X) {
  Matrix<double> E = random_normal(random, X.rows(), X.cols());
  return X + E * (disturbance * X.norm() / E.norm());
}

/// ||dK|| / ||K|| of step k = disturbed_at ... late, for a pair of filters of which one was disturbed; NaN from a
/// breakdown on.
template <class Filter>
std::vector<double> gain_differences(Filter one, Filter other, const RootModel<double>& model, double& moved) {
  std::vector<double> sizes;
  Matrix<double> at_early;
  for (int k = disturbed_at; k <= late; ++k) {
    const bool both = one.step(model) && other.step(model);
    const Matrix<double> dK = other.predictor_gain() - one.predictor_gain();
    sizes.push_back(both ? dK.norm() / one.predictor_gain().norm() : NaN);
    if (k == early) at_early = dK;
    if (k == late) moved = both ? (dK - at_early).norm() / at_early.norm() : NaN;
  }
  return sizes;
}

/// (a) and (c): P0 = 0, one disturbance.
void one_disturbance(const Settings& set, Findings& findings) {
  const int systems = static_cast<int>(set("systems"));
  const Dimensions d{static_cast<Index>(set("n")), 2, static_cast<Index>(set("p"))};
  Random random(static_cast<std::uint64_t>(set("seed")));
  const Vector<double> x0 = Vector<double>::Zero(d.n);
  reports::Figure figure;
  figure.id = "chandrasekhar-memory-disturbance";
  figure.title = "The Chandrasekhar filter remembers a disturbance for ever";
  figure.caption =
      "How long does a filter remember a relative disturbance of 1e-6 in what it holds, at step 5? Difference of the "
      "gains of two runs, one of them disturbed: in the Chandrasekhar filter it settles and stays, whether G or "
      "Re^(1/2) was hit; the square-root covariance filter forgets it by rho(F)^2 a step (dashed) down to rounding. "
      "The first of the random systems.";
  figure.x = {"step k", false};
  figure.y = {"||dK_k|| / ||K_k||", true};

  double of_G = 0, of_Re = 0, forgotten = 0, constancy = 0, of_E_R = 0;
  for (int s = 0; s < systems && going_on(); ++s) {
    const auto drawn = draw(random, d, set("rho"));
    if (!drawn) {
      of_G = of_Re = forgotten = constancy = of_E_R = NaN;
      break;
    }
    const auto& model = drawn->model;
    Chandrasekhar filter(d);
    filter.start(Matrix<double>::Zero(d.n, d.n), x0);
    SquareRoot root(d);
    root.start(Matrix<double>::Zero(d.n, d.n), x0);
    // Pbar_k = P0 + sum of L Sig L': L_0 = B Q^{1/2}, and the filter's own from then on.
    const Matrix<double> B = drawn->system.B.matrices.front();
    Matrix<double> Pbar = B * B.transpose();
    const auto increment = [](const Chandrasekhar& f) {
      const Matrix<double> L = f.increment();
      Matrix<double> signed_L = L;
      signed_L.rightCols(f.decreasing()) *= -1;
      return Matrix<double>(signed_L * L.transpose());
    };
    for (int k = 0; k < disturbed_at; ++k) {
      if (k > 0) Pbar += increment(filter);
      filter.step(model);
      root.step(model);
    }

    const Matrix<double> Re_root = filter.innovation_root(), G = filter.normalised_gain(), L = filter.increment();
    Chandrasekhar with_G(d), with_Re(d);
    with_G.start(Re_root, disturbed(random, G), L, filter.growing(), x0);
    with_Re.start(disturbed(random, Re_root).triangularView<Eigen::Lower>().toDenseMatrix(), G, L, filter.growing(),
                  x0);
    SquareRoot with_S(d);
    with_S.start(disturbed(random, root.factor()), x0);

    double moved = NaN, moved_Re = NaN, unused = 0;
    const auto dK_G = gain_differences(filter, with_G, model, moved);
    const auto dK_Re = gain_differences(filter, with_Re, model, moved_Re);
    const auto dK_S = gain_differences(root, with_S, model, unused);
    keep_worst(of_G, moved);
    keep_worst(of_Re, moved_Re);
    keep_worst(forgotten, dK_S.back());

    // E_G and E_R of the run whose G was disturbed.
    double first_E_G = NaN;
    Pbar += increment(with_G);
    for (int k = disturbed_at + 1; k <= late; ++k) {
      with_G.step(model);
      const Matrix<double>&Re = with_G.innovation_root(), &A = model.A, &C = model.C;
      const Matrix<double> CP = C * Pbar;
      const double E_G = (with_G.normalised_gain() * Re.transpose() - A * CP.transpose()).norm();
      const Matrix<double> exact_Re = model.R_root * model.R_root.transpose() + CP * C.transpose();
      if (k == disturbed_at + 1) first_E_G = E_G;
      keep_worst(constancy, std::abs(E_G / first_E_G - 1));
      const double unit = u * static_cast<double>(d.n + d.m + d.p) * k;
      keep_worst(of_E_R, (Re * Re.transpose() - exact_Re).norm() / exact_Re.norm() / unit);
      Pbar += increment(with_G);
    }
    if (s > 0) continue;
    for (const auto& [label, id, curve] : {std::tuple{"csrf, G disturbed", "csrf", &dK_G},
                                           {"csrf, Re^(1/2) disturbed", "srcf-hessenberg", &dK_Re},
                                           {"srcf, S disturbed", "srcf", &dK_S}}) {
      auto points = measured_points(fmt::format("{}-{}", id, figure.curves.size()), label, id);
      points.role = reports::CurveRole::measured_line;
      for (const double value : *curve)
        add_point(points, static_cast<double>(disturbed_at) + static_cast<double>(points.x.size()), value);
      figure.curves.push_back(std::move(points));
    }
    auto line = theory_line("theory", fmt::format("theory: {:.3f}^2k", drawn->limit.spectral_radius));
    for (double k = disturbed_at, y = dK_S.front(); y > 1e-17 && k <= late;
         ++k, y *= std::pow(drawn->limit.spectral_radius, 2))
      add_point(line, k, y);
    figure.curves.push_back(std::move(line));
  }
  findings.figures.push_back(std::move(figure));
  const std::string of = fmt::format(", {} systems", systems);
  findings.checks.push_back(
      check_at_most("csrf, G disturbed" + of + ": change of dK from step 50 to 299, relative", 1e-3, of_G,
                    "an error of the arrays is conserved; what still moves at step 50 is below rho(F)^90"));
  findings.checks.push_back(check_at_most(
      "csrf, Re^(1/2) disturbed" + of + ": change of dK from step 50 to 299, relative", 1e-3, of_Re, "as for G"));
  findings.checks.push_back(check_at_most("srcf, S disturbed" + of + ": dK at step 299, relative to K", 1e-12,
                                          forgotten, "a millionth of the disturbance: forgotten"));
  findings.checks.push_back(check_at_most("csrf, G disturbed" + of + ": worst change of ||E_G|| since step 6, relative",
                                          1e-6, constancy, "conserved; rounding is u over the disturbance of 1e-6"));
  findings.checks.push_back(check_at_most("csrf, G disturbed" + of + ": worst ||E_R|| over u (n+m+p) k ||Re||", 30,
                                          of_E_R, "rounding level, added up over k steps"));
}

/// (b): P0 = a I.
void large_prior(const Settings& set, Findings& findings) {
  const int systems = static_cast<int>(set("systems"));
  const Dimensions d{static_cast<Index>(set("n")), 2, static_cast<Index>(set("p"))};
  const auto steps = static_cast<std::int64_t>(set("steps"));
  Random random(static_cast<std::uint64_t>(set("seed")) + 1);
  Ladder csrf;
  std::map<std::string, Ladder> others;
  double worst = 0;
  for (int s = 0; s < systems && going_on(); ++s) {
    const auto drawn = draw(random, d, set("rho"));
    if (!drawn) {
      worst = NaN;
      break;
    }
    const auto& K = drawn->limit.predictor_gain;
    const Matrix<double>& A = drawn->system.A.matrices.front();
    const Matrix<double>& C = drawn->system.C.matrices.front();
    const Matrix<double> Re = Matrix<double>::Identity(d.p, d.p) + C * drawn->limit.P * C.transpose();
    const double k_Re = properties::Precise(Re).condition();
    for (std::size_t rung = 0; rung <= 5; ++rung) {
      const double a = std::pow(100., static_cast<double>(rung) + 1);
      auto system = drawn->system;
      system.P0.value = Matrix<double>(std::sqrt(a) * Matrix<double>::Identity(d.n, d.n));
      for (const char* id : {"csrf", "srcf", "ckf"}) {
        const auto filter = make_filter<double>(id);
        const auto problem = problem_of(system, filter->metadata().takes);
        filter->start(problem);
        double error = infinity;
        for (std::int64_t k = 0; k < steps; ++k) {
          const auto step = filter->step(k, nullptr, nullptr);
          if (!step.report) break;
          if (k < steps - 1) continue;
          const bool predictor = filter->metadata().gain == GainKind::predictor;
          error = ((predictor ? *step.gain : Matrix<double>(A * *step.gain)) - K).norm() / K.norm();
        }
        if (std::string_view(id) == "csrf") {
          csrf.add(rung, a, error);
          continue;
        }
        others[id].add(rung, a, error);
        const double unit = u * static_cast<double>(d.n + d.m + d.p);
        keep_worst(worst, error * (1 - std::pow(drawn->limit.spectral_radius, 2)) / (unit * k_Re));
      }
    }
  }
  const std::string of = fmt::format(", {} systems", systems);
  findings.checks.push_back(
      check_slope("csrf" + of + ": slope of the final error of K in the prior", 1, csrf.power(1e-14, .05), .15));
  findings.checks.push_back(
      check_at_most("srcf and ckf" + of + ": worst final error of K over u (n+m+p) k(Re) / (1 - rho(F)^2)", 30, worst,
                    "the prior is forgotten, and its rounding with it"));

  reports::Figure figure;
  figure.id = "chandrasekhar-memory-prior";
  figure.title = "The Chandrasekhar filter's gain loses the size of the prior";
  figure.caption = fmt::format(
      "What is left of the prior P0 = a I after {} steps, when every filter has forgotten it? The rounding that the "
      "first steps committed at the size of a stays in the Chandrasekhar filter's gain for ever (dashed: u a, the "
      "height of theory but for a constant). Medians of {} random systems, thin lines the quartiles.",
      steps, systems);
  figure.x = {"size a of the prior", true};
  figure.y = {"relative error of K at the end", true};
  add_curves(figure, csrf, "csrf");
  for (const auto& [id, ladder] : others) add_curves(figure, ladder, id);
  auto line = theory_line("theory", "theory: u a");
  for (const double a : csrf.difficulties()) add_point(line, a, u * a);
  figure.curves.push_back(std::move(line));
  findings.figures.push_back(std::move(figure));
}

Findings measure(const Settings& set) {
  Findings findings;
  one_disturbance(set, findings);
  large_prior(set, findings);
  return findings;
}

}  // namespace

Claim claim() {
  return {
      .id = "chandrasekhar-memory",
      .number = 7,
      .title = "The Chandrasekhar recursion forgets no error",
      .statement =
          "What rounding, or a disturbance, does to G or Re^(1/2) of the Chandrasekhar recursion stays there for "
          "ever, while a filter that holds S or P forgets it; so its final gain loses the size of the prior.",
      .source = "derived here, after Verhaegen and Van Dooren (1986), theory (2.5)",
      .setup =
          "Random systems, n = 4, m = p = 2, R = I, rho(A) = .95, those with rho(F) <= .9. P0 = 0, a relative "
          "disturbance of 1e-6 of G or Re^(1/2) (of S in srcf) at step 5; and P0 = a I, a = 1e2 ... 1e12, 400 steps.",
      .prediction =
          "dK at step 299 that of step 50 within 1e-3, ||E_G|| constant within 1e-6 and E_R at rounding level, E_R = "
          "Re - R - C Pbar C', E_G = G Re^(T/2) - A Pbar C', Pbar = P0 + sum L Sig L'; forgotten in srcf. Slope 1 "
          "(within .15) of the final error of K in a; rounding level in srcf and ckf.",
      .meaning =
          "It is cheap where it is exact at the start (P0 = 0). Do not start it from a vague prior, and do not run "
          "it for years.",
      .parameters = {{"rho", .95, "spectral radius of A", .1, 1.5},
                     {"n", 4, "number of states", 2, 8},
                     {"p", 2, "number of outputs", 1, 4},
                     {"steps", 400, "steps from P0 = a I", 300, 10000},
                     {"systems", 20, "number of random systems", 3, 1000},
                     {"seed", 1, "seed of the random systems", 0, 1e15}},
      .measure = measure,
      .mathematics =
          "P_{k+1} = P_k + L_k Sig L_k',  Sig = diag(I, -I)\n"
          "[Re_k^{1/2}, C L_k; G_k, A L_k] Theta = [Re_{k+1}^{1/2}, 0; G_{k+1}, L_{k+1}],  K_k = G_k Re_k^{-1/2}\n"
          "E_{R,k} = Re_k - R - C P_k C',  E_{G,k} = G_k Re_k^{T/2} - A P_k C'\n"
          "E_{R,k+1} = E_{R,k},  E_{G,k+1} = E_{G,k}"};
}

}  // namespace kfstab::experiments::claims::chandrasekhar_memory
