// A textbook Kalman filter that speaks protocol 1 (docs/protocol.md). C++20 and Eigen.
//
//     g++ -std=c++20 -O2 -I /usr/include/eigen3 -o textbook textbook.cpp
//     kfstab check --exec ./textbook
//
// Copy it, and put your own filter in the place of `Filter`: the rest is the protocol. (A filter that is a C++ type can be
// checked without any of it, in its own GoogleTest program: docs/protocol.md.)

#include <charconv>
#include <cmath>
#include <cstring>
#include <iostream>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Dense>

using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

// ---- The filter ----

struct Filter {
  Vector x;
  Matrix P, K;

  // From x_{k|k-1}, P_{k|k-1} to x_{k|k}, P_{k|k}.
  void update(const Matrix& C, const Matrix& R, const Vector& y) {
    const Matrix PC = P * C.transpose();
    const Matrix Re = C * PC + R;
    K = Re.transpose().partialPivLu().solve(PC.transpose()).transpose();  // P C' Re^{-1}
    x += K * (y - C * x);
    P -= K * PC.transpose();
  }

  // From x_{k|k}, P_{k|k} to x_{k+1|k}, P_{k+1|k}.
  void predict(const Matrix& A, const Matrix& B, const Matrix& Q) {
    x = A * x;
    P = A * P * A.transpose() + B * Q * B.transpose();
    P = (P + P.transpose()).eval() / 2;
  }
};

// ---- Protocol 1: a request a line, a line in reply, flushed ----

// A request. Of matrices only the entries are kept, in order: their sizes follow from n, m and the length of what came.
struct Request {
  std::string op;
  std::map<std::string, std::vector<double>, std::less<>> fields;

  void read(std::string_view line) {
    for (auto& [name, numbers] : fields) numbers.clear();
    const char *at = line.data(), *end = at + line.size();
    while (at < end) {
      const char* name = static_cast<const char*>(memchr(at, '"', static_cast<size_t>(end - at)));
      if (!name) return;
      const char* close = static_cast<const char*>(memchr(name + 1, '"', static_cast<size_t>(end - name - 1)));
      const std::string_view key(name + 1, static_cast<size_t>(close - name - 1));
      at = close + 2;  // the colon
      while (*at == ' ') ++at;
      if (key == "op") {
        const char* last = static_cast<const char*>(memchr(at + 1, '"', static_cast<size_t>(end - at - 1)));
        op.assign(at + 1, last);
        at = last + 1;
        continue;
      }
      auto field = fields.find(key);
      if (field == fields.end()) field = fields.emplace(key, std::vector<double>()).first;
      std::vector<double>& numbers = field->second;
      for (int depth = 0; at < end; ++at) {
        if (*at == '[') ++depth;
        if (*at == ']') --depth;
        if (depth == 0 && (*at == ']' || *at == ',' || *at == '}')) break;
        double value = 0;  // from_chars knows "nan" and "inf", too
        if (const auto [after, error] = std::from_chars(at, end, value); error == std::errc()) {
          numbers.push_back(value);
          at = after - 1;
        }
      }
    }
  }

  bool has(std::string_view name) const {
    const auto field = fields.find(name);
    return field != fields.end() && !field->second.empty();
  }
  int integer(std::string_view name) const { return static_cast<int>(fields.find(name)->second.front()); }
  Matrix matrix(std::string_view name, Eigen::Index rows, Eigen::Index cols) const {
    return Eigen::Map<const Eigen::Matrix<double, -1, -1, Eigen::RowMajor>>(fields.find(name)->second.data(), rows,
                                                                            cols);
  }
  Vector vector(std::string_view name) const {
    const auto& numbers = fields.find(name)->second;
    return Eigen::Map<const Vector>(numbers.data(), static_cast<Eigen::Index>(numbers.size()));
  }
};

void append(std::string& reply, double value) {
  if (!std::isfinite(value)) {
    reply += std::isnan(value) ? "\"nan\"" : value > 0 ? "\"inf\"" : "\"-inf\"";
    return;
  }
  char digits[32];  // the shortest that read back as the same number
  reply.append(digits, static_cast<size_t>(std::to_chars(digits, digits + sizeof digits, value).ptr - digits));
}

void append(std::string& reply, const Vector& x) {
  reply += '[';
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    if (i > 0) reply += ',';
    append(reply, x(i));
  }
  reply += ']';
}

void append(std::string& reply, const Matrix& X) {
  reply += '[';
  for (Eigen::Index i = 0; i < X.rows(); ++i) {
    if (i > 0) reply += ',';
    append(reply, Vector(X.row(i)));
  }
  reply += ']';
}

int main() {
  std::ios::sync_with_stdio(false);
  Filter filter;
  Eigen::Index n = 0, m = 0;
  Request request;
  std::string reply;
  for (std::string line; std::getline(std::cin, line);) {
    request.read(line);
    reply.clear();
    if (request.op == "stop") break;
    if (request.op == "hello") {
      reply = "{\"name\":\"textbook (C++)\",\"cycle\":\"update-predict\",\"gain\":\"filter\"}";
    } else if (request.op == "start") {
      n = request.integer("n");
      m = request.integer("m");
      filter.x = request.vector("x");
      filter.P = request.matrix("P", n, n);
      reply = "{\"ok\":true}";
    } else {
      const bool measured = request.has("y");
      if (measured) {
        const Vector y = request.vector("y");
        filter.update(request.matrix("C", y.size(), n), request.matrix("R", y.size(), y.size()), y);
      }
      filter.predict(request.matrix("A", n, n), request.matrix("B", n, m), request.matrix("Q", m, m));
      if (request.has("u")) {
        const Vector u = request.vector("u");
        filter.x += request.matrix("D", n, u.size()) * u;
      }
      append(reply += "{\"x\":", filter.x);
      append(reply += ",\"P\":", filter.P);
      if (measured) append(reply += ",\"K\":", filter.K);
      reply += '}';
    }
    std::cout << reply << std::endl;
  }
}
