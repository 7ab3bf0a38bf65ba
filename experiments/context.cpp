#include <kfstab/experiments/context.hpp>

#include <sys/utsname.h>

#include <cfloat>
#include <ctime>

#include <Eigen/Core>
#include <boost/version.hpp>
#include <fmt/core.h>

#include <kfstab/filters/kernels.hpp>
#include <mpfr.h>

#include <kfstab_revision.hpp>

namespace kfstab::experiments {
namespace {

std::string compiler() {
#if defined(__clang__)
  return fmt::format("clang {}", __clang_version__);
#else
  return fmt::format("g++ {}", __VERSION__);
#endif
}

std::string fused() {
#if defined(__FMA__) || defined(__ARM_FEATURE_FMA)
  return "available to the compiler; not contracted (-ffp-contract=off)";
#else
  return "not used";
#endif
}

std::string now() {
  const std::time_t time = std::time(nullptr);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", std::gmtime(&time));
  return text;
}

}  // namespace

Context context() {
  utsname machine{};
  uname(&machine);
  return {{"kfstab", KFSTAB_VERSION},
          {"revision", KFSTAB_REVISION},
          {"date", now()},
          {"compiler", compiler()},
          {"flags", KFSTAB_FLAGS},
          {"fused multiply-add", fused()},
          {"kernels", kernels::in_use() ? std::string(kernels::in_use()->isa) : "plain"},
          {"FLT_EVAL_METHOD", fmt::format("{}", FLT_EVAL_METHOD)},
          {"u", fmt::format("{:g}", DBL_EPSILON / 2)},
          {"Eigen", fmt::format("{}.{}.{}", EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION)},
          {"Boost", fmt::format("{}.{}.{}", BOOST_VERSION / 100000, BOOST_VERSION / 100 % 1000, BOOST_VERSION % 100)},
          {"MPFR", mpfr_get_version()},
          {"system", fmt::format("{} {}", machine.sysname, machine.machine)}};
}

}  // namespace kfstab::experiments
