#include <kfstab/properties/system_file.hpp>

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <map>
#include <tuple>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <kfstab/properties/csv.hpp>
#include <kfstab/properties/data.hpp>
#include <kfstab/properties/exact.hpp>
#include <kfstab/properties/expression.hpp>
#include <kfstab/properties/node.hpp>

namespace kfstab::properties {

namespace {

/// A file of this size holds some million numbers; its tree takes some hundred times as much memory.
constexpr std::uintmax_t largest_file = std::uintmax_t{8} << 20;
/// Larger models are not for text files, and { identity = 1000000 } is a slip.
constexpr Index largest_dimension = 1000;
/// What stands in the place of a measurement that is not there.
constexpr std::string_view missing = "missing";
constexpr double largest_steps = 9007199254740992.0;  // 2^53: every step has a number in double

std::string in_quotes(std::string_view text) {
  return '"' + std::string(text.substr(0, 60)) + (text.size() > 60 ? "...\"" : "\"");
}

std::string joined(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text;
}

std::string kind(const Node& node) {
  struct Visitor {
    std::string operator()(double x) const { return fmt::format("{}", x); }
    std::string operator()(std::int64_t i) const { return fmt::format("{}", i); }
    std::string operator()(const std::string& text) const { return in_quotes(text); }
    std::string operator()(const Node::List& list) const { return list.empty() ? "an empty list" : "a list"; }
    std::string operator()(const Node::Table&) const { return "a table"; }
    std::string operator()(const Node::Other& other) const { return other.kind; }
  };
  return std::visit(Visitor{}, node.value);
}

std::string shape_of(Index rows, Index cols) { return fmt::format("{} x {}", rows, cols); }

/// What shape a matrix must have; -1 is a size that the matrix itself decides.
struct Shape {
  Index rows = -1;
  Index cols = -1;
  std::string_view words;  ///< "n x m"

  std::string expected() const {
    if (rows >= 0 && cols >= 0) return fmt::format("{} ({})", shape_of(rows, cols), words);
    if (rows >= 0) return fmt::format("{} rows ({})", rows, words);
    if (cols >= 0) return fmt::format("{} columns ({})", cols, words);
    return std::string(words);
  }
};

class Reader {
 public:
  Reader(const Node& root, std::string origin, std::filesystem::path folder, const Overrides& overrides)
      : root_(root), origin_(std::move(origin)), folder_(std::move(folder)), overrides_(overrides) {}

  System system() {
    require_known_keys(*root_.table(), "",
                       {"name", "description", "source", "parameters", "A", "B", "C", "D", "Q", "Q_root", "R", "R_root", "P0",
                        "S0", "x0", "steps", "measurements", "inputs"});
    read_texts();
    read_parameters();
    read_steps();
    read_model();
    read_data();
    return std::move(system_);
  }

 private:
  // --- where and what -------------------------------------------------------------------------------------------------

  Place place(const Node& node, std::string field) const {
    return {origin_, node.line, node.column, node.pointer, std::move(field)};
  }
  [[noreturn]] void refuse(const Node& node, const std::string& field, std::string found, std::string expected) const {
    throw InputError(place(node, field), std::move(found), std::move(expected));
  }

  static const Node* member(const Node::Table& table, std::string_view key) {
    const auto found = std::ranges::find(table, key, &Node::Member::key);
    return found == table.end() ? nullptr : &found->node;
  }
  const Node* top(std::string_view key) const { return member(*root_.table(), key); }
  const Node& required(std::string_view key, std::string_view what) const {
    if (const Node* node = top(key)) return *node;
    throw InputError({origin_, 0, 0, {}, std::string(key)}, "no such key", std::string(what));
  }

  void require_known_keys(const Node::Table& table, std::string_view field, const std::vector<std::string>& known) const {
    for (const auto& [key, node] : table)
      if (std::ranges::find(known, key) == known.end())
        refuse(node, field.empty() ? key : fmt::format("{}.{}", field, key), "an unknown key " + in_quotes(key),
               "one of " + joined(known) + did_you_mean(key, known));
  }

  // --- numbers --------------------------------------------------------------------------------------------------------

  std::string number_words() const {
    std::vector<std::string> names;
    for (const auto& [name, value] : system_.parameters) names.push_back(name);
    return names.empty() ? "a number or an expression" : "a number or an expression of " + joined(names);
  }

