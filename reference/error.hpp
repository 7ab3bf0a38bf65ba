#pragma once

#include <stdexcept>

namespace kfstab::reference {

/// The reference has no answer: Re is not positive definite, A^{-1} is singular, a number is not finite or does not
/// fit a double, shapes do not agree, or no precision at hand certifies the digits asked for. what() says which, where
/// and at which step. The reference throws this rather than return a wrong number.
class ReferenceError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace kfstab::reference
