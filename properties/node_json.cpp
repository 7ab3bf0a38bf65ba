#include <kfstab/properties/node.hpp>

#include <algorithm>
#include <limits>

#include <nlohmann/json.hpp>

namespace kfstab::properties {

namespace {

/// A key as a part of a JSON pointer.
std::string escaped(const std::string& key) {
  std::string text;
  for (const char c : key) {
    if (c == '~')
      text += "~0";
    else if (c == '/')
      text += "~1";
    else
      text += c;
  }
  return text;
}

/// Builds the tree from the parser's events: a parsed nlohmann::json would have lost duplicate keys.
class Builder : public nlohmann::json_sax<nlohmann::json> {
 public:
  explicit Builder(const std::string& origin) : origin_(origin) {}

  Node root;

  bool null() override { return add(Node::Other{"null"}); }
  bool boolean(bool) override { return add(Node::Other{"a boolean"}); }
  bool number_integer(number_integer_t value) override { return add(std::int64_t{value}); }
  bool number_unsigned(number_unsigned_t value) override {
    if (value <= static_cast<number_unsigned_t>(std::numeric_limits<std::int64_t>::max()))
      return add(static_cast<std::int64_t>(value));
    return add(static_cast<double>(value));
  }
  bool number_float(number_float_t value, const string_t&) override { return add(value); }
  bool string(string_t& value) override { return add(std::string(value)); }
  bool binary(binary_t&) override { return add(Node::Other{"binary data"}); }
  bool start_object(std::size_t) override { return open(Node::Table{}); }
  bool start_array(std::size_t) override { return open(Node::List{}); }
  bool end_object() override { return close(); }
  bool end_array() override { return close(); }

  bool key(string_t& name) override {
    const auto& table = std::get<Node::Table>(open_.back()->value);
    if (std::ranges::any_of(table, [&](const auto& member) { return member.key == name; }))
      throw InputError({origin_, 0, 0, open_.back()->pointer + "/" + escaped(name), {}}, "this key a second time",
                       "each key once");
    if (table.size() == most_keys)
      throw InputError({origin_, 0, 0, open_.back()->pointer, {}}, "more than " + std::to_string(most_keys) + " keys", "a system");
    key_ = name;
    return true;
  }

  bool parse_error(std::size_t position, const std::string&, const nlohmann::json::exception& error) override {
    // "[json.exception.parse_error.101] parse error at line 3, column 4: ..." is prefixed for programmers.
    std::string what = error.what();
    if (const auto end = what.find("] "); end != std::string::npos) what.erase(0, end + 2);
    throw InputError({origin_, 0, 0, {}, {}}, what + " (byte " + std::to_string(position) + ")", "JSON");
  }

 private:
  static constexpr std::size_t deepest = 64;
  static constexpr std::size_t most_keys = 1000;

  Node* place(Node node) {
    if (open_.empty()) {
      root = std::move(node);
      return &root;
    }
    Node& parent = *open_.back();
    if (auto* list = std::get_if<Node::List>(&parent.value)) {
      node.pointer = parent.pointer + "/" + std::to_string(list->size());
      return &list->emplace_back(std::move(node));
    }
    auto& table = std::get<Node::Table>(parent.value);
    node.pointer = parent.pointer + "/" + escaped(key_);
    table.push_back({key_, std::move(node)});
    return &table.back().node;
  }

  template <class Value>
  bool add(Value value) {
    Node node;
    node.value = std::move(value);
    place(std::move(node));
    return true;
  }

  // A node that is open is the last of its parent, and its parent gets no other before it is closed: the pointers hold.
  template <class Value>
  bool open(Value value) {
    if (open_.size() == deepest)
      throw InputError({origin_, 0, 0, open_.back()->pointer, {}}, "values nested deeper than " + std::to_string(deepest),
                       "a system");
    Node node;
    node.value = std::move(value);
    open_.push_back(place(std::move(node)));
    return true;
  }

  bool close() {
    open_.pop_back();
    return true;
  }

  const std::string& origin_;
  std::vector<Node*> open_;
  std::string key_;
};

}  // namespace

Node parse_json(std::string_view text, const std::string& origin) {
  Builder builder(origin);
  nlohmann::json::sax_parse(text.begin(), text.end(), &builder);
  if (!builder.root.table()) throw InputError({origin, 0, 0, {}, {}}, "a file that holds no table", "{ \"name\": ..., \"A\": ... }");
  return std::move(builder.root);
}

}  // namespace kfstab::properties
