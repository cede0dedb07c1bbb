#include "tribode/diagnosis/noise_floor.hpp"
#include "tribode/base/random.hpp"
#include "tribode/diagnosis/response.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace tribode {

namespace {

constexpr std::size_t seeds = 6;
constexpr std::size_t model_order = 32; // 16 ms at 2 kHz: the loop's shape, short against any record
constexpr std::uint64_t floor_stream = 0x66c7;

double mean_square(const std::vector<double>& x) {
    double sum = 0;
    for (const double value : x) sum += value * value;
    return sum / static_cast<double>(x.size());
}

// Noise of the positions from their third differences, which a smooth motion hardly has. White noise of variance s^2
// gives 20 s^2.
double rms_of_fine_part(const std::vector<double>& y) {
    double sum = 0;
    for (std::size_t k = 0; k + 3 < y.size(); ++k) {
        const double d = y[k + 3] - 3 * y[k + 2] + 3 * y[k + 1] - y[k];
        sum += d * d;
    }
    return std::sqrt(sum / (20 * static_cast<double>(y.size() - 3)));
}

// Linear prediction of all signals by Burg's recursion, which uses no more than what is within them [Burg 1975]: covariances that lack
// what is beyond the ends say nothing of how little is new in a signal that is smooth.
std::vector<double> predictor_of(const std::vector<std::vector<double>>& signals, std::size_t order) {
    auto ahead = signals, behind = signals; // what predictions forwards and backwards leave
    std::vector<double> a;
    for (std::size_t n = 1; n <= order; ++n) {
        double product = 0, squares = 0;
        for (std::size_t s = 0; s < signals.size(); ++s) {
            for (std::size_t k = n; k < signals[s].size(); ++k) {
                product += ahead[s][k] * behind[s][k - 1];
                squares += ahead[s][k] * ahead[s][k] + behind[s][k - 1] * behind[s][k - 1];
            }
        }
        if (!(squares > 0)) break;
        const double reflection = 2 * product / squares;
        std::vector<double> next(n);
        for (std::size_t j = 0; j + 1 < n; ++j) next[j] = a[j] - reflection * a[n - 2 - j];
        next[n - 1] = reflection;
        a = std::move(next);
        for (std::size_t s = 0; s < signals.size(); ++s) {
            for (std::size_t k = signals[s].size() - 1; k >= n; --k) {
                const double forwards = ahead[s][k], backwards = behind[s][k - 1];
                ahead[s][k] = forwards - reflection * backwards;
                behind[s][k] = backwards - reflection * forwards;
            }
        }
    }
    return a;
}

} // namespace

std::vector<double> NoiseFloor::whitened(const std::vector<double>& errors) const {
    std::vector<double> white(errors.size());
    const double scale = 1 / innovation;
    for (std::size_t k = 0; k < errors.size(); ++k) {
        double value = errors[k];
        const std::size_t reach = std::min(k, predictor.size());
        for (std::size_t j = 0; j < reach; ++j) value -= predictor[j] * errors[k - 1 - j];
        white[k] = value * scale;
    }
    return white;
}

std::optional<NoiseFloor> noise_floor(const MachineModel& machine, const Measurement& measurement,
                                      const RunControl& control) {
    MachineModel noisy = machine;
    if (noisy.noise_rms == 0 && noisy.encoder_resolution == 0)
        noisy.noise_rms = rms_of_fine_part(measurement.position());
    const auto clean = simulated_position(noisy, measurement);
    if (!clean) return std::nullopt;
    std::vector<std::vector<double>> errors(seeds);
    RunControl quiet;
    quiet.workers = control.workers;
    for_each_index(seeds, quiet, "", [&](std::size_t i) {
        const auto run = simulated_position(noisy, measurement, derived_seed(floor_stream, i));
        if (!run) return;
        errors[i] = *run;
        for (std::size_t k = 0; k < clean->size(); ++k) errors[i][k] -= (*clean)[k];
    });
    std::erase_if(errors, [](const auto& e) { return e.empty(); });
    double square = 0;
    for (const auto& e : errors) square += mean_square(e) / static_cast<double>(errors.size());
    if (!(square > 0)) return std::nullopt;
    NoiseFloor floor;
    floor.rms = std::sqrt(square);
    floor.predictor = predictor_of(errors, std::min(model_order, measurement.size() / 10));
    std::vector<double> squares;
    for (const auto& e : errors) squares.push_back(mean_square(floor.whitened(e)));
    const double mean = std::accumulate(squares.begin(), squares.end(), 0.0) / static_cast<double>(squares.size());
    floor.innovation = std::sqrt(mean);
    double variance = 0;
    for (const double value : squares) variance += (value - mean) * (value - mean) / (mean * mean);
    variance /= std::max<double>(1, static_cast<double>(squares.size()) - 1);
    floor.spread = std::sqrt(std::max(variance - 2 / static_cast<double>(measurement.size()), 0.0));
    return floor;
}

} // namespace tribode