  /// An entry as doubles have it, and its text where that is exact and no double.
  struct Entry {
    double value = 0;
    std::string exact;
  };

  Entry entry(const Node& node, const std::string& field) const {
    Entry entry;
    if (const auto* real = std::get_if<double>(&node.value)) {
      entry.value = *real;
    } else if (const auto* integer = std::get_if<std::int64_t>(&node.value)) {
      entry.value = static_cast<double>(*integer);
    } else if (const auto* text = node.text()) {
      entry = entry_of(node, field, *text);
    } else {
      refuse(node, field, kind(node), number_words());
    }
    if (!std::isfinite(entry.value))
      refuse(node, field, std::isnan(entry.value) ? "nan" : "an infinity", "a finite number");
    return entry;
  }

  /// What is written in quotes: a number, or the name of a parameter that is one, exactly; an expression in double.
  Entry entry_of(const Node& node, const std::string& field, const std::string& text) const {
    try {
      const auto parameter = exact_parameters_.find(text);
      const std::string& literal = parameter == exact_parameters_.end() ? text : parameter->second;
      const auto exact = read_exact(literal);
      if (!exact) return {(*expressions_)(text), {}};
      const double nearest = reference::round_to_double(*exact);
      if (!std::isfinite(nearest)) throw ExpressionError(in_quotes(text) + ", which is beyond the range of double");
      if (nearest == 0 && !exact->is_zero())
        throw ExpressionError(in_quotes(text) + ", which is not 0 but nearer to it than to any other double");
      return {nearest, *exact == reference::Rational(nearest) ? std::string() : literal};
    } catch (const ExpressionError& error) {
      refuse(node, field, error.what(), number_words() + error.hint());
    }
  }

  double number(const Node& node, const std::string& field) const { return entry(node, field).value; }

  /// An entry, read into its place.
  template <class Derived>
  void read_entry(const Node& node, const std::string& field, Eigen::MatrixBase<Derived>& X, Index i, Index j,
                  std::vector<ExactEntry>& exact) const {
    Entry read = entry(node, field);
    X(i, j) = read.value;
    if (!read.exact.empty()) exact.push_back({0, i, j, std::move(read.exact)});
  }

  Index size(const Node& node, const std::string& field) const {
    const auto* value = std::get_if<std::int64_t>(&node.value);
    if (!value || *value < 0 || *value > largest_dimension)
      refuse(node, field, kind(node), fmt::format("an integer from 0 to {}", largest_dimension));
    return static_cast<Index>(*value);
  }

  // --- texts, parameters, steps ---------------------------------------------------------------------------------------

  void read_texts() {
    const Node& name = required("name", "the system's name, a text");
    if (!name.text()) refuse(name, "name", kind(name), "a text");
    const auto plain = [](char c) {
      return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_' || c == '.';
    };
    // It becomes a part of file names.
    if (name.text()->empty() || name.text()->size() > 100 || name.text()->front() == '.' || name.text()->front() == '-' ||
        !std::ranges::all_of(*name.text(), plain))
      refuse(name, "name", in_quotes(*name.text()), "1 to 100 letters, digits, '-', '_' or '.', a letter or a digit first");
    system_.name = *name.text();
    for (const auto& [key, target] :
         {std::pair{"description", &system_.description}, std::pair{"source", &system_.source}})
      if (const Node* node = top(key)) {
        if (!node->text()) refuse(*node, key, kind(*node), "a text");
        *target = *node->text();
      }
  }

