#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <set>

#include <kfstab/experiments/fingerprint.hpp>
#include <kfstab/filters/registry.hpp>
#include <kfstab/reference/bounds.hpp>

namespace kfstab::experiments {
namespace {

using properties::Answer;
using properties::Ending;

/// What filters are alike in: what they hold, and whether they forget.
enum class Kind { covariance, root, information, memory };

Kind kind_of(const Metadata& metadata) {
  if (metadata.holds == Held::gain) return Kind::memory;
  if (holds_root(metadata.holds)) return Kind::root;
  return metadata.holds == Held::covariance ? Kind::covariance : Kind::information;
}

Fingerprint fingerprint_of(std::string_view id) { return *fingerprint(*properties::built_in(id)); }

std::set<std::string> names(const std::vector<const Metadata*>& filters) {
  std::set<std::string> result;
  for (const Metadata* one : filters) result.emplace(one->id);
  return result;
}

// --- filters of others --------------------------------------------------------------------------------------------------

template <class Scalar>
Matrix<Scalar> inverse(Matrix<Scalar> X) {
  const Index n = X.rows();
  Matrix<Scalar> Y = Matrix<Scalar>::Identity(n, n);
  for (Index i = 0; i < n; ++i) {
    Index pivot = i;
    for (Index j = i + 1; j < n; ++j)
      if (std::abs(X(j, i)) > std::abs(X(pivot, i))) pivot = j;
    X.row(i).swap(X.row(pivot));
    Y.row(i).swap(Y.row(pivot));
    const Scalar by = X(i, i);
    X.row(i) /= by;
    Y.row(i) /= by;
    for (Index j = 0; j < n; ++j) {
      if (j == i) continue;
      const Scalar factor = X(j, i);
      X.row(j) -= factor * X.row(i);
      Y.row(j) -= factor * Y.row(i);
    }
  }
  return Y;
}

/// Lower L with LL' = XX', by Gram and Schmidt on the rows of X.
Matrix<double> lower_of(Matrix<double> X) {
  const Index n = X.rows();
  Matrix<double> L = Matrix<double>::Zero(n, n);
  for (Index i = 0; i < n; ++i) {
    L(i, i) = X.row(i).norm();
    if (L(i, i) > 0) X.row(i) /= L(i, i);
    for (Index j = i + 1; j < n; ++j) {
      L(j, i) = X.row(j).dot(X.row(i));
      X.row(j) -= L(j, i) * X.row(i);
    }
  }
  return L;
}

/// Cholesky's root, pivots that are not positive replaced by something small, as practice has it.
Matrix<double> clamped_root(const Matrix<double>& P) {
  const Index n = P.rows();
  Matrix<double> L = Matrix<double>::Zero(n, n);
  for (Index j = 0; j < n; ++j) {
    const double pivot = P(j, j) - L.row(j).squaredNorm();
    L(j, j) = std::sqrt(std::max(pivot, 1e-16 * P(j, j)));
    for (Index i = j + 1; i < n; ++i) L(i, j) = (P(i, j) - L.row(i).dot(L.row(j))) / L(j, j);
  }
  return L;
}

/// A Kalman filter as somebody else might write it: x, P, products from left to right.
template <class Scalar>
class Plain : public properties::StepwiseFilter {
 public:
  explicit Plain(std::string name) { traits_.name = std::move(name); }

  const properties::Traits& traits() const override { return traits_; }
  std::optional<Ending> start(const Dimensions&, const Vector<double>& x, const Matrix<double>& P) override {
    x_ = x.cast<Scalar>();
    P_ = P.cast<Scalar>();
    return std::nullopt;
  }
  std::variant<Answer, Ending> step(const properties::StepInput& in) override {
    return step(in.A.cast<Scalar>(), in.B.cast<Scalar>(), in.C.cast<Scalar>(), in.Q.cast<Scalar>(), in.R.cast<Scalar>(),
                in.y ? Vector<Scalar>(in.y->cast<Scalar>()) : Vector<Scalar>(Vector<Scalar>::Zero(in.C.rows())));
  }

