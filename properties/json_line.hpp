#pragma once

#include <cstddef>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include <kfstab/filters/matrix.hpp>

/// Messages of protocol 1 (docs/protocol.md): one JSON object a line, its members words, numbers, vectors and matrices.
/// Written and read here in about a microsecond each. A library's document of the answer of four states takes twelve, three times what
/// the whole way through two pipes does.
namespace kfstab::properties {

/// Puts together one line.
class JsonLine {
 public:
  void begin() { text_.assign(1, '{'); }
  void text(std::string_view name, std::string_view value);
  void texts(std::string_view name, const std::vector<std::string>& values);
  void integer(std::string_view name, Index value);
  /// The shortest decimals that read back as the same double, always with a point or an exponent, so that a language with
  /// integers takes them for what they are; "nan", "inf" and "-inf" as words.
  void number(std::string_view name, double value);
  void vector(std::string_view name, const Vector<double>& value);
  /// As an array of rows.
  void matrix(std::string_view name, const Matrix<double>& value);
  /// As `matrix`, for one that is often that of the line before: its text is kept.
  struct Kept {
    Matrix<double> value;
    std::string text;
  };
  void matrix(std::string_view name, const Matrix<double>& value, Kept& kept);
  void truth(std::string_view name, bool value);
  /// The line, with its newline.
  const std::string& end();

 private:
  void name(std::string_view name);
  std::string text_;
};

/// What is not a message: what(), as the end of a sentence, says why.
struct Malformed : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// One line, read. Members nobody asks for are none of its business. A number may be a word, as JsonLine writes it, or
/// the bare NaN and Infinity of Python, or null: a NaN.
class JsonMessage {
 public:
  /// Throws Malformed for what is not one JSON object, or has a name twice.
  void read(std::string_view line);

  bool has(std::string_view name) const { return find(name) != nullptr; }
  // Each throws Malformed if the member is there and is something else.
  std::optional<std::string> text(std::string_view name) const;
  std::optional<std::vector<std::string>> texts(std::string_view name) const;
  std::optional<bool> truth(std::string_view name) const;
  std::optional<double> number(std::string_view name) const;
  std::optional<Index> integer(std::string_view name) const;
  /// The entries of a vector, or the rows of a matrix.
  Index length(std::string_view name) const;
  /// Of one column or row, a plain array stands for a matrix, and an array of rows for a vector; of one entry, a number:
  /// so write languages in which they are the same thing. A matrix without entries may be any empty array.
  bool vector(std::string_view name, Index size, Vector<double>& value) const;
  bool matrix(std::string_view name, Index rows, Index cols, Matrix<double>& value) const;

 private:
  enum class Kind { null, truth, number, text, array, object };
  struct Member {
    std::string name;
    Kind kind = Kind::null;
    bool truth = false;
    double number = 0;
    std::string text;
    // Of an array: its numbers, all of them; how many there are in each of its rows; its words.
    std::size_t first_number = 0, numbers = 0, first_row = 0, rows = 0, first_text = 0, texts = 0;
    bool mixed = false;  ///< numbers beside rows, or something that is neither
  };

  const Member* find(std::string_view name) const;
  [[noreturn]] void wrong(const Member& member, const std::string& expected) const;
  std::string shape(const Member& member) const;
  bool has_rows_of(const Member& member, std::size_t cols) const;

  // The reader.
  [[noreturn]] void fail(const char* expected) const;
  char next();
  bool take(char c);
  void expect(char c);
  bool take_word(std::string_view word);
  void read_value(Member& member, int depth);
  void read_array(Member& member, int depth);
  void read_text(std::string& text);
  double read_number();

  std::vector<Member> members_;
  std::size_t count_ = 0;  ///< of members_, which keeps its strings from line to line
  std::vector<double> numbers_;
  std::vector<std::size_t> rows_;
  std::vector<std::string> texts_;
  std::string name_;
  Member ignored_;
  const char *begin_ = nullptr, *at_ = nullptr, *end_ = nullptr;
};

}  // namespace kfstab::properties
