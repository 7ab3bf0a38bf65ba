// What a step of our filters costs, beside what else one might use. Tables on stdout; given --docs they go into
// docs/performance.md too, and the figures into docs/images.
//
//   kfstab_benchmark [--filter REGEX] [--json FILE] [--docs DIR]

#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <random>
#include <regex>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include <benchmark/benchmark.h>
#include <fmt/core.h>
#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <nlohmann/json.hpp>

#include <kfstab/filters/kernels.hpp>
#include <kfstab/reports/files.hpp>
#include <kfstab/reports/markdown.hpp>
#include <kfstab/reports/number.hpp>
#include <kfstab/reports/plot.hpp>

#include "contenders.hpp"
#include "page.hpp"

namespace performance {
namespace {

using Matrix = kfstab::Matrix<double>;
using Json = nlohmann::ordered_json;

// ---- the system ----

/// Dense and random, with a spectral radius of A about .9; the same for everybody. P0 = I, which is its own root.
System system_of(Shape shape) {
  const auto [n, m, p] = shape;
  std::mt19937_64 random(static_cast<std::uint64_t>(n + m));
  const auto matrix = [&](int rows, int cols, double scale) {
    Matrix X(rows, cols);
    for (int j = 0; j < cols; ++j)
      for (int i = 0; i < rows; ++i) X(i, j) = scale * (static_cast<double>(random() >> 11) * 0x1p-52 - 1);
    return X;
  };
  const auto covariance = [&](int size) {
    const Matrix X = matrix(size, size, 1 / std::sqrt(static_cast<double>(size)));
    return Matrix(X * X.transpose() + Matrix::Identity(size, size));
  };
  const auto lower_root = [](const Matrix& X) { return Matrix(X.llt().matrixL()); };
  const auto inverse_root = [](const Matrix& X) { return Matrix(Matrix(X.inverse()).llt().matrixU()); };
  const auto numbers = [](const Matrix& X) { return std::vector<double>(X.data(), X.data() + X.size()); };

  const double scale = 1 / std::sqrt(static_cast<double>(n));
  const Matrix A = matrix(n, n, 1.5 * scale), B = matrix(n, m, 1), C = matrix(p, n, scale), Q = covariance(m),
               R = covariance(p), I = Matrix::Identity(n, n), A_inverse = A.inverse(), R_inverse_root = inverse_root(R);
  const Matrix RC = R_inverse_root * C;
  System s;
  s.shape = shape;
  s.A = numbers(A);
  s.B = numbers(B);
  s.C = numbers(C);
  s.Q = numbers(Q);
  s.R = numbers(R);
  s.P0 = s.S0 = s.T0 = numbers(I);
  s.Q_root = numbers(lower_root(Q));
  s.R_root = numbers(lower_root(R));
  s.A_inverse = numbers(A_inverse);
  s.A_inverse_B = numbers(A_inverse * B);
  s.Q_inverse_root = numbers(inverse_root(Q));
  s.R_inverse_root = numbers(R_inverse_root);
  s.T0_filtered = numbers(Matrix(I + RC.transpose() * RC).llt().matrixU());
  s.x0 = numbers(matrix(n, 1, 1));
  s.y = numbers(matrix(p, 1, 1));
  return s;
}

// ---- who is measured against whom ----

struct Routine {
  const char* filter;
  const char* peer;
  bool gain;  ///< of both; FB01SD and FB01TD have none: without it they and ours give the state, with it ours gives both
  const char* title;
  /// Multiply-adds of a step, theory (5).
  double (*operations)(double n, double m, double p);
};

constexpr double srcf_operations(double n, double m, double p) {
  return 7 * n * n * n / 6 + n * n * (5 * p / 2 + m) + n * (p * p + m * m / 2);
}

constexpr double srif_operations(double n, double m, double p) {
  return 7 * n * n * n / 6 + n * n * (5 * m / 2 + p) + n * (p * p / 2 + m * m);
}

constexpr double srif_hessenberg_operations(double n, double m, double p) {
  return n * n * n / 6 + n * n * (3 * m / 2 + p) + n * m * m;
}

constexpr std::array routines = {
    Routine{"srcf", "FB01QD", true, "srcf, with gain", srcf_operations},
    Routine{"srcf", "FB01QD", false, "srcf, without gain", srcf_operations},
    Routine{"srcf-hessenberg", "FB01RD", true, "srcf-hessenberg, with gain",
            [](double n, double m, double p) { return n * n * n / 6 + n * n * (5 * p / 2 + m) + n * p * p; }},
    Routine{"srif", "FB01SD", false, "srif, with state", srif_operations},
    Routine{"srif", "FB01SD", true, "srif, with state and gain",
            [](double n, double m, double p) { return srif_operations(n, m, p) + n * n * p; }},
    Routine{"srif-hessenberg", "FB01TD", false, "srif-hessenberg, with state", srif_hessenberg_operations},
    Routine{"srif-hessenberg", "FB01TD", true, "srif-hessenberg, with state and gain",
            [](double n, double m, double p) { return srif_hessenberg_operations(n, m, p) + 2 * n * n * p; }},
    Routine{"ckf", "FB01VD", true, "ckf",
            [](double n, double m, double p) { return 3 * n * n * n / 2 + n * n * (3 * p + m) / 2; }},
};

/// Of a condensed form our dense one, or nothing.
constexpr std::string_view dense_form(std::string_view filter) {
  return filter == "srcf-hessenberg" ? "srcf" : filter == "srif-hessenberg" ? "srif" : "";
}

/// Whether SLICOT's routine gives what ours gives, and all that it can.
constexpr bool like_for_like(const Routine& routine) {
  return routine.gain != (std::string_view(routine.filter).starts_with("srif"));
}

/// One routine at one size, and the medians of its runs so far.
struct Case {
  const Routine* routine;
  Shape shape;

