#pragma once
#include "tribode/base/error.hpp"

#include <functional>
#include <string>

namespace tribode {

// `kind: text` of the exception that `run` throws; `none: ` without one.
inline std::string problem_of(const std::function<void()>& run) {
    try {
        run();
    } catch (const InputError& problem) {
        return std::string("input: ") + problem.what();
    } catch (const OutputError& problem) {
        return std::string("output: ") + problem.what();
    } catch (const EndedEarly& problem) {
        return std::string("ended early: ") + problem.what();
    } catch (const Error& problem) {
        return std::string("other: ") + problem.what();
    }
    return "none: ";
}

} // namespace tribode
