#pragma once
#include "tribode/base/field_reader.hpp"
#include "tribode/base/json.hpp"
#include "tribode/base/options.hpp"
#include "tribode/effect/servo_axis.hpp"

#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace tribode {

class Effect;
struct Clues;
struct EffectForm;

// One parameter of a kind of effect: a number, or a choice, a flag, a list of records of numbers, a text, a list of texts,
// named numbers.
struct EffectParameter {
    enum class Type { number, choice, flag, records, text, texts, constants };

    std::string name;
    std::string unit = {}; // empty: none
    std::string meaning = {};
    Type type = Type::number;
    Allowed allowed = Allowed::finite; // numbers
    double plausible_min = 0; // what one meets in practice; numbers. Where a parameter may be negative, the range
    double plausible_max = 0; // is that of its magnitude, unless it begins below zero
    std::optional<double> fallback = {};      // value where it is left out; a flag: 0 or 1; a choice: its index
    std::vector<std::string> choices = {};    // choices
    std::vector<EffectParameter> fields = {}; // records; all numbers. A record is required to be there once or more
};

// Parameters that several kinds have.
EffectParameter phase_parameter(std::string name = "phase"); // [rad]
EffectParameter relaxed_position();                          // y0, of a spring [m]

// The quantity over which a plot of the residual shows an effect.
enum class DrawnAgainst { position, velocity, time, thrust, distance_since_reversal, frequency };
std::string_view name_of(DrawnAgainst axis);

// A kind of effect: something a servo axis may have. All that is known of it is in one file of effect/kinds/, as a
// constant of the file's name; the list of them is made from the names of the files.
struct EffectKind {
    std::string name;
    std::string summary;  // one sentence in plain words, for documentation and reports
    int order;            // its place in lists of kinds
    std::string equation; // as text, in the symbols of the parameters
    std::vector<EffectParameter> parameters;
    std::string example; // parameters one could meet, as JSON
    bool affine;         // whether a piecewise-affine machine stays so
    DrawnAgainst drawn_against;
    // Parameters at which it does nothing, the others being what they may: name and value; empty: there are none.
    std::vector<std::pair<std::string, double>> neutral = {};
    // Adds the effect to the axis; throws InputError where it cannot.
    void (*apply)(const Effect& effect, ServoAxis& axis);
    // The same in Lua, for machines as systems of equations: text that changes the settings m of models/servo by the
    // parameters p. Empty: such machines refuse it.
    std::string lua = {};

    // How a diagnosis looks for it. The forms in which it is fitted, with starts read from a record, likeliest first; none
    // where it could do nothing there. Without this function the kind is not looked for.
    std::vector<EffectForm> (*forms)(const Clues& clues) = nullptr;
    int fit_order = 0; // its place among the kinds that are tried
    // Kinds of no more parameters that it can do the work of, at some values or nearly: where it is found, each is tried in its
    // place. One of fewer parameters is preferred unless this one predicts better, one of as many is its rival.
    std::vector<std::string> simpler = {};
    // It is sought only in the place of a kind that names it as simpler, and the two are told as rivals.
    bool only_in_place = false;
    // It rounds what is measured: compared with a record, it counts as noise.
    bool is_rounding = false;
    // It adds a FrictionLaw: analyses that subtract friction subtract it too.
    bool is_friction_law = false;

    std::string unit_of(std::string_view path) const; // of a number: "k", "harmonics[1].F"; empty: none
};

// Every kind, in order.
const std::vector<const EffectKind*>& effect_kinds();
// Adds a kind that a program brings with it, which must live as long as the program. Call it before machines are read and
// while no other thread uses effects. Throws InputError where the name is taken or empty.
void register_effect(const EffectKind& kind);
// Throws InputError with the nearest name where there is none of this name.
const EffectKind& effect_kind(std::string_view name);

// All kinds as data: name, summary, equation, parameters, ... as tb.effects returns them.
Json effect_list();
// The tables of docs/effects.md, in Markdown.
std::string effect_tables();

// An effect of a machine: its kind and the values of its parameters. A small value: fits copy and change it.
class Effect {
  public:
    struct Value {
        double number = 0;                             // a flag: 0 or 1; a choice: its index
        std::vector<std::vector<double>> records = {}; // records: their fields, in the order of the kind
        std::vector<std::string> texts = {};           // a text, texts, or the names of constants
        std::vector<double> constants = {};            // their values
    };

