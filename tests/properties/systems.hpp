#pragma once

#include <cmath>
#include <string>

#include <gtest/gtest.h>

#include <kfstab/properties/system_file.hpp>

/// What the tests of this room share: a small valid system file to spoil, and equality bit by bit.
namespace kfstab::properties::testing {

/// n = 2, m = 1, p = 1. Each key on a line of its own, so that a test can replace one.
inline std::string valid_toml() {
  return "name = \"cart\"\n"                    // 1
         "A = [[1, \"T\"], [0, 1]]\n"           // 2
         "B = [[\"T^2/2\"], [\"T\"]]\n"         // 3
         "C = [[1, 0]]\n"                       // 4
         "Q = [[\"q\"]]\n"                      // 5
         "R = [[0.25]]\n"                       // 6
         "P0 = [[2, 0.5], [0.5, 1]]\n"          // 7
         "x0 = [1, -1]\n"                       // 8
         "steps = 3\n"                          // 9
         "measurements = [[0.5], [1], [1.5]]\n" // 10
         "[parameters]\n"                       // 11
         "T = 0.5\n"                            // 12
         "q = \"2^-3\"\n";                      // 13
}

/// The text with the line that starts with key = replaced; no line at all for an empty replacement.
inline std::string with(std::string text, const std::string& key, const std::string& line) {
  const auto begin = text.find(key + " =") == 0 ? 0 : text.find("\n" + key + " =") + 1;
  const auto end = text.find('\n', begin);
  return text.replace(begin, line.empty() ? end + 1 - begin : end - begin, line);
}

inline System read_toml(const std::string& text, const Overrides& overrides = {}) {
  return read_system_text(text, Format::toml, "cart.toml", overrides);
}

inline void expect_same_bits(const Matrix<double>& X, const Matrix<double>& Y, const std::string& what) {
  ASSERT_EQ(X.rows(), Y.rows()) << what;
  ASSERT_EQ(X.cols(), Y.cols()) << what;
  for (Index i = 0; i < X.rows(); ++i)
    for (Index j = 0; j < X.cols(); ++j) {
      if (std::isnan(X(i, j)) && std::isnan(Y(i, j))) continue;  // missing in both
      EXPECT_EQ(X(i, j), Y(i, j)) << what << '[' << i << ',' << j << ']';
      EXPECT_EQ(std::signbit(X(i, j)), std::signbit(Y(i, j))) << what << '[' << i << ',' << j << ']';
    }
}

inline void expect_same(const Sequence& X, const Sequence& Y, const std::string& what) {
  EXPECT_EQ(X.kind, Y.kind) << what;
  ASSERT_EQ(X.matrices.size(), Y.matrices.size()) << what;
  for (std::size_t k = 0; k < X.matrices.size(); ++k) expect_same_bits(X.matrices[k], Y.matrices[k], what);
}

inline void expect_same(const System& x, const System& y) {
  EXPECT_EQ(x.name, y.name);
  EXPECT_EQ(x.description, y.description);
  EXPECT_EQ(x.source, y.source);
  EXPECT_EQ(x.parameters, y.parameters);
  EXPECT_EQ(x.steps, y.steps);
  expect_same(x.A, y.A, "A");
  expect_same(x.B, y.B, "B");
  expect_same(x.C, y.C, "C");
  expect_same(x.D, y.D, "D");
  EXPECT_EQ(x.Q.written, y.Q.written);
  EXPECT_EQ(x.R.written, y.R.written);
  EXPECT_EQ(x.P0.written, y.P0.written);
  expect_same(x.Q.value, y.Q.value, "Q");
  expect_same(x.R.value, y.R.value, "R");
  expect_same(x.P0.value, y.P0.value, "P0");
  expect_same_bits(x.x0, y.x0, "x0");
  ASSERT_EQ(!x.data, !y.data);
  if (!x.data) return;
  const auto left = x.data->open(), right = y.data->open();
  for (std::int64_t k = 0; k < x.steps; ++k) {
    const StepData& a = left->next();
    const StepData& b = right->next();
    expect_same_bits(a.y, b.y, "y");
    expect_same_bits(a.u, b.u, "u");
  }
}

}  // namespace kfstab::properties::testing