  /// Parameters may be expressions of each other, in any order.
  void read_parameters() {
    std::map<std::string, std::pair<const Node*, const std::string*>> open;  // what is still an expression
    std::vector<std::string> known;
    if (const Node* node = top("parameters")) {
      if (!node->table()) refuse(*node, "parameters", kind(*node), "a table of names and values");
      for (const auto& [name, value] : *node->table()) {
        if (!Expressions::is_name(name))
          refuse(value, "parameters." + name, "the name " + in_quotes(name),
                 "letters, digits and '_', no digit first, and neither pi nor a function (" +
                     joined(Expressions::function_names()) + ")");
        known.push_back(name);
        const auto overriding = overrides_.parameters.find(name);
        if (overriding != overrides_.parameters.end())
          open[name] = {&value, &overriding->second};
        else if (value.text())
          open[name] = {&value, value.text()};
        else
          system_.parameters[name] = number(value, "parameters." + name);  // a double, never more
      }
    }
    for (const auto& [name, value] : overrides_.parameters)
      if (std::ranges::find(known, name) == known.end())
        throw InputError({origin_, 0, 0, {}, "parameters." + name}, "a value for " + in_quotes(name) + ", which the file does not define",
                         known.empty() ? "none: the file has no [parameters]" : "one of " + joined(known) + did_you_mean(name, known));

    while (!open.empty()) {
      bool progress = false;
      for (auto open_parameter = open.begin(); open_parameter != open.end();) {
        const auto& [name, source] = *open_parameter;
        const auto& [node, text] = source;
        expressions_ = std::make_unique<Expressions>(system_.parameters);
        const std::vector<std::string> uses = expressions_->names_in(*text);
        if (std::ranges::any_of(uses, [&](const std::string& used) { return open.contains(used); })) {
          ++open_parameter;
          continue;
        }
        Entry read = entry_of(*node, "parameters." + name, *text);
        system_.parameters[name] = read.value;
        if (!read.exact.empty()) exact_parameters_[name] = std::move(read.exact);
        open_parameter = open.erase(open_parameter);
        progress = true;
      }
      if (!progress) {
        const auto& [name, source] = *open.begin();
        refuse(*source.first, "parameters." + name, in_quotes(*source.second) + ", which leads back to itself",
               "parameters that can be computed one after the other");
      }
    }
    expressions_ = std::make_unique<Expressions>(system_.parameters);
  }

  void read_steps() {
    const Node& node = required("steps", "the number of steps, an integer >= 1");
    const double steps = number(node, "steps");
    if (steps < 1 || steps > largest_steps || steps != std::floor(steps))
      refuse(node, "steps", node.text() ? fmt::format("{} = {}", in_quotes(*node.text()), steps) : kind(node), "an integer >= 1");
    written_steps_ = static_cast<std::int64_t>(steps);
    system_.steps = overrides_.steps.value_or(written_steps_);
    if (system_.steps < 1) refuse(node, "steps", fmt::format("{} instead of it", system_.steps), "an integer >= 1");
  }

  /// What is given for each step has a length: that of the file's own steps.
  void require_one_a_step(const Node& node, const std::string& field, std::size_t length, std::string_view what) const {
    if (static_cast<std::int64_t>(length) != written_steps_)
      refuse(node, field, fmt::format("{} {}", length, what), fmt::format("{}, one for each step", written_steps_));
    if (system_.steps > written_steps_)
      refuse(node, field, fmt::format("{} {}", length, what),
             fmt::format("{} for the {} steps that are asked for instead of {}", system_.steps, system_.steps, written_steps_));
  }

  // --- matrices -------------------------------------------------------------------------------------------------------

  Sequence from_rows(const Node& node, const Node::List& rows, const std::string& field, const Shape& shape) const {
    const Index count = static_cast<Index>(rows.size());
    if (count > largest_dimension) refuse(node, field, fmt::format("{} rows", count), fmt::format("at most {}", largest_dimension));
    Sequence read(Matrix<double>(0, std::max<Index>(shape.cols, 0)));
    Matrix<double>& X = read.matrices.front();
    for (Index i = 0; i < count; ++i) {
      const Node& row = rows[static_cast<std::size_t>(i)];
      const std::string row_field = fmt::format("{}[{}]", field, i);
      const Node::List* entries = row.list();
      if (!entries) refuse(row, row_field, kind(row), fmt::format("a row: {} is a list of rows, [[...], [...]], even if there is one", field));
      const Index width = static_cast<Index>(entries->size());
      if (i == 0) {
        if (width > largest_dimension)
          refuse(row, row_field, fmt::format("{} columns", width), fmt::format("at most {}", largest_dimension));
        X.resize(count, width);
      }
      if (width != X.cols())
        refuse(row, row_field, fmt::format("a row of {} entries", width), fmt::format("{}, as the first row has", X.cols()));
      for (Index j = 0; j < width; ++j)
        read_entry((*entries)[static_cast<std::size_t>(j)], fmt::format("{}[{},{}]", field, i, j), X, i, j, read.exact);
    }
    return read;
  }

