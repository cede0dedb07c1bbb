#pragma once
#include <array>
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

namespace tribode {

// A function of one or two variables that goes through given points, as polynomials between them.
//
// Linear interpolation has kinks: abscissas at which the slope jumps. So has an extrapolation that holds a curve's last
// value. Kinks divide an axis into stretches, counted from 0. An equation that holds the side of its table, whether the
// stretch is odd, between events sees no kink within a step: beyond its end the stretch goes on as it was, up to the middle
// of the next one. border() is positive on odd stretches, negative on even ones, and its zeros are the kinks.
class LookupTable {
  public:
    enum class Interpolation {
        linear, // bilinear in two variables
        pchip,  // cubics that are monotonic where the points are [Fritsch 1984]; one variable
        spline, // the cubic spline with two continuous derivatives, whose first two and last two pieces are one cubic
        natural // the cubic spline whose second derivative is zero at the ends
    };
    enum class Extrapolation {
        refuse, // no value (NaN) beyond the abscissas
        hold,   // the value at the end
        linear  // the line that touches there
    };

    struct Points {
        std::string name = "table"; // for messages
        std::vector<double> x, y;   // abscissas; without y a function of x alone
        std::vector<double> values; // at x, or of each x those at y
        Interpolation interpolation = Interpolation::linear;
        Extrapolation extrapolation = Extrapolation::refuse;
        std::string x_unit, y_unit, unit; // as in Units; empty: any
    };

    // Throws InputError: fewer than two abscissas, abscissas that do not increase, numbers that are not finite, another
    // number of values than there are points, pchip of two variables.
    explicit LookupTable(const Points& points);

    int variables() const { return two_ ? 2 : 1; }
    const std::string& name() const { return name_; }
    const std::string& unit(int variable) const {
        return units_[static_cast<std::size_t>(variable)];
    } // 2: of the value

    // side: 1 where that of x is odd, plus 2 where that of y is. With one variable y is not looked at.
    double value(double x, double y, int side) const;
    // As value() with the sides on which x and y are.
    double value(double x, double y) const { return value(x, y, side_of(x, y)); }
    int side_of(double x, double y) const;
    // Whether the pieces between two kinks are one polynomial, with values everywhere.
    bool is_one_polynomial() const { return one_polynomial_; }

    // The derivative by a variable, on each piece; null where it is zero throughout.
    std::shared_ptr<const LookupTable> slope(int variable) const;
    // A function of one variable; null where there are no kinks. Its slope is continuous. The same one at each call.
    const std::shared_ptr<const LookupTable>& border(int variable) const {
        return borders_[static_cast<std::size_t>(variable)];
    }

    // The least interval that holds all values for one variable, an interval that does for two; with the tables that slope()
    // gives, those of the slope. Empty ranges and sides beyond 0 .. 3 are the caller's error. Not finite where a value of
    // the table may be none.
    struct Range {
        double low = 0, high = 0;
        bool operator==(const Range&) const = default;
    };
    Range range(const Range& x, const Range& y, int side) const;

    // The abscissas between which the table has values; infinite where it extrapolates.
    Range domain(int variable) const;

    // Equal tables give equal numbers.
    std::size_t hash() const;

    // The points it was made of, and how it came from the table through them: "slope 0 border 1". So it can be written down.
    const Points& points() const { return *points_; }
    const std::string& derivation() const { return derivation_; }
    // The table of such a derivation; null where there is none.
    static std::shared_ptr<const LookupTable> derived(std::shared_ptr<const LookupTable> from,
                                                      const std::string& derivation);

  private:
    // Piece 0 lies before the first abscissa, piece i behind abscissa i - 1. A piece is a polynomial in the distance from
    // the abscissa before it, or from the first one.
    struct Axis {
        std::vector<double> knots;
        std::vector<std::size_t> kinks; // places in knots
        std::size_t order = 1;          // coefficients of a piece
        bool refuses = false;

        double origin(std::size_t piece) const { return knots.empty() ? 0 : knots[piece > 0 ? piece - 1 : 0]; }
        std::size_t piece_at(double u) const;
        std::size_t stretch_at(double u) const; // kinks at or below u
        std::size_t piece(double u, bool odd) const;
    };
    struct Stretch {
        std::size_t piece;
        double low, high;
    };

    LookupTable() = default;
    std::shared_ptr<const LookupTable> border_of(std::size_t variable) const;
    static std::vector<Stretch> stretches(const Axis& axis, const Range& range, bool odd);
    const double* coefficients(std::size_t i, std::size_t j) const {
        return coefficients_.data() + (i * (axes_[1].knots.size() + 1) + j) * axes_[0].order * axes_[1].order;
    }

    std::shared_ptr<const Points> points_;
    std::string derivation_;
    std::string name_;
    std::array<std::string, 3> units_;
    bool two_ = false, one_polynomial_ = false;
    std::array<Axis, 2> axes_;
    std::array<std::shared_ptr<const LookupTable>, 2> borders_;
    std::vector<double> coefficients_; // of each piece of x those of y, each by powers of x and in them of y
};

} // namespace tribode
