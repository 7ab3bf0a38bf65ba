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

}  // namespace
}  // namespace kfstab::reports
