#include "tribode/machine/machine_model.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/field_path.hpp"
#include "tribode/base/field_reader.hpp"
#include "tribode/base/field_rows.hpp"
#include "tribode/base/text.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace tribode {

namespace {

constexpr int max_delayed_samples = 100000;

// "modes[2].gain" -> "modes.gain".
std::string without_indices(const std::string& path) {
    std::string text;
    bool inside = false;
    for (const char c : path) {
        inside = c == '[' || (inside && c != ']');
        if (!inside && c != ']') text += c;
    }
    return text;
}

// "friction." -> "friction"; "" stays.
std::string without_dot(const std::string& path) { return path.substr(0, path.empty() ? 0 : path.size() - 1); }

// Removes a path and all below it.
void erase_below(std::set<std::string>& paths, const std::string& path) {
    std::erase_if(paths, [&](const std::string& one) {
        return one.starts_with(path) &&
               (one.size() == path.size() || one[path.size()] == '.' || one[path.size()] == '[');
    });
}

// The fields in order of their names, notes left out, numbers as doubles: however a machine was written, it is the same.
void append_canonical(std::string& text, const Json& value) {
    if (value.is_object()) {
        std::map<std::string, const Json*> fields;
        for (const auto& [key, field] : value.items()) {
            if (!FieldReader::is_note(key) && !field.is_null()) fields[key] = &field;
        }
        for (const auto& [key, field] : fields) {
            text += key + "{";
            append_canonical(text, *field);
            text += "}";
        }
    } else if (value.is_array()) {
        for (const auto& entry : value) {
            text += "[";
            append_canonical(text, entry);
            text += "]";
        }
    } else if (value.is_number()) {
        append_text(text, value.get<double>());
    } else {
        text += value.dump();
    }
}

} // namespace

namespace {

// The moving mass may stand in place of its inverse.
Json with_rigid_gain(const Json& description, const std::string& where) {
    if (!description.is_object() || !description.contains("mass_kg") || description["mass_kg"].is_null()) {
        return description;
    }
    FieldReader fields(description, where);
    const double mass = fields.number("mass_kg", "kg", Allowed::positive);
    if (fields.has("rigid_gain_per_kg")) {
        fields.fail("mass_kg",
                    "and rigid_gain_per_kg are given, must be one of them: the second is the inverse of the first");
    }
    Json changed = description;
    changed.erase("mass_kg");
    changed["rigid_gain_per_kg"] = 1 / mass;
    return changed;
}

} // namespace

MachineModel MachineModel::read(const Json& given, const std::string& where) {
    const Json description = with_rigid_gain(given, where);
    FieldReader fields(description, where);
    MachineModel m;
    OptionReader reader(fields, &m.left_out);
    describe(m, reader);
    fields.finish();
    return m;
}

MachineModel MachineModel::from_description(const Json& description, const std::string& where) {
    MachineModel m = read(description, where);
    m.check(where);
    return m;
}

void MachineModel::check(const std::string& where) const {
    if (rigid_gain == 0 && modes.empty()) {
        throw InputError(
            where +
            ": rigid_gain_per_kg is zero or missing (or give mass_kg) and there is no mode: nothing could move");
    }
    for (const auto& [key, delay] : {std::pair{"input_delay_s", input_delay}, {"output_delay_s", output_delay}}) {
        if (delay > max_delayed_samples * sample_time) {
            throw InputError(fmt::format("{}: {} = {} s, must be {} sample times at most", where, key, to_text(delay),
                                         max_delayed_samples));
        }
    }
    visit_present(controller, [&](const auto& kind) {
        for (std::size_t i = 0; i < kind.filters.size(); ++i) {
            if (kind.filters[i].freq_hz * sample_time < 0.5) continue;
            throw InputError(fmt::format("{}: controller.filters[{}].freq_hz = {} Hz, must be below half the sampling "
                                         "rate, {} Hz",
                                         where, i + 1, to_text(kind.filters[i].freq_hz), to_text(0.5 / sample_time)));
        }
    });
    if (input == InputKind::band_limited && in_closed_loop()) {
        throw InputError(where + ": input = \"band_limited\" needs u as a whole record, so closed_loop must be false");
    }
    try {
        axis();
    } catch (const InputError& error) {
        throw InputError(fmt::format("{}: {}{}", where, effects.empty() ? "" : "effects: ", error.what()));
    }
}

Json MachineModel::description() const {
    OptionWriter writer(left_out, options_json(MachineModel()));
    describe(*this, writer);
    return writer.json;
}

std::string MachineModel::hash() const {
    std::string text;
    append_canonical(text, description());
    return sha256(text);
}

MachineModel MachineModel::with_fields(const Json& replaced, const Json& scaled, const std::string& where) const {
    MachineModel changed = *this;
    for (const auto& [path, value] : replaced.items()) changed.replace(path, value, where);
    for (const auto& field : scaled.items()) {
        const std::string& path = field.key();
        const Json& factor = field.value();
        const std::string name = fmt::format("{}: {}", where, path);
        if (!factor.is_number()) throw InputError(name + ": the factor must be a number");
        std::vector<std::pair<std::string, double>> numbers;
        const auto collect = [&](const double& number, const auto& full_path, auto&&...) {
            if (!changed.left_out.contains(full_path())) numbers.emplace_back(full_path(), number);
        };
        find_fields(changed, path, where, [&](const std::string& around, std::string_view, auto visit) {
            const std::size_t before = numbers.size();
            NumberWalker walker(collect, around);
            visit(walker);
            const bool is_one = numbers.size() == before + 1 &&
                                path_steps(numbers.back().first, where).size() == path_steps(path, where).size();
            if (!is_one) throw InputError(name + " is no number, so it cannot be multiplied");
        });
        for (const auto& [one, number] : numbers) changed.replace(one, number * factor.get<double>(), where);
    }
    changed.check(where);
    return changed;
}

