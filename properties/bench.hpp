#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <vector>

#include <kfstab/properties/subject.hpp>
#include <kfstab/reference/trajectory.hpp>

/// Where a subject is tried: its runs, and what was true of them, each computed once however many laws ask.
namespace kfstab::properties {

struct ObservedStep;  // law.hpp

/// What was true of a system's steps, in the numbers that a subject is given, and how far from it rounding excuses the
/// subject to be. Truths are certified (reference/trajectory.hpp).
class Course {
 public:
  /// What the subject's answer k is to be compared with. All n x n, n x p, n.
  const Matrix<double>& P(std::int64_t k) const;
  const Matrix<double>& K(
      std::int64_t k) const;  ///< the gain that the subject answers; the predictor's if it answers none
  const Vector<double>& x(std::int64_t k) const;  ///< empty without data
  const reference::Truth& truth(std::int64_t k) const { return truths_[static_cast<std::size_t>(k + offset_)]; }
  /// How many answers there are truths for: all, unless the reference could not go on.
  std::int64_t steps() const { return static_cast<std::int64_t>(truths_.size()) - offset_; }

  /// First-order bounds of the errors of answer k, absolute, in Frobenius norms: what each step commits by the tolerance of
  /// law one-step (of forms that hold P^{-1}, reference/bounds.hpp), carried on by F; u (n + m + p) their constant.
  double P_bound(std::int64_t k) const { return bounds_[index(k)].P; }
  double K_bound(std::int64_t k) const { return bounds_[index(k)].K; }
  double x_bound(std::int64_t k) const { return bounds_[index(k)].x; }

 private:
  friend class Bench;
  struct Bounds {
    double P, K, x;
  };
  std::size_t index(std::int64_t k) const { return static_cast<std::size_t>(k + offset_); }

  Instant instant_ = Instant::predicted;
  GainKind gain_ = GainKind::predictor;
  std::int64_t offset_ = 0;  ///< a filter that starts from k|k has its first answer after the second step of its course
  std::vector<reference::Truth> truths_;
  std::vector<Bounds> bounds_;
};

/// Truths that several subjects share.
class Truths {
 public:
  struct Entry {
    System system;
    Parametrisation takes;
    std::shared_ptr<const std::vector<reference::Truth>> truths;
  };
  /// As many as the reference has answers for.
  std::shared_ptr<const std::vector<reference::Truth>> of(const System& system, Parametrisation takes);
  void forget() { entries_.clear(); }

 private:
  std::vector<Entry> entries_;
};

class Bench {
 public:
  /// Both must outlive the bench.
  Bench(Subject& subject, Truths& truths) : subject_(subject), truths_(truths) {}

  const Traits& traits() const { return subject_.traits(); }
  std::size_t at_once() const { return subject_.at_once(); }

  /// The subject's run of the system: the one that was asked for before, or a new one. Valid until forget().
  const Run& run(const System& system);
  /// A new run, whatever was run before, at once with those beside it.
  Run rerun(const System& system, const std::vector<System>& beside = {});
  /// Runs these systems at once: asked for one of them later, run() has it already, forget() or not.
  void run_ahead(const std::vector<System>& systems);
  /// What was true, and how precise answers can be. Valid until forget().
  const Course& course(const System& system);

  /// The subject's steps so far.
  std::int64_t steps() const { return steps_; }
  /// Drops what has been run: the next system is another.
  void forget();

 private:
  friend const std::vector<ObservedStep>& observed_steps(Bench& bench, const System& system);

  Subject& subject_;
  Truths& truths_;
  std::vector<std::unique_ptr<Run>> runs_;
  std::vector<Run> ahead_;  ///< those that were not asked for yet
  std::map<const Run*, std::shared_ptr<const std::vector<ObservedStep>>> observed_;
  std::vector<std::pair<System, std::unique_ptr<Course>>> courses_;
  std::int64_t steps_ = 0;
};

/// The gain by which an innovation moves the answered x, as large as it counts for rounding, and its error: of K, A Kf or Kf.
/// What updates before it predicts makes Kf and then A Kf, which may be far smaller than either: there |A| |Kf|.
struct GainOfState {
  double size, error;
};
/// @param A  its norm    @param K_error  of the gain that is answered, absolute
GainOfState gain_of_state(Instant instant, GainKind answered, const reference::Truth& truth, double A, double K_error);

/// Whether the subject whitens the measurements, with R^{-1/2}: it holds a root, and needs an R that is positive definite. Then C
/// and y are to it as if they were off by k(R^{1/2}) u.
bool whitens(const Traits& subject);

/// Whether two systems are the same numbers: model, initial condition, steps and data. What they are called is no matter.
bool same_numbers(const System& a, const System& b);

/// The system whose filtered quantities at step k + 1 are those that a filter which starts from k|k and predicts first has
/// after its step k: a step without measurement before all others.
System delayed(const System& system);

}  // namespace kfstab::properties
