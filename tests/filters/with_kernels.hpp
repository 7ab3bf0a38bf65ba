#pragma once

#include <string>
#include <string_view>
#include <vector>

#include <kfstab/filters/kernels.hpp>

namespace kfstab::test {

/// The kernels of that name, or the plain text, until the block ends.
class WithKernels {
 public:
  explicit WithKernels(std::string_view isa) : before_(kernels::in_use() ? kernels::in_use()->isa : "plain") {
    kernels::use(isa);
  }
  WithKernels(const WithKernels&) = delete;
  ~WithKernels() { kernels::use(before_); }

 private:
  std::string before_;
};

/// All that this machine has, and the plain text.
inline std::vector<std::string> all_kernels() {
  std::vector<std::string> names = {"plain"};
  for (const kernels::Kernels& k : kernels::available()) names.emplace_back(k.isa);
  return names;
}

}  // namespace kfstab::test