 protected:
  using M = Matrix<Scalar>;
  using V = Vector<Scalar>;
  virtual Answer step(const M& A, const M& B, const M& C, const M& Q, const M& R, const V& y) = 0;

  Answer answer(const M& K) const {
    return {Held::covariance, P_.template cast<double>(), Matrix<double>(K.template cast<double>()),
            Vector<double>(x_.template cast<double>()), std::nullopt};
  }

  properties::Traits traits_;
  V x_;
  M P_;
};

/// Coding (iii).
template <class Scalar>
class Gain final : public Plain<Scalar> {
 public:
  using Plain<Scalar>::Plain;

 private:
  using M = Matrix<Scalar>;
  Answer step(const M& A, const M& B, const M& C, const M& Q, const M& R, const Vector<Scalar>& y) override {
    const M Re = C * this->P_ * C.transpose() + R;
    const M K = A * this->P_ * C.transpose() * inverse(Re);
    this->x_ = (A * this->x_ + K * (y - C * this->x_)).eval();
    this->P_ = (A * this->P_ * A.transpose() + B * Q * B.transpose() - K * Re * K.transpose()).eval();
    return this->answer(K);
  }
};

/// Predicts, updates by Joseph's form, symmetrises, and answers P_{k|k} and no gain.
class PredictUpdate final : public Plain<double> {
 public:
  PredictUpdate() : Plain("predict-update") {
    traits_.instant = Instant::filtered;
    traits_.starts_predicted = false;
    traits_.gain.reset();
  }

 private:
  Answer step(const M& A, const M& B, const M& C, const M& Q, const M& R, const V& y) override {
    const M P = A * P_ * A.transpose() + B * Q * B.transpose();
    const M Kf = P * C.transpose() * inverse<double>(C * P * C.transpose() + R);
    x_ = (A * x_).eval();
    x_ += Kf * (y - C * x_);
    const M I_KC = M::Identity(P.rows(), P.rows()) - Kf * C;
    P_ = I_KC * P * I_KC.transpose() + Kf * R * Kf.transpose();
    P_ = ((P_ + P_.transpose()) / 2).eval();
    Answer result = answer(Kf);
    result.gain.reset();
    return result;
  }
};

/// Joseph's form in double, but for a gain that went through a float.
class FloatInTheMiddle final : public Plain<double> {
 public:
  FloatInTheMiddle() : Plain("float-in-the-middle") {}

 private:
  Answer step(const M& A, const M& B, const M& C, const M& Q, const M& R, const V& y) override {
    const M Kf = M(P_ * C.transpose() * inverse<double>(C * P_ * C.transpose() + R)).cast<float>().cast<double>();
    x_ = (A * (x_ + Kf * (y - C * x_))).eval();
    const M I_KC = M::Identity(P_.rows(), P_.rows()) - Kf * C;
    P_ = (A * (I_KC * P_ * I_KC.transpose() + Kf * R * Kf.transpose()) * A.transpose() + B * Q * B.transpose()).eval();
    return answer(A * Kf);
  }
};

/// Holds S.
class Root final : public Plain<double> {
 public:
  /// With `again`, S is formed anew in every step: the root of S S'.
  explicit Root(bool again) : Plain(again ? "re-cholesky" : "root"), again_(again) {
    traits_.holds = Held::covariance_factor;
  }
  std::optional<Ending> start(const Dimensions& size, const Vector<double>& x, const Matrix<double>& P) override {
    Plain::start(size, x, P);
    S_ = clamped_root(P);
    return std::nullopt;
  }

