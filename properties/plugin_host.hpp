#pragma once

#include <filesystem>

namespace kfstab::properties {

/// Speaks protocol 1 on standard input and output for a shared library with the functions of kfstab_filter.h, until it is
/// told to stop or its input ends. What the library prints goes to standard error. Returns an exit code: 1 for a library
/// that cannot be loaded, or lacks what it needs, which is then said on standard error.
int serve_plugin(const std::filesystem::path& library);

}  // namespace kfstab::properties
