#include <atomic>
#include <cstdlib>
#include <optional>
#include <stdexcept>
#include <string>

#include <kfstab/filters/kernels.hpp>
#include <kfstab/filters/kernels/batch_covariance_kernel.hpp>
#include <kfstab/filters/kernels/covariance_kernel.hpp>

namespace kfstab::kernels {

#if defined(__x86_64__) && defined(__GNUC__)
namespace sse2 {
bool library_array_step(const ArrayStep&);
bool library_covariance_step(const CovarianceStep&);
void library_batch_array_step(const BatchArrayStep&);
void library_batch_covariance_step(const BatchCovarianceStep&);
}  // namespace sse2
namespace avx2 {
bool library_array_step(const ArrayStep&);
bool library_covariance_step(const CovarianceStep&);
void library_batch_array_step(const BatchArrayStep&);
void library_batch_covariance_step(const BatchCovarianceStep&);
}  // namespace avx2
namespace avx512 {
bool library_array_step(const ArrayStep&);
bool library_covariance_step(const CovarianceStep&);
void library_batch_array_step(const BatchArrayStep&);
void library_batch_covariance_step(const BatchCovarianceStep&);
}  // namespace avx512

namespace {
constexpr Kernels all[] = {
    {"sse2", sse2::library_array_step, sse2::library_covariance_step, sse2::library_batch_array_step,
     sse2::library_batch_covariance_step},
    {"avx2", avx2::library_array_step, avx2::library_covariance_step, avx2::library_batch_array_step,
     avx2::library_batch_covariance_step},
    {"avx512", avx512::library_array_step, avx512::library_covariance_step, avx512::library_batch_array_step,
     avx512::library_batch_covariance_step}};

std::size_t count() {
  __builtin_cpu_init();
  if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma")) return 1;
  return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") ? 3 : 2;
}
}  // namespace

std::span<const Kernels> available() {
  static const std::size_t of_this_machine = count();
  return {all, of_this_machine};
}

#elif defined(KFSTAB_KERNELS)

std::span<const Kernels> available() {
#define KFSTAB_NAME_OF(isa) #isa
#define KFSTAB_NAME(isa) KFSTAB_NAME_OF(isa)
  static constexpr Kernels only[] = {{KFSTAB_NAME(KFSTAB_KERNELS), KFSTAB_KERNELS::array_step,
                                      KFSTAB_KERNELS::covariance_step, KFSTAB_KERNELS::batch_array_step,
                                      KFSTAB_KERNELS::batch_covariance_step}};
  return only;
}

#else

std::span<const Kernels> available() { return {}; }

#endif

namespace {

/// Null for "plain", nothing for a name that stands for no kernels.
std::optional<const Kernels*> find(std::string_view isa) {
  if (isa == "plain") return nullptr;
  for (const Kernels& kernels : available())
    if (kernels.isa == isa) return &kernels;
  return {};
}

const Kernels* wanted() {
  const char* isa = std::getenv("KFSTAB_ISA");
  const Kernels* fastest = available().empty() ? nullptr : &available().back();
  return isa ? find(isa).value_or(fastest) : fastest;
}

std::atomic<const Kernels*>& chosen() {
  static std::atomic<const Kernels*> kernels = wanted();
  return kernels;
}

[[noreturn]] void refuse(std::string_view what, std::string_view isa) {
  std::string message = std::string(what) + ": this machine has no kernels for '" + std::string(isa) + "', but plain";
  for (const Kernels& kernels : available()) message += ", " + std::string(kernels.isa);
  throw std::invalid_argument(message);
}

}  // namespace

const Kernels* in_use() { return chosen().load(std::memory_order_relaxed); }

void use(std::string_view isa) {
  const auto kernels = find(isa);
  if (!kernels) refuse("kfstab::kernels::use", isa);
  chosen() = *kernels;
}

void check_environment() {
  const char* isa = std::getenv("KFSTAB_ISA");
  if (isa && !find(isa)) refuse("KFSTAB_ISA", isa);
}

}  // namespace kfstab::kernels
