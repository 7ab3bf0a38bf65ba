// No step allocates, at any size: every function of the allocator is counted, not only what Eigen says of itself.
#include <gtest/gtest.h>

#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <string>
#include <vector>

#include <kfstab/filters/batch.hpp>
#include <kfstab/filters/registry.hpp>

#include "filters/random_problem.hpp"
#include "filters/split_filter.hpp"

#if defined(__SANITIZE_ADDRESS__)
#define KFSTAB_ADDRESS_SANITIZER
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
#define KFSTAB_ADDRESS_SANITIZER
#endif
#endif

namespace {

std::atomic<bool> armed = false;
std::atomic<long> allocations = 0;

void count() noexcept {
  if (armed.load(std::memory_order_relaxed)) allocations.fetch_add(1, std::memory_order_relaxed);
}

}  // namespace

#ifdef KFSTAB_ADDRESS_SANITIZER
// The sanitizer has an allocator of its own, and a hook in it.
extern "C" int __sanitizer_install_malloc_and_free_hooks(void (*)(const volatile void*, std::size_t),
                                                         void (*)(const volatile void*));
static const int installed = __sanitizer_install_malloc_and_free_hooks(
    [](const volatile void*, std::size_t) { count(); }, [](const volatile void*) {});
#else
// The program's own definitions come before the C library's, for all of it: operator new, Eigen, the standard library.
extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);

void* malloc(std::size_t size) {
  count();
  return __libc_malloc(size);
}
void* calloc(std::size_t number, std::size_t size) {
  count();
  return __libc_calloc(number, size);
}
void* realloc(void* old, std::size_t size) {
  count();
  return __libc_realloc(old, size);
}
void* memalign(std::size_t alignment, std::size_t size) {
  count();
  return __libc_memalign(alignment, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  count();
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** out, std::size_t alignment, std::size_t size) {
  count();
  *out = __libc_memalign(alignment, size);
  return *out ? 0 : ENOMEM;
}
}
#endif

