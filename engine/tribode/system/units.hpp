#pragma once
#include "tribode/system/expressions.hpp"

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>

namespace tribode {

// What a quantity is measured in: powers of base units, "m" -> 1, "s" -> -2. Empty: a plain number. Nothing: not known,
// and then anything fits.
using Dimension = std::optional<std::map<std::string, double>>;

// "N m s/rad", "m/s^2", "V/(A s)", "1/s": a blank, "*" or "·" multiplies, "/" divides by the factor or bracket behind it.
// SI units are brought to kg, m, s, A and K; rad and 1 are plain numbers, degC is K. Any other name is a unit of its own,
// so that mm and m differ. Nothing where the text is empty or is no unit.
Dimension dimension_of(std::string_view unit);

std::string to_text(const Dimension& dimension); // "kg m/s2", "1"
// The same by one SI unit with a name of its own where that is shorter: "N/m", "1/V", "N s/m".
std::string to_readable_text(const Dimension& dimension);
bool is_si(const Dimension& dimension); // no other unit is a factor in it; or it is not known

// Whether the two may stand for the same quantity.
bool fit(const Dimension& a, const Dimension& b);

// Units of expressions. A variable without a unit and the time are of any unit; so are products with them and functions of
// them. A number written in an equation is a plain one as a factor, and of the unit of what it is added to or compared
// with. Sums, comparisons and branches need equal units, functions plain numbers.
class Units {
  public:
    explicit Units(const Expressions& graph) : graph_(graph) {}

    void set(Term variable, std::string_view unit) { known_[variable] = dimension_of(unit); }

    // Throws InputError where units do not fit: "x + v adds m and m/s".
    Dimension of(Term term);

    // What to say besides where a unit is not the one that was expected: of the first number that is a factor in the term,
    // which its writer may have meant in a unit. Else empty.
    std::string advice(Term term) const;

  private:
    Dimension combined(Term term) const; // from the operands, which are known

    const Expressions& graph_;
    std::unordered_map<Term, Dimension> known_;
};

} // namespace tribode
