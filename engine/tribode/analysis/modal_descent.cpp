#include "tribode/analysis/modal_descent.hpp"

#include <Eigen/QR>

#include <algorithm>
#include <cmath>

namespace tribode {

namespace {

double* numbers_of(std::vector<Lanes>& lanes) { return lanes.front().of.data(); }

// k/(w_j^2 - w^2 + j 2 zeta w_j w) for k = 1, added with k to P.
TRIBODE_CLONES void add_mode(std::size_t blocks, const Lanes* omega, const Lanes* square, double gain,
                             double own_square, double damp, Lanes* receptance, Lanes* model) {
    for (std::size_t b = 0; b < blocks; ++b) {
        const Lanes stiff = own_square - square[b], loss = damp * omega[b];
        const Lanes scale = 1 / (stiff * stiff + loss * loss);
        const Lanes real = scale * stiff, imag = -(scale * loss);
        receptance[b] = real;
        receptance[blocks + b] = imag;
        model[b] += gain * real;
        model[blocks + b] += gain * imag;
    }
}

TRIBODE_CLONES void set_rigid(std::size_t blocks, const Lanes* square, double gain, Lanes* model) {
    for (std::size_t b = 0; b < blocks; ++b) {
        model[b] = -gain / square[b];
        model[blocks + b] = Lanes{};
    }
}

// abs(H)^2/abs(P)^2, and H conj(P).
TRIBODE_CLONES void compare(std::size_t blocks, const Lanes* real, const Lanes* imag, const Lanes* norm,
                            const Lanes* model, Lanes* ratio, Lanes* cross) {
    for (std::size_t b = 0; b < blocks; ++b) {
        const Lanes &p = model[b], &q = model[blocks + b];
        ratio[b] = norm[b] / (p * p + q * q);
        cross[b] = real[b] * p + imag[b] * q;
        cross[blocks + b] = imag[b] * p - real[b] * q;
    }
}

// The derivatives -(dP/dp)/P by the logarithms, of gain and phase; times their weights.
TRIBODE_CLONES void put_rigid_column(std::size_t blocks, const Lanes* square, const Lanes* model, const Lanes* weight,
                                     double gain, Lanes* column) {
    for (std::size_t b = 0; b < blocks; ++b) {
        const Lanes &p = model[b], &q = model[blocks + b];
        const Lanes by = weight[b] * (gain / square[b]) / (p * p + q * q);
        column[b] = by * p;
        column[blocks + b] = -(by * q);
    }
}
TRIBODE_CLONES void put_mode_columns(std::size_t blocks, const Lanes* omega, const Lanes* receptance,
                                     const Lanes* model, const Lanes* weight, double gain, double own_square,
                                     double damp, Lanes* columns) {
    for (std::size_t b = 0; b < blocks; ++b) {
        const Lanes &p = model[b], &q = model[blocks + b];
        const Lanes scale = weight[b] / (p * p + q * q), inverse_real = -(scale * p), inverse_imag = scale * q;
        const Lanes &once_real = receptance[b], &once_imag = receptance[blocks + b];
        const Lanes part_real = gain * (once_real * inverse_real - once_imag * inverse_imag);
        const Lanes part_imag = gain * (once_real * inverse_imag + once_imag * inverse_real);
        // -receptance (2 w_j^2 + j loss) for w_j, of which that for zeta is a part.
        const Lanes loss = damp * omega[b];
        const Lanes damping_real = loss * once_imag, damping_imag = -(loss * once_real);
        const Lanes own_real = damping_real - 2 * own_square * once_real;
        const Lanes own_imag = damping_imag - 2 * own_square * once_imag;
        columns[b] = part_real;
        columns[blocks + b] = part_imag;
        columns[2 * blocks + b] = part_real * own_real - part_imag * own_imag;
        columns[3 * blocks + b] = part_real * own_imag + part_imag * own_real;
        columns[4 * blocks + b] = part_real * damping_real - part_imag * damping_imag;
        columns[5 * blocks + b] = part_real * damping_imag + part_imag * damping_real;
    }
}

TRIBODE_CLONES void put_right_side(std::size_t blocks, const Lanes* gain, const Lanes* phase, const Lanes* weight,
                                   Lanes* column) {
    for (std::size_t b = 0; b < blocks; ++b) {
        column[b] = weight[b] * gain[b];
        column[blocks + b] = weight[b] * phase[b];
    }
}

TRIBODE_CLONES void put_squares(std::size_t blocks, const Lanes* gain, const Lanes* phase, Lanes* square) {
    for (std::size_t b = 0; b < blocks; ++b) square[b] = gain[b] * gain[b] + phase[b] * phase[b];
}

// Always in the same order, whatever the processor.
double sum_of(const Lanes& a) { return ((a[0] + a[4]) + (a[2] + a[6])) + ((a[1] + a[5]) + (a[3] + a[7])); }

TRIBODE_CLONES double product_of(std::size_t blocks, const Lanes* a, const Lanes* b) {
    Lanes even, odd;
    std::size_t i = 0;
    for (; i + 1 < blocks; i += 2) {
        even += a[i] * b[i];
        odd += a[i + 1] * b[i + 1];
    }
    if (i < blocks) even += a[i] * b[i];
    return sum_of(even + odd);
}
TRIBODE_CLONES void subtract(std::size_t blocks, double factor, const Lanes* a, Lanes* b) {
    for (std::size_t i = 0; i < blocks; ++i) b[i] -= factor * a[i];
}

} // namespace

ModalDescent::ModalDescent(std::span<const ResponsePoint> points, Bounds gain, Bounds omega, Bounds zeta)
    : count_(points.size()),
      blocks_((points.size() + lane_count - 1) / lane_count),
      gain_(gain),
      omega_bounds_(omega),
      zeta_(zeta) {
    for (auto* column : {&omega_, &square_, &real_, &imag_, &norm_, &gain_error_, &phase_error_, &weight_}) {
        column->resize(blocks_);
    }
    model_.resize(2 * blocks_);
    for (std::size_t k = 0; k < blocks_ * lane_count; ++k) {
        const auto& [own, value] = points[std::min(k, count_ - 1)];
        numbers_of(omega_)[k] = own;
        numbers_of(square_)[k] = own * own;
        numbers_of(real_)[k] = value.real();
        numbers_of(imag_)[k] = value.imag();
        numbers_of(norm_)[k] = std::norm(value);
    }
}

void ModalDescent::evaluate(std::span<const double> logarithms) {
    rigid_gain_ = std::exp(logarithms[0]);
    set_rigid(blocks_, square_.data(), rigid_gain_, model_.data());
    modes_.clear();
    receptance_.resize(2 * blocks_ * ((logarithms.size() - 1) / 3));
    for (std::size_t j = 1; j < logarithms.size(); j += 3) {
        const double own = std::exp(logarithms[j + 1]);
        const Mode mode{std::exp(logarithms[j]), own * own, 2 * own * std::exp(logarithms[j + 2])};
        add_mode(blocks_, omega_.data(), square_.data(), mode.gain, mode.square, mode.damp,
                 receptance_.data() + 2 * blocks_ * modes_.size(), model_.data());
        modes_.push_back(mode);
    }
    columns_.resize(std::max(columns_.size(), 3 * blocks_)); // room for what is compared
    Lanes *const ratio = columns_.data(), *const cross = ratio + blocks_;
    compare(blocks_, real_.data(), imag_.data(), norm_.data(), model_.data(), ratio, cross);
    const double *ratios = ratio->of.data(), *reals = cross->of.data(), *imags = reals + blocks_ * lane_count;
    for (std::size_t k = 0; k < count_; ++k) {
        numbers_of(gain_error_)[k] = 0.5 * std::log(ratios[k]);
        numbers_of(phase_error_)[k] = std::atan2(imags[k], reals[k]);
    }
}

// The cost, with the weights of the equations.
double ModalDescent::weigh(double scale) {
    std::vector<Lanes>& squares = columns_;
    put_squares(blocks_, gain_error_.data(), phase_error_.data(), squares.data());
    double cost = 0;
    if (std::isinf(scale)) {
        for (std::size_t k = 0; k < count_; ++k) {
            cost += numbers_of(squares)[k];
            numbers_of(weight_)[k] = 1;
        }
        return 0.5 * cost;
    }
    // A sum of logarithms as that of products, each far from overflow.
    const double square_scale = scale * scale, inverse = 1 / square_scale;
    double product = 1;
    for (std::size_t k = 0; k < count_; ++k) {
        const double growth = 1 + numbers_of(squares)[k] * inverse;
        numbers_of(weight_)[k] = std::sqrt(1 / growth);
        product *= growth;
        if (product < 1e100) continue;
        cost += std::log(product);
        product = 1;
    }
    return 0.5 * square_scale * (cost + std::log(product));
}

// Fills columns_ with the weighted equations.
void ModalDescent::differentiate(std::size_t unknowns) {
    columns_.resize(std::max(columns_.size(), 2 * blocks_ * (unknowns + 1)));
    put_rigid_column(blocks_, square_.data(), model_.data(), weight_.data(), rigid_gain_, columns_.data());
    for (std::size_t j = 0; j < modes_.size(); ++j) {
        const Mode& mode = modes_[j];
        put_mode_columns(blocks_, omega_.data(), receptance_.data() + 2 * blocks_ * j, model_.data(), weight_.data(),
                         mode.gain, mode.square, mode.damp, columns_.data() + 2 * blocks_ * (1 + 3 * j));
    }
    put_right_side(blocks_, gain_error_.data(), phase_error_.data(), weight_.data(),
                   columns_.data() + 2 * blocks_ * unknowns);
}

// The modified method of Gram and Schmidt, the right side taken along: as good as reflections [Björck 1967].
void ModalDescent::decompose(std::size_t unknowns) {
    const auto size = static_cast<Eigen::Index>(unknowns);
    triangle_.setZero(size, size);
    right_.setZero(size);
    const std::size_t height = 2 * blocks_;
    const auto column = [&](std::size_t j) { return columns_.data() + height * j; };
    for (std::size_t j = 0; j < unknowns; ++j) {
        const double square = product_of(height, column(j), column(j));
        const auto row = static_cast<Eigen::Index>(j);
        const double length = triangle_(row, row) = std::sqrt(square);
        if (length == 0) continue;
        for (std::size_t k = j + 1; k <= unknowns; ++k) {
            const double along = product_of(height, column(j), column(k));
            (k < unknowns ? triangle_(row, static_cast<Eigen::Index>(k)) : right_[row]) = along / length;
            subtract(height, along / square, column(j), column(k));
        }
    }
}

ModalDescent::Result ModalDescent::descend(std::vector<double> start, double scale, int max_iterations) {
    constexpr double cost_tolerance = 1e-12, step_tolerance = 1e-12, gradient_tolerance = 1e-14;
    constexpr double first_radius = 1e4, least_radius = 1e-32, most_radius = 1e16;
    constexpr double least_length = 1e-3; // of a scaled column, for its damping
    constexpr double least_quality = 1e-3;
    constexpr int most_invalid = 5;

    Result result;
    std::vector<double>& at = result.logarithms = std::move(start);
    const std::size_t unknowns = at.size();
    const auto size = static_cast<Eigen::Index>(unknowns);
    const auto clamped = [&](std::size_t j, double value) {
        const auto [low, high] = bounds(j);
        return std::clamp(value, low, high);
    };
    for (std::size_t j = 0; j < unknowns; ++j) at[j] = clamped(j, at[j]);

    evaluate(at);
    std::fill(weight_.begin(), weight_.end(), Lanes{});
    result.cost = weigh(scale);
    if (!std::isfinite(result.cost)) {
        result.cost = std::numeric_limits<double>::infinity();
        return result;
    }
    Eigen::VectorXd column_scale, damping;
    double radius = first_radius, shrink = 2;
    bool is_new = true; // the point
    int invalid = 0;
    std::vector<double> tried(unknowns);
    for (;;) {
        if (is_new) {
            differentiate(unknowns);
            decompose(unknowns);
            const Eigen::VectorXd gradient = triangle_.transpose() * right_;
            if (column_scale.size() == 0) column_scale = (1 + triangle_.colwise().norm().array()).inverse();
            double steepest = 0;
            for (std::size_t j = 0; j < unknowns; ++j) {
                steepest =
                    std::max(steepest, std::abs(clamped(j, at[j] - gradient[static_cast<Eigen::Index>(j)]) - at[j]));
            }
            if (result.iterations >= max_iterations) return result;
            if (steepest <= gradient_tolerance) break;
            triangle_ *= column_scale.asDiagonal();
            damping = triangle_.colwise().norm().cwiseMax(least_length);
            is_new = false;
        }
        if (result.iterations >= max_iterations) return result;
        if (radius <= least_radius) break;
        ++result.iterations;

        Eigen::MatrixXd equations(2 * size, size);
        equations << triangle_, Eigen::MatrixXd((damping / std::sqrt(radius)).asDiagonal());
        Eigen::VectorXd right = Eigen::VectorXd::Zero(2 * size);
        right.head(size) = -right_;
        const Eigen::VectorXd step = equations.householderQr().solve(right);
        const Eigen::VectorXd moved = triangle_ * step;
        const double promised = -moved.dot(right_ + 0.5 * moved);
        if (!(promised > 0)) {
            if (++invalid == most_invalid) return result;
            radius *= 0.5;
            continue;
        }
        invalid = 0;

        double length = 0, distance = 0;
        for (std::size_t j = 0; j < unknowns; ++j) {
            const auto i = static_cast<Eigen::Index>(j);
            tried[j] = clamped(j, at[j] + step[i] * column_scale[i]);
            length += at[j] * at[j];
            distance += (tried[j] - at[j]) * (tried[j] - at[j]);
        }
        evaluate(tried);
        const double cost = weigh(scale);
        if (std::sqrt(distance) <= step_tolerance * (std::sqrt(length) + step_tolerance)) break;
        const double gained = result.cost - cost;
        if (std::abs(gained) <= cost_tolerance * result.cost) break;
        const double quality = gained / promised;
        if (quality > least_quality) {
            at = tried;
            result.cost = cost;
            radius = std::min(radius / std::max(1.0 / 3, 1 - std::pow(2 * quality - 1, 3)), most_radius);
            shrink = 2;
            is_new = true;
        } else {
            radius /= shrink;
            shrink *= 2;
        }
    }
    result.converged = true;
    return result;
}

ModalDescent::Residuals ModalDescent::residuals(std::span<const double> logarithms) {
    evaluate(logarithms);
    std::fill(weight_.begin(), weight_.end(), Lanes{});
    weigh(std::numeric_limits<double>::infinity());
    differentiate(logarithms.size());
    const auto rows = static_cast<Eigen::Index>(count_), columns = static_cast<Eigen::Index>(logarithms.size());
    Residuals found{std::vector<double>(numbers_of(gain_error_), numbers_of(gain_error_) + count_),
                    std::vector<double>(numbers_of(phase_error_), numbers_of(phase_error_) + count_),
                    Eigen::MatrixXd(2 * rows, columns)};
    const auto height = static_cast<Eigen::Index>(blocks_ * lane_count);
    const Eigen::Map<const Eigen::MatrixXd> all(numbers_of(columns_), 2 * height, columns);
    found.derivatives << all.topRows(rows), all.middleRows(height, rows);
    return found;
}

} // namespace tribode