namespace kfstab::test::step_allocation {
namespace {

template <class Function>
long allocations_of(Function&& function) {
  allocations = 0;
  armed = true;
  function();
  armed = false;
  return allocations;
}

/// Keeps the compiler from removing an allocation that nobody looks at.
void keep(const void* p) { asm volatile("" : : "r"(p) : "memory"); }

/// Well conditioned at n = 200 too.
AnyProblem<double> large(Parametrisation takes, Dimensions d) {
  AnyProblem<double> problem = random_problem(takes, {.d = d, .inputs = 1}, 61);
  std::visit(
      []<class Model>(Problem<Model>& given) {
        for (auto& model : given.models) {
          const auto tame = [](Matrix<double>& X) {
            for (Index j = 0; j < X.cols(); ++j)
              for (Index i = 0; i < X.rows(); ++i) X(i, j) = i == j ? .5 : X(i, j) / 256;
          };
          model.C /= 16;
          if constexpr (Model::parametrisation == Parametrisation::information) {
            tame(model.A_inverse);
            model.A_inverse_B /= 16;
            tame(model.Q_inverse_root);
            tame(model.R_inverse_root);
          } else {
            tame(model.A);
            model.B /= 16;
          }
          if constexpr (Model::parametrisation == Parametrisation::covariance) {
            model.Q.setIdentity();
            model.R.setIdentity();
          }
          if constexpr (Model::parametrisation == Parametrisation::root) {
            tame(model.Q_root);
            tame(model.R_root);
          }
        }
        given.initial.setIdentity();
      },
      problem);
  return problem;
}

std::vector<Dimensions> sizes() {
  std::vector<Dimensions> all;
  for (const Index n : {1, 8, 40, 200}) {
    all.push_back({n, 1, 2});
    all.push_back({n, 2, 1});
#ifdef KFSTAB_ADDRESS_SANITIZER
    if (n == 200) continue;  // takes a minute, and the other builds have it
#endif
    all.push_back({n, n, n});
  }
  return all;
}

std::string text(std::string_view id, Dimensions d) {
  return std::string(id) + " n=" + std::to_string(d.n) + " m=" + std::to_string(d.m) + " p=" + std::to_string(d.p);
}

}  // namespace

TEST(AllocationCounter, Counts) {
  EXPECT_EQ(allocations_of([] {}), 0);
  EXPECT_GE(allocations_of([] {
              std::vector<int> v;
              v.push_back(1);
              keep(v.data());
            }),
            1);
  EXPECT_GE(allocations_of([] {
              void* p = std::malloc(100);
              keep(p);
              p = std::realloc(p, 100000);
              keep(p);
              std::free(p);
              p = std::calloc(10, 10);
              keep(p);
              std::free(p);
              p = std::aligned_alloc(64, 128);
              keep(p);
              std::free(p);
              if (posix_memalign(&p, 64, 128) == 0) keep(p), std::free(p);
              struct alignas(64) Wide {
                double x[8];
              };
              const auto wide = std::make_unique<Wide>();
              keep(wide.get());
            }),
            6);
  // What the filters avoid: from 160 columns on, Eigen's product takes buffers from the heap.
  const Matrix<double> X = Matrix<double>::Ones(200, 200);
  Matrix<double> Y(200, 200);
  EXPECT_GE(allocations_of([&] { Y.noalias() = X * X; }), 1);
  EXPECT_EQ(allocations_of([&] { Y.noalias() = X.lazyProduct(X); }), 0);
}

TEST(Step, OfEveryFilterAllocatesNothing) {
  for (const Metadata& metadata : filters())
    for (const Dimensions d : sizes()) {
      const AnyProblem<double> problem = large(metadata.takes, d);
      const auto filter = make_filter<double>(metadata.id);
      filter->start(problem);
      Dice dice(62);
      const Vector<double> y = dice.vector(d.p, 16), input = dice.vector(1, 16);
      Status status = Status::ok;
      const int steps = d.n * d.p < 10000 ? 3 : 1;  // of 200 x 200 arrays one takes long enough
      for (int k = 0; k < steps && status == Status::ok; ++k)
        EXPECT_EQ(allocations_of([&] { status = filter->step(k, &y, &input).report.status; }), 0)
            << text(metadata.id, d) << ", step " << k;
      EXPECT_EQ(status, Status::ok) << text(metadata.id, d) << ": " << name(status);
    }
}

template <class Filter>
void batch_allocates_nothing() {
  using Model = typename Filter::Model;
  const Dimensions d{5, 2, 3};
  const auto problem = std::get<Problem<Model>>(large(Model::parametrisation, d));
  Batch<Filter> batch(9, d);
  Dice dice(64);
  for (Index i = 0; i < batch.count(); ++i) {
    Model model = problem.models[0];
    if (i == 4) model.C *= 1e200;  // is done alone
    if (i == 5) model.C(0, 0) = std::nan("");
    batch.start(i, problem.initial, problem.x0);
    batch.set_model(i, model);
    batch.set_data(i, dice.vector(d.p, 16));
  }
  for (const Wanted wanted : {Wanted::all, Wanted::state, Wanted::gain, Wanted::factor})
    EXPECT_EQ(allocations_of([&] { batch.step(true, wanted); }), 0) << static_cast<int>(wanted);
  EXPECT_EQ(batch.report(0).status, Status::ok);
  EXPECT_EQ(batch.report(5).status, Status::non_finite_input);
}

TEST(Step, OfABatchAllocatesNothing) {
  batch_allocates_nothing<ConventionalFilter<double>>();
  batch_allocates_nothing<SquareRootCovarianceFilter<double>>();
  batch_allocates_nothing<SquareRootInformationFilter<double>>();
}

TEST(Step, ThatFailsAllocatesNothing) {
  for (const Metadata& metadata : filters()) {
    const Dimensions d{8, 2, 2};
    const AnyProblem<double> problem = large(metadata.takes, d);
    const auto filter = make_filter<double>(metadata.id);
    filter->start(problem);
    const Vector<double> y = Vector<double>::Constant(2, std::nan("")), input = Vector<double>::Zero(1);
    Status status = Status::ok;
    EXPECT_EQ(allocations_of([&] { status = filter->step(0, &y, &input).report.status; }), 0) << metadata.id;
    EXPECT_EQ(status, Status::non_finite_input) << metadata.id;
  }
}

TEST(Step, InHalvesAllocatesNothing) {
  for (const std::string_view id : split_filters())
    for (const Dimensions d : sizes()) {
      const AnyProblem<double> problem = large(find_filter(id)->takes, d);
      const auto filter = make_split_filter(id);
      filter->start(problem);
      Dice dice(63);
      const Vector<double> y = dice.vector(d.p, 16), input = dice.vector(1, 16);
      Status first = Status::ok, second = Status::ok, both = Status::ok;
      EXPECT_EQ(allocations_of([&] { first = filter->measurement_update(0, &y).status; }), 0) << text(id, d);
      EXPECT_EQ(allocations_of([&] { second = filter->time_update(0, &input).status; }), 0) << text(id, d);
      EXPECT_EQ(allocations_of([&] { both = filter->step(0, &y, &input).status; }), 0) << text(id, d);
      EXPECT_EQ(first, Status::ok) << text(id, d);
      EXPECT_EQ(second, Status::ok) << text(id, d);
      EXPECT_EQ(both, Status::ok) << text(id, d);
    }
}

}  // namespace kfstab::test::step_allocation