    // One value for each parameter of the kind, in its order; not checked.
    Effect(const EffectKind& kind, std::vector<Value> values);
    // With the values of parameters that are left out; 0, the first choice or an empty list where there is none.
    explicit Effect(const EffectKind& kind);

    // {"name": ..., "parameters": {...}}. Throws InputError on unknown names, with the nearest, and on wrong values.
    static Effect read(FieldReader& fields);
    // Of the kind that the field `name` tells, every parameter at its default.
    static Effect begin(FieldReader& fields);
    // Its fields, see options.hpp: those of begin(), then the parameters of its kind.
    static void describe(auto& e, auto& fields) {
        fields.fixed("name", e.kind_->name);
        fields.group("parameters", [&](auto& parameters) {
            for (std::size_t i = 0; i < e.values_.size(); ++i) {
                describe_value(e.kind_->parameters[i], e.values_[i], parameters);
            }
        });
    }

    const EffectKind& kind() const { return *kind_; }
    const std::vector<Value>& values() const { return values_; }

    // By the parameter's name, which must be one of the kind's.
    double number(std::string_view name) const { return value(name).number; }
    bool flag(std::string_view name) const { return value(name).number != 0; }
    const std::string& choice(std::string_view name) const;
    const std::vector<std::vector<double>>& records(std::string_view name) const { return value(name).records; }

    const std::vector<std::string>& texts(std::string_view name) const { return value(name).texts; }
    const std::vector<double>& constants(std::string_view name) const { return value(name).constants; }

    // All parameters that are numbers, those in records and constants too, in order: what a fit may move.
    std::vector<double> numbers() const;
    std::vector<std::string> number_names() const;                 // of each: "k", "harmonics[1].F"
    Effect with_numbers(const std::vector<double>& numbers) const; // as many; not checked
    // Throws InputError where a number is not what its parameter allows.
    void require_allowed() const;

    void apply(ServoAxis& axis) const { kind_->apply(*this, axis); }
    Json to_json() const; // as read() takes it

  private:
    // Beyond what one meets in practice by this factor, a value is implausible.
    static constexpr double margin = 100;

    static void describe_number(const EffectParameter& p, auto& number, auto& fields) {
        const About about = About(p.meaning).usually(
            p.plausible_min < 0 ? p.plausible_min * margin : p.plausible_min / margin, p.plausible_max * margin);
        if (p.fallback) {
            fields.number(p.name, number, p.unit, p.allowed, about);
        } else {
            fields.required(p.name, number, p.unit, p.allowed, about);
        }
    }
    static void describe_value(const EffectParameter& p, auto& value, auto& fields) {
        using Type = EffectParameter::Type;
        constexpr bool writable = !std::is_const_v<std::remove_reference_t<decltype(value)>>;
        const About about(p.meaning);
        switch (p.type) {
        case Type::number: describe_number(p, value.number, fields); break;
        case Type::flag: {
            bool flag = value.number != 0;
            fields.flag(p.name, flag, about);
            if constexpr (writable) value.number = flag ? 1 : 0;
            break;
        }
        case Type::choice: {
            std::string name = value.number < 0 ? "" : p.choices[static_cast<std::size_t>(value.number)];
            fields.choice(p.name, name, p.choices, about);
            if constexpr (writable) value.number = place_of(name, p.choices);
            break;
        }
        case Type::text: fields.text(p.name, value.texts.front(), !p.fallback, about); break;
        case Type::texts: fields.texts(p.name, value.texts, about); break;
        case Type::constants: fields.constants(p.name, value.texts, value.constants, about); break;
        case Type::records:
            fields.entries(
                p.name, value.records, [&p](FieldReader&) { return defaults_of(p.fields); },
                [&p](auto& record, auto& inside) {
                    for (std::size_t i = 0; i < record.size(); ++i) describe_number(p.fields[i], record[i], inside);
                },
                about, true);
        }
    }
    static double place_of(const std::string& name, const std::vector<std::string>& names); // -1: there is none
    static std::vector<double> defaults_of(const std::vector<EffectParameter>& numbers);

    std::size_t index_of(std::string_view name) const;
    const Value& value(std::string_view name) const { return values_[index_of(name)]; }

    const EffectKind* kind_;
    std::vector<Value> values_;
};

// How a user's own force, written as text, becomes a force: set once, by the module that knows the language. Without it
// own_force is refused.
using ForceCompiler = std::shared_ptr<const PointForce> (*)(const Effect& effect);
void set_force_compiler(ForceCompiler compiler);
ForceCompiler force_compiler();

} // namespace tribode
