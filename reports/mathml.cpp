#include <kfstab/reports/mathml.hpp>

#include <algorithm>
#include <array>
#include <cctype>
#include <stdexcept>
#include <utility>
#include <vector>

#include <fmt/format.h>

namespace kfstab::reports {
namespace {

using Pair = std::pair<std::string_view, std::string_view>;

constexpr std::array<Pair, 23> greek{{{"alpha", "α"}, {"beta", "β"},  {"gamma", "γ"}, {"delta", "δ"},  {"epsilon", "ε"},
                                      {"eta", "η"},   {"theta", "θ"}, {"kappa", "κ"}, {"lambda", "λ"}, {"mu", "μ"},
                                      {"nu", "ν"},    {"pi", "π"},    {"rho", "ρ"},   {"sigma", "σ"},  {"tau", "τ"},
                                      {"phi", "φ"},   {"omega", "ω"}, {"Delta", "Δ"}, {"Lambda", "Λ"}, {"Phi", "Φ"},
                                      {"Sig", "Σ"},   {"Theta", "Θ"}, {"Omega", "Ω"}}};
constexpr std::array<std::string_view, 12> functions{"diag", "cos",  "sin", "max", "min",   "log",
                                                     "exp",  "sqrt", "sup", "inf", "trace", "sum"};
// Longer ones first.
constexpr std::array<Pair, 17> operators{{{"...", "…"},
                                          {":=", "≔"},
                                          {"<=", "≤"},
                                          {">=", "≥"},
                                          {"!=", "≠"},
                                          {"->", "→"},
                                          {"=", "="},
                                          {"<", "&lt;"},
                                          {">", "&gt;"},
                                          {"~", "∼"},
                                          {"+", "+"},
                                          {"-", "−"},
                                          {"/", "/"},
                                          {"*", "*"},
                                          {",", ","},
                                          {";", ";"},
                                          {":", ":"}}};

bool is_letter(char c) { return std::isalpha(static_cast<unsigned char>(c)) != 0; }
bool is_digit(char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; }

std::string escaped(std::string_view text) {
  std::string result;
  for (const char c : text) {
    switch (c) {
      case '<': result += "&lt;"; break;
      case '>': result += "&gt;"; break;
      case '&': result += "&amp;"; break;
      case '"': result += "&quot;"; break;
      case '\'': result += "&#39;"; break;
      default: result += c;
    }
  }
  return result;
}

std::string row(const std::string& content) { return "<mrow>" + content + "</mrow>"; }
std::string upright(std::string_view name) { return fmt::format("<mi mathvariant=\"normal\">{}</mi>", name); }
std::string fence(std::string_view sign) {
  return fmt::format("<mo stretchy=\"false\" lspace=\"0\" rspace=\"0\">{}</mo>", sign);
}

struct Unreadable : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class Parser {
 public:
  explicit Parser(std::string_view text) : text_(text) {}

  std::string all() {
    const std::string result = sequence("");
    if (at_ != text_.size()) throw Unreadable("something is left");
    return result;
  }

 private:
  char peek(std::size_t ahead = 0) const { return at_ + ahead < text_.size() ? text_[at_ + ahead] : '\0'; }
  bool starts(std::string_view what) const { return text_.substr(at_).starts_with(what); }
  bool ends(std::string_view closing) const { return !closing.empty() && starts(closing); }
  void expect(std::string_view what) {
    if (!starts(what)) throw Unreadable("a partner is missing");
    at_ += what.size();
  }

  /// Everything up to `closing`, which is left, or the end.
  std::string sequence(std::string_view closing) {
    std::string before;                // up to the last operator
    std::vector<std::string> product;  // since then
    bool spaced = false;
    const auto flush = [&] {
      for (const std::string& factor : product) before += factor;
      product.clear();
    };
    while (at_ < text_.size() && !ends(closing)) {
      if (peek() == ' ') {
        ++at_;
        spaced = true;
        continue;
      }
      if (peek() == ')' || peek() == ']' || peek() == '}') throw Unreadable("a partner is missing");
      if (starts("/ ") && at_ > 0 && text_[at_ - 1] == ' ' && !product.empty() && fraction(product)) continue;
      if (const std::string sign = operation(); !sign.empty()) {
        flush();
        before += sign;
        continue;
      }
      if (spaced && !product.empty()) product.push_back("<mspace width=\"0.15em\"/>");
      spaced = false;
      product.push_back(factor(closing));
    }
    flush();
    return before;
  }

