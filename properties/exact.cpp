#include <kfstab/properties/exact.hpp>

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include <kfstab/properties/data.hpp>
#include <kfstab/properties/expression.hpp>
#include <kfstab/reference/error.hpp>

namespace kfstab::properties {

namespace {

using reference::Integer;
using reference::Rational;

/// Far beyond double, and far from filling the memory.
constexpr int largest_power = 10000;
constexpr std::size_t longest = 4000;  // as of an expression

/// Reads a text from its front.
class Scanner {
 public:
  explicit Scanner(std::string_view text) : rest_(text) {}

  void skip_spaces() {
    while (!rest_.empty() && (rest_.front() == ' ' || rest_.front() == '\t')) rest_.remove_prefix(1);
  }
  bool take(char c) {
    if (rest_.empty() || rest_.front() != c) return false;
    rest_.remove_prefix(1);
    return true;
  }
  std::string_view digits() {
    const std::size_t count = std::min(rest_.find_first_not_of("0123456789"), rest_.size());
    const std::string_view taken = rest_.substr(0, count);
    rest_.remove_prefix(count);
    return taken;
  }
  bool at_end() const { return rest_.empty(); }

  /// [+-] digits [. digits] [e [+-] digits], digits on one side of the point at least.
  std::optional<Rational> decimal() {
    const bool negative = take('-');
    if (!negative) take('+');
    std::string mantissa(digits());
    long power = 0;
    if (take('.')) {
      const std::string_view fraction = digits();
      mantissa += fraction;
      power = -static_cast<long>(fraction.size());
    }
    if (mantissa.empty()) return std::nullopt;
    if (take('e') || take('E')) {
      const bool small = take('-');
      if (!small) take('+');
      const std::string_view exponent = digits();
      if (exponent.empty()) return std::nullopt;
      const std::size_t first = std::min(exponent.find_first_not_of('0'), exponent.size());
      const std::string significant(exponent.substr(first, 6));
      const long size = significant.empty() ? 0 : std::stol(significant);
      if (size > largest_power)
        throw ExpressionError(fmt::format("a power of ten beyond {}{}", small ? '-' : '+', largest_power));
      power += small ? -size : size;
    }
    mantissa.erase(0, mantissa.find_first_not_of('0'));  // or the rest would be octal
    Integer numerator(mantissa.empty() ? "0" : mantissa), denominator(1);
    const Integer scale = pow(Integer(10), static_cast<unsigned>(std::abs(power)));
    (power < 0 ? denominator : numerator) *= scale;
    const Rational value(numerator, denominator);
    return negative ? Rational(-value) : value;
  }

 private:
  std::string_view rest_;
};

/// The entries that belong to matrix k.
std::pair<const ExactEntry*, const ExactEntry*> entries_of(const std::vector<ExactEntry>& entries, std::size_t k) {
  const auto first = std::ranges::lower_bound(entries, k, {}, &ExactEntry::matrix);
  const auto last = std::ranges::upper_bound(entries, k, {}, &ExactEntry::matrix);
  return {entries.data() + (first - entries.begin()), entries.data() + (last - entries.begin())};
}

bool inside(const ExactEntry& entry, Index rows, Index cols) { return entry.row < rows && entry.col < cols; }

Matrix<Rational> exact_covariance(const Covariance& Q, std::size_t k) {
  const std::size_t i = k % Q.value.matrices.size();
  return Q.written == Covariance::Written::covariance ? exact_matrix(Q.value, i)
                                                      : reference::product_of_root(exact_matrix(Q.value, i));
}

/// The data's doubles step by step, and in between what was written exactly.
class ExactStream final : public DataStreamOf<Rational> {
 public:
  ExactStream(const Data& data, const std::vector<ExactEntry>& y, const std::vector<ExactEntry>& u)
      : stream_(data.open()), y_(&y), u_(&u) {}

  const StepDataOf<Rational>& next() override {
    const StepData& step = stream_->next();
    if (!all_finite(step.y) || !all_finite(step.u))
      throw reference::ReferenceError(fmt::format("the data of step {} are not finite", k_));
    step_.y = reference::rational(step.y);
    step_.u = reference::rational(step.u);
    put(*y_, at_y_, step.y, step_.y);
    put(*u_, at_u_, step.u, step_.u);
    ++k_;
    return step_;
  }

