#include <kfstab/reports/html.hpp>

#include <regex>
#include <set>
#include <stdexcept>

#include <kfstab/reports/gnuplot.hpp>
#include <kfstab/reports/plot.hpp>

#include "reports/scratch.hpp"

using namespace kfstab::reports;

namespace {

class Html : public ScratchFolder {};

Figure figure(const std::string& id) {
  return {.id = id,
          .title = "title of " + id,
          .caption = "question of " + id,
          .x = {"steps of " + id},
          .y = {"error of " + id, true},
          .curves = {{.id = "a", .label = "curve of " + id, .x = {0, 1, 2}, .y = {3e-16, 7e-16, 5e-16}}}};
}

Document sample_document() {
  Document document{.title = "The title", .subtitle = "The subtitle", .sections = {}, .context = {{"seed", "42"}, {"compiler", "g++"}}};
  document.sections.push_back({.anchor = "first-claim",
                               .title = "First claim",
                               .verdict = Verdict::confirmed,
                               .blocks = {Paragraph{"Some prose"}, Paragraph{"said so", "Labelled"}, Equations{{{"P+ = A P A'", "ckf"}}}, figure("one"), Checks{{{"slope of one", 0.5, 0.49, "within 10 %", true}, {"other", 1, 2e-9, "below", false}}}}});
  document.sections.push_back({.anchor = "second-claim", .title = "Second claim", .verdict = Verdict::refuted, .blocks = {figure("two"), Preformatted{"a  b\n c"}}});
  document.sections.push_back({.anchor = "timing",
                               .title = "Timing",
                               .verdict = std::nullopt,
                               .blocks = {Table{.caption = "Times", .header = {"filter", "ns"}, .rows = {{"ckf", "120"}, {"srcf"}}, .alignment = {Alignment::left, Alignment::right}}}});
  return document;
}

std::string no_picture(const Figure&) { return ""; }

std::string fake_svg(const Figure& drawn) {
  return "<?xml version=\"1.0\"?>\n<svg  onload=\"if (x) gnuplot_svg.Init(evt)\" viewBox=\"0 0 1 1\"><script>gnuplot_svg = function</script>"
         "<g id=\"figure_" + drawn.id + "_plot_1\"/><script>gnuplot_svg.plot_xmin = 1;</script></svg>\n";
}

}  // namespace

TEST_F(Html, SaysAllThatTheDocumentSays) {
  const std::string page = render_html(sample_document(), fake_svg);
  for (const char* text :
       {"<title>The title</title>", "<h1>The title</h1>", "The subtitle", "href=\"#first-claim\"", "id=\"first-claim\"", "First claim", "confirmed", "refuted",
        "1 of 2", "1 confirmed, 1 refuted", "Some prose", "question of one", "title of one: error of one against steps of one", "slope of one", ">0.5<", ">0.49<",
        ">2e-9<", "within 10 %", "a  b\n c", "<caption>Times</caption>", "<th scope=\"col\" class=\"right\">ns</th>", "<th scope=\"row\" class=\"left\">ckf</th>",
        "<td class=\"right\">120</td>", "<th scope=\"row\">curve of one</th>", ">3e-16<", ">7e-16<", ">5e-16<", "<dt>seed</dt><dd>42</dd>", "id=\"environment\"", "<strong>Labelled.</strong> said so", "<math display=\"block\">",
        "<th scope=\"row\">ckf</th>", "<a href=\"#figure-one\">Figure 1</a>. question of one", "<a href=\"#figure-two\">Figure 2</a>",
        "Also in this report", "id=\"figure-one\"", "aria-label=\"Times\""})
    EXPECT_NE(page.find(text), page.npos) << text;
  EXPECT_LT(page.find("id=\"first-claim\""), page.find("id=\"second-claim\""));
  EXPECT_LT(page.find("<h2>Verdicts</h2>"), page.find("<section"));
}

TEST_F(Html, EveryKeyOfTheTemplateHasAValue) {
  // A key that is missing becomes empty text without a word: so each text is made recognisable, and no element is empty.
  const std::string page = render_html(sample_document(), fake_svg);
  EXPECT_EQ(page.find("{{"), page.npos);
  EXPECT_FALSE(std::regex_search(page, std::regex("<(a|p|pre|h1|h2|dt|dd|title|caption|figcaption|summary|th)( [^>]*)?></"))) << page;
  EXPECT_FALSE(std::regex_search(page, std::regex(" (id|class|href|aria-label|aria-labelledby)=\"#?\"")));
}

