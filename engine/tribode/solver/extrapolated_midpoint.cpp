#include "tribode/solver/extrapolated_midpoint.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tribode {

namespace {

constexpr std::size_t max_columns = 8; // order 16
constexpr std::size_t few_columns = 5; // with so many a step may be longer
// Of two extrapolations; the error of the last one is far smaller.
constexpr double tolerance = 1e-12;
// Of the whole interval. At isolated points forces may have kinks, and powers and logarithms of the speed at rest: there the error does
// not fall against the sensitivity itself, which begins at zero, but no piece as short counts against what comes of the whole.
constexpr double shortest = 0x1p-24;

// to = from + factor slope
TRIBODE_CLONES void move(std::span<const Lanes> from, double factor, std::span<const Lanes> slope,
                         std::span<Lanes> to) {
    for (std::size_t i = 0; i < to.size(); ++i) to[i] = from[i] + factor * slope[i];
}

// (before + now + h slope)/2: without the part of the midpoint rule that alternates
TRIBODE_CLONES void smooth(std::span<const Lanes> before, std::span<const Lanes> now, double h,
                           std::span<const Lanes> slope, std::span<Lanes> to) {
    for (std::size_t i = 0; i < to.size(); ++i) to[i] = 0.5 * (before[i] + now[i] + h * slope[i]);
}

// now, extrapolated with the entry of one number of substeps less; that becomes what now was.
TRIBODE_CLONES void extrapolate(double weight, std::span<Lanes> last, std::span<Lanes> now) {
    for (std::size_t i = 0; i < now.size(); ++i) {
        const Lanes was = now[i];
        now[i] = was + weight * (was - last[i]);
        last[i] = was;
    }
}

} // namespace

ExtrapolatedMidpoint::ExtrapolatedMidpoint(std::vector<double> scale, std::size_t entries)
    : inverse_scale_(std::move(scale)),
      entries_(entries),
      longest_(std::numeric_limits<double>::infinity()) {
    for (double& one : inverse_scale_) one = 1 / one;
    for (auto* room : {&slope_, &start_slope_, &before_, &now_, &next_}) room->resize(entries_);
    table_.assign(max_columns, std::vector<Lanes>(entries_));
}

bool ExtrapolatedMidpoint::advance(double t, double h, std::span<Lanes> z, const Rates& rates) {
    double done = 0;
    while (done < h) {
        const double rest = h - done, piece = rest < 1.01 * longest_ ? rest : std::min(longest_, rest / 2);
        if (step(t + done, piece, piece <= shortest * h, z, rates)) {
            done = piece == rest ? h : done + piece;
            if (columns_ <= few_columns && piece > 0.9 * longest_) longest_ = 2 * piece;
            continue;
        }
        if (piece <= shortest * h) return false;
        longest_ = std::max(piece / 2, shortest * h);
    }
    return true;
}

// By how much the last extrapolation has moved z, of the largest sensitivity by that parameter.
double ExtrapolatedMidpoint::change(std::span<const Lanes> z, std::span<const Lanes> moved) const {
    double most = 0;
    for (std::size_t p = 0; p < lane_count; ++p) {
        double size = 0, off = 0;
        for (std::size_t i = 0; i < inverse_scale_.size(); ++i) {
            size = std::max(size, inverse_scale_[i] * std::max(std::abs(z[i][p]), std::abs(now_[i][p])));
            const double by = inverse_scale_[i] * std::abs(now_[i][p] - moved[i][p]);
            if (!(by <= off)) off = by; // also what is not a number
        }
        if (off == 0) continue;
        const double share = off / size;
        if (!(share <= most)) most = share;
        if (std::isnan(most)) return most;
    }
    return most;
}

// at_least: with an error that is any number.
bool ExtrapolatedMidpoint::step(double t, double h, bool at_least, std::span<Lanes> z, const Rates& rates) {
    rates(t, z, start_slope_);
    double last_change = 0;
    for (columns_ = 1; columns_ <= max_columns; ++columns_) {
        const std::size_t substeps = 2 * columns_;
        const double part = h / static_cast<double>(substeps);
        std::copy(z.begin(), z.end(), before_.begin());
        move(z, part, start_slope_, now_);
        for (std::size_t i = 1; i < substeps; ++i) {
            rates(t + static_cast<double>(i) * part, now_, slope_);
            move(before_, 2 * part, slope_, next_);
            before_.swap(now_);
            now_.swap(next_);
        }
        rates(t + h, now_, slope_);
        smooth(before_, now_, part, slope_, next_);
        now_.swap(next_);
        // Along the row of the table, each entry of one order more.
        for (std::size_t k = 1; k < columns_; ++k) {
            const double ratio = static_cast<double>(columns_) / static_cast<double>(columns_ - k);
            extrapolate(1 / (ratio * ratio - 1), table_[k - 1], now_);
        }
        const double moved = columns_ > 1 ? change(z, table_[columns_ - 2]) : 1;
        table_[columns_ - 1] = now_;
        if (moved <= tolerance || (at_least && columns_ == few_columns && std::isfinite(moved))) {
            std::copy(now_.begin(), now_.end(), z.begin());
            return true;
        }
        // Whether those that are left would do, if each gains as much as this one.
        if (columns_ > 3 && !at_least) {
            const double gain = moved / last_change;
            if (!(moved * std::pow(gain, static_cast<double>(max_columns - columns_)) <= tolerance)) return false;
        }
        last_change = moved;
    }
    return false;
}

} // namespace tribode