  Sequence from_table(const Node& node, const Node::Table& table, const std::string& field, bool over_time) const {
    std::vector<std::string> known = {"diagonal", "identity", "scale"};
    if (over_time) known.insert(known.end(), {"list", "period"});
    require_known_keys(table, field, known);
    const Node* diagonal = member(table, "diagonal");
    const Node* identity = member(table, "identity");
    const Node* scale = member(table, "scale");
    if (!diagonal == !identity || (scale && !identity))
      refuse(node, field, "a table that is none of these", "{ diagonal = [...] }, { identity = n } or { identity = n, scale = s }");
    if (identity) {
      const Index n = size(*identity, field + ".identity");
      Entry factor{1, {}};
      if (scale) factor = entry(*scale, field + ".scale");
      Sequence read(Matrix<double>(Matrix<double>::Identity(n, n) * factor.value));
      for (Index i = 0; i < n && !factor.exact.empty(); ++i) read.exact.push_back({0, i, i, factor.exact});
      return read;
    }
    const Node::List* entries = diagonal->list();
    if (!entries) refuse(*diagonal, field + ".diagonal", kind(*diagonal), "a list of numbers");
    const Index n = static_cast<Index>(entries->size());
    if (n > largest_dimension)
      refuse(*diagonal, field + ".diagonal", fmt::format("{} entries", n), fmt::format("at most {}", largest_dimension));
    Sequence read(Matrix<double>(Matrix<double>::Zero(n, n)));
    for (Index i = 0; i < n; ++i)
      read_entry((*entries)[static_cast<std::size_t>(i)], fmt::format("{}.diagonal[{}]", field, i),
                 read.matrices.front(), i, i, read.exact);
    return read;
  }

  /// One matrix, as a constant sequence.
  Sequence matrix(const Node& node, const std::string& field, const Shape& shape, bool over_time = false) const {
    Sequence read;
    if (const Node::List* rows = node.list()) {
      read = from_rows(node, *rows, field, shape);
    } else if (const Node::Table* table = node.table()) {
      read = from_table(node, *table, field, over_time);
    } else {
      read.matrices.front().resize(1, 1);
      read_entry(node, field, read.matrices.front(), 0, 0, read.exact);
    }
    const Matrix<double>& X = read.matrices.front();
    const bool square = shape.rows < 0 && shape.cols < 0;
    if ((shape.rows >= 0 && X.rows() != shape.rows) || (shape.cols >= 0 && X.cols() != shape.cols) ||
        (square && X.rows() != X.cols()))
      refuse(node, field, "a " + shape_of(X.rows(), X.cols()) + " matrix", shape.expected());
    return read;
  }

  /// Calls check(node, field, matrix) for each matrix as it is read: what is wrong has a place only now.
  template <class Check>
  Sequence sequence(const Node& node, const std::string& field, Shape shape, Check check) const {
    const auto read = [&](const Node& item, const std::string& item_field, bool over_time) {
      Sequence one = matrix(item, item_field, shape, over_time);
      check(item, item_field, one);
      shape.rows = one.rows();
      shape.cols = one.cols();
      return one;
    };
    const Node::Table* table = node.table();
    for (const auto& [key, of_kind] : {std::pair{"list", Sequence::Kind::list}, std::pair{"period", Sequence::Kind::periodic}}) {
      const Node* items = table ? member(*table, key) : nullptr;
      if (!items) continue;
      const std::string items_field = field + "." + key;
      if (table->size() > 1) refuse(node, field, "more keys beside " + in_quotes(key), "no other key");
      if (!items->list() || items->list()->empty()) refuse(*items, items_field, kind(*items), "a list of matrices, at least one");
      if (of_kind == Sequence::Kind::list) require_one_a_step(*items, items_field, items->list()->size(), "matrices");
      Sequence all(of_kind, {});
      all.matrices.reserve(items->list()->size());
      for (std::size_t k = 0; k < items->list()->size(); ++k) {
        Sequence one = read((*items->list())[k], fmt::format("{}[{}]", items_field, k), false);
        if (of_kind == Sequence::Kind::list && static_cast<std::int64_t>(k) >= system_.steps) continue;
        all.matrices.push_back(std::move(one.matrices.front()));
        for (ExactEntry& entry : one.exact) all.exact.push_back({k, entry.row, entry.col, std::move(entry.text)});
      }
      return all;
    }
    return read(node, field, true);
  }
  Sequence sequence(const Node& node, const std::string& field, const Shape& shape) const {
    return sequence(node, field, shape, [](const Node&, const std::string&, const Sequence&) {});
  }

