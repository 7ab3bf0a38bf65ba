#include <kfstab/reports/markdown.hpp>

#include <gtest/gtest.h>

namespace kfstab::reports {
namespace {

TEST(Markdown, ATableHasItsRuleAndItsAlignment) {
  const Table table{"not shown", {"id", "n"}, {{"srcf", "4"}, {"short"}}, {Alignment::left, Alignment::right}};
  EXPECT_EQ(render_markdown(table),
            "| id | n |\n"
            "| --- | ---: |\n"
            "| srcf | 4 |\n"
            "| short |  |\n");
}

TEST(Markdown, WhatWouldBeMarkupIsEscaped) {
  const Table table{"", {"a|b"}, {{"P_{k|k} *x* [y] <z> `c` \\\nnext"}}, {}};
  EXPECT_EQ(render_markdown(table),
            "| a\\|b |\n"
            "| --- |\n"
            "| P\\_{k\\|k} \\*x\\* \\[y\\] \\<z> \\`c\\` \\\\ next |\n");
}

Document sample_report() {
  Document document{"A *title*", "- no list", {}, {{"seed", "42"}}};
  Section section{"first", "First", Verdict::refuted, {}};
  section.blocks = {Paragraph{"# no heading"},
                    Paragraph{"two words", "Setup"},
                    Equations{{{"P+ = A P A'", "ckf"}, {"S+", "srcf"}}},
                    Figure{.id = "one", .title = "One", .caption = "Which?", .x = {}, .y = {}, .curves = {}},
                    Checks{{{"slope", 1, 2, "near", false}}},
                    Preformatted{"```\nkfstab"},
                    Table{"Times", {"filter"}, {{"ckf"}}, {}}};
  document.sections = {section, {"second", "Second", std::nullopt, {}}};
  return document;
}

TEST(Markdown, ADocumentBeginsWithVerdictsThatLinkToTheirSections) {
  const std::string text = render_markdown(sample_report(), [](const Figure&) { return true; });
  EXPECT_EQ(text.find("# A \\*title\\*\n\n\\- no list\n\n| | verdict |\n| --- | --- |\n| [First](#first) | refuted |\n\n"
                      "<a id=\"first\"></a>\n\n## First: refuted\n\n\\# no heading\n\n**Setup.** two words\n"),
            0u)
      << text;
  for (const char* part : {"\n```\nckf   P+ = A P A'\nsrcf  S+\n```\n", "<a id=\"figure-one\"></a>\n![One](one.svg)\n\nWhich?\n",
                           "| slope | 1 | 2 | no | near |", "\n````\n```\nkfstab\n````\n", "Times\n\n| filter |",
                           "<a id=\"environment\"></a>\n\n## Environment\n\n", "| seed | 42 |"})
    EXPECT_NE(text.find(part), text.npos) << part << "\nin\n" << text;
}

TEST(Markdown, AFigureThatWasNotDrawnIsNoBrokenPicture) {
  const std::string text = render_markdown(sample_report(), [](const Figure&) { return false; });
  EXPECT_EQ(text.find("!["), text.npos);
  EXPECT_NE(text.find("its numbers are in one.csv"), text.npos);
}

}  // namespace
}  // namespace kfstab::reports
