#pragma once

#include <cmath>
#include <set>
#include <stdexcept>
#include <string>

#include <gtest/gtest.h>

#include <kfstab/experiments/claim.hpp>

/// What tests of claims ask of them.
namespace kfstab::experiments {

inline Claim claim_called(const std::string& id) {
  for (const Claim& claim : all_claims())
    if (claim.id == id) return claim;
  throw std::invalid_argument("no " + id);
}

inline const kfstab::reports::Check& check_called(const ClaimResult& result, const std::string& start) {
  for (const kfstab::reports::Check& check : result.findings.checks)
    if (check.name.starts_with(start)) return check;
  throw std::invalid_argument("no check " + start);
}

inline const kfstab::reports::Curve& curve_called(const kfstab::reports::Figure& figure, const std::string& id) {
  for (const auto& curve : figure.curves)
    if (curve.id == id) return curve;
  throw std::invalid_argument("no curve " + id);
}

inline std::string failing(const ClaimResult& result) {
  std::string text;
  for (const kfstab::reports::Check& check : result.findings.checks)
    if (!check.holds)
      text += check.name + ": predicted " + std::to_string(check.predicted) + ", measured " +
              std::to_string(check.measured) + ", " + check.criterion + "\n";
  return text;
}

inline void expect_well_made(const ClaimResult& result) {
  std::set<std::string> names, figures;
  for (const kfstab::reports::Check& check : result.findings.checks) {
    EXPECT_TRUE(std::isfinite(check.predicted)) << check.name;
    EXPECT_FALSE(check.criterion.empty()) << check.name;
    EXPECT_TRUE(names.insert(check.name).second) << check.name << " stands twice";
  }
  EXPECT_FALSE(result.findings.figures.empty());
  for (const auto& figure : result.findings.figures) {
    EXPECT_TRUE(figures.insert(figure.id).second) << figure.id << " stands twice";
    EXPECT_FALSE(figure.title.empty() || figure.caption.empty() || figure.x.label.empty() || figure.y.label.empty())
        << figure.id;
    std::set<std::string> curves;
    bool theory = false;
    for (const auto& curve : figure.curves) {
      EXPECT_TRUE(curves.insert(curve.id).second) << figure.id << ": " << curve.id << " stands twice";
      EXPECT_FALSE(curve.x.empty()) << figure.id << ": " << curve.id;
      EXPECT_EQ(curve.x.size(), curve.y.size()) << figure.id << ": " << curve.id;
      theory = theory || curve.role == kfstab::reports::CurveRole::theory;
    }
    EXPECT_TRUE(theory || figure.id == "innovation-conditioning-units") << figure.id << " has no line of the theory";
  }
}

}  // namespace kfstab::experiments