 private:
  void put(const std::vector<ExactEntry>& entries, std::size_t& at, const Vector<double>& x,
           Vector<Rational>& exact) const {
    for (; at < entries.size() && entries[at].col == k_; ++at)
      if (entries[at].row < x.size()) exact(entries[at].row) = exact_value(entries[at], x(entries[at].row));
  }

  std::unique_ptr<DataStream> stream_;
  const std::vector<ExactEntry>*y_, *u_;
  std::size_t at_y_ = 0, at_u_ = 0;
  Index k_ = 0;
  StepDataOf<Rational> step_;
};

class ExactlyRead final : public reference::ExactData {
 public:
  explicit ExactlyRead(std::shared_ptr<const Data> data) : data_(std::move(data)) {}

  std::unique_ptr<DataStreamOf<Rational>> open() const override {
    static const std::vector<ExactEntry> none;
    if (const auto* recorded = dynamic_cast<const Recorded*>(data_.get()))
      return std::make_unique<ExactStream>(*data_, recorded->exact_y(), recorded->exact_u());
    if (const auto* simulated = dynamic_cast<const Simulated*>(data_.get()))
      return std::make_unique<ExactStream>(*data_, none, simulated->exact_inputs());
    return std::make_unique<ExactStream>(*data_, none, none);
  }

 private:
  std::shared_ptr<const Data> data_;
};

}  // namespace

std::optional<Rational> read_exact(std::string_view text) {
  if (text.size() > longest) return std::nullopt;
  Scanner scanner(text);
  scanner.skip_spaces();
  auto value = scanner.decimal();
  if (!value) return std::nullopt;
  scanner.skip_spaces();
  if (scanner.take('/')) {
    scanner.skip_spaces();
    const auto divisor = scanner.decimal();
    scanner.skip_spaces();
    if (!divisor || divisor->is_zero()) return std::nullopt;
    *value /= *divisor;
  }
  if (!scanner.at_end()) return std::nullopt;
  return value;
}

Rational exact_value(const ExactEntry& entry, double x) {
  const auto value = read_exact(entry.text);
  return value && reference::round_to_double(*value) == x ? *value : Rational(x);
}

Matrix<Rational> exact_matrix(const Sequence& sequence, std::size_t k) {
  const Matrix<double>& X = sequence.matrices[k];
  Matrix<Rational> exact = reference::rational(X);
  const auto [first, last] = entries_of(sequence.exact, k);
  for (const ExactEntry* entry = first; entry != last; ++entry)
    if (inside(*entry, X.rows(), X.cols()))
      exact(entry->row, entry->col) = exact_value(*entry, X(entry->row, entry->col));
  return exact;
}

bool written_exactly(const Sequence& sequence, std::size_t k) {
  const Matrix<double>& X = sequence.matrices[k];
  const Matrix<Rational> exact = exact_matrix(sequence, k);
  for (Index j = 0; j < X.cols(); ++j)
    for (Index i = 0; i < X.rows(); ++i)
      if (exact(i, j) == Rational(X(i, j)) && *read_exact(fmt::format("{}", X(i, j))) != exact(i, j)) return false;
  return true;
}

reference::ExactProblem exact_problem(const System& system) {
  const auto cycle = [](const Sequence& sequence) {
    std::vector<Matrix<Rational>> matrices;
    for (std::size_t k = 0; k < sequence.matrices.size(); ++k) matrices.push_back(exact_matrix(sequence, k));
    return [matrices = std::move(matrices)](std::size_t k) { return matrices[k % matrices.size()]; };
  };
  const auto A = cycle(system.A), B = cycle(system.B), C = cycle(system.C), D = cycle(system.D);
  reference::ExactProblem problem;
  problem.models.resize(system.model_count());
  for (std::size_t k = 0; k < problem.models.size(); ++k) {
    auto& model = problem.models[k];
    model.A = A(k);
    model.B = B(k);
    model.C = C(k);
    model.D = D(k);
    model.Q = exact_covariance(system.Q, k);
    model.R = exact_covariance(system.R, k);
  }
  problem.initial = exact_covariance(system.P0, 0);
  Sequence x0(Matrix<double>(system.x0));
  x0.exact = system.exact_x0;
  problem.x0 = exact_matrix(x0, 0);
  return problem;
}

std::shared_ptr<const reference::ExactData> exact_data(const System& system) {
  return system.data ? std::make_shared<ExactlyRead>(system.data) : nullptr;
}

}  // namespace kfstab::properties
