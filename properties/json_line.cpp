#include <kfstab/properties/json_line.hpp>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>

#include <fmt/format.h>

namespace kfstab::properties {

namespace {

constexpr int deepest = 64;

void append(std::string& out, double value) {
  if (std::isnan(value)) {
    out += "\"nan\"";
  } else if (std::isinf(value)) {
    out += value > 0 ? "\"inf\"" : "\"-inf\"";
  } else {
    char digits[32];
    const char* end = std::to_chars(digits, digits + sizeof digits, value).ptr;
    out.append(static_cast<const char*>(digits), end);
    if (std::none_of(static_cast<const char*>(digits), end, [](char c) { return c == '.' || c == 'e'; })) out += ".0";
  }
}

void append(std::string& out, const Matrix<double>& value) {
  out += '[';
  for (Index i = 0; i < value.rows(); ++i) {
    out += i == 0 ? "[" : ",[";
    for (Index j = 0; j < value.cols(); ++j) {
      if (j > 0) out += ',';
      append(out, value(i, j));
    }
    out += ']';
  }
  out += ']';
}

void append(std::string& out, std::string_view text) {
  out += '"';
  for (const char c : text) {
    if (c == '"' || c == '\\')
      (out += '\\') += c;
    else if (static_cast<unsigned char>(c) < 0x20)
      out += fmt::format("\\u{:04x}", static_cast<unsigned>(c));
    else
      out += c;
  }
  out += '"';
}

/// A NaN counts as itself, and -0 is not 0.
bool same_bits(const Matrix<double>& X, const Matrix<double>& Y) {
  return X.rows() == Y.rows() && X.cols() == Y.cols() &&
         (X.size() == 0 || std::memcmp(X.data(), Y.data(), static_cast<std::size_t>(X.size()) * sizeof(double)) == 0);
}

std::optional<double> word_for_number(std::string_view word) {
  constexpr double huge = std::numeric_limits<double>::infinity();
  if (word == "nan") return std::numeric_limits<double>::quiet_NaN();
  if (word == "inf") return huge;
  if (word == "-inf") return -huge;
  return std::nullopt;
}

}  // namespace

// --- writing ------------------------------------------------------------------------------------------------------------

void JsonLine::name(std::string_view name) {
  text_ += text_.size() > 1 ? ",\"" : "\"";
  text_ += name;
  text_ += "\":";
}

void JsonLine::text(std::string_view name, std::string_view value) {
  this->name(name);
  append(text_, value);
}

void JsonLine::texts(std::string_view name, const std::vector<std::string>& values) {
  this->name(name);
  text_ += '[';
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (i > 0) text_ += ',';
    append(text_, std::string_view(values[i]));
  }
  text_ += ']';
}

void JsonLine::integer(std::string_view name, Index value) {
  this->name(name);
  text_ += std::to_string(value);
}

void JsonLine::number(std::string_view name, double value) {
  this->name(name);
  append(text_, value);
}

void JsonLine::vector(std::string_view name, const Vector<double>& value) {
  this->name(name);
  text_ += '[';
  for (Index i = 0; i < value.size(); ++i) {
    if (i > 0) text_ += ',';
    append(text_, value(i));
  }
  text_ += ']';
}

void JsonLine::matrix(std::string_view name, const Matrix<double>& value) {
  this->name(name);
  append(text_, value);
}

void JsonLine::matrix(std::string_view name, const Matrix<double>& value, Kept& kept) {
  if (kept.text.empty() || !same_bits(value, kept.value)) {
    kept.value = value;
    kept.text.clear();
    append(kept.text, value);
  }
  this->name(name);
  text_ += kept.text;
}

void JsonLine::truth(std::string_view name, bool value) {
  this->name(name);
  text_ += value ? "true" : "false";
}

const std::string& JsonLine::end() { return text_ += "}\n"; }

// --- reading ------------------------------------------------------------------------------------------------------------

