#pragma once
#include "tribode/fmu_runtime/fmu_instance.hpp"

#include <algorithm>
#include <functional>
#include <stdexcept>
#include <string>

namespace tribode::fmu {

// What both versions of the standard do around each function: an exception becomes a logged message and a status.
struct Component {
    Component(const std::string& resources, const std::string& token, bool model_exchange)
        : instance(resources, token, model_exchange) {}

    Instance instance;
    std::function<void(const std::string& message)> log_error;
    double last_step_end = 0; // [s]
    bool stopped = false;     // by an event of the model

    // Whether the body came to its end.
    template <class Body>
    bool done(Body body) const {
        try {
            body();
            return true;
        } catch (const std::exception& problem) {
            log_error(problem.what());
            return false;
        }
    }

    template <class Reference, class Number>
    bool get(const Reference* references, std::size_t count, Number* values) {
        return done([&] {
            for (std::size_t i = 0; i < count; ++i) values[i] = instance.get(references[i]);
        });
    }
    template <class Reference, class Number>
    bool set(const Reference* references, std::size_t count, const Number* values) {
        return done([&] {
            for (std::size_t i = 0; i < count; ++i) instance.set(references[i], values[i]);
        });
    }
    // All variables are numbers.
    bool no_variables(std::size_t count, const char* type) const {
        if (count == 0) return true;
        log_error(std::string("the unit has no variables of the type ") + type);
        return false;
    }
    bool unsupported(const char* function) const {
        log_error(std::string(function) + " is not supported; see the capability flags in modelDescription.xml");
        return false;
    }

    bool step(double t, double size) {
        return done([&] {
            last_step_end = instance.time();
            const auto [reached, ended] = instance.step(t, size);
            last_step_end = reached;
            stopped = ended;
        });
    }

    // Of the variables of a kind, in order.
    bool list(Variable::Kind kind, double* values, std::size_t count) {
        return done([&] {
            if (count != instance.model().count(kind)) throw Mismatch(count, instance.model().count(kind));
            for (std::size_t i = 0; i < count; ++i) values[i] = instance.run().value(kind, i);
        });
    }
    bool nominals(double* values, std::size_t count) {
        return done([&] {
            const auto from = instance.run().nominals();
            if (count != from.size()) throw Mismatch(count, from.size());
            std::copy(from.begin(), from.end(), values);
        });
    }

  private:
    struct Mismatch : std::runtime_error {
        Mismatch(std::size_t found, std::size_t wanted)
            : std::runtime_error(std::to_string(found) + " values are asked for, must be " + std::to_string(wanted)) {}
    };
};

} // namespace tribode::fmu