 private:
  Answer step(const M& A, const M& B, const M& C, const M& Q, const M& R, const V& y) override {
    const Index n = A.rows(), m = B.cols(), p = C.rows();
    if (again_) S_ = clamped_root(S_ * S_.transpose());
    M pre = M::Zero(p + n, p + n + m);
    pre.topLeftCorner(p, p) = clamped_root(R);
    pre.block(0, p, p, n) = C * S_;
    pre.block(p, p, n, n) = A * S_;
    pre.bottomRightCorner(n, m) = B * clamped_root(Q);
    const M post = lower_of(pre);
    // K Re^{1/2} = G, column by column from the last.
    M K = post.bottomLeftCorner(n, p);
    for (Index j = p - 1; j >= 0; --j) {
      for (Index i = j + 1; i < p; ++i) K.col(j) -= K.col(i) * post(i, j);
      K.col(j) /= post(j, j);
    }
    S_ = post.bottomRightCorner(n, n);
    x_ = (A * x_ + K * (y - C * x_)).eval();
    Answer result = answer(K);
    result.holds = Held::covariance_factor;
    result.held = S_;
    return result;
  }

  bool again_;
  M S_;
};

/// Forgets the process noise.
class Noiseless final : public Plain<double> {
 public:
  Noiseless() : Plain("noiseless") {}

