#pragma once

/// Ctrl-C. Long work asks interrupted() between its steps, keeps what is done, and the command ends with exit code 130.
namespace kfstab::experiments {

/// From now on SIGINT and SIGTERM set a flag; a second one ends the process at once.
void watch_for_interruption();

bool interrupted();

/// What cannot be kept half done, a claim, asks this between its steps: true, or throws Interrupted. So what comes after its loops
/// may rely on all that they make.
struct Interrupted {};
bool going_on();

}  // namespace kfstab::experiments
