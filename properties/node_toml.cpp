#include <kfstab/properties/node.hpp>

#include <toml++/toml.h>

namespace kfstab::properties {

namespace {

Node convert(const toml::node& source) {
  Node node;
  node.line = static_cast<int>(source.source().begin.line);
  node.column = static_cast<int>(source.source().begin.column);
  switch (source.type()) {
    case toml::node_type::integer: node.value = source.as_integer()->get(); break;
    case toml::node_type::floating_point: node.value = source.as_floating_point()->get(); break;
    case toml::node_type::string: node.value = source.as_string()->get(); break;
    case toml::node_type::array: {
      Node::List list;
      list.reserve(source.as_array()->size());
      for (const toml::node& item : *source.as_array()) list.push_back(convert(item));
      node.value = std::move(list);
      break;
    }
    case toml::node_type::table: {
      Node::Table table;
      for (const auto& [key, item] : *source.as_table()) table.push_back({std::string(key.str()), convert(item)});
      node.value = std::move(table);
      break;
    }
    case toml::node_type::boolean: node.value = Node::Other{"a boolean"}; break;
    case toml::node_type::date:
    case toml::node_type::time:
    case toml::node_type::date_time: node.value = Node::Other{"a date or time"}; break;
    case toml::node_type::none: node.value = Node::Other{"nothing"}; break;
  }
  return node;
}

}  // namespace

Node parse_toml(std::string_view text, const std::string& origin) {
  try {
    return convert(toml::parse(text, origin));
  } catch (const toml::parse_error& error) {
    const toml::source_position at = error.source().begin;
    throw InputError({origin, static_cast<int>(at.line), static_cast<int>(at.column), {}, {}}, std::string(error.description()),
                     "TOML");
  }
}

}  // namespace kfstab::properties
