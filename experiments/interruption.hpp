#pragma once

/// Ctrl-C. Long work asks interrupted() between its steps, keeps what is done, and the command ends with exit code 130.
namespace kfstab::experiments {

/// From now on SIGINT and SIGTERM set a flag; a second one ends the process at once.
void watch_for_interruption();

bool interrupted();

}  // namespace kfstab::experiments
