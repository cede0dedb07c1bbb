#include "tribode/design/deadbeat_feedforward.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"

#include <Eigen/QR>
#include <fmt/format.h>
#include <numeric>

namespace tribode {

namespace {

// A step of the given height through a finite impulse response; the last value stays.
std::vector<double> step_response(const std::vector<double>& impulse, double height, std::size_t length) {
    std::vector<double> result(length);
    double sum = 0;
    for (std::size_t k = 0; k < length; ++k) {
        if (k < impulse.size()) sum += impulse[k];
        result[k] = height * sum;
    }
    return result;
}

} // namespace

std::vector<double> deadbeat_taps(const DiscretePlant& plant, std::size_t count, int smoothness) {
    const auto& n = plant.numerator();
    const double static_numerator = std::accumulate(n.begin(), n.end(), 0.0); // N(1)
    if (count == 0 || static_numerator == 0) {
        throw InputError("deadbeat feedforward: the plant has a zero at z = 1 or there is no tap, must not be so");
    }
    std::vector<double> cost = plant.denominator();
    for (int i = 1; i < smoothness; ++i) cost = product(cost, {1, -1});

    // min |A K|^2 with N(1) sum K = 1, A the convolution with `cost`: K is along (A^T A)^-1 1. By A = Q R without the
    // square of A, whose condition number is large: D is small at all low frequencies.
    const auto columns = static_cast<Eigen::Index>(count), rows = columns + static_cast<Eigen::Index>(cost.size()) - 1;
    Eigen::MatrixXd a = Eigen::MatrixXd::Zero(rows, columns);
    for (Eigen::Index j = 0; j < columns; ++j) {
        for (std::size_t i = 0; i < cost.size(); ++i) a(j + static_cast<Eigen::Index>(i), j) = cost[i];
    }
    const Eigen::HouseholderQR<Eigen::MatrixXd> qr(a);
    const auto r = qr.matrixQR().topRows(columns).triangularView<Eigen::Upper>();
    const Eigen::VectorXd direction = r.solve(r.transpose().solve(Eigen::VectorXd::Ones(columns)));
    const Eigen::VectorXd taps = direction / (direction.sum() * static_numerator);
    return {taps.begin(), taps.end()};
}

Feedforward deadbeat_feedforward(const ModalModel& model, const MoveTask& task, int smoothness) {
    const DiscretePlant plant(model, task.sample_time);
    const std::size_t end = task.settling_sample();
    if (end < plant.order()) {
        throw InputError(fmt::format("deadbeat feedforward: the duration {} s is {} samples, must be {} or more for a "
                                     "model of this order",
                                     to_text(task.duration), end, plant.order()));
    }
    const auto taps = deadbeat_taps(plant, end - plant.order() + 1, smoothness);
    return {"deadbeat", task, step_response(plant.times_numerator(taps), task.distance, task.length()),
            step_response(plant.times_denominator(taps), task.distance, task.length())};
}

} // namespace tribode
