#pragma once

#include <kfstab/filters/metadata.hpp>

namespace kfstab::experiments {

/// Multiply-adds of one step: Metadata::operations, theory (5), at these sizes. Where the count depends on more, it is
/// for alpha = n, the most that it can be, and s = 6 sweeps. NaN where nobody counted.
double operations(const Metadata& filter, Dimensions dimensions);

}  // namespace kfstab::experiments
