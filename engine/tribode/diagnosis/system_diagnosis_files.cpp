#include "tribode/diagnosis/system_diagnosis_files.hpp"
#include "tribode/base/quantity.hpp"
#include "tribode/base/text.hpp"
#include "tribode/diagnosis/system_record.hpp"
#include "tribode/diagnosis/system_report.hpp"
#include "tribode/record/csv.hpp"
#include "tribode/system/equations_lua.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <iterator>

namespace tribode {

namespace {

Json or_null(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

Json effect_json(const SystemEffect& effect) {
    Json parameters = Json::object(), errors = Json::object(), units = Json::object(), rivals = Json::array();
    for (std::size_t i = 0; i < effect.values.size(); ++i) {
        parameters[effect.parameters[i]] = effect.values[i];
        errors[effect.parameters[i]] = or_null(effect.standard_errors[i]);
        if (!effect.units[i].empty()) units[effect.parameters[i]] = effect.units[i];
    }
    for (const auto& [name, probability] : effect.rivals) {
        rivals.push_back({{"name", name}, {"probability", probability}});
    }
    return {{"name", effect.name},
            {"equation", effect.equation},
            {"expression", effect.expression},
            {"parameters", parameters},
            {"standard_errors", errors},
            {"units", units},
            {"probability", effect.probability},
            {"rivals", rivals},
            {"same_as", effect.same_as},
            {"evidence", effect.evidence}};
}

} // namespace

Json system_diagnosis_json(const SystemDiagnosis& d, const std::vector<std::string>& data,
                           const std::string& system_hash, double seconds) {
    Json effects = Json::array(), hypotheses = Json::array(), free = Json::object(), nearest = nullptr;
    for (const auto& effect : d.effects) effects.push_back(effect_json(effect));
    for (const auto& one : d.hypotheses) {
        hypotheses.push_back({{"names", one.names},
                              {"score", or_null(one.score)},
                              {"gap", {{"fitted", or_null(one.fitted)}, {"predicted", or_null(one.predicted)}}},
                              {"lost", one.lost.empty() ? Json(nullptr) : Json(one.lost)}});
    }
    for (const auto& one : d.free) {
        free[one.name] = {{"value", one.value}, {"standard_error", or_null(one.standard_error)}};
    }
    if (d.nearest && d.verdict == "unknown_effect")
        nearest = {{"name", d.nearest->first}, {"share", d.nearest->second}};
    return {{"verdict", d.verdict},
            {"effects", effects},
            {"where", d.where},
            {"gap", {{"ident", d.fitted_gap.json()}, {"validate", d.validation_gap.json()}}},
            {"gap_unit", gap_unit(d)},
            {"prediction_uncertainty", or_null(d.prediction_uncertainty)},
            {"explained", or_null(d.explained)},
            {"nearest", nearest},
            {"next_experiment", d.next_experiment ? Json(d.next_experiment->text) : Json(nullptr)},
            {"free", free},
            {"hypotheses", hypotheses},
            {"inputs", interpolation_text(d.interpolation)},
            {"out_of_time", d.out_of_time},
            {"remarks", d.remarks},
            {"data", data},
            {"system", system_hash},
            {"version", version()},
            {"seconds", seconds}};
}

void write_system_diagnosis(const SystemDiagnosis& d, const Json& summary, RunFolder& folder,
                            const RunControl& control) {
    Equations found = without_measured_states(d.after);
    if (!found.free.empty()) {
        for (const auto& effect : d.effects) std::ranges::copy(effect.parameters, std::back_inserter(found.free));
    }
    folder.write("system.lua", equations_lua(found, "-- " + verdict_sentence(d) + "\n"));
    const auto& validation = d.validation.front();
    Table table;
    table.add("t", "s", validation.record.t);
    for (std::size_t o = 0; o < validation.record.outputs.size(); ++o) {
        const auto& unit = d.before.equations.outputs[d.before.measured[o]].unit;
        const auto name = measured_name(d.before, o);
        table.add(name + "_measured", unit, validation.record.outputs[o]);
        table.add(name + "_before", unit, validation.before[o]);
        table.add(name + "_after", unit, validation.after[o]);
    }
    folder.write("validate.csv", to_csv(table));
    if (d.next_experiment) {
        const auto& next = d.next_experiment->record;
        Table inputs;
        inputs.add("t", "s", next.t);
        for (std::size_t i = 0; i < next.inputs.size(); ++i) {
            const auto& input = d.before.equations.inputs[i];
            if (!next.inputs[i].empty()) inputs.add(input.name, input.unit, next.inputs[i]);
        }
        folder.write("next_experiment.csv", to_csv(inputs));
    }
    RunControl whole = control; // with the verdict made, the rest takes moments
    whole.stop = nullptr;
    for (const auto& image : write_report(folder.path("report.html"), system_report(d), whole)) folder.add(image);
    folder.add("report.html");
    folder.write_json("diagnosis.json", summary);
}

std::string system_diagnosis_text(const SystemDiagnosis& d) {
    std::string text = fmt::format("{}\n{}\n", d.verdict, verdict_sentence(d));
    for (const auto& effect : d.effects) {
        text += fmt::format("  {} in {}, probability {:.2f}: {}\n", effect.name, effect.equation, effect.probability,
                            effect.expression);
        for (std::size_t i = 0; i < effect.values.size(); ++i) {
            const auto [factor, unit] = prefixed_unit(effect.values[i], effect.units[i]);
            const double error = factor * effect.standard_errors[i];
            text += fmt::format("    {} = {}", effect.parameters[i], format_quantity(factor * effect.values[i], ""));
            if (std::isfinite(error)) text += fmt::format(" +- {}", format_quantity(error, "", 2));
            text += unit.empty() ? "\n" : fmt::format(" {}\n", unit);
        }
        for (const auto& [name, probability] : effect.rivals) {
            text += fmt::format("    or {}: {:.2f}\n", name, probability);
        }
        if (effect.probability_of_none() > worth_a_line) {
            text += fmt::format("    or {}: {:.2f}\n", none_of_these, effect.probability_of_none());
        }
        for (const auto& name : effect.same_as) text += fmt::format("    the same as {}\n", name);
    }
    for (const auto& remark : d.remarks) text += fmt::format("  note: {}\n", remark);
    if (d.next_experiment) text += fmt::format("  next: {}\n", d.next_experiment->text);
    if (d.out_of_time) text += "  the budget of time ended the search\n";
    return text;
}

} // namespace tribode