  /// The product so far over the one factor that follows. Not if another follows that: a / b c may mean either.
  bool fraction(std::vector<std::string>& product) {
    const std::size_t start = at_;
    ++at_;
    while (peek() == ' ') ++at_;
    const bool parenthesised = peek() == '(';
    const std::size_t from = at_;
    if (!parenthesised && !is_letter(peek()) && !is_digit(peek())) return at_ = start, false;
    std::string below = factor("");
    // Parentheses around all that is below say what the line says already.
    if (parenthesised && text_[at_ - 1] == ')') {
      at_ = from + 1;
      below = row(sequence(")"));
      expect(")");
    }
    std::size_t next = at_;
    while (next < text_.size() && text_[next] == ' ') ++next;
    if (next < text_.size() && (is_letter(text_[next]) || is_digit(text_[next]) || text_[next] == '('))
      return at_ = start, false;
    std::string above;
    for (const std::string& one : product) above += one;
    product = {"<mfrac>" + row(above) + row(below) + "</mfrac>"};
    return true;
  }

  std::string operation() {
    for (const auto& [sign, shown] : operators)
      if (starts(sign)) {
        at_ += sign.size();
        if (sign == "/") return fence(sign);
        // Two blanks stand between equations.
        return fmt::format("<mo>{}</mo>{}", shown, starts("  ") ? "<mspace width=\"1.5em\"/>" : "");
      }
    return "";
  }

  /// A name, a number or something in brackets, with its scripts.
  std::string factor(std::string_view closing) {
    std::string below, above;
    std::string base = primary(closing, below);
    for (;;) {
      if (peek() == '\'') {
        ++at_;
        above += upright("T");
      } else if (peek() == '+' && raised_plus()) {
        ++at_;
        above += "<mo>+</mo>";
      } else if (peek() == '_' && above.empty()) {
        ++at_;
        below += script();
      } else if (peek() == '^') {
        ++at_;
        if (!above.empty()) base = row(scripted(base, std::exchange(below, ""), std::exchange(above, "")));
        above = script();
        // A transposed power: the T goes to the whole.
        if (peek() == '\'') base = row(scripted(base, std::exchange(below, ""), std::exchange(above, "")));
      } else {
        return scripted(base, below, above);
      }
    }
  }

  /// P+ but not k+1 nor a + b.
  bool raised_plus() const {
    const char next = peek(1);
    return next == '\0' || std::string_view(" '),;|]}^_").find(next) != std::string_view::npos;
  }

  std::string scripted(const std::string& base, const std::string& below, const std::string& above) const {
    if (below.empty() && above.empty()) return base;
    if (above.empty()) return "<msub>" + base + row(below) + "</msub>";
    if (below.empty()) return "<msup>" + base + row(above) + "</msup>";
    return "<msubsup>" + base + row(below) + row(above) + "</msubsup>";
  }

  std::string script() {
    if (peek() == '{') {
      ++at_;
      in_script_ = true;
      std::string content = sequence("}");
      in_script_ = false;
      expect("}");
      return content;
    }
    std::string sign;
    if (peek() == '-') ++at_, sign = "<mo>−</mo>";
    if (is_digit(peek())) return sign + number();
    if (is_letter(peek())) {
      std::string below;
      const std::string base = name(below);
      return sign + scripted(base, below, "");
    }
    throw Unreadable("an empty script");
  }

  std::string primary(std::string_view closing, std::string& below) {
    const char c = peek();
    if (is_digit(c) || (c == '.' && is_digit(peek(1)))) return number();
    if (is_letter(c)) return name(below);
    if (c == '(') return bracketed(")");
    if (c == '{') return bracketed("}");
    if (c == '[') return matrix();
    if (starts("||")) return bars("||", "‖");
    if (c == '|') return bars("|", "|");
    if (ends(closing)) throw Unreadable("a factor is missing");
    // Whatever else: one character of any length in UTF-8, as it is.
    std::size_t size = 1;
    while ((static_cast<unsigned char>(peek(size)) & 0xc0u) == 0x80u) ++size;
    const std::string_view other = text_.substr(at_, size);
    at_ += size;
    return fmt::format("<mo>{}</mo>", escaped(other));
  }

  std::string number() {
    std::size_t end = at_;
    while (end < text_.size() && (is_digit(text_[end]) || text_[end] == '.')) ++end;
    if (end < text_.size() && text_[end] == 'e') {
      std::size_t exponent = end + 1;
      if (exponent < text_.size() && (text_[exponent] == '-' || text_[exponent] == '+')) ++exponent;
      if (exponent < text_.size() && is_digit(text_[exponent])) {
        end = exponent;
        while (end < text_.size() && is_digit(text_[end])) ++end;
      }
    }
    const std::string_view digits = text_.substr(at_, end - at_);
    at_ = end;
    return fmt::format("<mn>{}</mn>", digits);
  }

  std::string_view word() const {
    std::size_t end = at_;
    while (end < text_.size() && is_letter(text_[end])) ++end;
    return text_.substr(at_, end - at_);
  }

