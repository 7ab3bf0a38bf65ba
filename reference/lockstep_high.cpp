#include <kfstab/reference/detail/lockstep_of.hpp>

// The rungs for ill-conditioned and for long unstable runs.
namespace kfstab::reference::detail {

std::unique_ptr<Lockstep> make_high_lockstep(int pair, const AnyProblem<double>& problem, bool with_data) {
  switch (pair) {
    case 3: return std::make_unique<LockstepOf<200, 400>>(problem, with_data);
    case 4: return std::make_unique<LockstepOf<400, 800>>(problem, with_data);
    default: return std::make_unique<LockstepOf<800, 1600>>(problem, with_data);
  }
}

}  // namespace kfstab::reference::detail
