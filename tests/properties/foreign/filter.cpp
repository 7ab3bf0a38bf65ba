// A filter of somebody else's, for the tests of protocol 1, in every state of health: filter MODE [FILE]. FILE takes the
// process ids of what it leaves behind.

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <string>
#include <vector>

#include <unistd.h>

#include <kfstab/properties/json_line.hpp>
#include <kfstab/properties/plugin_host.hpp>

#include "textbook.hpp"

namespace {

using namespace kfstab;
using namespace kfstab::properties;

std::string mode;

bool is(const char* name) { return mode == name; }

void say(const std::string& line) {
  std::fputs(line.c_str(), stdout);
  if (!is("unflushed")) std::fflush(stdout);
}

void sleep_for_ever() {
  for (;;) ::pause();
}

void note(const char* file) { std::ofstream(file, std::ios::app) << ::getpid() << std::endl; }

/// Leaves a process behind that does not want to go.
void leave_behind(const char* file, bool session) {
  if (::fork() != 0) return;
  if (session) {
    ::setsid();
    if (::fork() != 0) ::_exit(0);
  }
  std::signal(SIGTERM, SIG_IGN);
  std::signal(SIGHUP, SIG_IGN);
  note(file);
  sleep_for_ever();
}

void misbehave(int step) {
  if (step != 1) return;
  if (is("hang")) {
    std::signal(SIGTERM, SIG_IGN);
    sleep_for_ever();
  }
  if (is("crash")) {
    std::fprintf(stderr, "about to follow a null pointer\n");
    std::raise(SIGSEGV);
  }
  if (is("exit")) std::exit(3);
  if (is("hungry"))
    for (std::vector<char*> eaten;;) {
      eaten.push_back(new char[1 << 24]);
      std::memset(eaten.back(), 1, 1 << 24);
    }
  if (is("flood-line"))
    for (;;) std::fputs("xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx", stdout);
  if (is("flood"))
    for (;;) std::puts("{\"x\":[0],\"P\":[[1]]}");
}

template <class Scalar>
void serve(const char* file) {
  testing::Textbook<Scalar> filter;
  Index n = 0, m = 0;
  int step = -1;
  JsonMessage request;
  JsonLine reply;
  Matrix<double> A, B, C, Q, R, D, P, K;
  Vector<double> x, y, u;
  const bool predicts_first = is("predict-update");
  for (std::string line; std::getline(std::cin, line);) {
    request.read(line);
    const std::string op = *request.text("op");
    reply.begin();
    if (op == "stop") return;
    if (op == "hello") {
      if (is("grandchild")) leave_behind(file, false);
      if (is("session")) leave_behind(file, true);
      reply.text("name", "a " + mode + " filter");
      reply.text("cycle", predicts_first ? "predict-update" : "update-predict");
      reply.text("gain", "filter");
      if (is("single")) reply.text("precision", "single");
      reply.integer("a field of its own", 7);
    } else if (op == "start") {
      n = *request.integer("n");
      m = *request.integer("m");
      step = -1;
      if (is("two-states") && n != 2) {
        reply.text("unsupported", "two states alone");
      } else {
        request.vector("x", n, x);
        request.matrix("P", n, n, P);
        filter.x = x.cast<Scalar>();
        filter.P = P.cast<Scalar>();
        reply.truth("ok", true);
      }
    } else {
      ++step;
      misbehave(step);
      if (is("slow")) ::usleep(20'000);
      if (is("talkative")) std::cerr << std::string(20'000, 't') << std::endl;
      const bool measured = request.has("y");
      const Index p = measured ? request.length("y") : 0;
      request.matrix("A", n, n, A);
      request.matrix("B", n, m, B);
      request.matrix("Q", m, m, Q);
      const auto update = [&] {
        if (!measured) return;
        request.matrix("C", p, n, C);
        request.matrix("R", p, p, R);
        request.vector("y", p, y);
        if (is("r-squared") || is("r-squared-short")) R = R * R;
        filter.update(C.cast<Scalar>(), R.cast<Scalar>(), y.cast<Scalar>());
      };
      if (!predicts_first) update();
      filter.predict(A.cast<Scalar>(), B.cast<Scalar>(), Q.cast<Scalar>());
      if (request.has("u")) {
        const Index inputs = request.length("u");
        request.matrix("D", n, inputs, D);
        request.vector("u", inputs, u);
        filter.x += (D * u).cast<Scalar>();
      }
      if (predicts_first) update();
      if (is("refusing") && step == 1) {
        say("{\"error\":\"I would rather not\"}\n");
        continue;
      }
      x = filter.x.template cast<double>();
      P = filter.P.template cast<double>();
      if (is("nan") && step == 1) P(0, 0) = std::nan("");
      if (is("r-squared-short")) {
        // As a stream writes them that nobody told otherwise.
        const auto six_digits = [](double value) {
          char text[32];
          std::snprintf(text, sizeof text, "%.6g", value);
          return std::strtod(text, nullptr);
        };
        x = x.unaryExpr(six_digits).eval();
        P = P.unaryExpr(six_digits).eval();
      }
      if (is("shape") && step == 1) P.conservativeResize(n, n + 1);
      reply.vector("x", x);
      if (is("root"))
        reply.matrix("S", Matrix<double>(P.array().abs().sqrt()));
      else
        reply.matrix("P", P);
      if (measured) reply.matrix("K", Matrix<double>(filter.K.template cast<double>()));
    }
    if (is("rubbish") && step == 1)
      say("Step 1\n");
    else
      say(reply.end());
    if (is("echo") && step == 1) say("a line for those who debug\n");
  }
}

}  // namespace

int main(int argc, char** argv) {
  mode = argc > 1 ? argv[1] : "";
  const char* file = argc > 2 ? argv[2] : nullptr;
  if (is("plugin-host")) return serve_plugin(file);
  if (is("unflushed")) std::cin.tie(nullptr);  // or reading would flush
  if (file && is("correct")) note(file);
  is("single") ? serve<float>(file) : serve<double>(file);
}
