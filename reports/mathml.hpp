#pragma once
// Equations in plain notation, as docs/theory.md and the filters' metadata have them, as MathML that a browser sets.

#include <string>
#include <string_view>

namespace kfstab::reports {

/// One equation as a <math> element:
///   P+ = A (P - W W') A'          a sign right after a name is a superscript; ' is the transpose, set as a raised T
///   x_{k+1|k}  Re^{1/2}  n^3      subscripts and superscripts, in braces if longer than a sign
///   Re  Kf  P0  l1                a second letter in lower case, or a number, is a subscript
///   lambda  rho(F)  Sig           Greek letters by name; Phi, Sig, Theta are capitals
///   |l1 l2|  ||F||                absolute values and norms
///   [A S, B; 0, I]                a matrix: rows end with `;`, entries with `,`
///   u / (1 - rho(F)^2)            a fraction, if there are blanks around the stroke; else as it is written
/// Other words stay words. What cannot be read (a bracket without its partner) is text as a whole.
std::string render_mathml(std::string_view equation);

}  // namespace kfstab::reports
