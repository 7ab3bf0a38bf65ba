#include <kfstab/reports/mathml.hpp>

#include <array>
#include <fstream>
#include <regex>
#include <sstream>

#include <gtest/gtest.h>

using kfstab::reports::render_mathml;

namespace {

/// Without the wrapping, and without what only makes room.
std::string inner(const std::string& equation) {
  std::string text = std::regex_replace(render_mathml(equation), std::regex("<mspace[^>]*/>"), "");
  text = std::regex_replace(text, std::regex(" (stretchy|lspace|rspace)=\"[^\"]*\""), "");
  const std::string begin = "<math display=\"block\"><mrow>", end = "</mrow></math>";
  EXPECT_EQ(text.find(begin), 0u);
  return text.substr(begin.size(), text.size() - begin.size() - end.size());
}

/// Every element is closed, in its turn, and there is none that a browser does not know.
void expect_well_formed(const std::string& text) {
  static const std::regex tag("<(/?)([a-z]+)[^>]*?(/?)>");
  std::vector<std::string> open;
  for (auto match = std::sregex_iterator(text.begin(), text.end(), tag); match != std::sregex_iterator(); ++match) {
    const std::string name = (*match)[2];
    EXPECT_TRUE(
        std::regex_match(name, std::regex("math|mrow|mi|mn|mo|mtext|mspace|msub|msup|msubsup|mfrac|mtable|mtr|mtd")))
        << name;
    if ((*match)[3].length() > 0) continue;
    if ((*match)[1].length() == 0) {
      open.push_back(name);
    } else {
      ASSERT_FALSE(open.empty()) << text;
      EXPECT_EQ(open.back(), name) << text;
      open.pop_back();
    }
  }
  EXPECT_TRUE(open.empty()) << text;
}

/// What a reader sees of it, elements apart: to hold it against the plain text.
std::string letters_of(const std::string& text) {
  std::string result;
  for (const char c : std::regex_replace(text, std::regex("<[^>]*>|&[^;]*;"), ""))
    if (std::isalnum(static_cast<unsigned char>(c))) result += c;
  return result;
}

std::vector<std::string> equations_of(const std::string& file, const std::regex& pattern) {
  std::ifstream stream(KFSTAB_SOURCE_DIR "/" + file);
  std::vector<std::string> equations;
  std::smatch match;
  for (std::string line; std::getline(stream, line);)
    if (std::regex_search(line, match, pattern)) equations.push_back(match[1]);
  return equations;
}

const std::string T = "<mi mathvariant=\"normal\">T</mi>";

}  // namespace

TEST(MathML, SetsNamesAndTheirScripts) {
  EXPECT_EQ(inner("P"), "<mi>P</mi>");
  EXPECT_EQ(inner("Re"), "<msub><mi>R</mi><mrow><mi>e</mi></mrow></msub>");
  EXPECT_EQ(inner("P0"), "<msub><mi>P</mi><mrow><mn>0</mn></mrow></msub>");
  EXPECT_EQ(inner("lambda"), "<mi>λ</mi>");
  EXPECT_EQ(inner("A'"), "<msup><mi>A</mi><mrow>" + T + "</mrow></msup>");
  EXPECT_EQ(inner("Kf'"), "<msubsup><mi>K</mi><mrow><mi>f</mi></mrow><mrow>" + T + "</mrow></msubsup>");
  EXPECT_EQ(inner("n^3"), "<msup><mi>n</mi><mrow><mn>3</mn></mrow></msup>");
  EXPECT_EQ(inner("X^{T/2}"), "<msup><mi>X</mi><mrow>" + T + "<mo>/</mo><mn>2</mn></mrow></msup>");
  EXPECT_EQ(inner("P_{k|k}"), "<msub><mi>P</mi><mrow><mi>k</mi><mo>|</mo><mi>k</mi></mrow></msub>");
  EXPECT_EQ(inner("2^-53"), "<msup><mn>2</mn><mrow><mo>−</mo><mn>53</mn></mrow></msup>");
}

TEST(MathML, APlusThatEndsANameIsASuperscriptAndOthersAdd) {
  EXPECT_EQ(inner("S+"), "<msup><mi>S</mi><mrow><mo>+</mo></mrow></msup>");
  EXPECT_EQ(inner("S+'"), "<msup><mi>S</mi><mrow><mo>+</mo>" + T + "</mrow></msup>");
  EXPECT_EQ(inner("a + b"), "<mi>a</mi><mo>+</mo><mi>b</mi>");
  EXPECT_EQ(inner("k+1"), "<mi>k</mi><mo>+</mo><mn>1</mn>");
}

