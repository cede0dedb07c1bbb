#include "tribode/machine/servo_numbers.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/field_path.hpp"
#include "tribode/base/text.hpp"

#include <cmath>
#include <fmt/format.h>
#include <utility>

namespace tribode {

namespace {

std::vector<double> values_of(const ServoNumbers& numbers) {
    std::vector<double> all;
    ServoNumbers::each(numbers, [&](double number) { all.push_back(number); });
    return all;
}

// What must not change with a parameter: which parts there are.
std::vector<double> parts_of(const ServoNumbers& n) {
    const auto& plant = n.plant.plant;
    const auto* pid = std::get_if<PidController>(&n.controller);
    const bool is_dry = plant.dry.present() || plant.forward.level != 0 || plant.backward.level != 0 ||
                        plant.forward.viscous != plant.backward.viscous;
    return {plant.current_loop_hz > 0 ? 1.0 : 0.0, is_dry ? 1.0 : 0.0, plant.dry.velocity_dependent() ? 1.0 : 0.0,
            pid && pid->derivative_filter_hz > 0 ? 1.0 : 0.0, static_cast<double>(values_of(n).size())};
}

// The derivative at 0 of values(c), which are smooth and `here` there: differences at h, h/2, h/4, ... extrapolated to h = 0
// [Richardson 1911]. one_sided: c must not be negative.
std::vector<double> derivative(const std::vector<double>& here,
                               const std::function<std::vector<double>(double)>& values, double h, bool one_sided) {
    constexpr std::size_t levels = 5;
    constexpr double rounding = 0x1p-45;    // of differences, relative
    std::vector<std::vector<double>> table; // of the last level, by order
    for (std::size_t level = 0; level < levels; ++level, h /= 2) {
        const auto above = values(h), below = one_sided ? here : values(-h);
        std::vector<double> row(here.size());
        for (std::size_t i = 0; i < row.size(); ++i) {
            row[i] = above[i] == below[i] ? 0 : (above[i] - below[i]) / (one_sided ? h : 2 * h);
        }
        // Along the row of the table: each entry eliminates one more power of h.
        bool moves = level == 0;
        for (std::size_t order = 1; order <= level; ++order) {
            const double power = std::pow(2.0, static_cast<double>(one_sided ? order : 2 * order));
            auto& last = table[order - 1];
            for (std::size_t i = 0; i < row.size(); ++i) {
                const double change = (row[i] - last[i]) / (power - 1);
                moves = moves || (order == level && std::abs(change) > rounding * std::abs(row[i]));
                last[i] = std::exchange(row[i], row[i] + change);
            }
        }
        table.push_back(std::move(row));
        if (!moves) break; // numbers that are polynomials of it
    }
    return table.back();
}

[[noreturn]] void refuse(const std::string& name, const std::string& reason) {
    throw InputError(fmt::format("sensitivities: a run has no derivative by {}: {}", name, reason));
}

ServoDirection direction(const std::string& name, const std::function<ServoNumbers(double)>& numbers_at, double size,
                         bool one_sided) {
    ServoDirection direction{.name = name, .numbers = numbers_at(0)};
    const auto parts = parts_of(direction.numbers);
    const auto by = derivative(
        values_of(direction.numbers),
        [&](double c) {
            const auto numbers = numbers_at(c);
            if (parts_of(numbers) != parts) {
                refuse(name, "its value is none at present, and any other value adds a part to the machine");
            }
            return values_of(numbers);
        },
        size, one_sided);
    std::size_t next = 0;
    ServoNumbers::each(direction.numbers, [&](double& number) { number = by[next++]; });
    if (direction.numbers.sample_time != 0) refuse(name, "it sets the sample instants");
    if (direction.numbers.encoder_resolution != 0) refuse(name, "the encoder's rounding jumps with it");
    visit_present(direction.numbers.controller, [&](const auto& controller) {
        for (const auto& filter : controller.filters) {
            if (filter.freq_hz != 0 || filter.zeta != 0 || filter.depth != 0) {
                refuse(name, "filters of the controller are taken as exact");
            }
        }
    });
    return direction;
}

} // namespace

ServoNumbers ServoNumbers::of(const MachineModel& model) {
    ServoAxis axis = model.axis();
    ServoNumbers n{.sample_time = model.sample_time,
                   .encoder_resolution = axis.encoder_resolution,
                   .output_delay = model.output_delay,
                   .input_delay = axis.input_delay,
                   .noise_rms = model.noise_rms,
                   .process_noise_rms = model.process_noise_rms,
                   .amplifier = axis.amplifier,
                   .encoder_errors = std::move(axis.encoder_errors),
                   .controller = model.controller,
                   .plant = ServoPlantNumbers::of(std::move(axis.plant))};
    return n;
}

ServoDirection servo_direction(const std::string& name, const std::function<MachineModel(double)>& model, double size) {
    return direction(
        name, [&](double c) { return ServoNumbers::of(model(c)); }, size, false);
}

ServoDirection servo_direction(const MachineModel& model, const std::string& name) {
    using Special = double& (*)(ServoDirection & own);
    static const std::vector<std::pair<std::string, Special>> special = {
        {"start.position_m", [](ServoDirection& own) -> double& { return own.numbers.start.position; }},
        {"start.velocity_m_per_s", [](ServoDirection& own) -> double& { return own.numbers.start.velocity; }},
        {"u", [](ServoDirection& own) -> double& { return own.thrust; }},
        {"r", [](ServoDirection& own) -> double& { return own.reference; }},
        {"exc", [](ServoDirection& own) -> double& { return own.excitation; }}};
    for (const auto& [path, number] : special) {
        if (path != name) continue;
        ServoDirection own{.name = name, .numbers = ServoNumbers::of(model)};
        ServoNumbers::each(own.numbers, [](double& other) { other = 0; });
        number(own) = 1;
        return own;
    }
    std::size_t place = 0, found = 0;
    double value = 0;
    bool is_there = false, may_be_negative = true;
    each_number(model, [&](const double& number, const auto& path, std::string_view, Allowed allowed, const About&) {
        if (!is_there && path() == name) {
            is_there = true;
            found = place;
            value = number;
            may_be_negative = allowed == Allowed::finite;
        }
        ++place;
    });
    if (!is_there) {
        std::vector<std::string> known;
        for (const auto& [path, number] : special) known.push_back(path);
        each_number(model, [&](const double&, const auto& path, auto&&...) { known.push_back(path()); });
        throw InputError(
            fmt::format("sensitivities: \"{}\" is no number of the machine{}", name, suggestion(name, known)));
    }
    // Steps of a 64th of the number: the extrapolation leaves rounding.
    const double size = value != 0 ? std::abs(value) / 64 : 1e-3;
    MachineModel other = model;
    double& number = *other.numbers()[found];
    return direction(
        name,
        [&](double c) {
            number = value + c;
            return ServoNumbers::of(other);
        },
        size, value == 0 && !may_be_negative);
}

} // namespace tribode
