#include "tribode/fmu_import/unit_system.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/system/units.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <fmt/format.h>
#include <set>

namespace tribode {

namespace {

using Variables = std::vector<UnitDescription::Variable>;

// "der(body.x)" -> "der_body_x".
std::string plain_name(const std::string& name) {
    std::string plain;
    for (const char c : name) {
        const bool kept = std::isalnum(static_cast<unsigned char>(c)) || c == '_';
        if (kept) {
            plain += c;
        } else if (!plain.empty() && plain.back() != '_') {
            plain += '_';
        }
    }
    while (plain.ends_with('_') && !name.ends_with('_')) plain.pop_back();
    if (plain.empty() || std::isdigit(static_cast<unsigned char>(plain[0]))) plain = "_" + plain;
    return plain == "t" || plain == "mode" ? plain + "_" : plain;
}

// One run, as its samples see it.
class SampledUnit {
  public:
    SampledUnit(std::shared_ptr<const UnitFile> unit, double period) : unit_(std::move(unit)), period_(period) {}

    // `read`: inputs, then parameters.
    void sample(long k, std::span<const double> read, std::span<double> written) {
        const UnitDescription& description = unit_->description();
        const auto inputs = read.first(description.inputs.size());
        const double t = static_cast<double>(k) * period_;
        const bool first = !run_;
        if (first) {
            run_ = open_unit(unit_);
            set_changed(description.parameters, read.subspan(inputs.size()));
            run_->set(description.inputs, inputs);
            run_->start(t);
        } else {
            if (k != last_ + 1) {
                throw InputError(fmt::format("{}: sample {} follows sample {}, and a unit cannot go back",
                                             unit_->file().string(), k, last_));
            }
            const double begin = static_cast<double>(last_) * period_;
            run_->step(begin, t - begin);
        }
        run_->get(description.outputs, written);
        for (std::size_t i = 0; i < written.size(); ++i) {
            if (std::isfinite(written[i])) continue;
            throw InputError(fmt::format("{}: {} is not a finite number at t = {} s", unit_->file().string(),
                                         description.outputs[i].name, to_text(t)));
        }
        // Units may compute outputs anew once an input is set, so they are read before.
        if (!first) run_->set(description.inputs, inputs);
        last_ = k;
    }

  private:
    // Some variables may be set only where they are meant to be, so those with their start value are left alone.
    void set_changed(const Variables& variables, std::span<const double> values) {
        for (std::size_t i = 0; i < variables.size(); ++i) {
            if (values[i] == variables[i].start) continue;
            run_->set(std::span(&variables[i], 1), values.subspan(i, 1));
        }
    }

    std::shared_ptr<const UnitFile> unit_;
    double period_;
    std::unique_ptr<UnitRun> run_;
    long last_ = -1;
};

} // namespace

std::string unit_from_fmi(std::string_view unit) {
    std::string text(unit);
    std::replace(text.begin(), text.end(), '.', ' ');
    return dimension_of(text) ? text : "";
}

Equations equations_of_unit(const std::shared_ptr<const UnitFile>& unit, double period) {
    const UnitDescription& description = unit->description();
    if (!description.varies_step && description.fixed_step > 0) {
        const double steps = period / description.fixed_step;
        if (std::abs(steps - std::round(steps)) > 1e-9 * steps || std::round(steps) < 1) {
            throw InputError(fmt::format("{}: period_s = {} s, must be a multiple of its own step of {} s",
                                         unit->file().string(), to_text(period), to_text(description.fixed_step)));
        }
    }
    Equations made;
    made.name = description.model_name;
    made.graph = std::make_shared<Expressions>();
    made.time = made.graph->variable("t");
    Equations::Function function;
    std::set<std::string> names;
    const auto variable = [&](const UnitDescription::Variable& from) {
        const std::string name = plain_name(from.name);
        if (!names.insert(name).second) {
            throw InputError(fmt::format("{}: two variables would have the name {}, one of them is {}",
                                         unit->file().string(), name, printable(from.name)));
        }
        return std::pair(name, made.graph->variable(name));
    };
    std::vector<double> start;
    for (const auto& input : description.inputs) {
        const auto [name, symbol] = variable(input);
        made.inputs.push_back({name, unit_from_fmi(input.unit), input.start, symbol});
        function.reads.push_back(symbol);
        start.push_back(input.start);
    }
    for (const auto& parameter : description.parameters) {
        const auto [name, symbol] = variable(parameter);
        made.parameters.push_back({name, unit_from_fmi(parameter.unit), parameter.start, symbol});
        function.reads.push_back(symbol);
        start.push_back(parameter.start);
    }
    // The outputs after a start, for the discrete variables before the first sample.
    std::vector<double> outputs(description.outputs.size());
    SampledUnit(unit, period).sample(0, start, outputs);
    for (std::size_t i = 0; i < outputs.size(); ++i) {
        const auto [name, symbol] = variable(description.outputs[i]);
        made.discrete.push_back({name, unit_from_fmi(description.outputs[i].unit), outputs[i], symbol, {}});
        function.writes.push_back(symbol);
    }
    function.open = [unit, period] {
        return [run = std::make_shared<SampledUnit>(unit, period)](
                   long k, std::span<const double> read, std::span<double> written) { run->sample(k, read, written); };
    };
    made.clocks.push_back({"step", period, 0, {}, std::move(function)});
    return made;
}

} // namespace tribode
