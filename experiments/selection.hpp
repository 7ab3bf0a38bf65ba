#pragma once

#include <functional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include <kfstab/filters/metadata.hpp>

namespace kfstab::experiments {

/// Nothing matched: exit code 5.
class NothingSelected : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// What a regular expression selects of names: those in which it is found; those in which it is not, after a leading
/// '-'; everything if it is empty. ECMAScript syntax, as std::regex. Throws properties::InputError, with
/// `what` for its place, for an expression that is none.
class Selection {
 public:
  explicit Selection(const std::string& expression, const std::string& what);
  bool operator()(std::string_view name) const;

 private:
  std::function<bool(std::string_view)> matches_;
};

/// The filters of the registry that --filters selects, in its order. Throws NothingSelected.
std::vector<const Metadata*> select_filters(const std::string& expression);

}  // namespace kfstab::experiments
