#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include <kfstab/properties/input_error.hpp>

/// What a TOML and a JSON file have in common: a tree of values that know where they stand. One reader of systems
/// serves both formats.
namespace kfstab::properties {

struct Node {
  struct Member;
  using List = std::vector<Node>;
  using Table = std::vector<Member>;
  /// Any other kind of value, by its name: "a boolean", "a date", "null".
  struct Other {
    std::string kind;
  };

  std::variant<double, std::int64_t, std::string, List, Table, Other> value;
  int line = 0;         ///< counted from 1; 0 in JSON
  int column = 0;
  std::string pointer;  ///< JSON pointer; empty in TOML

  const List* list() const { return std::get_if<List>(&value); }
  const Table* table() const { return std::get_if<Table>(&value); }
  const std::string* text() const { return std::get_if<std::string>(&value); }
};

/// One key of a table, and what it stands for.
struct Node::Member {
  std::string key;
  Node node;
};

/// Both throw InputError for what is no TOML, no JSON (a duplicate key, a number beyond double's range), and for a file
/// whose outermost value is not a table. origin stands for the file's name.
Node parse_toml(std::string_view text, const std::string& origin);
Node parse_json(std::string_view text, const std::string& origin);

}  // namespace kfstab::properties
