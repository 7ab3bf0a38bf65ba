#include <kfstab/experiments/scan.hpp>

#include <cmath>
#include <string>

#include "reports/scratch.hpp"

#include <kfstab/properties/data.hpp>
#include <kfstab/properties/input_error.hpp>

using namespace kfstab;
using namespace kfstab::experiments;
using properties::InputError;

namespace {

properties::System at(const std::string& word, const std::vector<std::string>& scans,
                      const std::vector<double>& values) {
  std::vector<Scan> parsed;
  for (const auto& scan : scans) parsed.push_back(parse_scan(scan));
  return scanned_system(word, {}, parsed, values);
}

}  // namespace

TEST(ParseScan, TakesAList) {
  const Scan scan = parse_scan("bits=53,24,113,24");
  EXPECT_EQ(scan.of, Scan::Of::bits);
  EXPECT_EQ(scan.values, (std::vector<double>{24, 53, 113}));
  EXPECT_FALSE(scan.log);
  EXPECT_TRUE(parse_scan("d=1e-6,1e-2").log);
  EXPECT_FALSE(parse_scan("d=-1,1000").log);
}

TEST(ParseScan, SpreadsByFactorsOrByDifferences) {
  const Scan powers = parse_scan("d=2^-20:2^-10:log:3");
  EXPECT_EQ(powers.of, Scan::Of::parameter);
  EXPECT_TRUE(powers.log);
  EXPECT_EQ(powers.values, (std::vector<double>{0x1p-20, 0x1p-15, 0x1p-10}));
  const Scan decades = parse_scan("d=1e-8:1e-2:log:7");
  ASSERT_EQ(decades.values.size(), 7u);
  EXPECT_EQ(decades.values.front(), 1e-8);
  EXPECT_EQ(decades.values.back(), 1e-2);
  // exp2 of a logarithm near 27 that is off by a few roundings, each worth its size in the result
  for (int i = 0; i < 7; ++i)
    EXPECT_NEAR(std::log10(decades.values[static_cast<std::size_t>(i)]), i - 8, 1e3 * 0x1p-53);
  const Scan even = parse_scan("q=1:0:lin:5");
  EXPECT_EQ(even.values, (std::vector<double>{0, 0.25, 0.5, 0.75, 1}));
  EXPECT_FALSE(even.log);
  EXPECT_EQ(parse_scan("bits=8:16:log:3").values, (std::vector<double>{8, 11, 16}));
}

TEST(ParseScan, KnowsEntriesAndFactors) {
  const Scan entry = parse_scan("P0[2,11]=1,2");
  EXPECT_EQ(entry.of, Scan::Of::entry);
  EXPECT_EQ(entry.matrix, "P0");
  EXPECT_EQ(entry.row, 2);
  EXPECT_EQ(entry.col, 11);
  const Scan factor = parse_scan("scale:Q=1,2");
  EXPECT_EQ(factor.of, Scan::Of::scale);
  EXPECT_EQ(factor.matrix, "Q");
}

TEST(ParseScan, RefusesEverythingElse) {
  for (const std::string text : {"",
                                 "x",
                                 "=1,2",
                                 "x=",
                                 "x=1",
                                 "x=1,1",
                                 "x=1,",
                                 "x=1:2:log:1",
                                 "x=1:1:lin:3",
                                 "x=0:1:log:3",
                                 "x=1:2:other:3",
                                 "x=1:2:lin",
                                 "x=1:2:lin:2.5",
                                 "x=1:2:lin:1001",
                                 "x=a,b",
                                 "x=1/0,2",
                                 "1x=1,2",
                                 "bits=7,24",
                                 "bits=24.5,53",
                                 "bits=24,238",
                                 "R[0,0=1,2",
                                 "R[-1,0]=1,2",
                                 "R[0,99999]=1,2",
                                 "scale:=1,2",
                                 "scale:Z=1,2",
                                 "Z[0,0]=1,2",
                                 "x y=1,2"}) {
    try {
      parse_scan(text);
      ADD_FAILURE() << "'" << text << "' was taken";
    } catch (const InputError& error) {
      EXPECT_EQ(error.place().origin, "--scan") << text;
    }
  }
}

