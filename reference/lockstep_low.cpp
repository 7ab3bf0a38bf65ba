#include <kfstab/reference/detail/lockstep_of.hpp>

// The rungs that nearly every run stays on.
namespace kfstab::reference::detail {

std::unique_ptr<Lockstep> make_low_lockstep(int pair, const AnyProblem<double>& problem, bool with_data) {
  switch (pair) {
    case 0: return std::make_unique<LockstepOf<20, 50>>(problem, with_data);
    case 1: return std::make_unique<LockstepOf<50, 100>>(problem, with_data);
    default: return std::make_unique<LockstepOf<100, 200>>(problem, with_data);
  }
}

}  // namespace kfstab::reference::detail