 private:
  Answer step(const M& A, const M&, const M& C, const M&, const M& R, const V& y) override {
    const M K = A * P_ * C.transpose() * inverse<double>(C * P_ * C.transpose() + R);
    x_ = (A * x_ + K * (y - C * x_)).eval();
    P_ = ((A - K * C) * P_ * A.transpose()).eval();
    return answer(K);
  }
};

template <class Filter, class... Arguments>
Fingerprint fingerprint_of(Arguments... arguments) {
  return *fingerprint(*properties::subject(std::make_unique<Filter>(arguments...)));
}

// --- the registry -------------------------------------------------------------------------------------------------------

TEST(Fingerprint, PlacesEveryFilterOfTheRegistryAtItself) {
  for (const Metadata& metadata : filters()) {
    SCOPED_TRACE(metadata.id);
    const Fingerprint found = fingerprint_of(metadata.id);
    EXPECT_EQ(found.precision(), "double");
    EXPECT_FALSE(found.answers_floats);
    // The same numbers: no distance at all.
    EXPECT_EQ(found.neighbours.front().distance, 0);
    EXPECT_TRUE(names(found.alike()).contains(std::string(metadata.id)));
    EXPECT_LT(found.steps, 2000);
  }
}

TEST(Fingerprint, NextToAFilterAreThoseOfItsKind) {
  for (const Metadata& metadata : filters()) {
    if (kind_of(metadata) == Kind::memory) continue;  // there is one
    // The information filter by normal equations is the square of the other two, and like nothing else.
    if (metadata.holds == Held::information) continue;
    SCOPED_TRACE(metadata.id);
    const Fingerprint found = fingerprint_of(metadata.id);
    for (const Neighbour& other : found.neighbours) {
      if (other.filter->id == metadata.id) continue;
      EXPECT_EQ(kind_of(*other.filter), kind_of(metadata)) << other.filter->id;
      break;
    }
  }
}

TEST(Fingerprint, SlopesAreThoseOfTheory) {
  for (const Metadata& metadata : filters()) {
    SCOPED_TRACE(metadata.id);
    const Fingerprint found = fingerprint_of(metadata.id);
    const auto expect = [&](const char* ladder, const Line& line, double slope) {
      // The 95 % interval, and what a ladder of few systems is off besides.
      EXPECT_NEAR(line.slope, slope, line.half_width + .05) << ladder;
      EXPECT_LT(line.half_width, .75) << ladder;
    };
    const Climb &innovation = found.climb("innovation"), &prior = found.climb("prior"),
                &accurate = found.climb("accurate"), &graded = found.climb("graded"),
                &dynamics = found.climb("dynamics");
    switch (kind_of(metadata)) {
      case Kind::covariance:
        expect("innovation", innovation.K_slope, 2);
        expect("accurate", accurate.K_slope, 2);
        expect("prior", prior.P_slope, 1);
        expect("graded", graded.P_slope, 1);
        EXPECT_TRUE(std::isnan(dynamics.P_slope.slope));
        // u/d^2 of P is as large as P at d = 2^-26, in all of them.
        EXPECT_LE(std::min(accurate.indefinite.value_or(INFINITY), accurate.broken.value_or(INFINITY)), 0x1p26);
        break;
      case Kind::root:
        expect("innovation", innovation.K_slope, 1);
        expect("accurate", accurate.K_slope, 1);
        // One number times I: D of U D U' and the singular values have it to all digits.
        if (metadata.holds == Held::covariance_factor) {
          expect("prior", prior.P_slope, .5);
          expect("graded", graded.P_slope, .5);
        }
        EXPECT_TRUE(std::isnan(dynamics.P_slope.slope));
        EXPECT_FALSE(accurate.indefinite);
        break;
      case Kind::information:
        expect("innovation", innovation.K_slope, metadata.holds == Held::information ? 2 : 1);
        expect("dynamics", dynamics.P_slope, metadata.holds == Held::information ? 2 : 1);
        break;
      case Kind::memory:
        expect("innovation", innovation.K_slope, 1);
        expect("prior", prior.K_slope, 1);
        EXPECT_TRUE(std::isnan(innovation.P_slope.slope));
        break;
    }
  }
}

TEST(Fingerprint, AsymmetryGrowsAsTheCodingSays) {
  for (const Metadata& metadata : filters()) {
    if (metadata.holds != Held::covariance) continue;
    SCOPED_TRACE(metadata.id);
    const Fingerprint found = fingerprint_of(metadata.id);
    const double one = found.asymmetry("one-output").growth, two = found.asymmetry("two-outputs").growth,
                 product = found.asymmetry("one-output").product;
    EXPECT_NEAR(product, 1.05 * 1.05, 2 * 1.05 * 0x1p-20);  // entries are rounded to 20 bits
    switch (metadata.asymmetry) {
      case Asymmetry::none: EXPECT_TRUE(one == 0 && two == 0); break;
      case Asymmetry::textbook: EXPECT_TRUE(one == 1 && two == 1); break;
      case Asymmetry::mixed: EXPECT_TRUE(one > product && two > 1); break;
      case Asymmetry::gain: EXPECT_NEAR(one, product, .01) << two; break;
      case Asymmetry::cp:
      case Asymmetry::downdate:
        EXPECT_NEAR(one, product, .01);
        EXPECT_GT(two, 1);
        break;
    }
  }
}

TEST(Fingerprint, SaysItInASentence) {
  EXPECT_EQ(
      sentence(fingerprint_of("ckf-gain")),
      "behaves like ckf-gain: loses two digits per decade of k(Re^1/2) (srcf would lose one), its asymmetry grows by "
      "|l1 l2| = 1.10 a step, definiteness is lost at d = 3.8e-06");
  const std::string root = sentence(fingerprint_of("srcf"));
  EXPECT_NE(root.find("behaves like srcf: loses one digit per decade of k(Re^1/2)"), std::string::npos) << root;
  EXPECT_EQ(root.find("symmetr"), std::string::npos) << root;
}

// --- filters of others --------------------------------------------------------------------------------------------------

TEST(Fingerprint, KnowsACodingThatSomebodyElseWrote) {
  const Fingerprint found = fingerprint_of<Gain<double>>("mine");
  EXPECT_TRUE(names(found.alike()).contains("ckf-gain")) << sentence(found);
  EXPECT_EQ(found.precision(), "double");
  EXPECT_NE(sentence(found).find("its asymmetry grows by |l1 l2| = 1.10 a step"), std::string::npos) << sentence(found);
}

TEST(Fingerprint, KnowsSinglePrecision) {
  const Fingerprint found = fingerprint_of<Gain<float>>("mine");
  EXPECT_EQ(found.precision(), "single");
  EXPECT_TRUE(found.answers_floats);
  EXPECT_EQ(kind_of(*found.neighbours.front().filter), Kind::covariance) << sentence(found);
  EXPECT_EQ(sentence(found).rfind("computes in single precision, behaves like ", 0), 0u) << sentence(found);
}

TEST(Fingerprint, KnowsAFloatInTheMiddle) {
  const Fingerprint found = fingerprint_of<FloatInTheMiddle>();
  EXPECT_EQ(found.precision(), "single");
  EXPECT_FALSE(found.answers_floats);
  EXPECT_EQ(sentence(found).rfind("computes in single precision somewhere, though it answers in double", 0), 0u)
      << sentence(found);
}

TEST(Fingerprint, TakesOneThatPredictsFirstAndShowsNoGain) {
  const Fingerprint found = fingerprint_of<PredictUpdate>();
  EXPECT_EQ(found.precision(), "double");
  EXPECT_EQ(names(found.alike()), std::set<std::string>{"joseph"}) << sentence(found);
  EXPECT_NE(sentence(found).find("P stays symmetric"), std::string::npos) << sentence(found);
  for (const Climb& climb : found.climbs)
    for (const double K : climb.K) EXPECT_TRUE(std::isnan(K));
}

TEST(Fingerprint, KnowsARootFromOneThatIsNone) {
  const Fingerprint root = fingerprint_of<Root>(false), again = fingerprint_of<Root>(true);
  EXPECT_EQ(kind_of(*root.neighbours.front().filter), Kind::root) << sentence(root);
  EXPECT_TRUE(names(root.alike()).contains("ud")) << sentence(root);  // as Thornton's update, by Gram and Schmidt
  EXPECT_TRUE(again.alike().empty()) << sentence(again);
  // S formed anew from S S' loses the size of the prior, not its root: as if P were held.
  const Line& slope = again.climb("prior").P_slope;
  EXPECT_NEAR(slope.slope, 1, slope.half_width + .05);
  EXPECT_LT(slope.half_width, .2);
}

TEST(Fingerprint, AWrongFilterHasNone) {
  const Fingerprint found = fingerprint_of<Noiseless>();
  EXPECT_EQ(found.precision(), "wrong");
  EXPECT_TRUE(found.neighbours.empty());
  EXPECT_EQ(sentence(found).rfind("is wrong on ordinary systems", 0), 0u) << sentence(found);
}

TEST(Fingerprint, StopsWhenAsked) {
  int asked = 0;
  const auto subject = properties::built_in("ckf");
  EXPECT_FALSE(fingerprint(*subject, [&] { return ++asked > 20; }));
  EXPECT_EQ(asked, 21);
}

/// Does not survive a determinant of Re below `least`.
class Mortal final : public Plain<double> {
 public:
  explicit Mortal(double least) : Plain("mortal"), least_(least) {}