  /// Neither a name nor a function: part of a sentence.
  static bool is_prose(std::string_view word) {
    if (word.size() < 2 || (word.size() == 2 && (std::isupper(word[0]) || word[0] == 'd'))) return false;
    return std::ranges::find(greek, word, &Pair::first) == greek.end() &&
           std::ranges::find(functions, word) == functions.end() &&
           !std::ranges::all_of(word, [](char c) { return std::isupper(c); });
  }

  std::string prose() {
    const std::size_t start = at_;
    std::size_t end = at_;
    while (is_prose(word())) {
      at_ += word().size();
      end = at_;
      while (peek() == ' ') ++at_;
    }
    at_ = end;
    return fmt::format("<mtext>&#xa0;{}&#xa0;</mtext>", text_.substr(start, end - start));
  }

  /// A name, and in `below` the subscript that is part of it.
  std::string name(std::string& below) {
    const std::string_view name = word();
    if (is_prose(name)) return prose();
    at_ += name.size();
    std::string shown;
    if (const auto letter = std::ranges::find(greek, name, &Pair::first); letter != greek.end()) {
      shown = fmt::format("<mi>{}</mi>", letter->second);
    } else if (name.size() == 1) {
      shown = in_script_ && name == "T" ? upright(name) : fmt::format("<mi>{}</mi>", name);
    } else if (name.size() == 2 && std::islower(name[1]) && name[0] != 'd') {
      shown = fmt::format("<mi>{}</mi>", name[0]);
      below = fmt::format("<mi>{}</mi>", name[1]);
    } else if (name.size() == 2 && name[0] == 'd') {
      shown = row(upright("d") + fmt::format("<mi>{}</mi>", name[1]));  // a differential
    } else if (std::ranges::find(functions, name) != functions.end()) {
      shown = upright(name);
    } else {
      for (const char c : name) shown += fmt::format("<mi>{}</mi>", c);
      shown = row(shown);
    }
    if (is_digit(peek())) below += number();
    return peek() == '(' ? row(shown + "<mo>&#x2061;</mo>") : shown;
  }

  std::string bracketed(std::string_view closing) {
    // The number of a coding, "(iv)": no product.
    const std::size_t end = text_.find(closing, at_);
    const bool apart = at_ == 0 || text_[at_ - 1] == ' ';
    if (apart && end != text_.npos && end > at_ + 1 && text_.find_first_not_of("iv", at_ + 1) == end) {
      const std::string_view number = text_.substr(at_, end + 1 - at_);
      at_ = end + 1;
      return fmt::format("<mtext>{}</mtext>", number);
    }
    const std::string_view opening = text_.substr(at_++, 1);
    const std::string content = sequence(closing);
    expect(closing);
    return row(fence(opening) + content + fence(closing));
  }

  std::string bars(std::string_view sign, std::string_view shown) {
    const std::size_t start = at_;
    at_ += sign.size();
    // One that has no partner stands between: k|k.
    if (in_script_ || text_.find(sign, at_) == text_.npos) return fence(shown);
    try {
      const std::string content = sequence(sign);
      expect(sign);
      return row(fence(shown) + content + fence(shown));
    } catch (const Unreadable&) {
      at_ = start + sign.size();
      return fence(shown);
    }
  }

  std::string matrix() {
    std::size_t depth = 0, end = at_;
    std::vector<std::vector<std::string_view>> rows(1);
    std::size_t from = at_ + 1;
    for (; end < text_.size(); ++end) {
      const char c = text_[end];
      if (c == '[' || c == '(' || c == '{') ++depth;
      if (c == ']' || c == ')' || c == '}') --depth;
      const bool over = depth == 0 && c == ']';
      if (over || (depth == 1 && (c == ';' || c == ','))) {
        rows.back().push_back(text_.substr(from, end - from));
        from = end + 1;
      }
      if (over) break;
      if (depth == 1 && c == ';') rows.emplace_back();
    }
    if (end == text_.size()) throw Unreadable("a partner is missing");
    at_ = end + 1;
    std::string table;
    for (const auto& entries : rows) {
      table += "<mtr>";
      for (const std::string_view entry : entries) table += "<mtd>" + Parser(entry).all() + "</mtd>";
      table += "</mtr>";
    }
    return row("<mo>[</mo><mtable>" + table + "</mtable><mo>]</mo>");
  }

  std::string_view text_;
  std::size_t at_ = 0;
  bool in_script_ = false;
};

}  // namespace

std::string render_mathml(std::string_view equation) {
  std::string content;
  try {
    content = Parser(equation).all();
  } catch (const Unreadable&) {
    content = "<mtext>" + escaped(equation) + "</mtext>";
  }
  return "<math display=\"block\">" + row(content) + "</math>";
}

}  // namespace kfstab::reports