TEST(MathML, DividesWhereItIsSafe) {
  EXPECT_EQ(inner("u / (1 - r)"),
            "<mfrac><mrow><mi>u</mi></mrow><mrow><mrow><mn>1</mn><mo>−</mo><mi>r</mi></mrow></mrow></mfrac>");
  EXPECT_EQ(inner("a b / c"), "<mfrac><mrow><mi>a</mi><mi>b</mi></mrow><mrow><mi>c</mi></mrow></mfrac>");
  EXPECT_EQ(inner("a/b"), "<mi>a</mi><mo>/</mo><mi>b</mi>");
  EXPECT_EQ(inner("a / b c"), "<mi>a</mi><mo>/</mo><mi>b</mi><mi>c</mi>") << "which of the two was meant?";
}

TEST(MathML, SetsMatricesAndNorms) {
  EXPECT_EQ(inner("[A S, B; 0, I]"),
            "<mrow><mo>[</mo><mtable><mtr><mtd><mi>A</mi><mi>S</mi></mtd><mtd><mi>B</mi></mtd></mtr>"
            "<mtr><mtd><mn>0</mn></mtd><mtd><mi>I</mi></mtd></mtr></mtable><mo>]</mo></mrow>");
  EXPECT_EQ(inner("|l1|^2"),
            "<msup><mrow><mo>|</mo><msub><mi>l</mi><mrow><mn>1</mn></mrow></msub><mo>|</mo></mrow><mrow><mn>2</mn></"
            "mrow></msup>");
  EXPECT_EQ(inner("||F||"), "<mrow><mo>‖</mo><mi>F</mi><mo>‖</mo></mrow>");
}

TEST(MathML, KnowsTheNumberOfACodingFromAProduct) {
  EXPECT_EQ(inner("D+ in (iv), (v)"),
            "<msup><mi>D</mi><mrow><mo>+</mo></mrow></msup><mtext>&#xa0;in&#xa0;</mtext><mtext>(iv)</mtext>"
            "<mo>,</mo><mtext>(v)</mtext>");
  EXPECT_EQ(inner("f(v)"), "<mrow><mi>f</mi><mo>&#x2061;</mo></mrow><mrow><mo>(</mo><mi>v</mi><mo>)</mo></mrow>");
}

TEST(MathML, LeavesAsTextWhatItCannotRead) {
  for (const std::string text : {"(a", "a)", "[a, b", "x_{k", "x_", "a^", "}"})
    EXPECT_EQ(inner(text), "<mtext>" + text + "</mtext>");
  EXPECT_EQ(inner("(a < b & c"), "<mtext>(a &lt; b &amp; c</mtext>");
  EXPECT_EQ(inner("Q upper, and so"),
            "<mi>Q</mi><mtext>&#xa0;upper&#xa0;</mtext><mo>,</mo><mtext>&#xa0;and so&#xa0;</mtext>");
  EXPECT_EQ(inner(""), "");
}

// Nothing is lost of any equation that the project has, and nothing is left as it was written.
TEST(MathML, ReadsEveryEquationOfTheRegistryAndOfTheTheory) {
  auto equations = equations_of("filters/registry.inc", std::regex("\\.update = \"(.*)\""));
  EXPECT_GE(equations.size(), 17u);
  // Those of the theory that stand on one line: an indented line with a sign of equality, without its number.
  const auto theory = equations_of("docs/theory.md", std::regex("^ {4}(.*[=<].*?) *(?:\\([0-9]\\.[0-9iv]+\\))?$"));
  EXPECT_GE(theory.size(), 60u);
  for (const std::string& equation : equations)
    EXPECT_EQ(render_mathml(equation).find("<mtext>" + equation), std::string::npos) << "not read: " << equation;
  equations.insert(equations.end(), theory.begin(), theory.end());
  const std::regex letter_names(
      "(^|[^A-Za-z])(alpha|beta|gamma|delta|epsilon|eta|theta|kappa|lambda|mu|nu|pi|rho|sigma|tau|phi|omega|"
      "Delta|Lambda|Phi|Sig|Theta|Omega)(?![A-Za-z])");
  std::size_t unread = 0;
  for (const std::string& equation : equations) {
    SCOPED_TRACE(equation);
    const std::string mathml = render_mathml(equation);
    expect_well_formed(mathml);
    if (mathml.find("<mrow><mtext>" + equation) != mathml.npos) ++unread;
    const std::string plain = std::regex_replace(equation, letter_names, "$1");
    const std::string transposed = std::regex_replace(plain, std::regex("'"), "T");
    EXPECT_EQ(letters_of(mathml), letters_of(transposed));
  }
  // Rows of matrices that docs/theory.md draws over several lines have one bracket each.
  EXPECT_LE(unread, 12u);
}
