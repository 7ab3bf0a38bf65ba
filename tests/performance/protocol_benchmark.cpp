// How many steps a second a filter makes that is driven by protocol 1, beside one that is built in: ./kfstab benchmark protocol.
//
//   kfstab_protocol_benchmark [PAGE]   prints the table, or puts it into the page

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <iostream>
#include <memory>
#include <random>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include <kfstab/properties/data.hpp>
#include <kfstab/properties/plugin_host.hpp>
#include <kfstab/properties/protocol.hpp>
#include <kfstab/properties/system.hpp>

#include "page.hpp"

namespace {

using namespace kfstab;
using namespace kfstab::properties;

/// Dense, n = 4, m = p = 2, the same in every step, with data; P0 = Q = R = I.
System dense_system() {
  constexpr Index n = 4, m = 2, p = 2, steps = 500;
  std::mt19937_64 random(1986);
  const auto entries = [&](Index rows, Index cols, double size) {
    Matrix<double> X(rows, cols);
    for (Index j = 0; j < cols; ++j)
      for (Index i = 0; i < rows; ++i) X(i, j) = size * (static_cast<double>(random() % 2001) / 1000 - 1);
    return X;
  };
  const auto identity = [](Index size) {
    return Covariance{Covariance::Written::covariance, Sequence(Matrix<double>(Matrix<double>::Identity(size, size)))};
  };
  System system;
  system.name = "dense";
  system.steps = steps;
  system.A = Sequence(entries(n, n, .5));
  system.B = Sequence(entries(n, m, 1));
  system.C = Sequence(entries(p, n, 1));
  system.D = Sequence(Matrix<double>(n, 0));
  system.Q = identity(m);
  system.R = identity(p);
  system.P0 = identity(n);
  system.x0 = Vector<double>::Zero(n);
  system.data = std::make_shared<Recorded>(entries(p, steps, 1), Matrix<double>(0, steps));
  return system;
}

struct Contender {
  std::string name, command;
  std::unique_ptr<Subject> subject;
  double best = 0;  ///< steps a second
};

double steps_a_second(Subject& subject, const System& system) {
  using Clock = std::chrono::steady_clock;
  std::int64_t steps = 0;
  const auto begin = Clock::now();
  double seconds = 0;
  while (seconds < .2) {
    const Ending ending = subject.run(system, [&](std::int64_t, const Answer&) {
      ++steps;
      return true;
    });
    if (ending.kind != Ending::Kind::done) throw std::runtime_error(subject.traits().name + ": " + ending.reason);
    seconds = std::chrono::duration<double>(Clock::now() - begin).count();
  }
  return static_cast<double>(steps) / seconds;
}

/// With two digits.
std::string rounded(double value) {
  const double unit = std::pow(10, std::floor(std::log10(value)) - 1);
  const double two = std::round(value / unit) * unit;
  char text[32];
  std::snprintf(text, sizeof text, two < 10 ? "%.1f" : "%.0f", two);
  return text;
}

bool there_is(const std::string& program) {
  return std::system(("command -v " + program + " >/dev/null 2>&1").c_str()) == 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 3 && std::string(argv[1]) == "plugin-host") return serve_plugin(argv[2]);
  const std::string examples = KFSTAB_SOURCE_DIR "/examples/";
  std::vector<Contender> all;
  all.push_back({"built in: `ckf-textbook`", "", built_in("ckf-textbook")});
  all.push_back({"shared library, C: `textbook.c`", "", plugin_subject(KFSTAB_STARTER_PLUGIN)});
  all.push_back({"program, C++: `textbook.cpp`", "", exec_subject(KFSTAB_STARTER)});
  if (there_is("python3"))
    all.push_back({"program, Python: `textbook.py`", "", exec_subject("python3 '" + examples + "textbook.py'")});
  if (there_is("octave-cli"))
    all.push_back(
        {"program, Octave: `textbook.m`", "", exec_subject("octave-cli --quiet '" + examples + "textbook.m'")});

  const System system = dense_system();
  for (const Contender& one : all) steps_a_second(*one.subject, system);  // starts it
  for (int turn = 0; turn < 7; ++turn)
    for (Contender& one : all) one.best = std::max(one.best, steps_a_second(*one.subject, system));

  std::ostringstream table;
  table << "On " << performance::processor()
        << ".\n\n| filter | steps a second | microseconds a step |\n| --- | ---: | ---: |\n";
  for (const Contender& one : all)
    table << "| " << one.name << " | " << rounded(one.best) << " | " << rounded(1e6 / one.best) << " |\n";
  std::cout << table.str();
  if (argc < 2) return 0;
  if (performance::put_between_markers(argv[1], "kfstab_protocol_benchmark", table.str())) return 0;
  std::cerr << argv[1] << " has no place for this table\n";
  return 2;
}
