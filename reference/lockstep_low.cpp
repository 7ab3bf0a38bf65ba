#include <kfstab/reference/detail/lockstep_of.hpp>

// The rungs that nearly every run stays on.
namespace kfstab::reference::detail {

std::unique_ptr<Lockstep> make_low_lockstep(int pair, const Source& source, bool with_data) {
  switch (pair) {
    case 0: return std::make_unique<LockstepOf<57, 76>>(source, with_data);
    case 1: return std::make_unique<LockstepOf<76, 115>>(source, with_data);
    default: return std::make_unique<LockstepOf<115, 192>>(source, with_data);
  }
}

}  // namespace kfstab::reference::detail
