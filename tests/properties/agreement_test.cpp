// Every filter beside the certified reference, and every form beside every other, on ten thousand random systems.

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include <kfstab/filters/chandrasekhar.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/properties/generators.hpp>
#include <kfstab/properties/precise.hpp>
#include <kfstab/reference/bounds.hpp>
#include <kfstab/reference/definiteness.hpp>
#include <kfstab/reference/trajectory.hpp>

namespace kfstab::properties::testing {
namespace {

constexpr int shards = 8, systems_a_shard = 1250;
constexpr double worst_condition = 1e4, threshold = 30;

struct Worst {
  double ratio = 0;
  std::string where;
  void see(double value, double bound, const std::string& at) {
    const double r = value == 0 ? 0 : value / bound;
    if (!(r <= ratio)) {
      ratio = std::isnan(r) ? std::numeric_limits<double>::infinity() : r;
      where = at;
    }
  }
};

double norm2(const Matrix<double>& X) { return X.size() == 0 ? 0 : reference::two_norm(X); }

/// The error bounds of one filter along a run, in units of u (n+m+p): theory (4.1) to (4.4).
class Bounds {
 public:
  Bounds(const Metadata& filter, Dimensions d)
      : filter_(filter), first_order_(filter, d),
        unit_(unit_roundoff<double>() * static_cast<double>(d.n + d.m + d.p)) {}

  /// theta: the largest k(Theta) of csrf so far.
  void advance(const reference::Truth& truth, const Matrix<double>& A, const Matrix<double>& C, double theta) {
    const double before = state_;  // of what the gain is computed from: P_{k|k-1}
    const double re_inverse = truth.innovation.size() == 0 ? 0 : norm2(Precise(truth.innovation).inverse()->rounded());
    const double re = norm2(truth.innovation), k_root = std::sqrt(truth.innovation_condition);
    const bool predictor = filter_.gain == GainKind::predictor;
    const Matrix<double>& K = predictor ? truth.predictor_gain : truth.filter_gain;
    const double gain_size = norm2(K), c = norm2(C), p = norm2(truth.P_predicted);

    // SRCF's bound (4.2) of the gain; (c u / sp) ((s1/sp) |S+| + s1 |G| + |S+| / cos), without A for a filter gain.
    const double s_next = std::sqrt(predictor ? norm2(truth.P_next) : norm2(truth.P_filtered));
    const double cosine = predictor ? truth.cosine : std::min(1.0, s_next / std::max(std::sqrt(p), s_next));
    const double of_root =
        std::sqrt(re_inverse) * ((k_root + 1 / cosine) * s_next + std::sqrt(re) * norm2(K) * std::sqrt(re));

    if (filter_.holds == Held::gain) {
      // What rounding does to Re and G Re^{T/2} = K Re stays there undamped, and so does what it did to L_0 at the start,
      // theory 3; the gain comes of them by the Re of now, which may have become far smaller.
      if (undamped_ == 0) started_ = p + norm2(A) * norm2(A) * p + norm2(truth.P_next);
      undamped_ += theta * re * (1 + norm2(K));
      const double inherited = undamped_ * (1 + norm2(K)) + theta * started_ * c * (norm2(A) + norm2(K) * c);
      gain_ = unit_ * (inherited * re_inverse + theta * of_root);
      held_ = 0;
      return;
    }
    held_ = first_order_.advance(truth);
    const bool filtered = filter_.instant == Instant::filtered;
    if (filtered) {
      const Matrix<double>& P = truth.P_filtered;
      const double now = held_ * P.norm();  // of P_{k|k}, from which the gain is P_{k|k} C' R^{-1}
      const Matrix<double> weight = truth.information.lazyProduct(truth.filter_gain);  // C' R^{-1}
      gain_ = now * norm2(weight) + unit_ * norm2(truth.information) * norm2(P) * gain_size;
      return;
    }
    if (filter_.asymmetry != Asymmetry::none) {
      // An asymmetry takes its own way: at most |F|^2 (i), 2 |A|^2 + |F|^2 (ii), |A|^2 + |KC|^2 (iii to v) a step.
      const double a = norm2(A), f = norm2(truth.closed_loop), kc = norm2(truth.predictor_gain.lazyProduct(C));
      const double growth = filter_.asymmetry == Asymmetry::textbook ? f * f
                            : filter_.asymmetry == Asymmetry::mixed  ? 2 * a * a + f * f
                                                                     : a * a + kc * kc;
      asymmetry_ = growth * asymmetry_ +
                   unit_ * truth.innovation_condition / (truth.cosine * truth.cosine) * norm2(truth.P_next);
      held_ += asymmetry_ / truth.P_next.norm();
    }
    if (filter_.holds == Held::covariance) {
      // (4.1) speaks of P+ and Re as if they came at once; what is rounded are the products they are made of, A P A', C P
      // and C P C', however small A or C let them become. Joseph: I - Kf C is rounded to u (1 + |Kf| |C|), and squared.
      const double a = norm2(A), f = norm2(truth.closed_loop), reduction = 1 + norm2(truth.filter_gain) * c;
      const double kappa = filter_.id == "joseph" ? reduction * reduction : (re + c * c * p) * re_inverse;
      products_ = f * f * products_ + unit_ * a * a * kappa * p;
      held_ += products_ / truth.P_next.norm();
    }
    const double in = predictor ? norm2(A) + norm2(K) * c : 1 + norm2(K) * c;
    // (4.1), and the rounding of the products that the gain is made of, which may cancel in it.
    const double products = (predictor ? norm2(A) : 1) * p * c * re_inverse;
    const double local = holds_root(filter_.holds) ? of_root : truth.innovation_condition * gain_size + products;
    gain_ = in * before * c * re_inverse + unit_ * local;
    state_ = held_ * truth.P_next.norm();
  }

