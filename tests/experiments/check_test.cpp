// What `kfstab check` writes, for people and for CI, and what it takes.
#include <gtest/gtest.h>

#include <sstream>
#include <string>
#include <vector>

#include <fmt/core.h>
#include <boost/property_tree/ptree.hpp>
#include <boost/property_tree/xml_parser.hpp>
#include <nlohmann/json.hpp>

#include <kfstab/properties/system_file.hpp>

#include "experiments/tool.hpp"

namespace kfstab::test::check {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

/// A filter that takes R^2 for R, and the same filter without that mistake.
const std::string wrong = "--exec '" KFSTAB_FOREIGN_FILTER " r-squared'";
const std::string right = "--exec " KFSTAB_FOREIGN_FILTER;

class Check : public ToolInFolder {
 protected:
  json results() const { return json::parse(read(folder / "results.json")); }

  /// The law with that id.
  static json law(const json& results, const std::string& id) {
    for (const json& one : results["laws"])
      if (one["id"] == id) return one;
    ADD_FAILURE() << "no law " << id;
    return {};
  }

  static std::vector<std::string> failing(const json& results) {
    std::vector<std::string> ids;
    for (const json& one : results["laws"])
      if (one["status"] == "fail") ids.push_back(one["id"]);
    return ids;
  }
};

}  // namespace

TEST_F(Check, OfARightFilterPasses) {
  ASSERT_EQ(kfstab("check --cases 40 --no-fingerprint --json results.json " + right), 0) << out() << err();
  const json found = results();
  EXPECT_EQ(found["schema"], "kfstab.check/1");
  EXPECT_EQ(found["verdict"], "pass");
  EXPECT_EQ(found["complete"], true);
  EXPECT_EQ(found["cases"]["tried"], 40);
  EXPECT_TRUE(found["diagnosis"].empty());
  EXPECT_TRUE(found["fingerprint"].is_null());
  EXPECT_TRUE(failing(found).empty());
  const json one = law(found, "one-step");
  EXPECT_EQ(one["status"], "pass");
  EXPECT_GT(one["cases"], 0);
  EXPECT_LE(one["max_ratio"], 30);
  EXPECT_TRUE(one["counterexample"].is_null());
  EXPECT_GT(found["classes"].size(), 10u);
}

TEST_F(Check, OfFiltersInBatches) {
  ASSERT_EQ(kfstab("check --filters '-^(ckf|srif)$' --batch --cases 100 --json results.json"), 0) << out() << err();
  const json found = results();
  EXPECT_EQ(found["subject"], "srcf-batch");
  EXPECT_EQ(found["cases"]["tried"], 100);
  EXPECT_TRUE(failing(found).empty());
  EXPECT_NE(found["context"]["kernels"], "plain");
  ASSERT_EQ(kfstab("check --filters . --batch --cases 5 --no-fingerprint"), 0) << out() << err();
  EXPECT_NE(out().find("3 filters: "), std::string::npos) << out();
  EXPECT_EQ(kfstab("check --filters ud --batch"), 5);
  EXPECT_NE(err().find("ckf, srcf, srif"), std::string::npos) << err();
  EXPECT_EQ(kfstab("check --batch " + right), 2);
}

