#include "tribode/script/lua_force.hpp"
#include "tribode/base/error.hpp"
#include "tribode/effect/effect.hpp"
#include "tribode/script/lua_state.hpp"

#include <algorithm>
#include <cctype>
#include <fmt/format.h>
#include <mutex>

namespace tribode {

namespace {

void require_name(const std::string& name) {
    const auto fits = [](unsigned char c) { return std::isalnum(c) || c == '_'; };
    const bool taken = name == "y" || name == "v" || name == "t";
    if (!name.empty() && !taken && !std::isdigit(static_cast<unsigned char>(name[0])) &&
        std::all_of(name.begin(), name.end(), fits)) {
        return;
    }
    throw InputError(fmt::format("own_force: \"{}\" cannot be the name of a state or constant, which has letters, "
                                 "digits and _, and is not y, v or t",
                                 name));
}

class LuaForce final : public PointForce {
  public:
    explicit LuaForce(const Effect& effect)
        : names_(effect.texts("states")),
          lua_(ScriptLimits{}, ScriptAccess{}, RunControl{}),
          work_(3 + names_.size()) {
        const auto& constants = effect.texts("constants");
        for (const auto& name : names_) require_name(name);
        for (std::size_t i = 0; i < constants.size(); ++i) {
            require_name(constants[i]);
            lua_.set_global(constants[i], effect.constants("constants")[i]);
        }
        std::vector<std::string> arguments = {"y", "v", "t"};
        arguments.insert(arguments.end(), names_.begin(), names_.end());
        force_ = lua_.compile(effect.texts("force").front(), arguments, "=own_force.force");
        rates_ = lua_.compile(effect.texts("rates").front(), arguments, "=own_force.rates");
        // What is wrong with the text shows here, before a run.
        std::vector<double> start(names_.size()), ended(names_.size());
        force(0, 0, 0, start);
        rates(0, 0, 0, start, ended);
    }

    double force(double t, double y, double v, std::span<const double> s) const override {
        double result = 0;
        call(force_, t, y, v, s, {&result, 1});
        return result;
    }
    void rates(double t, double y, double v, std::span<const double> s, std::span<double> dsdt) const override {
        if (!names_.empty()) call(rates_, t, y, v, s, dsdt.first(names_.size()));
    }
    std::vector<StateVariable> states() const override {
        std::vector<StateVariable> states;
        for (const auto& name : names_) states.push_back({name, "", std::nullopt, 1.0});
        return states;
    }
    std::string reason() const override {
        return "the user's own force (own_force) is a program, of which only its values are known";
    }

  private:
    // A run is on one thread; the lock is for those who look at the system besides.
    void call(const LuaState::Numbers& function, double t, double y, double v, std::span<const double> s,
              std::span<double> results) const {
        const std::lock_guard lock(mutex_);
        work_[0] = y;
        work_[1] = v;
        work_[2] = t;
        std::copy_n(s.begin(), names_.size(), work_.begin() + 3);
        function(work_, results);
    }

    std::vector<std::string> names_;
    mutable std::mutex mutex_;
    LuaState lua_;
    mutable std::vector<double> work_;
    LuaState::Numbers force_, rates_;
};

} // namespace

void enable_lua_forces() {
    set_force_compiler([](const Effect& effect) -> std::shared_ptr<const PointForce> {
        return std::make_shared<const LuaForce>(effect);
    });
}

} // namespace tribode
