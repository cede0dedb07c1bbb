// A right side of 30 terms as a tape, recorded from a script, and compiled as C, beside the same written by hand in C++:
// see by_hand.cpp. Before they are timed, they are compared.

#include "tape/by_hand.hpp"
#include "tribode/script/symbols.hpp"
#include "tribode/script/system_reader.hpp"
#include "tribode/system/equation_system.hpp"

#include <benchmark/benchmark.h>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <lua.hpp>

namespace tribode {
namespace {

constexpr const char* script = R"(
local function masses(force1, force2, force3)
  return require("tribode").system {
    states = { a = 0.3, b = -0.2, c = 0.5, u = 0.1, v = -0.4, w = 0.2 },
    der = function(s)
      local d1, d2 = s.a - s.b, s.b - s.c
      return { a = s.u, b = s.v, c = s.w, u = force1(s, d1, d2), v = force2(s, d1, d2), w = force3(s, d1, d2) }
    end,
  }
end
local sin, cos, tanh = math.sin, math.cos, require("tribode").tanh
return masses(
  function(s, d1) return -1.5 * s.a - 0.3 * s.a * s.a * s.a - 0.7 * d1 - 0.2 * d1 * d1 * d1 - 0.11 * s.u - 0.05 * (s.u - s.v) +
    0.9 * s.w - 0.01 * s.u * s.u * s.u + 0.02 * s.a * s.u end,
  function(s, d1, d2) return -1.7 * s.b + 0.7 * d1 + 0.2 * d1 * d1 * d1 - 0.8 * d2 - 0.4 * d2 * d2 * d2 - 0.12 * s.v +
    0.05 * (s.u - s.v) - 0.06 * (s.v - s.w) + 0.03 * s.b * s.v end,
  function(s, d1, d2) return -1.9 * s.c - 0.6 * s.c * s.c * s.c + 0.8 * d2 + 0.4 * d2 * d2 * d2 - 0.13 * s.w +
    0.06 * (s.v - s.w) - 0.02 * s.w * s.w * s.w + 0.04 * s.c * s.w + 0.5 end),
masses(
  function(s, d1) return -1.5 * sin(s.a) - 0.3 * tanh(s.u) - 0.7 * d1 - 0.2 * d1 * d1 * d1 - 0.11 * s.u -
    0.05 * (s.u - s.v) + 0.9 * cos(s.c) - 0.01 * s.u * s.u * s.u + 0.02 * s.a * s.u end,
  function(s, d1, d2) return -1.7 * sin(s.b) + 0.7 * d1 + 0.2 * d1 * d1 * d1 - 0.8 * d2 - 0.4 * tanh(s.v) - 0.12 * s.v +
    0.05 * (s.u - s.v) - 0.06 * (s.v - s.w) + 0.03 * s.b * s.v end,
  function(s, d1, d2) return -1.9 * sin(s.c) - 0.6 * tanh(s.w) + 0.8 * d2 + 0.4 * cos(d2) - 0.13 * s.w +
    0.06 * (s.v - s.w) - 0.02 * s.w * s.w * s.w + 0.04 * s.c * s.w + 0.5 end)
)";

// The two systems of the script.
std::vector<Equations> recorded() {
    std::vector<Equations> systems;
    const auto symbols = std::make_shared<Symbols>();
    LuaState lua({}, {}, {});
    add_symbols(lua, symbols);
    lua.add_stack_function("system", [&](lua_State* state) {
        systems.push_back(read_system(state, 1, symbols));
        return 0;
    });
    lua.run_text(script, "masses.lua");
    return systems;
}

using ByHand = void (*)(const double*, double*);

struct Pair {
    const char* name;
    EquationSystem system, compiled;
    ByHand by_hand;
};

std::vector<std::unique_ptr<Pair>> pairs() {
    std::vector<std::unique_ptr<Pair>> list;
    auto systems = recorded();
    list.push_back(std::unique_ptr<Pair>(
        new Pair{"products", EquationSystem(systems[0]), EquationSystem(systems[0]), products_by_hand}));
    list.push_back(std::unique_ptr<Pair>(
        new Pair{"functions", EquationSystem(systems[1]), EquationSystem(systems[1]), functions_by_hand}));
    for (const auto& pair : list) {
        pair->compiled.compile({});
        const SystemState start = pair->system.initial_state();
        std::vector<double> tape(6), code(6), hand(6);
        pair->system.derivative(0, start.x, *start.discrete, tape);
        pair->compiled.derivative(0, start.x, *start.discrete, code);
        pair->by_hand(start.x.data(), hand.data());
        for (std::size_t i = 0; i < hand.size(); ++i) {
            if (std::abs(tape[i] - hand[i]) <= 1e-15 && tape[i] == code[i]) continue;
            std::fprintf(stderr, "%s: der[%zu] is %.17g by the tape, %.17g compiled and %.17g by hand\n", pair->name, i,
                         tape[i], code[i], hand[i]);
            std::exit(1);
        }
    }
    return list;
}

// As an integrator does it, each evaluation begins where the last one led, with all its states: then none can be left
// out or moved. `overlapping`: all but one state stay, so that the processor may begin before the last one has ended.
template <class Evaluate>
void time_it(benchmark::State& state, std::vector<double> x, bool overlapping, const Evaluate& evaluate) {
    std::vector<double> dxdt(x.size());
    const std::size_t moved = overlapping ? 1 : x.size();
    for (auto _ : state) {
        evaluate(x, dxdt);
        for (std::size_t i = 0; i < moved; ++i) x[i] += 1e-9 * dxdt[i];
        benchmark::DoNotOptimize(x.data());
        benchmark::ClobberMemory();
    }
}

} // namespace
} // namespace tribode

int main(int argc, char** argv) {
    using namespace tribode;
    benchmark::Initialize(&argc, argv);
    const auto all = pairs();
    for (const auto& owned : all) {
        const Pair* pair = owned.get();
        const std::string name = pair->name;
        const auto start = std::make_shared<SystemState>(pair->system.initial_state());
        for (const bool overlapping : {false, true}) {
            const std::string end = overlapping ? "/overlapping" : "";
            benchmark::RegisterBenchmark((name + "/by_hand" + end).c_str(), [=](benchmark::State& state) {
                time_it(state, start->x, overlapping,
                        [&](const auto& x, auto& dxdt) { pair->by_hand(x.data(), dxdt.data()); });
            });
            for (const auto& [kind, system] : {std::pair{"/tape", &pair->system}, {"/compiled", &pair->compiled}}) {
                benchmark::RegisterBenchmark((name + kind + end).c_str(), [=, evaluated = system](auto& state) {
                    time_it(state, start->x, overlapping,
                            [&](const auto& x, auto& dxdt) { evaluated->derivative(0, x, *start->discrete, dxdt); });
                });
            }
        }
    }
    benchmark::RunSpecifiedBenchmarks();
}