TEST_F(Html, EscapesAllText) {
  const std::string evil = "<script>alert('1')</script>\"&";
  Document document = sample_document();
  document.title = document.subtitle = evil;
  document.context = {{evil, evil}};
  Figure drawn = figure("one");
  drawn.title = drawn.caption = drawn.x.label = drawn.y.label = drawn.curves[0].label = evil;
  document.sections = {{.anchor = "a\"b",
                        .title = evil,
                        .verdict = Verdict::inconclusive,
                        .blocks = {Paragraph{evil, evil}, Equations{{{evil, evil}, {"(" + evil, ""}}}, Preformatted{evil}, drawn, Checks{{{evil, 1, 1, evil, true}}},
                                   Table{.caption = evil, .header = {evil}, .rows = {{evil, evil}}, .alignment = {}}}},
                       {.anchor = "b", .title = evil, .verdict = std::nullopt, .blocks = {}},
                       {.anchor = "c", .title = evil, .verdict = std::nullopt, .blocks = {}}};
  const std::string page = render_html(document, no_picture);
  EXPECT_EQ(page.find("<script>alert"), page.npos);
  EXPECT_EQ(page.find("alert('1')"), page.npos);
  EXPECT_EQ(page.find("\"a\"b\""), page.npos);
  EXPECT_GE(count(page, "&lt;script&gt;alert"), 18u);
}

TEST_F(Html, LeavesOutWhatIsNotThere) {
  const std::string page = render_html({.title = "Bare", .subtitle = "", .sections = {{.anchor = "s", .title = "S", .verdict = std::nullopt, .blocks = {}}}, .context = {}}, nullptr);
  for (const char* absent : {"<nav", "id=\"environment\"", "class=\"subtitle\"", "<h2>Verdicts", "class=\"verdict"}) EXPECT_EQ(page.find(absent), page.npos) << absent;
}

TEST_F(Html, AFigureWithoutPictureIsStillNumbers) {
  const std::string page = render_html(sample_document(), no_picture);
  EXPECT_EQ(page.find("class=\"picture\""), page.npos);
  EXPECT_EQ(page.find("In all figures"), page.npos);
  EXPECT_NE(page.find("two.csv"), page.npos);
  EXPECT_NE(page.find("<details open>"), page.npos);
}

TEST_F(Html, GnuplotsScriptServesThePageOnce) {
  const std::string page = render_html(sample_document(), fake_svg);
  EXPECT_EQ(count(page, "gnuplot_svg = function"), 1u);
  EXPECT_EQ(count(page, "<script></script>"), 1u);
  EXPECT_EQ(count(page, "gnuplot_svg.plot_xmin"), 2u);
  EXPECT_EQ(page.find("<?xml"), page.npos);
  EXPECT_EQ(page.find("onload"), page.npos);
  EXPECT_EQ(count(page, "In all figures"), 1u);
}

TEST_F(Html, RefusesWhatWouldCollideInThePage) {
  Document anchors = sample_document();
  anchors.sections[1].anchor = "first-claim";
  EXPECT_THROW(render_html(anchors, no_picture), std::invalid_argument);
  for (const char* own : {"environment", "verdicts"}) {
    anchors.sections[1].anchor = own;
    EXPECT_THROW(render_html(anchors, no_picture), std::invalid_argument);
  }
  Document figures = sample_document();
  figures.sections[1].blocks.emplace_back(figure("one"));
  EXPECT_THROW(render_html(figures, no_picture), std::invalid_argument);
}

TEST_F(Html, WithRealPicturesNeedsNoNetworkAndNamesEachCurveOnce) {
  if (!find_gnuplot()) GTEST_SKIP() << "no gnuplot here";
  const Folder out(folder / "out");
  for (const char* id : {"one", "two"}) ASSERT_EQ(write_figure(figure(id), out).warning, "");
  const std::string page = render_html(sample_document(), [&](const Figure& drawn) { return read_svg(drawn, out); });

  const std::regex loads("(src|href|url|action|data)\\s*[=(]\\s*[\"']?\\s*(https?:)?//", std::regex::icase);
  EXPECT_FALSE(std::regex_search(page, loads));
  EXPECT_EQ(page.find("@import"), page.npos);
  const std::regex address("https?://[^\"' ]*");
  for (auto match = std::sregex_iterator(page.begin(), page.end(), address); match != std::sregex_iterator(); ++match)
    EXPECT_EQ(match->str().find("http://www.w3.org/"), 0u) << match->str();

  EXPECT_EQ(count(page, "gnuplot_svg = function"), 1u);
  for (const char* name : {"figure_one", "figure_two"}) EXPECT_EQ(count(page, std::string("<g id=\"") + name + "_plot_1\""), 1u) << name;
}