  /// The node of an entry where it was written as rows; else that of the matrix.
  static const Node& node_of_entry(const Node& node, Index i, Index j) {
    if (const Node::List* rows = node.list())
      if (const Node::List* row = (*rows)[static_cast<std::size_t>(i)].list()) return (*row)[static_cast<std::size_t>(j)];
    return node;
  }

  /// The doubles, which filters take, and what was written have to be covariances both. Of singular ones only
  /// entries that were not rounded tell whether they are.
  void require_covariance(const Node& node, const std::string& field, const Sequence& read) const {
    const Matrix<double>& X = read.matrices.front();
    for (Index i = 0; i < X.rows(); ++i)
      for (Index j = 0; j < i; ++j)
        if (X(i, j) != X(j, i))
          refuse_asymmetric(node, field, i, j, fmt::format("{}", X(i, j)), fmt::format("{}", X(j, i)));
    if (const auto wrong = admissible_covariance(X)) refuse(node, field, *wrong, "a positive semidefinite matrix");
    if (read.exact.empty()) return;

    const Matrix<reference::Rational> exact = exact_matrix(read, 0);
    for (Index i = 0; i < X.rows(); ++i)
      for (Index j = 0; j < i; ++j)
        if (exact(i, j) != exact(j, i))
          refuse_asymmetric(node, field, i, j, exact(i, j).str() + " exactly", exact(j, i).str() + " exactly");
    if (written_exactly(read, 0) && !reference::no_negative_eigenvalue(exact))
      refuse(node, field, "a matrix with a negative eigenvalue, by its exact entries",
             "a positive semidefinite matrix");
  }

  [[noreturn]] void refuse_asymmetric(const Node& node, const std::string& field, Index i, Index j,
                                      const std::string& found, const std::string& opposite) const {
    refuse(node_of_entry(node, i, j), fmt::format("{}[{},{}]", field, i, j), found,
           fmt::format("{}, the same as {}[{},{}]: a covariance is symmetric", opposite, field, j, i));
  }

  void require_lower(const Node& node, const std::string& field, const Sequence& read) const {
    const Matrix<double>& X = read.matrices.front();
    for (Index j = 0; j < X.cols(); ++j)
      for (Index i = 0; i < j; ++i)
        if (X(i, j) != 0)
          refuse(node_of_entry(node, i, j), fmt::format("{}[{},{}]", field, i, j), fmt::format("{}", X(i, j)),
                 "0: a root is lower triangular");
  }

  Covariance covariance(std::string_view name, std::string_view root_name, const Shape& shape, bool over_time) const {
    const Node* plain = top(name);
    const Node* root = top(root_name);
    if (plain && root)
      refuse(*root, std::string(root_name), fmt::format("both {} and {}", name, root_name), "one of them");
    if (!plain && !root)
      throw InputError({origin_, 0, 0, {}, std::string(name)}, "no such key",
                       fmt::format("{}, a covariance ({}), or {}, a lower root of it", name, shape.words, root_name));
    Covariance result;
    result.written = root ? Covariance::Written::root : Covariance::Written::covariance;
    const std::string field(root ? root_name : name);
    const auto check = [&](const Node& node, const std::string& item_field, const Sequence& read) {
      if (root)
        require_lower(node, item_field, read);
      else
        require_covariance(node, item_field, read);
    };
    const Node& node = root ? *root : *plain;
    if (over_time) {
      result.value = sequence(node, field, shape, check);
    } else {
      result.value = matrix(node, field, shape);
      check(node, field, result.value);
    }
    return result;
  }

