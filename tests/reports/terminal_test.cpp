#include <kfstab/reports/terminal.hpp>

#include <gtest/gtest.h>

using namespace kfstab::reports;

TEST(DisplayWidth, CountsColumnsNotBytes) {
  EXPECT_EQ(display_width(""), 0u);
  EXPECT_EQ(display_width("abc"), 3u);
  EXPECT_EQ(display_width("κ ≤ 10⁻¹⁶"), 9u);
  EXPECT_EQ(display_width("x\u0302"), 1u);   // a combining hat
  EXPECT_EQ(display_width("行列"), 4u);
  EXPECT_EQ(display_width("\U0001F600"), 2u);
}

TEST(DisplayWidth, TakesWhatIsNoUtf8ByteByByte) {
  EXPECT_EQ(display_width("\xff\xfe"), 2u);
  EXPECT_EQ(display_width("a\xc3"), 2u);          // cut off
  EXPECT_EQ(display_width("\xc0\xaf"), 2u);       // overlong
  EXPECT_EQ(display_width("\xe2\x28\xa1"), 3u);   // broken inside
}

TEST(TextTable, LinesUp) {
  const Table table{.caption = "Errors",
                    .header = {"filter", "κ"},
                    .rows = {{"ckf", "1.2e-7"}, {"行", "3"}},
                    .alignment = {Alignment::left, Alignment::right}};
  EXPECT_EQ(render_text(table),
            "Errors\n"
            "filter       κ\n"
            "------  ------\n"
            "ckf     1.2e-7\n"
            "行           3\n");
}

TEST(TextTable, CentersAndForgives) {
  const Table table{.caption = "", .header = {"a"}, .rows = {{"x", "long", "two\nlines"}, {}, {"y", "m"}}, .alignment = {Alignment::left, Alignment::center}};
  EXPECT_EQ(render_text(table),
            "a\n"
            "-  ----  ---------\n"
            "x  long  two lines\n"
            "\n"
            "y   m\n");
  EXPECT_EQ(render_text(Table{}), "");
  EXPECT_EQ(render_text(Table{.caption = "", .header = {}, .rows = {{"a", "b"}}, .alignment = {}}), "a  b\n");
}

TEST(TextVerdict, IsColoredOnlyIfAsked) {
  EXPECT_EQ(render_text(Verdict::confirmed), "confirmed");
  EXPECT_EQ(render_text(Verdict::refuted), "refuted");
  EXPECT_EQ(render_text(Verdict::inconclusive), "inconclusive");
  EXPECT_EQ(render_text(Verdict::refuted, true), "\x1b[31mrefuted\x1b[0m");
}

TEST(TextChecks, SayBothNumbersAndTheCriterion) {
  const Checks checks{{{"slope", 0.5, 0.498, "within 10 %", true}, {"growth κ", 0, 2.34e-14, "", false}}};
  EXPECT_EQ(render_text(checks),
            "ok    slope     predicted        0.5  measured      0.498\n"
            "      within 10 %\n"
            "FAIL  growth κ  predicted          0  measured   2.34e-14\n");
  EXPECT_NE(render_text(checks, true).find("\x1b[31mFAIL\x1b[0m"), std::string::npos);
  EXPECT_EQ(render_text(Checks{}), "");
}