void JsonMessage::read(std::string_view line) {
  begin_ = at_ = line.data();
  end_ = at_ + line.size();
  count_ = 0;
  numbers_.clear();
  rows_.clear();
  texts_.clear();
  if (next() != '{') throw Malformed("is not a JSON object");
  ++at_;
  if (!take('}')) {
    do {
      next();
      read_text(name_);
      if (find(name_)) throw Malformed(fmt::format("has \"{}\" twice", name_));
      expect(':');
      if (count_ == members_.size()) members_.emplace_back();
      Member& member = members_[count_];
      member.name = name_;
      read_value(member, 1);
      ++count_;
    } while (take(','));
    expect('}');
  }
  next();
  if (at_ != end_) fail("nothing more");
}

void JsonMessage::fail(const char* expected) const {
  throw Malformed(fmt::format("is not JSON: {} {}, expected {}", at_ == end_ ? "it ends" : "something else stands",
                              at_ == end_ ? fmt::format("after {} characters", end_ - begin_)
                                          : fmt::format("at character {}", at_ - begin_ + 1),
                              expected));
}

/// The next character that is no white space, not taken; 0 at the end.
char JsonMessage::next() {
  while (at_ != end_ && (*at_ == ' ' || *at_ == '\t' || *at_ == '\r')) ++at_;
  return at_ == end_ ? '\0' : *at_;
}

bool JsonMessage::take(char c) {
  if (next() != c || at_ == end_) return false;
  ++at_;
  return true;
}

void JsonMessage::expect(char c) {
  const char text[] = {'\'', c, '\'', '\0'};
  if (!take(c)) fail(text);
}

bool JsonMessage::take_word(std::string_view word) {
  if (!std::string_view(at_, static_cast<std::size_t>(end_ - at_)).starts_with(word)) return false;
  at_ += word.size();
  return true;
}

/// Depth 1 is that of the message's own members.
void JsonMessage::read_value(Member& member, int depth) {
  if (depth > deepest) fail("less depth");
  const char c = next();
  if (c == '[') {
    member.kind = Kind::array;
    read_array(member, depth);
  } else if (c == '"') {
    member.kind = Kind::text;
    read_text(member.text);
  } else if (c == '{') {
    member.kind = Kind::object;
    ++at_;
    if (take('}')) return;
    do {
      std::string ignored_name;
      next();
      read_text(ignored_name);
      expect(':');
      read_value(ignored_, depth + 1);
    } while (take(','));
    expect('}');
    member.kind = Kind::object;  // it was ignored_ itself, perhaps
  } else if (take_word("true") || take_word("false")) {
    member.kind = Kind::truth;
    member.truth = at_[-2] == 'u';
  } else if (take_word("null")) {
    member.kind = Kind::null;
  } else {
    member.kind = Kind::number;
    member.number = read_number();
  }
}

/// Of numbers, of rows of numbers, of words. What else there may be is read over.
void JsonMessage::read_array(Member& member, int depth) {
  expect('[');
  if (depth == 1) {
    member.first_number = numbers_.size();
    member.first_row = rows_.size();
    member.first_text = texts_.size();
    member.mixed = false;
  }
  std::size_t before = numbers_.size();
  bool scalars = false;
  if (!take(']')) {
    do {
      const char c = next();
      if (c == '[' && depth == 1) {
        before = numbers_.size();
        read_array(member, depth + 1);
        rows_.push_back(numbers_.size() - before);
      } else if (c == '[' || c == '{') {
        read_value(ignored_, depth + 1);
        member.mixed = true;
      } else if (c == '"') {
        read_text(name_);
        if (const auto value = word_for_number(name_)) {
          numbers_.push_back(*value);
          scalars = true;
        } else {
          texts_.push_back(name_);
          member.mixed = member.mixed || depth > 1;
        }
      } else if (take_word("null")) {
        numbers_.push_back(std::numeric_limits<double>::quiet_NaN());
        scalars = true;
      } else if (take_word("true") || take_word("false")) {
        member.mixed = true;
      } else {
        numbers_.push_back(read_number());
        scalars = true;
      }
    } while (take(','));
    expect(']');
  }
  if (depth > 1) return;
  member.numbers = numbers_.size() - member.first_number;
  member.rows = rows_.size() - member.first_row;
  member.texts = texts_.size() - member.first_text;
  if (int{scalars} + int{member.rows > 0} + int{member.texts > 0} > 1) member.mixed = true;
}

