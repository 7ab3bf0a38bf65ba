#include <kfstab/reference/detail/lockstep_of.hpp>

// The rungs for ill-conditioned and for long unstable runs.
namespace kfstab::reference::detail {

std::unique_ptr<Lockstep> make_high_lockstep(int pair, const Source& source, bool with_data) {
  switch (pair) {
    case 3: return std::make_unique<LockstepOf<192, 384>>(source, with_data);
    case 4: return std::make_unique<LockstepOf<384, 770>>(source, with_data);
    default: return std::make_unique<LockstepOf<770, 1540>>(source, with_data);
  }
}

}  // namespace kfstab::reference::detail