 private:
  Answer step(const M& A, const M& B, const M& C, const M& Q, const M& R, const V& y) override {
    const M Re = C * P_ * C.transpose() + R;
    if (Re.rows() == 2 && Re(0, 0) * Re(1, 1) - Re(0, 1) * Re(1, 0) < least_)
      throw properties::SubjectFault(properties::SubjectFault::Kind::died, "died");
    const M K = A * P_ * C.transpose() * inverse<double>(Re);
    x_ = (A * x_ + K * (y - C * x_)).eval();
    P_ = ((A - K * C) * P_ * A.transpose() + B * Q * B.transpose()).eval();
    return answer(K);
  }

  double least_;
};

TEST(Fingerprint, AFaultOnAnOrdinarySystemIsOne) {
  const auto subject = properties::subject(std::make_unique<Mortal>(1e9));
  EXPECT_THROW(fingerprint(*subject), properties::SubjectFault);
}

TEST(Fingerprint, WhoDiesOnALadderBreaksDownThere) {
  // In the first of four steps det Re = 8 d^2 nearly, theory (6.3). In the last, P = (I + 3 C'C/d^2)^{-1}: of the directions of C,
  // with singular values whose squares are 6 and d^2/3, d^2/3 and d^2/6 are left, so det Re = (4/3)(7/6) d^4 = 14/9 d^4.
  const double least = 1e-7;
  const Fingerprint found = fingerprint_of<Mortal>(least);
  const double d = 1 / *found.climb("accurate").broken;
  EXPECT_LT(14. / 9 * std::pow(d, 4), least);
  EXPECT_GT(14. / 9 * std::pow(4 * d, 4), least);  // d is four times that on the rung below
  EXPECT_FALSE(found.neighbours.empty());
}

}  // namespace
}  // namespace kfstab::experiments
