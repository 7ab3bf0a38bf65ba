#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include <fmt/core.h>

#include <kfstab/experiments/claim.hpp>
#include <kfstab/experiments/constants.hpp>
#include <kfstab/experiments/curves.hpp>
#include <kfstab/experiments/fit.hpp>
#include <kfstab/experiments/interruption.hpp>
#include <kfstab/experiments/models.hpp>
#include <kfstab/experiments/perturbation.hpp>
#include <kfstab/properties/precise.hpp>
#include <kfstab/reference/steady_state.hpp>

namespace kfstab::experiments::claims::forgetting {
namespace {

constexpr double criterion = .01;
/// Windows, relative to P: beneath, the rounding of the two runs counts.
constexpr double eigenvector_floor = 1e-11, any_floor = 1e-10;

/// A real eigenpair of largest modulus, by the power method; nothing if it does not converge.
struct Eigenpair {
  double value;
  Vector<double> vector;
};
std::optional<Eigenpair> dominant_eigenpair(const Matrix<double>& X) {
  Vector<double> v = Vector<double>::Ones(X.rows());
  for (int i = 0; i < 4096; ++i) v = (X * v).normalized();
  const double value = v.dot(X * v);
  if (!((X * v - value * v).norm() <= 1e-13 * std::abs(value))) return std::nullopt;
  return Eigenpair{value, v};
}

/// A random system at its steady state, whose closed loop has a real dominant eigenvalue of modulus .4 to .9.
struct SteadySystem {
  properties::System system;
  reference::SteadyState limit;
  Eigenpair pair;
};
std::optional<SteadySystem> draw(Random& random, Dimensions dimensions, double radius, std::int64_t steps) {
  for (int attempt = 0; attempt < 100; ++attempt) {
    auto system = random_system(random, dimensions, radius, steps);
    auto limit = reference::steady_state(problem_of(system, Parametrisation::covariance));
    const auto pair = dominant_eigenpair(limit.closed_loop);
    if (!pair || !(std::abs(pair->value) > .4 && std::abs(pair->value) < .9)) continue;
    const Matrix<double> P = (limit.P + limit.P.transpose()) / 2;
    system.P0 = {properties::Covariance::Written::covariance, P};
    return SteadySystem{std::move(system), std::move(limit), *pair};
  }
  return std::nullopt;
}

/// Sizes of a difference, relative to that after the first step, while they are above the floor and known to a fifth of
/// the criterion: the factor of a step is a quotient of two.
std::vector<double> decay(std::vector<double> sizes, double floor) {
  const double lowest = std::max(floor, 10 / criterion * noise(sizes)), first = sizes.front();
  std::vector<double> curve;
  for (const double size : sizes) {
    if (!(size > lowest)) break;
    curve.push_back(size / first);
  }
  return curve;
}

/// The factor of each step over the predicted one: the largest distance from 1; NaN for a curve of fewer than 4 points.
double worst_distance(const std::vector<double>& curve, double factor) {
  double worst = curve.size() < 4 ? NaN : 0;
  for (std::size_t k = 1; k < curve.size(); ++k)
    worst = std::max(worst, std::abs(curve[k] / curve[k - 1] / factor - 1));
  return worst;
}

/// 1, factor, factor^2 ... down to low.
reports::Curve powers(const std::string& id, const std::string& label, double factor, double low) {
  auto line = theory_line(id, label);
  for (double y = 1; y > low; y *= factor) add_point(line, static_cast<double>(line.x.size()), y);
  return line;
}

/// Every fourth point, so that curves which lie upon one another do not hide.
reports::Curve every_fourth(std::size_t first, const std::string& id, const std::string& label,
                            const std::vector<double>& y, const std::string& filter) {
  auto curve = measured_points(id, label, filter);
  for (std::size_t k = first; k < y.size(); k += 4) add_point(curve, static_cast<double>(k), y[k]);
  return curve;
}

Findings measure(const Settings& set) {
  const int systems = static_cast<int>(set("systems"));
  const auto n = static_cast<Index>(set("n")), p = static_cast<Index>(set("p"));
  const std::int64_t steps = 160;
  Random random(static_cast<std::uint64_t>(set("seed")));
  const auto filters = forgetful_filters();

  reports::Figure eigen;
  eigen.id = "forgetting-eigenvector";
  eigen.title = "P and K forget by lambda^2 a step, x by lambda";
  eigen.caption =
      "How fast does a filter in steady state forget an error? Points: the difference of two runs of one filter, one "
      "of which starts from P + dP, dP along the dominant eigenvector of F = A - K C (or from x + dx), relative to "
      "that after the first step. Dashed: powers of lambda^2 and of lambda, nothing fitted. The first of the random "
      "systems.";
  eigen.x = {"steps since the first", false};
  eigen.y = {"size of the error, relative to the first step's", true};

  reports::Figure any;
  any.id = "forgetting-any-error";
  any.title = "Any error of P goes by the closed loop, transients included";
  any.caption =
      "Does the product of the closed loops predict what becomes of any error of P? Points: ||dP_k|| of filters that "
      "hold P, S or T, for a random, small dP; dashed: ||Phi dP Phi'||, Phi the product of F = A - K C (or, for "
      "srif, which shows P_{k|k}, that of (I - Kf C) A), nothing fitted. The first of the random systems.";
  any.x = {"step k", false};
  any.y = {"||dP_k|| / ||dP||", true};

  std::map<std::string_view, double> along, anywhere;
  for (const Metadata* filter : filters) along[filter->id] = anywhere[filter->id] = 0;
  bool enough = true;
  for (int s = 0; s < systems && going_on(); ++s) {
    const auto drawn = draw(random, {n, 2, p}, set("rho"), steps);
    if (!drawn) {
      enough = false;
      break;
    }
    const double size = drawn->limit.P.norm(), lambda = drawn->pair.value, squared = lambda * lambda;
    const Vector<double>& v = drawn->pair.vector;
    const Matrix<double> dP = 1e-4 * size * v * v.transpose();
    const Matrix<double> y = random_normal(random, p, steps);
    for (const Metadata* filter : filters) {
      const auto of_P = deviations(*filter, drawn->system, (dP + dP.transpose()) / 2, {}, {});
      std::vector<double> gain_sizes, x_sizes;
      for (const Deviation& deviation : of_P) gain_sizes.push_back(deviation.gain.norm());
      const auto P = decay(sizes_of_P(of_P), eigenvector_floor * size);
      const auto gain = decay(gain_sizes, eigenvector_floor * drawn->limit.predictor_gain.norm());
      const auto of_x = deviations(*filter, drawn->system, {}, v, y);
      for (const Deviation& deviation : of_x) x_sizes.push_back(deviation.x.norm());
      const auto x = decay(x_sizes, eigenvector_floor);
      keep_worst(along[filter->id], worst_distance(P, squared));
      keep_worst(along[filter->id], worst_distance(gain, squared));
      keep_worst(along[filter->id], worst_distance(x, std::abs(lambda)));
      if (s > 0) continue;
      const std::string id(filter->id);
      if (id == "ckf") eigen.curves.push_back(every_fourth(0, "P-ckf", "P, ckf", P, id));
      if (id == "joseph") eigen.curves.push_back(every_fourth(1, "K-joseph", "K, joseph", gain, id));
      if (id == "srif") eigen.curves.push_back(every_fourth(2, "P-srif", "P, srif", P, id));
      if (id == "svd") eigen.curves.push_back(every_fourth(3, "K-svd", "K, svd", gain, id));
      if (id == "srcf") eigen.curves.push_back(every_fourth(0, "x-srcf", "x, srcf", x, id));
    }
    if (s == 0) {
      eigen.curves.push_back(powers("theory-1", fmt::format("theory: |lambda|^k, |lambda| = {:.3f}", std::abs(lambda)),
                                    std::abs(lambda), eigenvector_floor));
      eigen.curves.push_back(powers("theory-2", "theory: lambda^2k", squared, 1e-7));
    }

    // An error in every direction, small in the unit that counts: it becomes, exactly, Phi dP (I + W dP)^{-1} Phi',
    // with W the sum of Phi_j' C' Re^{-1} C Phi_j, so that for dP >= 0 the product of the closed loops is off by ||W||
    // ||dP|| at most.
    const auto Phi = transitions(drawn->system);
    const Matrix<double>& C = drawn->system.C.matrices.front();
    const Matrix<double> Re = Matrix<double>::Identity(p, p) + carried(C, drawn->limit.P, C);
    const Matrix<double> Re_inverse = properties::Precise(Re).inverse()->rounded();
    Matrix<double> W = carried(C.transpose(), Re_inverse, C.transpose());
    for (const Matrix<double>& T : Phi.predicted) {
      const Matrix<double> CT = C * T;
      W += carried(CT.transpose(), Re_inverse, CT.transpose());
    }
    const Matrix<double> X = random_normal(random, n, n);
    Matrix<double> random_error = X * X.transpose();
    random_error *= 1e-3 / (W.norm() * random_error.norm());
    for (const Metadata* filter : filters) {
      const auto measured = deviations(*filter, drawn->system, random_error, {}, {});
      const double floor = std::max(any_floor * size, 5 / criterion * noise(sizes_of_P(measured)));
      const std::string id(filter->id);
      auto curve = measured_points(id, id, id);
      auto line = theory_line("theory-" + id, id == "srif" ? "theory, P_{k|k}" : "theory, P_{k+1|k}");
      for (std::size_t k = 0; k < measured.size(); ++k) {
        const auto& T = Phi.of(filter->instant)[k];
        const Matrix<double> predicted = carried(T, random_error, T);
        if (!(predicted.norm() > floor)) break;
        keep_worst(anywhere[filter->id], (measured[k].P - predicted).norm() / predicted.norm());
        add_point(curve, static_cast<double>(k), measured[k].P.norm() / random_error.norm());
        add_point(line, static_cast<double>(k), predicted.norm() / random_error.norm());
      }
      if (curve.x.size() < 2) anywhere[filter->id] = NaN;  // nothing that could be told from rounding
      if (s > 0 || !(id == "ckf" || id == "srcf" || id == "srif")) continue;
      any.curves.push_back(std::move(curve));
      if (id != "ckf") any.curves.push_back(std::move(line));
    }
  }

  Findings findings;
  for (const Metadata* filter : filters)
    findings.checks.push_back(check_at_most(
        fmt::format("{}, {} systems: factor a step of P and K over lambda^2, of x over |lambda|, worst distance from 1",
                    filter->id, systems),
        criterion, enough ? along[filter->id] : NaN,
        "theory (3.1)-(3.3); what is left is of second order in dP, and rounding"));
  for (const Metadata* filter : filters)
    findings.checks.push_back(check_at_most(
        fmt::format("{}, {} systems: worst distance of any dP_k from Phi dP_0 Phi', relative", filter->id, systems),
        criterion, enough ? anywhere[filter->id] : NaN,
        "theory (3.4), (3.5); dP_0 > 0, so within ||W|| ||dP_0|| = 1e-3, and rounding"));
  findings.figures = {std::move(eigen), std::move(any)};
  return findings;
}

}  // namespace

Claim claim() {
  return {
      .id = "forgetting",
      .number = 1,
      .title = "An error is forgotten at the filter's own pace",
      .statement =
          "In steady state an error along an eigenvector of F = A - K C shrinks by lambda^2 a step in P and K and by "
          "lambda in x, and any error of P by the products of the closed loops: alike in every form that holds P and "
          "keeps it symmetric, or a root of P or of its inverse.",
      .source = "derived here, after Verhaegen and Van Dooren (1986), theory (3.1)-(3.5)",
      .setup =
          "Random systems, n = 4, m = p = 2, R = I, rho(A) = 1.1, started from their steady state, those with a real "
          "dominant eigenvalue of F, .4 < |lambda| < .9. Two runs of one filter: from P and P + 1e-4 |P| v v' (from "
          "x and x + v), Fv = lambda v; and from P and P + dP, dP random and positive definite, ||dP|| = 1e-3 / "
          "||W||, W = sum of F^j' C' Re^-1 C F^j. Compared while the difference exceeds 1e-11 (1e-10) of P and is "
          "known to a fifth of the criterion, by what rounding has left of it after 160 steps.",
      .prediction = "Factors lambda^2, lambda^2 and |lambda| within 1 % at every step; dP_k = Phi dP Phi' within 1 %.",
      .meaning =
          "What rounding did long ago does not matter, in whichever of these forms: the slower the filter forgets "
          "its data, the slower it forgets its errors.",
      .parameters = {{"rho", 1.1, "spectral radius of A", .5, 1.5},
                     {"n", 4, "number of states", 2, 8},
                     {"p", 2, "number of outputs", 1, 4},
                     {"systems", 20, "number of random systems", 1, 1000},
                     {"seed", 1, "seed of the random systems", 0, 1e15}},
      .measure = measure,
      .mathematics =
          "dP+ = F dP F',  dK = F dP C' Re^{-1}\n"
          "dx+ = F dx + dK (y - C x)\n"
          "F v = lambda v:  dP+ = lambda^2 dP  for dP = v v',  dx+ = lambda dx  for dx = v\n"
          "dP_k = Phi dP_0 Phi',  Phi = F_{k-1} ... F_1 F_0"};
}

}  // namespace kfstab::experiments::claims::forgetting