  void read_model() {
    const auto nothing = " (no columns, [[], ...], where there is none)";
    system_.A = sequence(required("A", "the transition matrix (n x n)"), "A", {-1, -1, "n x n, square"});
    const Index n = system_.A.rows();
    const Node& B = required("B", fmt::format("the noise input matrix (n x m){}", nothing));
    const Node& C = required("C", "the output matrix (p x n), [] where there is no output");

    // With no states, B = [] says nothing of its columns: Q does.
    if (n == 0) {
      system_.Q = covariance("Q", "Q_root", {-1, -1, "m x m"}, true);
      system_.B = sequence(B, "B", {0, system_.Q.value.rows(), "n x m"});
    } else {
      system_.B = sequence(B, "B", {n, -1, "n x m"});
      const Index m = system_.B.cols();
      system_.Q = covariance("Q", "Q_root", {m, m, "m x m"}, true);
    }
    system_.C = sequence(C, "C", {-1, n, "p x n"});
    const Index p = system_.C.rows();
    system_.R = covariance("R", "R_root", {p, p, "p x p"}, true);
    system_.P0 = covariance("P0", "S0", {n, n, "n x n"}, false);
    const Node* D = top("D");
    system_.D = D ? sequence(*D, "D", {n, -1, "n x inputs"}) : Sequence(Matrix<double>(n, 0));

    system_.x0 = Vector<double>::Zero(n);
    if (const Node* x0 = top("x0")) {
      if (const Node::List* entries = x0->list()) {
        if (static_cast<Index>(entries->size()) != n)
          refuse(*x0, "x0", fmt::format("{} entries", entries->size()), fmt::format("{} (n)", n));
        for (Index i = 0; i < n; ++i)
          read_entry((*entries)[static_cast<std::size_t>(i)], fmt::format("x0[{}]", i), system_.x0, i, 0,
                     system_.exact_x0);
      } else if (n == 1) {
        read_entry(*x0, "x0", system_.x0, 0, 0, system_.exact_x0);
      } else {
        refuse(*x0, "x0", kind(*x0), fmt::format("a list of {} numbers (n)", n));
      }
    }
  }

  // --- data -----------------------------------------------------------------------------------------------------------

  /// One row a step, or a CSV file with one: width x steps, a step a column, as a constant sequence.
  Sequence rows_of_data(const Node& node, const std::string& field, const std::string& column, Index width,
                        Gaps gaps) const {
    if (const Node::Table* table = node.table()) {
      const Node* csv = member(*table, "csv");
      if (!csv || !csv->text()) refuse(csv ? *csv : node, field + ".csv", csv ? kind(*csv) : "no such key", "the name of a CSV file");
      // A file name is looked for beside the system file; an absolute one stands as it is.
      const std::filesystem::path file = folder_ / *csv->text();
      Matrix<double> data;
      try {
        data = read_csv(file, column, width, gaps);
      } catch (const InputError& error) {
        if (error.place().line > 0) throw;
        refuse(*csv, field + ".csv", error.place().origin + ", " + error.found(), error.expected());
      }
      require_one_a_step(*csv, field, static_cast<std::size_t>(data.cols()), "rows in " + file.string());
      return Sequence(std::move(data));
    }
    const Node::List* rows = node.list();
    if (!rows) refuse(node, field, kind(node), "a list of rows, one for each step, or { csv = \"file.csv\" }");
    require_one_a_step(node, field, rows->size(), "rows");
    Sequence read(Matrix<double>(width, static_cast<Index>(rows->size())));
    Matrix<double>& data = read.matrices.front();
    const auto read_datum = [&](const Node& datum, const std::string& datum_field, Index i, Index k) {
      if (gaps == Gaps::allowed && datum.text() && *datum.text() == missing)
        data(i, k) = std::numeric_limits<double>::quiet_NaN();
      else
        read_entry(datum, datum_field, data, i, k, read.exact);
    };
    for (Index k = 0; k < data.cols(); ++k) {
      const Node& row = (*rows)[static_cast<std::size_t>(k)];
      const Node::List* entries = row.list();
      if (!entries && width == 1) {
        read_datum(row, fmt::format("{}[{}]", field, k), 0, k);
        continue;
      }
      if (!entries || static_cast<Index>(entries->size()) != width)
        refuse(row, fmt::format("{}[{}]", field, k), entries ? fmt::format("{} entries", entries->size()) : kind(row),
               fmt::format("a row of {}", width));
      for (Index i = 0; i < width; ++i)
        read_datum((*entries)[static_cast<std::size_t>(i)], fmt::format("{}[{},{}]", field, k, i), i, k);
    }
    return read;
  }