void JsonMessage::read_text(std::string& text) {
  text.clear();
  if (at_ == end_ || *at_ != '"') fail("a string");
  ++at_;
  const auto code_unit = [&] {
    unsigned value = 0;
    if (end_ - at_ < 4 || std::from_chars(at_, at_ + 4, value, 16).ptr != at_ + 4) fail("four hexadecimal digits");
    at_ += 4;
    return value;
  };
  for (;;) {
    if (at_ == end_) fail("the end of a string");
    const char c = *at_++;
    if (c == '"') return;
    if (c != '\\') {
      text += c;
      continue;
    }
    if (at_ == end_) fail("the end of a string");
    switch (const char escaped = *at_++) {
      case 'b': text += '\b'; break;
      case 'f': text += '\f'; break;
      case 'n': text += '\n'; break;
      case 'r': text += '\r'; break;
      case 't': text += '\t'; break;
      case 'u': {
        unsigned point = code_unit();
        if (point >= 0xd800 && point < 0xdc00 && take_word("\\u"))
          point = 0x10000 + ((point - 0xd800) << 10) + (code_unit() & 0x3ff);
        const auto add = [&](unsigned byte) { text += static_cast<char>(byte); };
        if (point < 0x80) {
          add(point);
        } else if (point < 0x800) {
          add(0xc0 | point >> 6), add(0x80 | (point & 0x3f));
        } else if (point < 0x10000) {
          add(0xe0 | point >> 12), add(0x80 | (point >> 6 & 0x3f)), add(0x80 | (point & 0x3f));
        } else {
          add(0xf0 | point >> 18), add(0x80 | (point >> 12 & 0x3f)), add(0x80 | (point >> 6 & 0x3f)),
              add(0x80 | (point & 0x3f));
        }
        break;
      }
      default: text += escaped;
    }
  }
}

double JsonMessage::read_number() {
  constexpr double huge = std::numeric_limits<double>::infinity();
  if (next() == '\0') fail("a value");
  if (take_word("NaN")) return std::numeric_limits<double>::quiet_NaN();
  if (take_word("Infinity")) return huge;
  if (take_word("-Infinity")) return -huge;
  if (*at_ != '-' && (*at_ < '0' || *at_ > '9')) fail("a value");
  double value = 0;
  const auto [end, error] = std::from_chars(at_, end_, value);
  if (error == std::errc::invalid_argument) fail("a number");
  // Beyond the range of double: strtod says on which side.
  if (error == std::errc::result_out_of_range) value = std::strtod(std::string(at_, end).c_str(), nullptr);
  at_ = end;
  return value;
}

// --- looking ------------------------------------------------------------------------------------------------------------

const JsonMessage::Member* JsonMessage::find(std::string_view name) const {
  for (std::size_t i = 0; i < count_; ++i)
    if (members_[i].name == name) return &members_[i];
  return nullptr;
}

std::string JsonMessage::shape(const Member& member) const {
  switch (member.kind) {
    case Kind::null: return "null";
    case Kind::truth: return "a boolean";
    case Kind::number: return "a number";
    case Kind::text: return "a string";
    case Kind::object: return "an object";
    case Kind::array: break;
  }
  if (member.mixed || (member.texts > 0 && member.rows == 0)) return "an array of other things";
  if (member.rows == 0) return fmt::format("an array of {} numbers", member.numbers);
  for (std::size_t i = 1; i < member.rows; ++i)
    if (rows_[member.first_row + i] != rows_[member.first_row])
      return fmt::format("ragged: row 0 has {} entries, row {} has {}", rows_[member.first_row], i,
                         rows_[member.first_row + i]);
  return fmt::format("{} x {}", member.rows, rows_[member.first_row]);
}

void JsonMessage::wrong(const Member& member, const std::string& expected) const {
  throw Malformed(fmt::format("has a wrong {}: it is {}, expected {}", member.name, shape(member), expected));
}

