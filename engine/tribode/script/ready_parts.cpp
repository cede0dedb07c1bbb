#include "tribode/script/ready_parts.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/script/table_fields.hpp"
#include "tribode/system/tape.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <lua.hpp>

namespace tribode {

namespace {

constexpr const char* part_type = "tribode.part";
constexpr double infinity = std::numeric_limits<double>::infinity();

} // namespace

// What a part is called and made of.
struct ReadyParts::Kind {
    enum class Law { friction, impact, play, maxwell, relay, backlash };
    struct Option {
        const char* name;
        bool required;
        double least = -infinity, most = infinity; // at the start values
        const char* allowed = "";
        std::optional<double> fallback = std::nullopt;
    };
    Law law;
    const char* name;
    const char* output;
    std::vector<std::string> modes;
    std::vector<Option> options;
};

const std::vector<ReadyParts::Kind>& ReadyParts::kinds() {
    using Law = Kind::Law;
    constexpr double above_zero = std::numeric_limits<double>::min();
    static const std::vector<Kind> all = {
        {Law::friction,
         "coulomb",
         "force",
         {"stick", "forward", "backward"},
         {{"velocity", true},
          {"level", true, 0, infinity, "not be negative"},
          {"static", false, 0, infinity, "not be negative"},
          {"stribeck_velocity", false, above_zero, infinity, "be positive"},
          {"exponent", false, above_zero, infinity, "be positive", 1.0}}},
        {Law::impact,
         "impact",
         "force",
         {"free", "rest"},
         {{"gap", true},
          {"restitution", true, 0, 1, "be from 0 to 1"},
          {"rest_speed", false, 0, infinity, "not be negative"}}},
        {Law::play,
         "play",
         "output",
         {"free", "ahead", "behind"},
         {{"input", true}, {"width", true, 0, infinity, "not be negative"}}},
        {Law::maxwell,
         "maxwell",
         "force",
         {"stick", "forward", "backward"},
         {{"position", true},
          {"stiffness", true, above_zero, infinity, "be positive"},
          {"level", true, above_zero, infinity, "be positive"}}},
        {Law::relay,
         "relay",
         "output",
         {"low", "high"},
         {{"input", true},
          {"on", true},
          {"off", true},
          {"high", false, -infinity, infinity, "", 1.0},
          {"low", false, -infinity, infinity, "", 0.0}}},
        {Law::backlash,
         "backlash",
         "force",
         {"open", "ahead", "behind"},
         {{"distance", true},
          {"gap", true, 0, infinity, "not be negative"},
          {"stiffness", true, above_zero, infinity, "be positive"},
          {"damping", false, 0, infinity, "not be negative", 0.0}}},
    };
    return all;
}

// ---- in Lua ------------------------------------------------------------------------------------------------------

// tb.parts.play{ … }: the options as they are, looked through.
void add_ready_parts(LuaState& lua) {
    for (const auto& kind : ReadyParts::kinds()) {
        lua.add_stack_function(fmt::format("parts.{}", kind.name), [&kind](lua_State* state) {
            const std::string where = fmt::format("tb.parts.{}", kind.name);
            if (!lua_istable(state, 1)) {
                throw InputError(
                    fmt::format("{}: found a {}, must be a table of options", where, luaL_typename(state, 1)));
            }
            std::vector<std::string> known{"unit"};
            for (const auto& option : kind.options) known.emplace_back(option.name);
            check_keys(state, 1, known, where);
            if (has_field(state, 1, "unit")) text_field(state, 1, "unit", where);
            for (const auto& option : kind.options) {
                const int type = lua_getfield(state, 1, option.name);
                if (type == LUA_TNIL ? option.required
                                     : type != LUA_TFUNCTION && type != LUA_TNUMBER && type != LUA_TSTRING) {
                    throw InputError(
                        fmt::format("{}: {} is {}, must be a function of the system's variables, the name of "
                                    "one, or a number",
                                    where, option.name,
                                    type == LUA_TNIL ? "missing" : fmt::format("a {}", lua_typename(state, type))));
                }
                lua_pop(state, 1);
            }
            const auto place = static_cast<const ReadyParts::Kind**>(lua_newuserdatauv(state, sizeof(void*), 1));
            *place = &kind;
            lua_pushvalue(state, 1);
            lua_setiuservalue(state, -2, 1);
            if (luaL_newmetatable(state, part_type)) {
                lua_pushboolean(state, false);
                lua_setfield(state, -2, "__metatable");
                lua_pushliteral(state, "ready part");
                lua_setfield(state, -2, "__name");
            }
            lua_setmetatable(state, -2);
            return 1;
        });
    }
}

bool ReadyParts::declare(const std::string& name, int index, Equations& made) {
    const auto* held = static_cast<const Kind* const*>(luaL_testudata(lua_, index, part_type));
    if (!held) return false;
    Part part{*held, name, ""};
    const auto variable = [&](const char* key) { return graph_.variable(name + "." + key); };
    lua_getiuservalue(lua_, index, 1);
    const int options = lua_gettop(lua_);
    if (has_field(lua_, options, "unit")) part.unit = text_field(lua_, options, "unit", "tb.parts");
    for (const auto& option : part.kind->options) {
        if (lua_getfield(lua_, options, option.name) == LUA_TNIL) {
            lua_pop(lua_, 1);
            part.references.push_back(LUA_NOREF);
        } else {
            part.references.push_back(luaL_ref(lua_, LUA_REGISTRYINDEX));
        }
    }
    lua_pop(lua_, 1);
    part.output = variable(part.kind->output);
    part.mode = variable("mode");
    made.discrete.push_back({name + ".mode", "", 0, part.mode, part.kind->modes});
    using Law = Kind::Law;
    if (part.kind->law == Law::play || part.kind->law == Law::maxwell) {
        part.held = variable("held");
        const std::string unit = part.kind->law == Law::play ? part.unit : "";
        made.discrete.push_back({name + ".held", unit, 0, part.held, {}});
    }
    made.outputs.push_back({name + "." + part.kind->output, part.unit, part.output});
    parts_.push_back(std::move(part));
    return true;
}

std::vector<std::pair<std::string, Term>> ReadyParts::outputs() const {
    std::vector<std::pair<std::string, Term>> list;
    for (const auto& part : parts_) list.emplace_back(part.name + "." + part.kind->output, part.output);
    return list;
}

void ReadyParts::record(EquationRecorder& recorder) {
    for (auto& part : parts_) {
        for (std::size_t i = 0; i < part.references.size(); ++i) {
            const auto& option = part.kind->options[i];
            const std::string what = fmt::format("tb.system: parts.{}: {}", part.name, option.name);
            if (part.references[i] == LUA_NOREF) {
                if (option.fallback) part.options[option.name] = {"", "", graph_.constant(*option.fallback)};
                continue;
            }
            lua_rawgeti(lua_, LUA_REGISTRYINDEX, part.references[i]);
            luaL_unref(lua_, LUA_REGISTRYINDEX, part.references[i]);
            if (lua_type(lua_, -1) == LUA_TFUNCTION) {
                part.options[option.name] = recorder.record(what, true)[0];
                continue;
            }
            if (lua_type(lua_, -1) == LUA_TNUMBER) {
                const double value = lua_tonumber(lua_, -1);
                if (!std::isfinite(value)) throw InputError(fmt::format("{} = {}, must be finite", what, value));
                part.options[option.name] = {"", "", graph_.constant(value), what};
            } else {
                part.options[option.name] = recorder.named(lua_tostring(lua_, -1), what);
            }
            lua_pop(lua_, 1);
        }
        const auto in_unit_of_output = [&](std::initializer_list<const char*> keys) {
            for (const char* key : keys) {
                if (part.has(key)) require_unit(part.options.at(key), dimension_of(part.unit), "it");
            }
        };
        using Law = Kind::Law;
        switch (part.kind->law) {
        case Law::friction:
        case Law::maxwell: in_unit_of_output({"level", "static"}); break;
        case Law::play: in_unit_of_output({"input", "width"}); break;
        case Law::relay:
            in_unit_of_output({"high", "low"});
            for (const char* key : {"on", "off"})
                require_unit(part.options.at(key), part.options.at("input").dimension, "it");
            break;
        case Law::backlash: require_unit(part.options.at("gap"), part.options.at("distance").dimension, "it"); break;
        case Law::impact: break;
        }
    }
}

// ---- laws --------------------------------------------------------------------------------------------------------

Term ReadyParts::in_mode(const Part& part, double mode) {
    return graph_.make(Op::equal, part.mode, graph_.constant(mode));
}

Term ReadyParts::half_width(const Part& part) const {
    if (part.kind->law == Kind::Law::maxwell) return graph_.make(Op::divide, part["level"], part["stiffness"]);
    return graph_.make(Op::multiply, graph_.constant(0.5), part[part.kind->law == Kind::Law::play ? "width" : "gap"]);
}

// Of friction in slip: where it has a Stribeck velocity, it falls from `static` to `level`. A step may look a little beyond
// the reversal.
Term ReadyParts::level(const Part& part) const {
    if (!part.has("stribeck_velocity")) return part["level"];
    const Term v = part["velocity"], zero = graph_.constant(0);
    const Term speed = graph_.make(
        Op::no_event, graph_.make(Op::select, graph_.make(Op::less, v, zero), graph_.make(Op::negate, v), v));
    const Term ratio = graph_.make(Op::divide, speed, part["stribeck_velocity"]);
    const Term share = graph_.make(Op::exp, graph_.make(Op::negate, graph_.make(Op::power, ratio, part["exponent"])));
    const Term excess = graph_.make(Op::subtract, part["static"], part["level"]);
    return graph_.make(Op::add, part["level"], graph_.make(Op::multiply, excess, share));
}

// The force of a flank: it presses where that is not against its side.
Term ReadyParts::pressed(const Part& part, double side) const {
    const Term reach =
        graph_.make(Op::subtract, part["distance"], graph_.make(Op::multiply, graph_.constant(side), half_width(part)));
    return graph_.make(Op::add, graph_.make(Op::multiply, part["stiffness"], reach),
                       graph_.make(Op::multiply, part["damping"], graph_.make(Op::rate, part["distance"])));
}

void ReadyParts::define(std::unordered_map<Term, Term>& definition) const {
    const auto by_mode = [&](const Part& part, Term first, Term second, Term third) {
        const auto in = [&](double mode) { return graph_.make(Op::equal, part.mode, graph_.constant(mode)); };
        return graph_.make(Op::select, in(1), second, graph_.make(Op::select, in(2), third, first));
    };
    const auto negative = [&](Term term) { return graph_.make(Op::negate, term); };
    for (const auto& part : parts_) {
        Term& output = definition[part.output];
        using Law = Kind::Law;
        switch (part.kind->law) {
        case Law::friction:
        case Law::impact: definition.erase(part.output); break;
        case Law::play:
            output = by_mode(part, part.held, graph_.make(Op::subtract, part["input"], half_width(part)),
                             graph_.make(Op::add, part["input"], half_width(part)));
            break;
        case Law::maxwell:
            output = by_mode(
                part,
                graph_.make(Op::multiply, part["stiffness"], graph_.make(Op::subtract, part["position"], part.held)),
                part["level"], negative(part["level"]));
            break;
        case Law::relay: output = by_mode(part, part["low"], part["high"], part["low"]); break;
        case Law::backlash: output = by_mode(part, graph_.constant(0), pressed(part, 1), pressed(part, -1)); break;
        }
    }
}

double ReadyParts::value_at_start(Term term, const Equations& made) const {
    std::vector<Term> outputs;
    for (const auto& part : parts_) outputs.push_back(part.output); // forces that are still to be found
    return made.value_at_start(term, outputs);
}

void ReadyParts::check(const Part& part, const Equations& made) const {
    const auto value_of = [&](const Recorded& option) { return value_at_start(option.term, made); };
    for (const auto& option : part.kind->options) {
        if (!part.has(option.name)) continue;
        const double value = value_of(part.options.at(option.name));
        if (!(value < option.least) && !(value > option.most)) continue;
        throw InputError(fmt::format("tb.system: parts.{}: {} is {} at the start, must {}", part.name, option.name,
                                     to_text(value), option.allowed));
    }
    const auto at_least = [&](const char* more, const char* less) {
        if (!part.has(more) || !(value_of(part.options.at(more)) < value_of(part.options.at(less)))) return;
        throw InputError(
            fmt::format("tb.system: parts.{}: {} is below {} at the start, must not be", part.name, more, less));
    };
    at_least("static", "level");
    at_least("on", "off");
    if (part.has("stribeck_velocity") && !part.has("static")) {
        throw InputError(
            fmt::format("tb.system: parts.{}: stribeck_velocity needs the static level beside it", part.name));
    }
}

namespace {

// An event of a part. What holds at the start happens there.
void add(std::vector<Equations::When>& whens, const std::string& name, Term condition, Equations::Assignments set) {
    whens.push_back({name, condition, std::move(set), true, false});
}

} // namespace

// What is dragged along, with play: ahead of it the input pushes, until it turns.
void ReadyParts::close_play(const Part& part, Equations& made, std::vector<Equations::When>& whens) {
    const bool is_maxwell = part.kind->law == Kind::Law::maxwell;
    const Term input = part[is_maxwell ? "position" : "input"], zero = graph_.constant(0);
    const Term ahead = graph_.make(Op::subtract, input, half_width(part));
    const Term behind = graph_.make(Op::add, input, half_width(part));
    const auto all = [&](Term a, Term b) { return graph_.make(Op::all, a, b); };
    const auto less = [&](Term a, Term b) { return graph_.make(Op::less, a, b); };
    const auto mode = [&](double value) { return std::pair(part.mode, graph_.constant(value)); };
    const std::string takes = part.name + (is_maxwell ? ".slips" : ".takes along");
    const std::string leaves = part.name + (is_maxwell ? ".sticks" : ".lets go");
    for (auto& discrete : made.discrete) {
        if (discrete.symbol == part.held) discrete.start = value_at_start(input, made);
    }
    // What moves by jumps alone takes it along and is at rest.
    const Term rate = graph_.make(Op::rate, input), rests = graph_.make(Op::equal, rate, zero);
    const auto mode_unless_at_rest = [&](double value) {
        return std::pair(part.mode, graph_.make(Op::select, rests, zero, graph_.constant(value)));
    };
    // A little beyond, so that rounding does not take it back at a reversal.
    const Term beyond = graph_.make(Op::multiply, graph_.constant(1e-14), half_width(part));
    add(whens, takes, all(in_mode(part, 0), less(graph_.make(Op::add, part.held, beyond), ahead)),
        {{part.held, ahead}, mode_unless_at_rest(1)});
    add(whens, takes, all(in_mode(part, 0), less(behind, graph_.make(Op::subtract, part.held, beyond))),
        {{part.held, behind}, mode_unless_at_rest(2)});
    // A jump back leaves it where it was.
    const auto before = [&](Term edge) { return graph_.make(Op::before, edge); };
    const auto fell = [&](Term from, Term to) {
        const Term size = graph_.make(Op::select, less(from, zero), graph_.make(Op::negate, from), from);
        const Term scale = graph_.make(Op::add, half_width(part), size);
        const Term rounding = graph_.make(Op::multiply, graph_.constant(1e-12), scale);
        return graph_.make(Op::no_event, less(graph_.make(Op::add, to, rounding), from));
    };
    add(whens, leaves, all(in_mode(part, 1), fell(before(ahead), ahead)), {{part.held, before(ahead)}, mode(0)});
    add(whens, leaves, all(in_mode(part, 2), fell(behind, before(behind))), {{part.held, before(behind)}, mode(0)});
    add(whens, leaves, all(in_mode(part, 1), less(rate, zero)), {{part.held, ahead}, mode(0)});
    add(whens, leaves, all(in_mode(part, 2), less(zero, rate)), {{part.held, behind}, mode(0)});
}

void ReadyParts::close_relay(const Part& part, std::vector<Equations::When>& whens) {
    const auto all = [&](Term a, Term b) { return graph_.make(Op::all, a, b); };
    const auto less = [&](Term a, Term b) { return graph_.make(Op::less, a, b); };
    add(whens, part.name + ".on", all(in_mode(part, 0), less(part["on"], part["input"])),
        {{part.mode, graph_.constant(1)}});
    add(whens, part.name + ".off", all(in_mode(part, 1), less(part["input"], part["off"])),
        {{part.mode, graph_.constant(0)}});
}

// The damper lets go before the spring does: it touches where it is closed and would press.
void ReadyParts::close_backlash(const Part& part, std::vector<Equations::When>& whens) {
    const Term zero = graph_.constant(0), half = half_width(part);
    const auto all = [&](Term a, Term b) { return graph_.make(Op::all, a, b); };
    const auto less = [&](Term a, Term b) { return graph_.make(Op::less, a, b); };
    const auto open = in_mode(part, 0);
    const bool damped = !graph_.is_constant(part["damping"], 0);
    for (const double side : {1.0, -1.0}) {
        const Term force = pressed(part, side);
        const auto beyond = [&](Term a, Term b) { return side > 0 ? less(b, a) : less(a, b); };
        const Term limit = side > 0 ? half : graph_.make(Op::negate, half);
        const Term closed = beyond(part["distance"], limit);
        add(whens, part.name + ".touches", all(open, damped ? all(closed, beyond(force, zero)) : closed),
            {{part.mode, graph_.constant(side > 0 ? 1 : 2)}});
        add(whens, part.name + ".leaves",
            all(in_mode(part, side > 0 ? 1 : 2), damped ? beyond(zero, force) : beyond(limit, part["distance"])),
            {{part.mode, zero}});
    }
}

void ReadyParts::close(Equations& made, const Expressions::Replacement& known) {
    if (parts_.empty()) return;
    for (auto& part : parts_) {
        for (auto& [name, option] : part.options) {
            option.term = graph_.substitute(std::span(&option.term, 1), known)[0];
        }
    }
    for (const auto& part : parts_) {
        check(part, made);
        const bool is_friction = part.kind->law == Kind::Law::friction;
        if (!is_friction && part.kind->law != Kind::Law::impact) continue;
        Equations::Contact contact{.name = part.name, .force = part.output, .mode = part.mode};
        if (is_friction) {
            contact.quantity = part["velocity"];
            contact.level = level(part);
            contact.release = part[part.has("static") ? "static" : "level"];
        } else {
            contact.law = Equations::Contact::Law::impact;
            contact.quantity = part["gap"];
            contact.restitution = part["restitution"];
            if (part.has("rest_speed")) contact.rest_speed = part["rest_speed"];
        }
        made.contacts.push_back(std::move(contact));
    }
    std::vector<Equations::When> whens;
    for (const auto& part : parts_) {
        using Law = Kind::Law;
        if (part.kind->law == Law::play || part.kind->law == Law::maxwell) close_play(part, made, whens);
        if (part.kind->law == Law::relay) close_relay(part, whens);
        if (part.kind->law == Law::backlash) close_backlash(part, whens);
    }
    made.whens.insert(made.whens.begin(), whens.begin(), whens.end());
}

} // namespace tribode