TEST_F(Check, NamesTheMistakeAndShowsItOnAScalar) {
  ASSERT_EQ(kfstab("check --cases 40 --no-fingerprint --regressions kept --json results.json " + wrong), 1) << err();
  const json found = results();
  EXPECT_EQ(found["verdict"], "fail");
  ASSERT_FALSE(found["diagnosis"].empty());
  EXPECT_EQ(found["diagnosis"][0]["mistake"], "r-squared");
  EXPECT_GE(found["diagnosis"][0]["digits"], 10);
  EXPECT_TRUE(found["candidates"].empty()) << "what is sure needs no guess";
  const json broken = law(found, "one-step");
  ASSERT_EQ(broken["status"], "fail");
  EXPECT_FALSE(broken["hint"].get<std::string>().empty());
  const json& shown = broken["counterexample"];
  EXPECT_GT(shown["ratio"], 30);
  // As small as such a filter can be seen: one state, one output, one step.
  const auto system =
      properties::read_system_text(shown["system"].get<std::string>(), properties::Format::toml, "counterexample");
  EXPECT_EQ(system.dimensions().n, 1);
  EXPECT_EQ(system.dimensions().p, 1);
  EXPECT_EQ(system.steps, 1);
  // It is kept, and the command that is given shows it again: that system alone.
  const fs::path kept = folder / shown["file"].get<std::string>();
  ASSERT_TRUE(fs::exists(kept)) << kept;
  const std::string command = shown["command"];
  ASSERT_TRUE(command.starts_with("kfstab check ")) << command;
  EXPECT_EQ(kfstab(command.substr(7) + " --json results.json"), 1) << err();
  EXPECT_EQ(failing(results()), std::vector<std::string>{"one-step"});
  // What is in the folder is tried first, of a right filter without a case drawn.
  EXPECT_EQ(kfstab("check --cases 0 --no-fingerprint --regressions kept " + right), 0) << out();
  EXPECT_EQ(kfstab("check --cases 0 --no-fingerprint --regressions kept " + wrong), 1) << out();
}

// R^2 for R, and all answers are written with six digits besides: no re-enactment answers the same.
TEST_F(Check, GuessesWhereNoMistakeExplainsTheAnswers) {
  ASSERT_EQ(kfstab("check --cases 60 --no-fingerprint --json results.json --markdown it.md --exec '" KFSTAB_FOREIGN_FILTER
                   " r-squared-short'"),
            1)
      << err();
  const json found = results();
  EXPECT_TRUE(found["diagnosis"].empty());
  const json& guesses = found["candidates"];
  ASSERT_FALSE(guesses.empty());
  EXPECT_LE(guesses.size(), 3u);
  EXPECT_EQ(guesses[0]["mistake"], "r-squared") << guesses;
  EXPECT_GT(guesses[0]["digits"], guesses[0]["right_digits"]);
  EXPECT_GT(guesses[0]["likeness"], 0);
  EXPECT_LE(guesses[0]["likeness"], 1);
  EXPECT_LE(guesses[0]["laws_alike"], guesses[0]["laws_either"]);
  EXPECT_GT(guesses[0]["systems"], 0);
  // What is a guess is called one.
  EXPECT_NE(out().find("A guess"), std::string::npos) << out();
  EXPECT_NE(out().find("takes R for R^{1/2}"), std::string::npos) << out();
  const std::string markdown = read(folder / "it.md");
  EXPECT_NE(markdown.find("A guess"), std::string::npos);
  EXPECT_NE(markdown.find("- " + guesses[0]["sentence"].get<std::string>() + "\n"), std::string::npos);
}