  void read_data() {
    const Node* measurements = top("measurements");
    const Node* inputs = top("inputs");
    if (inputs && system_.inputs() == 0) refuse(*inputs, "inputs", "inputs without a D", "a D (n x inputs) that they act through");
    if (inputs && !measurements) refuse(*inputs, "inputs", "inputs without measurements", "both or none: without measurements no state is computed");
    if (!measurements) return;
    if (system_.inputs() > 0 && !inputs)
      throw InputError({origin_, 0, 0, {}, "inputs"}, "no such key", fmt::format("the {} inputs of each step, for D has {} columns", system_.inputs(), system_.inputs()));

    Sequence u;
    if (inputs) u = rows_of_data(*inputs, "inputs", "u", system_.inputs(), Gaps::refused);

    if (const Node::Table* table = measurements->table()) {
      require_known_keys(*table, "measurements", {"csv", "simulate"});
      if (table->size() != 1) refuse(*measurements, "measurements", fmt::format("{} keys", table->size()), "one of csv and simulate");
      if (const Node* simulate = member(*table, "simulate")) {
        if (!simulate->table()) refuse(*simulate, "measurements.simulate", kind(*simulate), "{ seed = 1 }");
        require_known_keys(*simulate->table(), "measurements.simulate", {"seed"});
        const Node* seed = member(*simulate->table(), "seed");
        const auto* value = seed ? std::get_if<std::int64_t>(&seed->value) : nullptr;
        if (!value || *value < 0)
          refuse(seed ? *seed : *simulate, "measurements.simulate.seed", seed ? kind(*seed) : "no such key", "an integer >= 0");
        system_.data =
            std::make_shared<Simulated>(system_, overrides_.seed.value_or(static_cast<std::uint64_t>(*value)),
                                        std::move(u.matrices.front()), std::move(u.exact));
        return;
      }
    }
    Sequence y = rows_of_data(*measurements, "measurements", "y", system_.dimensions().p, Gaps::allowed);
    system_.data = std::make_shared<Recorded>(std::move(y.matrices.front()), std::move(u.matrices.front()),
                                              std::move(y.exact), std::move(u.exact));
  }

  const Node& root_;
  std::string origin_;
  std::filesystem::path folder_;
  const Overrides& overrides_;
  std::map<std::string, std::string> exact_parameters_;  ///< those that were written exactly and are no doubles
  std::unique_ptr<Expressions> expressions_ = std::make_unique<Expressions>(std::map<std::string, double>{});
  std::int64_t written_steps_ = 0;
  System system_;
};

// --- writing ------------------------------------------------------------------------------------------------------------

std::string text_literal(const std::string& text) {
  std::string literal = "\"";
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '"' || c == '\\')
      literal += std::string("\\") + c;
    else if (c == '\n')
      literal += "\\n";
    else if (byte < 0x20 || byte == 0x7F)
      literal += fmt::format("\\u{:04X}", byte);
    else
      literal += c;
  }
  return literal + '"';
}

/// The shortest that reads back as x. An integer has no negative zero; only measurements are NaN, those that are missing.
std::string number_literal(double x) {
  if (std::isnan(x)) return text_literal(std::string(missing));
  return x == 0 && std::signbit(x) ? "-0.0" : fmt::format("{}", x);
}

/// What was written exactly, where it still holds.
class Literals {
 public:
  Literals(const std::vector<ExactEntry>& entries) {
    for (const ExactEntry& entry : entries) texts_[{entry.matrix, entry.row, entry.col}] = &entry;
  }
  std::string operator()(double x, std::size_t matrix, Index row, Index col) const {
    const auto found = texts_.find({matrix, row, col});
    return found == texts_.end() || exact_value(*found->second, x) == reference::Rational(x)
               ? number_literal(x)
               : text_literal(found->second->text);
  }

 private:
  std::map<std::tuple<std::size_t, Index, Index>, const ExactEntry*> texts_;
};

template <class Entry>
std::string row_literal(Index size, Entry entry) {
  std::string text = "[";
  for (Index j = 0; j < size; ++j) text += (j > 0 ? ", " : "") + entry(j);
  return text + "]";
}
/// A column that is written as a row: x0, or the data of one step.
std::string column_literal(const Vector<double>& x, const Literals& literals, Index col = 0) {
  return row_literal(x.size(), [&](Index i) { return literals(x(i), 0, i, col); });
}

