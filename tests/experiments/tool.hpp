#pragma once

#include <sys/wait.h>

#include <cstdlib>
#include <string>

#include <fmt/core.h>

#include "reports/scratch.hpp"

namespace kfstab::test {

/// The tool, run in a scratch folder as from a shell, without a PATH to gnuplot.
class ToolInFolder : public ScratchFolder {
 protected:
  /// Its exit code; its output goes into files.
  int kfstab(const std::string& arguments) const {
    const std::string command =
        fmt::format("cd '{}' && PATH=/nowhere '{}' {} >out 2>err", folder.string(), KFSTAB_TOOL_PATH, arguments);
    const int status = std::system(command.c_str());
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  std::string out() const { return read(folder / "out"); }
  std::string err() const { return read(folder / "err"); }
};

}  // namespace kfstab::test
