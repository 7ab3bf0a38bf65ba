#include <kfstab/reports/number.hpp>

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <random>

#include <gtest/gtest.h>

using kfstab::reports::exact_number;
using kfstab::reports::short_number;

TEST(ShortNumber, IsShortestInItsRange) {
  EXPECT_EQ(short_number(2.34e-14), "2.3e-14");
  EXPECT_EQ(short_number(-2.36e-14), "-2.4e-14");
  EXPECT_EQ(short_number(2e-14), "2e-14");
  EXPECT_EQ(short_number(0.5), "0.5");
  EXPECT_EQ(short_number(0.001), "0.001");
  EXPECT_EQ(short_number(0.00099), "9.9e-4");
  EXPECT_EQ(short_number(12), "12");
  EXPECT_EQ(short_number(100), "100");
  EXPECT_EQ(short_number(-1234.4), "-1234");
  EXPECT_EQ(short_number(123456), "1.2e5");
  EXPECT_EQ(short_number(1.79e308), "1.8e308");
  EXPECT_EQ(short_number(3.14159, 4), "3.142");
}

TEST(ShortNumber, RoundingMayRaiseTheExponent) {
  EXPECT_EQ(short_number(9.99), "10");
  EXPECT_EQ(short_number(0.0009996), "0.001");
  EXPECT_EQ(short_number(9.99e-14), "1e-13");
}

TEST(ShortNumber, NamesWhatIsNoNumber) {
  EXPECT_EQ(short_number(0.0), "0");
  EXPECT_EQ(short_number(-0.0), "0");
  EXPECT_EQ(short_number(std::numeric_limits<double>::infinity()), "inf");
  EXPECT_EQ(short_number(-std::numeric_limits<double>::infinity()), "-inf");
  EXPECT_EQ(short_number(std::nan("")), "nan");
  EXPECT_EQ(short_number(-std::nan("")), "nan");
}

TEST(ExactNumber, ReadsBackAsTheSameDouble) {
  EXPECT_EQ(exact_number(0.1), "0.1");
  EXPECT_EQ(exact_number(-std::nan("")), "nan");
  std::mt19937_64 bits(7);
  for (int k = 0; k < 20000; ++k) {
    const double value = std::bit_cast<double>(static_cast<std::uint64_t>(bits()));
    if (std::isnan(value)) continue;
    const std::string text = exact_number(value);
    EXPECT_EQ(std::bit_cast<std::uint64_t>(std::strtod(text.c_str(), nullptr)), std::bit_cast<std::uint64_t>(value)) << text;
  }
  for (double value : {-0.0, 5e-324, std::numeric_limits<double>::max(), 1.0 / 3})
    EXPECT_EQ(std::bit_cast<std::uint64_t>(std::strtod(exact_number(value).c_str(), nullptr)), std::bit_cast<std::uint64_t>(value));
}
