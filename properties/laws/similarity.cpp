#include <kfstab/properties/comparison.hpp>

namespace kfstab::properties::laws::similarity {

namespace {

std::optional<Finding> examine(Bench& bench, const System& system) {
  if (system.A.rows() < 2) return std::nullopt;
  return compare_bases(bench, with_data(system), system, {.T = reflection(system.A.rows())},
                       "turned back into the first basis");
}

}  // namespace

Law law() {
  return {.id = "similarity",
          .statement =
              "The state in another orthonormal basis (A as T A T', B as T B, C as C T', P0 as T P0 T', x0 as T x0): P "
              "as T P T', K as T K, x as T x",
          .assumptions = "steps in which 30 b is small, where first order holds",
          .source = "theory 1; orthogonal T leave every norm and every condition number as it is",
          .tolerance =
              "30 (b + b), b the tolerance of comparison.hpp: the first-order bound of the form, and what rounding the "
              "turned numbers once does",
          .failure =
              "The filter is right in one basis only: A or P transposed in a place where it matters, products taken "
              "entry by entry, off-diagonal entries of P forgotten, states treated one by one.",
          .examine = examine};
}

}  // namespace kfstab::properties::laws::similarity