  std::string name() const {
    return fmt::format("{}{}/n:{}/m:{}/p:{}", routine->filter, routine->gain ? "" : "/no-gain", shape.n, shape.m,
                       shape.p);
  }
};

/// n/2 noises and outputs; and n/8, where the zeros of a condensed form count for more.
std::vector<Case> all_cases() {
  std::vector<Case> cases;
  for (const Routine& routine : routines)
    for (const int share : {2, 8})
      for (const int n : {2, 4, 8, 16, 32, 64, 128, 256, 512}) {
        if (share == 8 && (n < 16 || !like_for_like(routine) || std::string_view(routine.filter) == "ckf")) continue;
        cases.push_back({&routine, {n, n / share, n / share}});
      }
  return cases;
}

/// A column of the tables: somebody who does the step.
struct Column {
  std::string name;
  std::string kernel;  ///< fixed, dynamic, batch: whom of ours a peer is measured against; empty: all of them
  bool ours;
  Contender contender;
};

std::vector<Column> columns_of(const Case& c, const System& system) {
  const Routine& routine = *c.routine;
  const std::string filter = routine.filter;
  std::vector<Column> columns;
  const auto add = [&](const char* name, const char* kernel, bool ours, Maybe contender) {
    if (contender) columns.push_back({name, kernel, ours, std::move(*contender)});
  };
  add("fixed", "fixed", true, ours_fixed(filter, system, routine.gain));
  add("dynamic", "dynamic", true, ours_dynamic(filter, system, routine.gain));
  if (c.shape.n <= 32) {
    Maybe batch = ours_batch_fixed(filter, system, routine.gain);
    add("batch", "batch", true, batch ? batch : ours_batch(filter, system, routine.gain));
  }
  add(routine.peer, "", false, slicot(routine.peer, system, routine.gain));
  if (const std::string dense(dense_form(filter)); !dense.empty()) {
    add(dense.c_str(), "fixed", false, ours_fixed(dense, system, routine.gain));
    add(dense.c_str(), "dynamic", false, ours_dynamic(dense, system, routine.gain));
  }
  if (filter == "srcf") {
    add("Eigen QR", "fixed", false, eigen_qr_fixed(system, routine.gain));
    add("Eigen QR", "dynamic", false, eigen_qr(system, routine.gain));
  }
  if (filter == "ckf") {
    add("Eigen textbook", "fixed", false, eigen_textbook_fixed(system));
    add("Eigen textbook", "dynamic", false, eigen_textbook(system));
  }
  return columns;
}

// ---- measuring ----

/// Of this thread: what else the machine does shall not count.
double processor_seconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// The first step of a turn is not measured: it fetches from memory what the others' turns have driven out of the caches, and a
/// filter that runs has that there.
double seconds_of(const Contender& contender, int times) {
  double start = 0;
  for (int k = 0; k <= times; ++k) {
    if (k == 1) start = processor_seconds();
    if (!contender.step()) throw std::runtime_error("a step failed");
  }
  return processor_seconds() - start;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// All must compute the same. Half of the digits is enough to tell that: a wrong formula has none.
void compare(const Case& c, const std::vector<Column>& columns) {
  std::vector<double> first;
  for (const Column& column : columns) {
    for (int k = 0; k < 3; ++k)
      if (!column.contender.step()) throw std::runtime_error(c.name() + ", " + column.name + ": a step failed");
    const std::vector<double> product = column.contender.product();
    if (first.empty()) first = product;
    double difference = 0, size = 0;
    for (std::size_t i = 0; i < first.size(); ++i) {
      difference = std::max(difference, std::abs(product[i] - first[i]));
      size = std::max(size, std::abs(first[i]));
    }
    if (!(difference <= 0x1p-26 * size))
      throw std::runtime_error(fmt::format("{}: {} ({}) is {} away from {}", c.name(), column.name, column.kernel,
                                           difference / size, columns.front().name));
  }
}

/// Of each column the microseconds for one step of one filter, round by round, in which all take turns; the limits' last.
std::vector<std::vector<double>> rounds_of(const std::vector<Column>& columns, const std::vector<Contender>& limits) {
  constexpr double seconds_of_a_turn = 0.001, seconds_of_all_turns = 0.3;
  std::vector<const Contender*> all;
  for (const Column& column : columns) all.push_back(&column.contender);
  for (const Contender& limit : limits) all.push_back(&limit);
  std::vector<int> times;
  double slowest = 0;
  for (const Contender* contender : all) {
    const double once = std::min(seconds_of(*contender, 1), seconds_of(*contender, 1));
    slowest = std::max(slowest, once);
    times.push_back(std::clamp(static_cast<int>(seconds_of_a_turn / once), 1, 20000));
  }
  const int count = std::clamp(static_cast<int>(seconds_of_all_turns / std::max(slowest, seconds_of_a_turn)), 3, 31);
  std::vector<std::vector<double>> rounds(all.size());
  for (int round = 0; round < count; ++round)
    for (std::size_t k = 0; k < all.size(); ++k)
      rounds[k].push_back(1e6 * seconds_of(*all[k], times[k]) / times[k] / all[k]->filters);
  return rounds;
}

/// One pair, at one size.
struct Row {
  const Case* of;
  std::string peer, kernel;
  std::vector<double> ours{}, peers{}, ratios{}, shares{}, processor_shares{};  // one a run

  double ours_us() const { return median(ours); }
  double peer_us() const { return median(peers); }
  double ratio() const { return median(ratios); }
  /// Of what DGEMM does, and of what the processor can do at all.
  double share() const { return shares.empty() ? std::nan("") : median(shares); }
  double processor_share() const { return median(processor_shares); }
};

using Rows = std::vector<Row>;

/// One run of one case, into its rows.
void measure(const Case& c, Rows& rows) {
  const System system = system_of(c.shape);
  std::vector<Column> columns = columns_of(c, system);
  compare(c, columns);
  std::vector<Contender> limits{multiply_adds()};
  if (const Maybe blas = dgemm()) limits.push_back(*blas);
  const auto rounds = rounds_of(columns, limits);
  const double operations = c.routine->operations(c.shape.n, c.shape.m, c.shape.p);
  const double cube = std::pow(dgemm_order, 3);
  for (std::size_t i = 0; i < columns.size(); ++i) {
    if (!columns[i].ours) continue;
    for (std::size_t j = 0; j < columns.size(); ++j) {
      if (columns[j].ours || (!columns[j].kernel.empty() && columns[j].kernel != columns[i].kernel)) continue;
      std::vector<double> ratios, of_limits[2];
      for (std::size_t k = 0; k < rounds[i].size(); ++k) {
        ratios.push_back(rounds[j][k] / rounds[i][k]);
        for (std::size_t l = 0; l < limits.size(); ++l)
          of_limits[l].push_back((operations / rounds[i][k]) / (cube / rounds[columns.size() + l][k]));
      }
      auto row = std::ranges::find_if(
          rows, [&](const Row& r) { return r.of == &c && r.peer == columns[j].name && r.kernel == columns[i].kernel; });
      if (row == rows.end()) row = rows.insert(rows.end(), Row{&c, columns[j].name, columns[i].kernel});
      row->ours.push_back(median(rounds[i]));
      row->peers.push_back(median(rounds[j]));
      row->ratios.push_back(median(ratios));
      row->processor_shares.push_back(median(of_limits[0]));
      if (limits.size() > 1) row->shares.push_back(median(of_limits[1]));
    }
  }
}

// ---- tables ----

std::string number(double x) {
  if (std::isnan(x)) return "";
  return x < 10 ? fmt::format("{:.2f}", x) : x < 100 ? fmt::format("{:.1f}", x) : fmt::format("{:.0f}", x);
}

const Row* find(const Rows& rows, const Case& c, std::string_view peer, std::string_view kernel) {
  const auto row = std::ranges::find_if(
      rows, [&](const Row& r) { return r.of == &c && r.kernel == kernel && (peer.empty() || r.peer == peer); });
  return row == rows.end() ? nullptr : &*row;
}

std::vector<std::string> peers_of(const Routine& routine) {
  std::vector<std::string> peers{routine.peer};
  if (const auto dense = dense_form(routine.filter); !dense.empty()) peers.emplace_back(dense);
  if (std::string_view(routine.filter) == "srcf") peers.push_back("Eigen QR");
  if (std::string_view(routine.filter) == "ckf") peers.push_back("Eigen textbook");
  return peers;
}

kfstab::reports::Table table_of(const Routine& routine, const std::vector<Case>& cases, const Rows& rows) {
  kfstab::reports::Table table;
  table.caption = routine.title;
  table.header = {"n", "m, p"};
  std::vector<const char*> kernels;
  for (const char* kernel : {"fixed", "dynamic", "batch"})
    if (std::ranges::any_of(rows, [&](const Row& r) { return r.of->routine == &routine && r.kernel == kernel; })) {
      kernels.push_back(kernel);
      table.header.push_back(std::string("ours, ") + kernel);
    }
  for (const std::string& peer : peers_of(routine)) {
    table.header.push_back(peer);
    for (const char* kernel : kernels)
      if (peer == routine.peer || std::string_view(kernel) != "batch")
        table.header.push_back(fmt::format("{} / {}", peer, kernel));
  }
  table.header.push_back("share of DGEMM");
  table.alignment.assign(table.header.size(), kfstab::reports::Alignment::right);
  for (const Case& c : cases) {
    if (c.routine != &routine || !std::ranges::any_of(rows, [&](const Row& r) { return r.of == &c; })) continue;
    std::vector<std::string> cells{fmt::format("{}", c.shape.n), fmt::format("{}", c.shape.m)};
    double share = std::nan("");
    for (const char* kernel : kernels) {
      const Row* row = find(rows, c, "", kernel);
      cells.push_back(row ? number(row->ours_us()) : "");
      if (row && std::string_view(kernel) != "batch") share = row->share();
    }
    for (const std::string& peer : peers_of(routine)) {
      // Of the others the time shown is that which the last kernel but batch is compared with.
      std::string time = "not there";
      std::vector<std::string> ratios;
      for (const char* kernel : kernels) {
        if (peer != routine.peer && std::string_view(kernel) == "batch") continue;
        const Row* row = find(rows, c, peer, kernel);
        if (row) time = number(row->peer_us());
        ratios.push_back(row ? number(row->ratio()) : "");
      }
      cells.push_back(time);
      cells.insert(cells.end(), ratios.begin(), ratios.end());
    }
    cells.push_back(std::isnan(share) ? "" : fmt::format("{:.0f} %", 100 * share));
    table.rows.push_back(std::move(cells));
  }
  return table;
}

/// What we want to reach: the least ratio over sizes, or the least share of DGEMM.
struct Target {
  const char* what;
  std::string_view filter, kernel;
  bool gain;
  int from, to;
  double wanted;
  bool share = false;
};

constexpr std::array targets = {
    Target{"srcf, fixed, n <= 8", "srcf", "fixed", true, 2, 8, 10},
    Target{"srcf, dynamic, n <= 8", "srcf", "dynamic", true, 2, 8, 5},
    Target{"srcf, fixed, n = 16", "srcf", "fixed", true, 16, 16, 8},
    Target{"srcf, dynamic, n = 16", "srcf", "dynamic", true, 16, 16, 5},
    Target{"srcf, dynamic, n = 32 ... 128", "srcf", "dynamic", true, 32, 128, 5},
    Target{"srcf, dynamic, n = 256", "srcf", "dynamic", true, 256, 256, 3.6},
    Target{"srcf without gain, fixed, n <= 8", "srcf", "fixed", false, 2, 8, 6},
    Target{"srcf without gain, dynamic, n <= 8", "srcf", "dynamic", false, 2, 8, 3.5},
    Target{"srcf without gain, dynamic, n = 16 ... 128", "srcf", "dynamic", false, 16, 128, 5},
    Target{"srif, fixed, n <= 8", "srif", "fixed", false, 2, 8, 8},
    Target{"srif, dynamic, n <= 64", "srif", "dynamic", false, 2, 64, 4},
    Target{"srif, dynamic, n > 64", "srif", "dynamic", false, 65, 512, 3},
    Target{"srif-hessenberg, fixed, n <= 8", "srif-hessenberg", "fixed", false, 2, 8, 8},
    Target{"srif-hessenberg, dynamic, n <= 64", "srif-hessenberg", "dynamic", false, 2, 64, 4},
    Target{"srif-hessenberg, dynamic, n > 64", "srif-hessenberg", "dynamic", false, 65, 512, 3},
    Target{"srcf-hessenberg, fixed, n <= 8", "srcf-hessenberg", "fixed", true, 2, 8, 8},
    Target{"srcf-hessenberg, dynamic, n <= 64", "srcf-hessenberg", "dynamic", true, 2, 64, 4},
    Target{"srcf-hessenberg, dynamic, n > 64", "srcf-hessenberg", "dynamic", true, 65, 512, 3},
    Target{"ckf, fixed, n <= 8", "ckf", "fixed", true, 2, 8, 5},
    Target{"ckf, dynamic, n <= 32", "ckf", "dynamic", true, 2, 32, 2},
    Target{"ckf, dynamic, n > 32", "ckf", "dynamic", true, 33, 512, 1.2},
    Target{"srcf, share of DGEMM, n >= 128", "srcf", "dynamic", true, 128, 512, 0.9, true},
    Target{"srcf, batch, n = 4", "srcf", "batch", true, 4, 4, 60},
    Target{"srcf, batch, n = 8", "srcf", "batch", true, 8, 8, 30},
};

kfstab::reports::Table targets_table(const Rows& rows) {
  kfstab::reports::Table table;
  table.header = {"against SLICOT",       "wanted",           "measured, at its least", "at n, m",
                  "wanted is reached to", "at DGEMM's speed", "at the processor's"};
  using enum kfstab::reports::Alignment;
  table.alignment = {left, right, right, right, right, right, right};
  for (const Target& target : targets) {
    const Row* least = nullptr;
    double value = INFINITY;
    for (const Row& row : rows) {
      const Case& c = *row.of;
      if (c.routine->filter != target.filter || c.routine->gain != target.gain || row.kernel != target.kernel ||
          row.peer != c.routine->peer || c.shape.n < target.from || c.shape.n > target.to)
        continue;
      if (const double x = target.share ? row.share() : row.ratio(); x < value) {
        value = x;
        least = &row;
      }
    }
    if (least)
      table.rows.push_back(
          {target.what, kfstab::reports::short_number(target.wanted), number(value),
           fmt::format("{}, {}", least->of->shape.n, least->of->shape.m),
           value >= target.wanted ? "100 %, met" : fmt::format("{:.0f} %", 100 * value / target.wanted),
           number(value / least->share()), number(value / least->processor_share())});
  }
  return table;
}

// ---- figures ----

std::string figure_id(const Routine& routine) { return std::string("cost-") + routine.filter; }

kfstab::reports::Figure figure_of(const Routine& routine, const Rows& rows) {
  using namespace kfstab::reports;
  Figure figure;
  figure.id = figure_id(routine);
  figure.title = fmt::format("Cost of a step of {}, m = p = n/2", routine.filter);
  figure.x = {"n, states", true};
  figure.y = {"microseconds a step", true};
  std::map<std::string, Curve> curves;
  for (const Row& row : rows) {
    if (row.of->routine != &routine || row.of->shape.p != row.of->shape.n / 2) continue;
    const auto add = [&](const std::string& id, const std::string& label, double us, CurveRole role) {
      Curve& curve = curves[id];
      curve.id = id;
      curve.label = label;
      curve.role = role;
      if (!curve.x.empty() && curve.x.back() == row.of->shape.n) return;
      curve.x.push_back(row.of->shape.n);
      curve.y.push_back(us);
    };
    add("ours-" + row.kernel, "kfstab, " + row.kernel, row.ours_us(), CurveRole::measured_line);
    if (row.kernel == "dynamic") {
      const bool slicot = row.peer == routine.peer, dense = row.peer == dense_form(routine.filter);
      add(slicot ? routine.peer : dense ? "dense" : "eigen",
          slicot ? "SLICOT " + row.peer : (dense ? "kfstab, " : "") + row.peer, row.peer_us(), CurveRole::measured_line);
      if (!row.shares.empty()) add("dgemm", "at DGEMM's speed", row.ours_us() * row.share(), CurveRole::theory);
    }
  }
  for (auto& [id, curve] : curves) figure.curves.push_back(std::move(curve));
  return figure;
}

/// The figure as an SVG file of the folder, and nothing else of it.
void draw(const kfstab::reports::Figure& figure, const std::filesystem::path& images) {
  const auto scratch = std::filesystem::temp_directory_path() / ("kfstab-benchmark-" + std::to_string(::getpid()));
  {
    const kfstab::reports::Folder folder(scratch);
    const auto drawn = kfstab::reports::write_figure(figure, folder);
    if (drawn.drawn)
      kfstab::reports::write_file(images / (figure.id + ".svg"), kfstab::reports::read_svg(figure, folder));
    else
      fmt::print(stderr, "kfstab: {}\n", drawn.warning);
  }
  std::filesystem::remove_all(scratch);
}

// ---- the program ----

constexpr int runs = 3;

std::string kernels() {
  const auto* in_use = kfstab::kernels::in_use();
  return in_use ? std::string(in_use->isa) : "plain";
}

std::string report(const std::vector<Case>& cases, const Rows& rows, bool with_figures) {
  std::string text =
      fmt::format("On {}, our kernels for {}. SLICOT 5.0 with {}, one thread.\n", processor(), kernels(), blas());
  if (const auto table = targets_table(rows); !table.rows.empty())
    text += "\nWhat was to be reached:\n\n" + kfstab::reports::render_markdown(table);
  for (const Routine& routine : routines) {
    const auto table = table_of(routine, cases, rows);
    if (table.rows.empty()) continue;
    text += fmt::format("\n**{}**, microseconds a step:\n\n", routine.title);
    if (with_figures && like_for_like(routine))
      text += fmt::format("![Cost of a step against n: ours, SLICOT's {}, and the limit](images/{}.svg)\n\n",
                          routine.peer, figure_id(routine));
    text += kfstab::reports::render_markdown(table);
  }
  return text;
}

std::string json_of(const Rows& rows) {
  Json json;
  json["schema"] = "kfstab.benchmark/1";
  Json& context = json["context"];
  context["processor"] = processor();
  context["kernels"] = kernels();
  context["blas"] = blas();
  context["runs"] = runs;
  json["rows"] = Json::array();
  const auto value = [](double x) { return std::isfinite(x) ? Json(x) : Json(nullptr); };
  for (const Row& row : rows) {
    const Shape& shape = row.of->shape;
    json["rows"].push_back({{"routine", row.of->routine->filter},
                            {"peer", row.peer},
                            {"n", shape.n},
                            {"m", shape.m},
                            {"p", shape.p},
                            {"kernel", row.kernel},
                            {"gain", row.of->routine->gain},
                            {"ours_us", value(row.ours_us())},
                            {"peer_us", value(row.peer_us())},
                            {"ratio", value(row.ratio())},
                            {"dgemm_share", value(row.share())},
                            {"processor_share", value(row.processor_share())}});
  }
  return json.dump(1) + "\n";
}

/// Tells a terminal how far it is, and nobody else anything.
class Progress : public benchmark::BenchmarkReporter {
 public:
  explicit Progress(std::size_t cases) : cases_(cases) {}
  bool ReportContext(const Context&) override { return true; }
  void ReportRuns(const std::vector<Run>&) override {}
  void tell(const std::string& name) {
    if (isatty(2)) fmt::print(stderr, "\r\033[K{} of {}: {}", ++done_, cases_ * runs, name);
  }
  void Finalize() override {
    if (isatty(2)) fmt::print(stderr, "\r\033[K");
  }

 private:
  std::size_t cases_, done_ = 0;
};

constexpr const char* usage =
    "usage: ./kfstab benchmark [--filter REGEX] [--json FILE]\n"
    "       ./kfstab benchmark reference\n"
    "REGEX selects by names such as srcf/no-gain/n:8/m:4/p:4; without it the tables of docs/performance.md are "
    "written\n"
    "anew. FILE - is stdout, and nothing else there.\n";

struct Usage : std::runtime_error {
  using runtime_error::runtime_error;
};

struct Arguments {
  std::string filter, json, docs;
};

Arguments parse(int count, char** words) {
  Arguments arguments;
  const std::map<std::string, std::string*> options = {
      {"--filter", &arguments.filter}, {"--json", &arguments.json}, {"--docs", &arguments.docs}};
  for (const auto& [name, value] : options) {
    std::string twin = "KFSTAB_" + name.substr(2);
    std::ranges::transform(twin, twin.begin(), [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
    if (name != "--docs" && std::getenv(twin.c_str())) *value = std::getenv(twin.c_str());
  }
  for (int i = 1; i < count; ++i) {
    const std::string word = words[i];
    if (word == "--help" || word == "-h") {
      fmt::print("{}", usage);
      std::exit(0);
    }
    const auto equals = word.find('=');
    const auto option = options.find(word.substr(0, equals));
    if (option == options.end()) throw Usage("found '" + word + "'");
    if (equals == std::string::npos && i + 1 == count) throw Usage(word + " takes a value");
    *option->second = equals == std::string::npos ? words[++i] : word.substr(equals + 1);
  }
  try {
    std::regex(arguments.filter);
  } catch (const std::regex_error&) {
    throw Usage("not a regular expression: " + arguments.filter);
  }
  return arguments;
}

int run(const Arguments& arguments) {
  const std::vector<Case> cases = all_cases();
  const std::regex filter(arguments.filter);
  const auto selected = static_cast<std::size_t>(
      std::ranges::count_if(cases, [&](const Case& c) { return std::regex_search(c.name(), filter); }));
  if (selected == 0) {
    fmt::print(stderr, "kfstab: no benchmark matches '{}'; they are called {} and so on\n", arguments.filter,
               cases.front().name());
    return 5;
  }
  // The runs of all cases are shuffled, so that none has the machine's mood of one minute for all of its numbers.
  char name[] = "kfstab_benchmark", shuffled[] = "--benchmark_enable_random_interleaving=true";
  char* words[] = {name, shuffled, nullptr};
  int count = 2;
  benchmark::Initialize(&count, words);
  Rows rows;
  Progress progress(selected);
  for (const Case& c : cases)
    if (std::regex_search(c.name(), filter))
      benchmark::RegisterBenchmark(
          c.name().c_str(),
          [&](benchmark::State& state) {
            progress.tell(c.name());
            for ([[maybe_unused]] auto _ : state) {
              measure(c, rows);
              state.SetIterationTime(1);  // the reporter shows none: times are those of the turns
            }
          })
          ->Iterations(1)
          ->Repetitions(runs)
          ->UseManualTime();
  benchmark::RunSpecifiedBenchmarks(&progress);
  std::ranges::stable_sort(rows, {}, [](const Row& row) { return row.of; });

  const bool complete = selected == cases.size() && !arguments.docs.empty();
  const std::string text = report(cases, rows, complete);
  std::fputs(text.c_str(), arguments.json == "-" ? stderr : stdout);
  if (!arguments.json.empty())
    kfstab::reports::write_file(arguments.json == "-" ? "/dev/stdout" : arguments.json, json_of(rows));
  if (complete) {
    const std::filesystem::path docs = arguments.docs;
    for (const Routine& routine : routines)
      if (like_for_like(routine)) draw(figure_of(routine, rows), docs / "images");
    if (!put_between_markers(docs / "performance.md", "kfstab_benchmark", text))
      throw std::runtime_error((docs / "performance.md").string() + ": there are no markers");
  }
  return 0;
}

}  // namespace
}  // namespace performance

int main(int count, char** words) {
  kfstab::reports::ignore_file_signals();
  try {
    return performance::run(performance::parse(count, words));
  } catch (const performance::Usage& error) {
    fmt::print(stderr, "kfstab: {}\n{}", error.what(), performance::usage);
    return 2;
  } catch (const kfstab::reports::FileError& error) {
    fmt::print(stderr, "kfstab: {}\n", error.what());
    return 2;
  } catch (const std::exception& error) {
    fmt::print(stderr, "kfstab: {}\n", error.what());
    return 3;
  }
}
