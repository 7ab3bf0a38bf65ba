#pragma once

#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace kfstab::properties {

/// Where in somebody's input something stands. What is not known is left empty (line and column: 0).
struct Place {
  std::string origin;   ///< the file as it was named, or "standard input", "catalogue"
  int line = 0;         ///< counted from 1
  int column = 0;       ///< counted from 1
  std::string pointer;  ///< JSON pointer, where the format has no lines: "/A/1/0"
  std::string field;    ///< "A[1,0]": row, column, both counted from 0
};

/// Input that is refused. what() is one line that needs no context:
///
///     tracking.toml:12:9: A[1,0]: found "dt", expected a number or an expression of the parameters q, T
class InputError : public std::runtime_error {
 public:
  InputError(Place place, std::string found, std::string expected);

  const Place& place() const { return place_; }
  const std::string& found() const { return found_; }
  const std::string& expected() const { return expected_; }

 private:
  Place place_;
  std::string found_;
  std::string expected_;
};

/// The known names that a mistyped name may have meant: those within a third of its length in edits (at least 1; a
/// swap of neighbours counts as one, case as none), nearest first, three at most.
std::vector<std::string> near_misses(std::string_view name, std::span<const std::string> known);

/// The same as the end of a message: "; did you mean 'period'?" or "".
std::string did_you_mean(std::string_view name, std::span<const std::string> known);

}  // namespace kfstab::properties