std::string matrix_literal(const Matrix<double>& X, const Literals& literals, std::size_t k,
                           const std::string& indent) {
  if (X.rows() == 0) return "[]";
  std::string text = "[\n";
  for (Index i = 0; i < X.rows(); ++i)
    text += indent + "  " + row_literal(X.cols(), [&](Index j) { return literals(X(i, j), k, i, j); }) + ",\n";
  return text + indent + "]";
}

std::string sequence_literal(const Sequence& sequence) {
  const Literals literals(sequence.exact);
  if (sequence.kind == Sequence::Kind::constant) return matrix_literal(sequence.at(0), literals, 0, "");
  std::string text = sequence.kind == Sequence::Kind::list ? "{ list = [\n" : "{ period = [\n";
  for (std::size_t k = 0; k < sequence.matrices.size(); ++k)
    text += "  " + matrix_literal(sequence.matrices[k], literals, k, "  ") + ",\n";
  return text + "] }";
}

}  // namespace

System read_system(const std::filesystem::path& path, const Overrides& overrides) {
  const std::string text = read_text(path, largest_file, " bytes in a system file (measurements may be in a CSV file)");
  return read_system_text(text, path.extension() == ".json" ? Format::json : Format::toml, path.string(), overrides,
                          path.parent_path());
}

System read_system_text(std::string_view text, Format format, std::string origin, const Overrides& overrides,
                        const std::filesystem::path& folder) {
  const Node root = format == Format::json ? parse_json(text, origin) : parse_toml(text, origin);
  return Reader(root, std::move(origin), folder, overrides).system();
}

std::string write_system(const System& system) {
  std::string text = "name = " + text_literal(system.name) + "\n";
  if (!system.description.empty()) text += "description = " + text_literal(system.description) + "\n";
  if (!system.source.empty()) text += "source = " + text_literal(system.source) + "\n";
  text += fmt::format("steps = {}\n\n", system.steps);

  const auto write = [&text](std::string_view key, const Sequence& sequence) {
    text += fmt::format("{} = {}\n", key, sequence_literal(sequence));
  };
  const auto write_covariance = [&](std::string_view name, std::string_view root_name, const Covariance& Q) {
    write(Q.written == Covariance::Written::root ? root_name : name, Q.value);
  };
  write("A", system.A);
  write("B", system.B);
  write("C", system.C);
  if (system.inputs() > 0) write("D", system.D);
  write_covariance("Q", "Q_root", system.Q);
  write_covariance("R", "R_root", system.R);
  write_covariance("P0", "S0", system.P0);
  text += "x0 = " + column_literal(system.x0, system.exact_x0) + "\n";

  const auto* simulated = dynamic_cast<const Simulated*>(system.data.get());
  std::string inputs, measurements;
  if (simulated) {
    const Literals u(simulated->exact_inputs());
    measurements = fmt::format("{{ simulate = {{ seed = {} }} }}", simulated->seed());
    for (Index k = 0; k < std::min<std::int64_t>(simulated->inputs().cols(), system.steps); ++k)
      inputs += "  " + column_literal(simulated->inputs().col(k), u, k) + ",\n";
  } else if (system.data) {
    const auto* recorded = dynamic_cast<const Recorded*>(system.data.get());
    const std::vector<ExactEntry> none;
    const Literals y(recorded ? recorded->exact_y() : none), u(recorded ? recorded->exact_u() : none);
    const auto stream = system.data->open();
    measurements = "[\n";
    for (Index k = 0; k < system.steps; ++k) {
      const StepData& step = stream->next();
      measurements += "  " + column_literal(step.y, y, k) + ",\n";
      inputs += "  " + column_literal(step.u, u, k) + ",\n";
    }
    measurements += "]";
  }
  if (system.data) text += "measurements = " + measurements + "\n";
  if (system.data && system.inputs() > 0) text += "inputs = [\n" + inputs + "]\n";

  if (!system.parameters.empty()) text += "\n[parameters]\n";
  for (const auto& [name, value] : system.parameters) text += fmt::format("{} = {}\n", name, number_literal(value));
  return text;
}

}  // namespace kfstab::properties
