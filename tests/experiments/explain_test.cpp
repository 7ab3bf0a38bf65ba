#include <kfstab/experiments/explain.hpp>

#include <cmath>
#include <string>

#include <gtest/gtest.h>

#include <kfstab/experiments/catalogue.hpp>
#include <kfstab/experiments/explain_page.hpp>
#include <kfstab/experiments/results.hpp>
#include <kfstab/experiments/selection.hpp>
#include <kfstab/experiments/stored.hpp>

using namespace kfstab;
using namespace kfstab::experiments;

namespace {

/// Two nearly equal measurements, d = 2^-20 apart, come at step 2; before and after nothing happens.
const std::string late = R"(
name = "late"
A = { identity = 3 }
B = [[], [], []]
C = { list = [[[1, 0, 0], [0, 1, 0]], [[1, 0, 0], [0, 1, 0]], [[1, 1, 1], [1, 1, "1 + 2^-20"]], [[1, 0, 0], [0, 1, 0]], [[1, 0, 0], [0, 1, 0]]] }
Q = []
R = { list = [{ identity = 2 }, { identity = 2 }, { identity = 2, scale = "2^-40" }, { identity = 2 }, { identity = 2 }] }
P0 = { identity = 3 }
steps = 5
)";

Explained explain_late(const std::string& filters) {
  return explain(properties::read_system_text(late, properties::Format::toml, "test"), select_filters(filters), {});
}

std::string story(const Explanation& e) {
  std::string text;
  for (const auto& sentence : e.sentences) text += sentence + "\n";
  return text;
}

}  // namespace

TEST(Explain, FindsTheStepThatCostTheDigits) {
  const Explained explained = explain_late("^(ckf|srcf)$");
  const Explanation &ckf = explained.filters[0], &srcf = explained.filters[1];
  ASSERT_FALSE(ckf.losses.empty());
  const Loss& most = ckf.losses.front();
  EXPECT_EQ(most.step, 2);
  // k(Re) is of the size of 1/d^2 = 2^40, as in (6.3): P is no longer the identity, which moves it by a small factor.
  EXPECT_NEAR(std::log2(most.innovation_condition), 40, 5);
  EXPECT_GT(most.digits, ckf.lost / 2);
  EXPECT_NE(story(ckf).find(" at step 2, where "), std::string::npos) << story(ckf);
  EXPECT_NE(story(ckf).find("k(Re) = "), std::string::npos) << story(ckf);
  // (4.1), (4.2): the one loses k(Re), the other its root.
  EXPECT_LT(srcf.lost, ckf.lost / 2 + 1);
}

TEST(Explain, LossesAddUpToWhatWasLost) {
  for (const Explanation& e : explain_late("").filters) {
    if (e.refused) continue;
    double sum = 0;
    for (const Loss& loss : e.losses) sum += loss.digits;
    EXPECT_LE(sum, e.lost * (1 + 1e-12)) << e.filter->id;
    // Five steps, of which three are kept: at least three fifths.
    EXPECT_GE(sum, e.lost * 3 / 5) << e.filter->id;
    for (std::size_t i = 1; i < e.losses.size(); ++i) EXPECT_LE(e.losses[i].digits, e.losses[i - 1].digits);
  }
}

TEST(Explain, KnowsTheEntriesAndTheCancellations) {
  const Explained explained = explain_late("^ckf$");
  const Explanation& ckf = explained.filters[0];
  ASSERT_EQ(ckf.entries.rows(), 3);
  EXPECT_GT(ckf.entries.maxCoeff(), 0);
  ASSERT_TRUE(ckf.cancellations);
  // det Re is what is left of two numbers of equal size: 1/d of them in its Cholesky factor, 40 bits.
  EXPECT_GE(ckf.cancellations->half_word, 1);
  EXPECT_EQ(ckf.cancellations->step, 2);
  EXPECT_GE(ckf.cancellations->any, ckf.cancellations->half_word);
  EXPECT_GT(ckf.cancellations->additions, ckf.cancellations->any);
}

TEST(Explain, TellsAnAsymmetry) {
  const Explained explained =
      explain(find_system("asymmetry-divergence", {{}, 200, {}}), select_filters("^(ckf|ckf-gain)$"), {});
  EXPECT_EQ(explained.filters[0].asymmetry, 0);
  EXPECT_GT(explained.filters[1].asymmetry, 0.5);
  EXPECT_EQ(story(explained.filters[0]).find("asymmetry"), std::string::npos);
  EXPECT_NE(story(explained.filters[1]).find("Its error is an asymmetry"), std::string::npos);
}

