#pragma once

#include <string>

#include <kfstab/properties/check.hpp>

namespace kfstab::properties {

/// What is wrong, for the message of a failed test: the law, the smallest system that breaks it, what was found there, and
/// where to look.
std::string failure_message(const LawOutcome& outcome);

}  // namespace kfstab::properties