TEST_F(Check, ReportsForCiHaveEachFailure) {
  ASSERT_EQ(kfstab("check --cases 20 --no-fingerprint --json results.json --junit junit.xml --markdown it.md " + wrong),
            1)
      << err();
  const json found = results();
  const auto broken = failing(found);
  ASSERT_GT(broken.size(), 3u);

  std::istringstream text(read(folder / "junit.xml"));
  boost::property_tree::ptree junit;
  ASSERT_NO_THROW(boost::property_tree::read_xml(text, junit));
  const auto& suite = junit.get_child("testsuites.testsuite");
  EXPECT_EQ(suite.get<std::size_t>("<xmlattr>.failures"), broken.size());
  EXPECT_EQ(suite.get<std::size_t>("<xmlattr>.tests"), found["laws"].size());
  std::vector<std::string> failures;
  std::size_t skipped = 0, cases = 0;
  for (const auto& [tag, node] : suite) {
    if (tag != "testcase") continue;
    ++cases;
    skipped += node.count("skipped");
    if (node.count("failure") > 0) failures.push_back(node.get<std::string>("<xmlattr>.name"));
  }
  EXPECT_EQ(cases, found["laws"].size());
  EXPECT_EQ(suite.get<std::size_t>("<xmlattr>.skipped"), skipped);
  EXPECT_EQ(failures, broken);

  const std::string markdown = read(folder / "it.md");
  for (const std::string& id : broken) EXPECT_NE(markdown.find("\n### " + id + "\n"), std::string::npos) << id;
  // What was drawn, and how often.
  ASSERT_FALSE(found["classes"].empty());
  EXPECT_NE(markdown.find("| systems tried |"), std::string::npos) << markdown;
  for (const auto& [name, count] : found["classes"].items()) {
    std::string one = name;  // as Markdown has it
    if (const auto less = one.find('<'); less != std::string::npos) one.insert(less, "\\");
    EXPECT_NE(markdown.find(fmt::format("| {} | {} | {} % |", one, count.get<int>(), count.get<int>() * 5)),
              std::string::npos)
        << one;
  }
}

TEST_F(Check, KnownFailuresAreStrict) {
  ASSERT_EQ(kfstab("check --cases 20 --no-fingerprint --json results.json " + wrong), 1) << err();
  std::string known = "# R squared, see issue 7\n";
  for (const std::string& id : failing(results())) known += id + "  # known\n";
  put(folder / "known.txt", known);
  EXPECT_EQ(kfstab("check --cases 20 --no-fingerprint --expect known.txt --json results.json " + wrong), 0) << out();
  EXPECT_EQ(law(results(), "one-step")["status"], "expected-failure");
  // A law that begins to hold fails, too: the list stays true.
  put(folder / "known.txt", known + "symmetry\n");
  EXPECT_EQ(kfstab("check --cases 20 --no-fingerprint --expect known.txt --json results.json " + wrong), 1) << out();
  EXPECT_EQ(law(results(), "symmetry")["status"], "unexpected-pass");
}

TEST_F(Check, RefusesWhatItCannotRead) {
  put(folder / "known.txt", "symmetry\n\nsymetry\n");
  EXPECT_EQ(kfstab("check --expect known.txt " + right), 2);
  EXPECT_NE(err().find("known.txt:3"), std::string::npos) << err();
  EXPECT_NE(err().find("symmetry"), std::string::npos) << "near miss: " << err();
  EXPECT_EQ(kfstab("check --expect nowhere.txt " + right), 2);
  EXPECT_EQ(kfstab("check --replay nowhere.toml " + right), 2);
  EXPECT_EQ(kfstab("check --regressions known.txt " + right), 2);
  EXPECT_EQ(kfstab("check --laws no-such-law " + right), 5);
  EXPECT_EQ(kfstab("check --filters no-such-filter"), 5);
  EXPECT_EQ(kfstab("check"), 2);
}

TEST_F(Check, SaysWhatItLeftOut) {
  EXPECT_EQ(kfstab("check --cases 100000 --budget 0.3 --no-fingerprint --json results.json " + right), 0) << err();
  EXPECT_NE(out().find("out of time"), std::string::npos) << out();
  EXPECT_EQ(results()["complete"], false);
  EXPECT_LT(results()["cases"]["tried"], 100000);
}

TEST_F(Check, DrawsTheSameSystemsForASeed) {
  std::vector<json> ratios;
  for (const char* seed : {"7", "7", "8"}) {
    ASSERT_EQ(kfstab(fmt::format("check --cases 20 --no-fingerprint --seed {} --json results.json {}", seed, right)),
              0);
    json all;
    const json found = results();
    for (const json& one : found["laws"]) all.push_back(one["max_ratio"]);
    ratios.push_back(all);
  }
  EXPECT_EQ(ratios[0], ratios[1]);
  EXPECT_NE(ratios[0], ratios[2]);
}

}  // namespace kfstab::test::check