// One step inverts an A of condition number 2^30; the others are the identity.
TEST(Explain, NamesWhatCostsAnInformationForm) {
  const auto system = properties::read_system_text(R"(
name = "nearly-singular"
A = { list = [[[1, 0], [0, 1]], [[1, 0], [0, 1]], [[1, 1], [1, "1 + 2^-29"]], [[1, 0], [0, 1]]] }
B = [[1, 0], [0, 1]]
C = [[1, 0], [0, 1]]
Q = { identity = 2 }
R = { identity = 2 }
P0 = { identity = 2 }
steps = 4
)",
                                                   properties::Format::toml, "test");
  const Explained explained = explain(system, select_filters("^(srif|ckf)$"), {});
  const Explanation &ckf = explained.filters[0], &srif = explained.filters[1];
  ASSERT_EQ(srif.filter->id, "srif");
  ASSERT_FALSE(srif.losses.empty());
  const Loss& most = srif.losses.front();
  EXPECT_EQ(most.step, 3) << "step k takes A of k - 1";
  EXPECT_NEAR(std::log2(most.information.A), 31, 1);  // k(A) = 4 / 2^-29
  EXPECT_GT(most.digits, srif.lost / 2);
  EXPECT_LT(ckf.lost, 2) << "it inverts no A";
  EXPECT_NE(story(srif).find("k(A) = "), std::string::npos) << story(srif);
  EXPECT_NE(story(srif).find("A is inverted"), std::string::npos) << story(srif);
  EXPECT_EQ(loss_table(explained).rows[1].size(), loss_table(explained).header.size());
  // What is stored says the same.
  const auto read = std::get<StoredRun>(read_results(run_json({explained.run}), "results.json"));
  const Explained stored = explain(read.systems.front());
  EXPECT_EQ(stored.filters[1].sentences.front(), srif.sentences.front());
}

// A weak prior: what is held is right, and P, made from it, is not.
TEST(Explain, KnowsThatPIsMadeFromAnInformationRoot) {
  const Explained explained = explain(find_system("weak-prior", {}), select_filters("^(srif|information)$"), {});
  for (const Explanation& e : explained.filters) EXPECT_NE(story(e).find("k(T) = "), std::string::npos) << story(e);
}

TEST(Explain, TellsWhatWasRefusedAndWhatBrokeDown) {
  const Explained explained = explain_late("^(csrf|ckf)$");
  ASSERT_EQ(explained.filters.size(), 2u);
  EXPECT_NE(story(explained.filters[1]).find("It was not run: csrf needs"), std::string::npos)
      << story(explained.filters[1]);
  EXPECT_EQ(loss_table(explained).rows.size(), 2u);
}

TEST(ExplainStored, SaysTheSameOfTheCurves) {
  const Explained live = explain_late("^(ckf|srcf|joseph)$");
  const auto read = std::get<StoredRun>(read_results(run_json({live.run}), "results.json"));
  ASSERT_EQ(read.systems.size(), 1u);
  const Explained stored = explain(read.systems.front());
  ASSERT_EQ(stored.filters.size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(stored.filters[i].lost, live.filters[i].lost);
    ASSERT_EQ(stored.filters[i].losses.size(), live.filters[i].losses.size());
    EXPECT_EQ(stored.filters[i].losses.front().step, live.filters[i].losses.front().step);
    EXPECT_EQ(stored.filters[i].losses.front().innovation_condition,
              live.filters[i].losses.front().innovation_condition);
    EXPECT_EQ(stored.filters[i].entries.size(), 0);
    EXPECT_FALSE(stored.filters[i].cancellations);
    EXPECT_EQ(stored.filters[i].sentences.front(), live.filters[i].sentences.front());
  }
}

TEST(ExplainPage, DrawsLossesCostsAndEntries) {
  const auto document = explain_document({explain_late("^(ckf|srcf)$")});
  std::vector<const reports::Figure*> figures;
  for (const auto& block : document.sections.at(0).blocks)
    if (const auto* figure = std::get_if<reports::Figure>(&block)) figures.push_back(figure);
  ASSERT_EQ(figures.size(), 3u);
  EXPECT_EQ(figures[0]->curves.size(), 2u);
  EXPECT_EQ(figures[1]->curves.size(), 3u);
  EXPECT_TRUE(figures[2]->maps.matrix);
  EXPECT_EQ(figures[2]->maps.panels.size(), 2u);
  EXPECT_EQ(figures[2]->maps.panels[0].values.size(), 9u);
}