std::optional<std::string> JsonMessage::text(std::string_view name) const {
  const Member* member = find(name);
  if (!member) return std::nullopt;
  if (member->kind != Kind::text) wrong(*member, "a string");
  return member->text;
}

std::optional<std::vector<std::string>> JsonMessage::texts(std::string_view name) const {
  const Member* member = find(name);
  if (!member) return std::nullopt;
  if (member->kind != Kind::array || member->mixed || member->numbers > 0 || member->rows > 0)
    wrong(*member, "an array of strings");
  const auto first = texts_.begin() + static_cast<std::ptrdiff_t>(member->first_text);
  return std::vector<std::string>(first, first + static_cast<std::ptrdiff_t>(member->texts));
}

std::optional<bool> JsonMessage::truth(std::string_view name) const {
  const Member* member = find(name);
  if (!member) return std::nullopt;
  if (member->kind != Kind::truth) wrong(*member, "true or false");
  return member->truth;
}

std::optional<double> JsonMessage::number(std::string_view name) const {
  const Member* member = find(name);
  if (!member) return std::nullopt;
  if (member->kind == Kind::number) return member->number;
  if (member->kind == Kind::null) return std::numeric_limits<double>::quiet_NaN();
  if (member->kind == Kind::text)
    if (const auto value = word_for_number(member->text)) return value;
  wrong(*member, "a number");
}

std::optional<Index> JsonMessage::integer(std::string_view name) const {
  const auto value = number(name);
  if (!value) return std::nullopt;
  if (!(std::abs(*value) < 1e9) || *value != std::floor(*value)) wrong(*find(name), "an integer");
  return static_cast<Index>(*value);
}

Index JsonMessage::length(std::string_view name) const {
  const Member* member = find(name);
  if (!member || member->kind != Kind::array) return 0;
  return static_cast<Index>(member->rows > 0 ? member->rows : member->numbers);
}

bool JsonMessage::has_rows_of(const Member& member, std::size_t cols) const {
  const auto first = rows_.begin() + static_cast<std::ptrdiff_t>(member.first_row);
  return std::all_of(first, first + static_cast<std::ptrdiff_t>(member.rows),
                     [&](std::size_t own) { return own == cols; });
}

bool JsonMessage::vector(std::string_view name, Index size, Vector<double>& value) const {
  const Member* member = find(name);
  if (!member) return false;
  value.resize(size);
  if (member->kind == Kind::number && size == 1) {
    value(0) = member->number;
    return true;
  }
  const auto entries = static_cast<std::size_t>(size);
  if (member->kind != Kind::array || member->mixed || member->texts > 0 || member->numbers != entries ||
      !(member->rows <= 1 || has_rows_of(*member, 1)))
    wrong(*member, fmt::format("an array of {} numbers", size));
  std::copy_n(numbers_.data() + member->first_number, size, value.data());
  return true;
}

bool JsonMessage::matrix(std::string_view name, Index rows, Index cols, Matrix<double>& value) const {
  const Member* member = find(name);
  if (!member) return false;
  value.resize(rows, cols);
  if (member->kind == Kind::number && rows == 1 && cols == 1) {
    value(0, 0) = member->number;
    return true;
  }
  const auto entries = static_cast<std::size_t>(rows * cols);
  const bool array = member->kind == Kind::array && !member->mixed && member->texts == 0 && member->numbers == entries;
  const bool in_rows =
      member->rows == static_cast<std::size_t>(rows) && has_rows_of(*member, static_cast<std::size_t>(cols));
  const bool in_one = member->rows == 0 && (rows == 1 || cols == 1);
  if (!array || !(in_rows || in_one || entries == 0)) wrong(*member, fmt::format("{} x {}", rows, cols));
  const double* entry = numbers_.data() + member->first_number;
  for (Index i = 0; i < rows; ++i)
    for (Index j = 0; j < cols; ++j) value(i, j) = *entry++;
  return true;
}

}  // namespace kfstab::properties
