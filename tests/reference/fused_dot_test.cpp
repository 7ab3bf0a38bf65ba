#include <gtest/gtest.h>

#include <kfstab/reference/detail/dense.hpp>

#include "reference/mpfr_numbers.hpp"

namespace kfstab::reference::detail {
namespace {

using testing::exact_number;
using testing::ExactNumber;
using testing::Kind;
using testing::Numbers;

template <class T>
class FusedDot : public ::testing::Test {};
// 38 and 96 digits are 128 and 320 bits, whole limbs; numbers of 2500 are too long for the stack.
using Precisions =
    ::testing::Types<Real<10>, Real<20>, Real<38>, Real<50>, Real<96>, Real<100>, Real<1600>, Real<2500>>;
TYPED_TEST_SUITE(FusedDot, Precisions);

TYPED_TEST(FusedDot, IsRightToItsBound) {
  using T = TypeParam;
  Numbers numbers(1);
  for (const Kind kind : testing::kinds)
    for (const Index count : {0, 1, 2, 3, 7, 40})
      for (const Into into : {Into::set, Into::add, Into::subtract}) {
        const Matrix<T> x = numbers.matrix<T>(1, count, kind), y = numbers.matrix<T>(count, 1, kind),
                        before = numbers.matrix<T>(1, 1, kind);
        T z = before(0, 0);
        fused_dot(*z.backend().data(), into, entries(x).row(0), entries(y).column(0), count);

        ExactNumber sum = into == Into::set ? ExactNumber(0) : exact_number(before(0, 0)), terms = abs(sum);
        for (Index l = 0; l < count; ++l) {
          const ExactNumber term = exact_number(x(0, l)) * exact_number(y(l, 0));
          sum += into == Into::subtract ? ExactNumber(-term) : term;
          terms += abs(term);
        }
        const ExactNumber got = exact_number(z);
        const ExactNumber bound = (abs(got) + terms / 4) * testing::power_of_two(-testing::precision_of(z));
        EXPECT_TRUE(abs(got - sum) <= bound) << "kind " << static_cast<int>(kind) << ", " << count << " terms: error "
                                             << testing::ratio(got - sum, bound) << " of the bound";
      }
}

// What fits is exact, and ties go to even, as mpfr rounds them.
TYPED_TEST(FusedDot, RoundsAsMpfrDoes) {
  using T = TypeParam;
  Numbers numbers(2);
  const auto p = static_cast<int>(testing::precision_of(T()));
  for (int k = 0; k < 50; ++k) {
    // one term, or z and one that ends half a place or a quarter of a place below it
    const T a = numbers.matrix<T>(1, 1, Kind::full)(0, 0), b = numbers.matrix<T>(1, 1, Kind::full)(0, 0);
    T z, expected = a * b;
    fused_dot(*z.backend().data(), Into::set, {a.backend().data(), 0}, {b.backend().data(), 0}, 1);
    EXPECT_EQ(z, expected);
    for (const int below : {1, 2, 3}) {
      const T one = 1, small = ldexp(T(k % 2 == 0 ? 1 : -1), mpfr_get_exp(a.backend().data()) - p - below);
      z = a;
      fused_dot(*z.backend().data(), Into::add, {one.backend().data(), 0}, {small.backend().data(), 0}, 1);
      expected = a + small;
      EXPECT_EQ(z, expected) << below;
    }
  }
}

TYPED_TEST(FusedDot, LeavesWhatIsNotFiniteToMpfr) {
  using T = TypeParam;
  const T infinity = std::numeric_limits<T>::infinity(), zero = 0, one = 1;
  T z = 1;
  fused_dot(*z.backend().data(), Into::subtract, {infinity.backend().data(), 0}, {one.backend().data(), 0}, 1);
  EXPECT_EQ(z, T(-infinity));
  fused_dot(*z.backend().data(), Into::set, {infinity.backend().data(), 0}, {zero.backend().data(), 0}, 1);
  EXPECT_TRUE(isnan(z));
  // beyond the exponents that are added up here, within mpfr's
  T huge, tiny;
  mpfr_set_ui_2exp(huge.backend().data(), 1, mpfr_exp_t(1) << 28, MPFR_RNDN);
  mpfr_set_ui_2exp(tiny.backend().data(), 1, -(mpfr_exp_t(1) << 28), MPFR_RNDN);
  fused_dot(*z.backend().data(), Into::set, {huge.backend().data(), 0}, {tiny.backend().data(), 0}, 1);
  EXPECT_EQ(z, T(1));
}

}  // namespace
}  // namespace kfstab::reference::detail