  double held() const { return held_; }      ///< of the relative error of P, Frobenius
  double gain() const { return gain_; }      ///< of the absolute error of the gain

 private:
  const Metadata& filter_;
  reference::FirstOrderBound first_order_;
  double unit_, held_ = 0, gain_ = 0, state_ = 0, asymmetry_ = 0, products_ = 0, undamped_ = 0, started_ = 0;
};

/// How far apart the truths of two parametrisations may be: each number of the one is a number of the other, rounded
/// after a conversion with condition number kappa. To first order dP+ = F dP F' + K dR K' + B dQ B' + dA P_{k|k} A' + its
/// transpose; B, where it is A (A^{-1} B), suffers kappa twice.
class Conversion {
 public:
  Conversion(double kappa, Dimensions d)
      : kappa_(kappa), relative_(kappa * unit_roundoff<double>() * static_cast<double>(d.n + d.m + d.p)) {}

  double advance(const reference::Truth& truth, const RootModel<double>& model) {
    if (bound_ < 0) bound_ = relative_ * norm2(truth.P_predicted);
    const double f = norm2(truth.closed_loop), k = norm2(truth.predictor_gain), r = norm2(model.R_root);
    const double bq = norm2(model.B) * norm2(model.Q_root), a = norm2(model.A);
    bound_ = f * f * bound_ + relative_ * (k * k * r * r + kappa_ * bq * bq + 2 * a * a * norm2(truth.P_filtered));
    return bound_;
  }

