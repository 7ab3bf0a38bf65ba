#include <kfstab/properties/plugin_host.hpp>

#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>

#include <dlfcn.h>
#include <unistd.h>

#include <fmt/format.h>

#include <kfstab_filter.h>
#include <kfstab/properties/json_line.hpp>

namespace kfstab::properties {

namespace {

using RowMajor = Eigen::Matrix<double, Dynamic, Dynamic, Eigen::RowMajor>;

/// The functions of a library. It stays loaded: the process is there for it alone.
struct Library {
  decltype(&kfstab_filter_describe) describe;
  decltype(&kfstab_filter_create) create;
  decltype(&kfstab_filter_step) step;
  decltype(&kfstab_filter_destroy) destroy;

  explicit Library(const std::string& path) {
    // A name without a slash would be looked for in the system's folders.
    handle_ =
        ::dlopen(fmt::format("{}{}", path.find('/') == path.npos ? "./" : "", path).c_str(), RTLD_NOW | RTLD_LOCAL);
    if (!handle_) throw std::runtime_error(::dlerror());
    decltype(&kfstab_filter_abi) abi;
    find("kfstab_filter_abi", abi);
    if (const int version = abi(); version != KFSTAB_FILTER_ABI)
      throw std::runtime_error(
          fmt::format("{}: found version {} of kfstab_filter.h, expected {}", path, version, KFSTAB_FILTER_ABI));
    find("kfstab_filter_describe", describe);
    find("kfstab_filter_create", create);
    find("kfstab_filter_step", step);
    find("kfstab_filter_destroy", destroy);
  }

 private:
  template <class Function>
  void find(const char* name, Function& function) {
    function = reinterpret_cast<Function>(::dlsym(handle_, name));
    if (!function) throw std::runtime_error(::dlerror());
  }

  void* handle_ = nullptr;
};

class Host {
 public:
  explicit Host(const Library& library) : library_(library), filter_(nullptr, library.destroy) {}

  /// False at the end.
  bool answer(std::string_view line) {
    request_.read(line);
    const std::string op = request_.text("op").value_or("");
    reply_.begin();
    if (op == "hello")
      describe();
    else if (op == "start")
      start();
    else if (op == "step" && filter_)
      step();
    else if (op == "stop")
      return false;
    else
      reply_.text("error", fmt::format("what is {}?", op));
    return true;
  }

  const std::string& reply() { return reply_.end(); }

 private:
  void describe() {
    const kfstab_filter_description* description = library_.describe();
    if (!description) throw std::runtime_error("kfstab_filter_describe() returned NULL");
    const auto add = [&](const char* name, const char* value) {
      if (value) reply_.text(name, value);
    };
    add("name", description->name);
    add("cycle", description->cycle);
    add("gain", description->gain);
    add("precision", description->precision);
    if (!description->needs) return;
    std::vector<std::string> needs(1);
    for (const char* c = description->needs; *c; ++c) {
      if (*c != ' ' && *c != ',')
        needs.back() += *c;
      else if (!needs.back().empty())
        needs.emplace_back();
    }
    if (needs.back().empty()) needs.pop_back();
    reply_.texts("needs", needs);
  }

  void start() {
    n_ = request_.integer("n").value_or(0);
    m_ = request_.integer("m").value_or(0);
    const Index p = request_.integer("p").value_or(0);
    request_.vector("x", n_, x_);
    read("P", n_, n_, P_);
    const char* why = nullptr;
    filter_.reset();
    filter_.reset(
        library_.create(static_cast<int>(n_), static_cast<int>(m_), static_cast<int>(p), x_.data(), P_.data(), &why));
    if (filter_)
      reply_.truth("ok", true);
    else
      reply_.text("unsupported", why ? why : "kfstab_filter_create() returned NULL");
  }

  void step() {
    const bool measured = request_.has("y");
    const Index p = request_.length("C"), inputs = request_.length("u");
    read("A", n_, n_, A_);
    read("B", n_, m_, B_);
    read("C", p, n_, C_);
    read("Q", m_, m_, Q_);
    read("R", p, p, R_);
    if (measured) request_.vector("y", p, y_);
    if (inputs > 0) {
      read("D", n_, inputs, D_);
      request_.vector("u", inputs, u_);
    }
    S_.resize(n_, n_);
    K_.resize(n_, p);
    const kfstab_filter_input input{static_cast<int>(n_),
                                    static_cast<int>(m_),
                                    static_cast<int>(p),
                                    static_cast<int>(inputs),
                                    A_.data(),
                                    B_.data(),
                                    C_.data(),
                                    Q_.data(),
                                    R_.data(),
                                    inputs > 0 ? D_.data() : nullptr,
                                    inputs > 0 ? u_.data() : nullptr,
                                    measured ? y_.data() : nullptr};
    kfstab_filter_answer answer{x_.data(), P_.data(), S_.data(), K_.data(), 0, 0, 0, 0, nullptr};
    if (library_.step(filter_.get(), &input, &answer) != 0) {
      reply_.text("error", answer.why ? answer.why : "kfstab_filter_step() says no");
      return;
    }
    reply_.vector("x", x_);
    reply_.matrix(answer.has_S ? "S" : "P", Matrix<double>(answer.has_S ? S_ : P_));
    if (answer.has_K) reply_.matrix("K", Matrix<double>(K_));
    if (answer.has_loglik) reply_.number("loglik", answer.loglik);
  }

  void read(const char* name, Index rows, Index cols, RowMajor& value) {
    if (!request_.matrix(name, rows, cols, read_)) throw std::runtime_error(fmt::format("the request lacks {}", name));
    value = read_;
  }

  const Library& library_;
  std::unique_ptr<void, decltype(&kfstab_filter_destroy)> filter_;
  JsonMessage request_;
  JsonLine reply_;
  Index n_ = 0, m_ = 0;
  Matrix<double> read_;
  RowMajor A_, B_, C_, D_, Q_, R_, P_, S_, K_;
  Vector<double> x_, y_, u_;
};

}  // namespace

int serve_plugin(const std::filesystem::path& path) {
  // What the library prints must not come between our lines.
  const int output = ::dup(STDOUT_FILENO);
  ::dup2(STDERR_FILENO, STDOUT_FILENO);
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> replies(::fdopen(output, "w"), std::fclose);
  if (!replies) return 1;
  char* line = nullptr;
  std::size_t size = 0;
  int code = 0;
  try {
    const Library library(path.string());
    Host host(library);
    for (ssize_t length; (length = ::getline(&line, &size, stdin)) > 0;) {
      while (length > 0 && line[length - 1] == '\n') --length;
      if (!host.answer({line, static_cast<std::size_t>(length)})) break;
      const std::string& reply = host.reply();
      if (std::fwrite(reply.data(), 1, reply.size(), replies.get()) != reply.size() || std::fflush(replies.get()) != 0)
        break;
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    code = 1;
  }
  std::free(line);
  return code;
}

}  // namespace kfstab::properties