// Reads single fields into what is there; of a group it takes a note only.
class MachineModel::Replacer : public OptionReader {
  public:
    using OptionReader::OptionReader;
    void group(std::string_view, auto, const About& = {}) { is_group = true; }
    bool is_group = false;
};

void MachineModel::replace(const std::string& path, const Json& value, const std::string& where) {
    if (value.is_null()) throw InputError(fmt::format("{}: {} = null, must be a value", where, path));
    std::vector<std::pair<std::string, std::string>> groups;
    find_fields(*this, path, where, [&](const std::string& around, std::string_view key, auto visit) {
        // As if it was the only field of a description.
        const Json description = {{std::string(key), value}};
        FieldReader fields(description, where, without_dot(around));
        Replacer reader(fields, &left_out);
        erase_below(left_out, around + std::string(key));
        visit(reader);
        if (reader.is_group) groups.emplace_back(without_dot(around), key);
    });
    // The fields of a group lie in what is around it, which is read anew: fields that the value does not have get their defaults.
    for (const auto& [around, key] : groups) {
        Json all = around.empty() ? description() : field(around);
        all[key] = value;
        if (around.empty()) {
            *this = read(all, where);
        } else {
            replace(around, all, where);
        }
    }
}

Json MachineModel::field(const std::string& path) const {
    Json value;
    find_fields(*this, path, "machine", [&](const std::string&, std::string_view key, auto visit) {
        OptionWriter writer;
        visit(writer);
        value = writer.json[std::string(key)];
    });
    return value;
}

std::vector<double*> MachineModel::numbers() {
    std::vector<double*> all;
    each_number(*this, [&](double& number, auto&&...) { all.push_back(&number); });
    return all;
}

std::vector<MachineModel::UncertainField> MachineModel::uncertain_fields() const {
    std::vector<UncertainField> fields;
    std::size_t place = 0;
    each_number(*this, [&](const double& number, const auto& path, std::string_view, Allowed, const About& about) {
        const std::size_t here = place++;
        const auto entry = tolerance.find(std::string(about.tolerance));
        // What is zero stays so by any factor.
        if (number == 0 || entry == tolerance.end() || entry->second == 0) return;
        const std::string own = path();
        const std::string name = without_indices(own) == entry->first ? own : entry->first;
        for (auto& field : fields) {
            if (field.name == name) return field.places.push_back(here);
        }
        fields.push_back({name, entry->second, {here}});
    });
    return fields;
}

std::vector<std::string> MachineModel::warnings(const std::string& where) const {
    std::vector<std::string> sentences;
    each_number(*this, [&](const double& number, const auto& path, std::string_view unit, Allowed, const About& about) {
        if (about.plausible(number)) return;
        const std::string suffix = unit.empty() ? "" : fmt::format(" {}", unit);
        sentences.push_back(fmt::format("{}: {} = {}{} is implausible, {} to {} is usual{}{}", where, path(),
                                        to_text(number), suffix, to_text(about.min), to_text(about.max),
                                        about.hint.empty() ? "" : "; ", about.hint));
    });
    return sentences;
}

const std::vector<std::string>& MachineModel::tolerance_keys() {
    static const std::vector<std::string> keys = [] {
        FieldLister lister;
        const MachineModel machine;
        describe_known(machine, lister);
        std::vector<std::string> all;
        for (const auto& row : lister.rows) {
            const std::string key(row.about.tolerance);
            if (!key.empty() && std::find(all.begin(), all.end(), key) == all.end()) all.push_back(key);
        }
        return all;
    }();
    return keys;
}

std::string MachineModel::field_table() {
    FieldLister lister;
    const MachineModel machine;
    describe(machine, lister);
    std::string text = "| field | unit | values | default | plausible | `tolerance` key | meaning |\n"
                       "|---|---|---|---|---|---|---|\n";
    for (const auto& row : lister.rows) {
        if (row.path.starts_with("tolerance.")) continue; // in the column of keys
        const auto& about = row.about;
        const std::string range =
            about.min == about.max ? "" : fmt::format("{} to {}", to_text(about.min), to_text(about.max));
        const std::string key = about.tolerance.empty() ? "" : fmt::format("`{}`", about.tolerance);
        text += fmt::format("| `{}` | {} | {} | {} | {} | {} | {} |\n", row.path, row.unit, row.values, row.fallback,
                            range, key, about.meaning);
    }
    return text;
}

MachineModel MachineModel::with_effects(std::vector<Effect> others) const {
    MachineModel m = *this;
    m.effects = std::move(others);
    erase_below(m.left_out, "effects"); // all of them are written
    m.axis();                           // may refuse
    return m;
}

ServoAxis MachineModel::axis() const {
    ServoAxis axis;
    axis.plant = {rigid_gain, modes, RollingFriction(elements), dry, viscous, current_loop_hz};
    axis.input_delay = input_delay;
    axis.encoder_resolution = encoder_resolution;
    for (const auto& effect : effects) effect.apply(axis);
    axis.require_possible();
    if (axis.input_delay > max_delayed_samples * sample_time) {
        throw InputError(fmt::format("they leave an input delay of {} s, must be {} sample times at most",
                                     to_text(axis.input_delay), max_delayed_samples));
    }
    return axis;
}

} // namespace tribode
