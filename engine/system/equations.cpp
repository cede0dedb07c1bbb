#include "system/equations.hpp"

namespace tribode {

void Equations::replace(const Expressions::Replacement& replacement) {
    const auto put_in = [&](Term& term) { term = graph->substitute(std::span(&term, 1), replacement)[0]; };
    for (auto& state : states) put_in(state.rate);
    for (auto& output : outputs) put_in(output.value);
    for (auto& when : whens) {
        put_in(when.condition);
        for (auto& [target, value] : when.set) put_in(value);
    }
    for (auto& clock : clocks) {
        for (auto& [target, value] : clock.set) put_in(value);
        if (!clock.function) continue;
        for (auto& term : clock.function->reads) put_in(term);
    }
}

} // namespace tribode