TEST(ScannedSystem, HasTheParameter) {
  const auto system = at("dyer-mcreynolds", {"d=2^-8,2^-4"}, {0x1p-4});
  EXPECT_EQ(system.parameters.at("d"), 0x1p-4);
  EXPECT_EQ(system.C.at(0)(1, 2), 1 + 0x1p-4);
  EXPECT_THROW(at("dyer-mcreynolds", {"e=1,2"}, {1}), InputError);
}

TEST(ScannedSystem, HasTheEntryAndItsMirror) {
  const auto system = at("dyer-mcreynolds", {"A[0,2]=1,2", "R[1,0]=0,2"}, {1.5, 0x1p-42});
  EXPECT_EQ(system.A.at(0)(0, 2), 1.5);
  EXPECT_EQ(system.A.at(0)(2, 0), 0);
  EXPECT_EQ(system.R.value.at(0)(1, 0), 0x1p-42);
  EXPECT_EQ(system.R.value.at(0)(0, 1), 0x1p-42);
  EXPECT_THROW(at("dyer-mcreynolds", {"R[2,0]=1,2"}, {1}), InputError) << "R is 2 x 2";
  EXPECT_THROW(at("dyer-mcreynolds", {"R[1,0]=1,2"}, {1}), InputError) << "R is indefinite then";
  EXPECT_THROW(at("dyer-mcreynolds", {"R_root[0,0]=1,2"}, {1}), InputError) << "the file writes R";
}

TEST(ScannedSystem, IsScaled) {
  const auto written = at("double-integrator", {"bits=24,53"}, {53});
  const auto scaled = at("double-integrator", {"scale:P0=1,8", "scale:A=1,2"}, {8, 2});
  EXPECT_EQ(scaled.P0.value.at(0), 8 * written.P0.value.at(0));
  EXPECT_EQ(scaled.A.at(0), 2 * written.A.at(0));
  EXPECT_THROW(at("double-integrator", {"scale:P0=-1,8"}, {-1}), InputError);
}

TEST(ScannedSystem, DrawsItsMeasurementsAnew) {
  const auto first = [](const properties::System& system) { return system.data->open()->next().y(0); };
  const auto written = at("double-integrator", {"bits=24,53"}, {53});
  EXPECT_EQ(first(at("double-integrator", {"scale:R=1,4"}, {1})), first(written));
  EXPECT_NE(first(at("double-integrator", {"scale:R=1,4"}, {4})), first(written));
  EXPECT_EQ(dynamic_cast<const properties::Simulated&>(*written.data).seed(), 1u);
}

class ScannedRoot : public ScratchFolder {};

TEST_F(ScannedRoot, ScalesTheCovarianceByTheRootOfTheFactor) {
  put(folder / "root.toml", "name = \"root\"\nA = 1\nB = 1\nC = 1\nQ_root = 3\nR = 1\nP0 = 1\nsteps = 2\n");
  const std::string file = (folder / "root.toml").string();
  EXPECT_EQ(at(file, {"scale:Q=1,4"}, {4}).Q.value.at(0)(0, 0), 6);
  EXPECT_EQ(at(file, {"scale:Q_root=1,4"}, {4}).Q.value.at(0)(0, 0), 12);
  EXPECT_EQ(at(file, {"scale:R_root=1,4"}, {4}).R.value.at(0)(0, 0), 16);
  EXPECT_EQ(at(file, {"Q_root[0,0]=1,4"}, {4}).Q.value.at(0)(0, 0), 4);
  EXPECT_THROW(at(file, {"Q[0,0]=1,4"}, {4}), InputError);
}

TEST(ScannedBits, AreThoseOfTheScan) {
  const std::vector<Scan> scans = {parse_scan("d=1,2"), parse_scan("bits=24,53")};
  EXPECT_EQ(scanned_bits(scans, std::vector<double>{1, 24}), 24);
  EXPECT_EQ(scanned_bits(std::span(scans).first(1), std::vector<double>{1}), 53);
}