 private:
  double kappa_, relative_, bound_ = -1;
};

struct Course {
  AnyProblem<double> problem;
  std::unique_ptr<reference::Trajectory> truth;
};

struct Runner {
  const Metadata& metadata;
  Course& course;
  Bounds bounds;
  std::unique_ptr<AnyFilter<double>> filter;
  std::unique_ptr<ChandrasekharFilter<double>> chandrasekhar;  // for its k(Theta), which AnyFilter has no name for
  double theta = 1;
  bool broken_down = false;
};

class Agreement : public ::testing::TestWithParam<int> {};

TEST_P(Agreement, OfEveryFilterWithTheReference) {
  Options options;
  options.worst_condition = worst_condition;
  options.most_steps = 10;
  options.singular = options.data = options.units = false;
  options.p = {1, 6};
  const auto generator = systems(options);

  std::map<std::string, Worst> of_P, of_K;
  std::map<std::string, int> judged, broken_down;
  Worst conversion;
  int systems_judged = 0;
  for (int number = 0; systems_judged < systems_a_shard; ++number) {
    ASSERT_LT(number, 4 * systems_a_shard) << "too few well-conditioned systems are drawn";
    System system = drawn_system(generator, 1000 + static_cast<std::uint64_t>(GetParam()), number % 1000 + 1, 1001);
    if (number >= 1000) system = drawn_system(generator, 5000 + static_cast<std::uint64_t>(GetParam()), number, 8 * systems_a_shard);
    system.steps = 10;
    const std::string at = "shard " + std::to_string(GetParam()) + " system " + std::to_string(number);

    std::map<Parametrisation, Course> courses;
    for (const auto takes : {Parametrisation::covariance, Parametrisation::root, Parametrisation::information}) {
      auto made = problem(system, takes);
      if (auto* any = std::get_if<AnyProblem<double>>(&made)) courses[takes].problem = std::move(*any);
    }
    ASSERT_EQ(courses.size(), 3u) << at;  // nothing singular is drawn
    for (auto& [takes, course] : courses)
      course.truth = std::make_unique<reference::Trajectory>(course.problem, nullptr, reference::Request{.digits = 20});

    std::vector<Runner> runners;
    for (const Metadata& metadata : filters()) {
      if (refusal(metadata, system)) continue;
      Course& course = courses.at(metadata.takes);
      Runner& r = runners.emplace_back(
          Runner{metadata, course, {metadata, system.dimensions()}, make_filter<double>(metadata.id), nullptr});
      r.filter->start(course.problem);
      if (metadata.holds == Held::gain) {
        const auto& roots = std::get<Problem<RootModel<double>>>(course.problem);
        r.chandrasekhar = std::make_unique<ChandrasekharFilter<double>>(system.dimensions());
        r.chandrasekhar->start(roots.initial, roots.x0);
      }
    }
    Conversion to_covariance(1, system.dimensions()), to_information(worst_condition, system.dimensions());
    bool well_conditioned = true;
    for (std::int64_t k = 0; k < system.steps && well_conditioned; ++k) {
      for (auto& [takes, course] : courses) course.truth->advance();
      const reference::Truth& truth = courses.at(Parametrisation::root).truth->truth();
      well_conditioned = truth.innovation_condition <= worst_condition;
      if (!well_conditioned) break;
      const auto& model = std::get<Problem<RootModel<double>>>(courses.at(Parametrisation::root).problem).model(k);
      const Matrix<double>& P = truth.P_next;
      const std::string when = at + " step " + std::to_string(k);
      conversion.see(norm2(courses.at(Parametrisation::covariance).truth->truth().P_next - P),
                     to_covariance.advance(truth, model), when + ", covariance");
      conversion.see(norm2(courses.at(Parametrisation::information).truth->truth().P_next - P),
                     to_information.advance(truth, model), when + ", information");
      for (Runner& r : runners) {
        if (r.broken_down) continue;
        if (r.chandrasekhar) {
          r.chandrasekhar->step(model);
          r.theta = std::max(r.theta, r.chandrasekhar->rotation_condition());
        }
        const reference::Truth& own = r.course.truth->truth();
        r.bounds.advance(own, model.A, model.C, r.theta);
        const Step<double> step = r.filter->step(k, nullptr, nullptr);
        const std::string id(r.metadata.id);
        if (!step.report) {
          // It may break down only where its bound says that no digit of what it holds need be right.
          EXPECT_GE(threshold * std::max(r.bounds.held(), r.bounds.gain() / own.filter_gain.norm()), 1)
              << at << " step " << k << " " << id << ": " << name(step.report.status);
          r.broken_down = true;
          ++broken_down[id];
          continue;
        }
        const auto errors = r.course.truth->measure(r.metadata, step);
        const std::string here = at + " step " + std::to_string(k);
        if (step.held) of_P[id].see(errors.covariance, r.bounds.held(), here);
        const Matrix<double>& K = r.metadata.gain == GainKind::predictor ? own.predictor_gain : own.filter_gain;
        of_K[id].see(errors.gain * K.norm(), r.bounds.gain(), here);
        ++judged[id];
      }
    }
    systems_judged += well_conditioned;
  }
  // With this, what agrees with its own truth agrees with every other form.
  EXPECT_LE(conversion.ratio, threshold) << conversion.where;
  std::printf("  parametrisations: worst ratio %8.3g\n", conversion.ratio);
  for (const Metadata& metadata : filters()) {
    const std::string id(metadata.id);
    EXPECT_GE(judged[id], systems_a_shard) << id << " was hardly ever judged";
    if (metadata.holds != Held::gain) {
      EXPECT_LE(of_P[id].ratio, threshold) << id << ", P: " << of_P[id].where;
    }
    EXPECT_LE(of_K[id].ratio, threshold) << id << ", gain: " << of_K[id].where;
    std::printf("  %-16s %7d steps, %4d breakdowns, worst ratio: P %8.3g  gain %8.3g\n", id.c_str(), judged[id],
                broken_down[id], of_P[id].ratio, of_K[id].ratio);
  }
}

INSTANTIATE_TEST_SUITE_P(Shards, Agreement, ::testing::Range(0, shards));

}  // namespace
}  // namespace kfstab::properties::testing
