// What many runs on one thread gain from one another: S1 at 64 frequencies and S3, one by one, with prepared steps shared, and
// in turn sample by sample; and the series of several runs in one loop. docs/decisions/0032. Alternating, in processor time.

#include "contender.hpp"
#include "machine_of.hpp"
#include "tribode/machine/servo_system.hpp"
#include "tribode/solver/prepared_steps.hpp"
#include "tribode/solver/series_kernels.hpp"
#include "tribode/solver/simulator.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fmt/format.h>
#include <functional>
#include <limits>
#include <memory>
#include <random>

namespace tribode::bench {
namespace {

double processor_time() {
    timespec t{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

// ---- whole runs

class OneOfMany {
  public:
    OneOfMany(const Scenario& scenario, PreparedSteps* shared)
        : scenario_(scenario),
          system_(machine_of(scenario), ClosedLoop{[this](long k) {
                      return LoopInput{0, scenario_.excitation(static_cast<std::size_t>(k))};
                  }}),
          run_(system_, {.method = Method::exact, .prepared_steps = shared}) {}

    std::size_t samples() const { return scenario_.samples; }
    void advance_to(std::size_t sample) {
        if (!run_.advance_to(static_cast<double>(sample) * scenario_.table.sample_time).ok()) std::exit(1);
    }
    double end() const { return run_.state().x[0]; }

  private:
    const Scenario& scenario_;
    const ServoSystem system_;
    Simulator run_;
};

// The sum of the last positions: the same to the bit, however the runs are made.
double one_by_one(const std::vector<Scenario>& scenarios, PreparedSteps* shared) {
    double sum = 0;
    for (const Scenario& scenario : scenarios) {
        OneOfMany run(scenario, shared);
        run.advance_to(run.samples());
        sum += run.end();
    }
    return sum;
}

double in_turn(const std::vector<Scenario>& scenarios, std::size_t at_a_time) {
    double sum = 0;
    for (std::size_t first = 0; first < scenarios.size(); first += at_a_time) {
        std::vector<std::unique_ptr<OneOfMany>> runs;
        std::size_t longest = 0;
        for (std::size_t i = first; i < std::min(first + at_a_time, scenarios.size()); ++i) {
            runs.push_back(std::make_unique<OneOfMany>(scenarios[i], nullptr));
            longest = std::max(longest, runs.back()->samples());
        }
        for (std::size_t k = 0; k <= longest; ++k) {
            for (auto& run : runs) {
                if (k <= run->samples()) run->advance_to(k);
            }
        }
        for (auto& run : runs) sum += run->end();
    }
    return sum;
}

void measure_runs(const std::string& name, const std::vector<Scenario>& scenarios) {
    long samples = 0;
    for (const Scenario& scenario : scenarios) samples += static_cast<long>(scenario.samples);
    struct Way {
        std::string name;
        std::function<double()> run;
        std::vector<double> seconds = {};
    };
    std::vector<Way> ways = {{"one by one", [&] { return one_by_one(scenarios, nullptr); }},
                             {"prepared steps shared", [&] {
                                  PreparedSteps shared;
                                  return one_by_one(scenarios, &shared);
                              }}};
    for (const std::size_t count : {2, 4, 8}) {
        ways.push_back(
            {fmt::format("{} in turn, sample by sample", count), [&, count] { return in_turn(scenarios, count); }});
    }
    const double expected = one_by_one(scenarios, nullptr);
    for (int repetition = 0; repetition < 11; ++repetition) {
        for (Way& way : ways) {
            const double start = processor_time();
            if (way.run() != expected) std::exit(1);
            way.seconds.push_back(processor_time() - start);
        }
    }
    for (const Way& way : ways) {
        std::vector<double> ratios;
        for (std::size_t i = 0; i < way.seconds.size(); ++i) ratios.push_back(way.seconds[i] / ways[0].seconds[i]);
        std::nth_element(ratios.begin(), ratios.begin() + 5, ratios.end());
        const double least = *std::min_element(way.seconds.begin(), way.seconds.end());
        fmt::print("{},{},{:.4f},{:.3f}\n", name, way.name, 1e6 * least / static_cast<double>(samples), ratios[5]);
    }
}

// ---- series of several runs in one loop, as expand_columns() makes them one by one; without its shortcut for a lag

using Block __attribute__((vector_size(64), aligned(8), may_alias)) = double;
using Bits = long long __attribute__((vector_size(64)));

struct Series {
    std::array<double, 64> a{}, square{};
    std::array<double, 8> f{};
    double h = 0; // [s]
};

constexpr long long not_sign = std::numeric_limits<long long>::max();

template <int J>
[[gnu::always_inline]] inline void multiply_by_number(const Block& column, const Block& x, Block& product) {
    product = column * __builtin_shufflevector(x, x, J, J, J, J, J, J, J, J);
}
[[gnu::always_inline]] inline void multiply(const double* matrix, const Block& x, double factor, Block& product) {
    const auto column = [&](int j) -> const Block& { return *reinterpret_cast<const Block*>(matrix + 8 * j); };
    Block parts[8];
    multiply_by_number<0>(column(0), x, parts[0]);
    multiply_by_number<1>(column(1), x, parts[1]);
    multiply_by_number<2>(column(2), x, parts[2]);
    multiply_by_number<3>(column(3), x, parts[3]);
    multiply_by_number<4>(column(4), x, parts[4]);
    multiply_by_number<5>(column(5), x, parts[5]);
    multiply_by_number<6>(column(6), x, parts[6]);
    multiply_by_number<7>(column(7), x, parts[7]);
    product =
        (((parts[0] + parts[4]) + (parts[1] + parts[5])) + ((parts[2] + parts[6]) + (parts[3] + parts[7]))) * factor;
}

template <int count>
[[gnu::always_inline]] inline void expand_together(const Series* series, double* terms, int* orders) {
    Block odd[count], even[count], most[count];
    for (int i = 0; i < count; ++i) {
        const auto& f = series[i].f;
        odd[i] = Block{f[0], f[1], f[2], f[3], f[4], f[5], f[6], f[7]} * series[i].h;
        multiply(series[i].a.data(), odd[i], series[i].h / 2, even[i]);
        most[i] = 0x1p-54 * (Block)((Bits)odd[i] & not_sign) + 1e-25;
        orders[i] = 0;
    }
    for (int n = 1, left = count; n < 28 && left > 0; n += 2) {
        for (int i = 0; i < count; ++i) {
            const double square = series[i].h * series[i].h;
            multiply(series[i].square.data(), Block(odd[i]), square / ((n + 1) * (n + 2)), odd[i]);
            multiply(series[i].square.data(), Block(even[i]), square / ((n + 2) * (n + 3)), even[i]);
            if (orders[i] > 0) continue;
            double* own = terms + 256 * i + 8 * (n + 2);
            *reinterpret_cast<Block*>(own) = odd[i];
            *reinterpret_cast<Block*>(own + 8) = even[i];
            const Bits large = (Bits)(most[i] + (Block)((Bits)odd[i] | ~not_sign)) |
                               (Bits)(most[i] + (Block)((Bits)even[i] | ~not_sign));
            const auto four =
                __builtin_shufflevector(large, large, 0, 1, 2, 3) | __builtin_shufflevector(large, large, 4, 5, 6, 7);
            const auto two = __builtin_shufflevector(four, four, 0, 1) | __builtin_shufflevector(four, four, 2, 3);
            if ((two[0] | two[1]) < 0) continue;
            orders[i] = n + 3;
            --left;
        }
    }
}
#define TRIBODE_CLONES [[gnu::target_clones("avx512f", "avx2", "default")]]
TRIBODE_CLONES void one_series(const Series* series, double* terms, int* orders) {
    expand_together<1>(series, terms, orders);
}
TRIBODE_CLONES void two_series(const Series* series, double* terms, int* orders) {
    expand_together<2>(series, terms, orders);
}
TRIBODE_CLONES void four_series(const Series* series, double* terms, int* orders) {
    expand_together<4>(series, terms, orders);
}

// Each group begins only when the last one has come to its end, as the runs between which it lies do.
void measure_series() {
    const ServoSystem system(machine_of(s1()), ClosedLoop{[](long) { return LoopInput{}; }});
    const SystemState start = system.initial_state();
    const AffineForm form = system.affine_form(*start.discrete);
    const std::size_t n = start.x.size();
    std::mt19937_64 random(1);
    std::uniform_real_distribution<double> share(0, 1);
    std::vector<Series> all(512);
    for (Series& series : all) {
        for (std::size_t j = 0; j < n; ++j) std::copy_n(form.a.data() + j * n, n, series.a.data() + j * 8);
        for (std::size_t j = 0; j < 8; ++j) {
            multiply_columns(series.a.data(), 8, 8, series.a.data() + j * 8, series.square.data() + j * 8);
        }
        series.h = 5e-4 * share(random);
        for (std::size_t j = 0; j < n; ++j) series.f[j] = share(random) - 0.5;
    }
    std::vector<double> terms(4 * 256);
    int orders[4];
    const auto time = [&](auto expand, std::size_t count) {
        double least = 1, carry = 0;
        for (int repetition = 0; repetition < 400; ++repetition) {
            const double begin = processor_time();
            for (std::size_t i = 0; i + count <= all.size(); i += count) {
                for (std::size_t k = 0; k < count; ++k) all[i + k].f[0] += carry;
                expand(all.data() + i, terms.data(), orders);
                carry = 1e-300 * terms[static_cast<std::size_t>(8 * orders[0])];
            }
            least = std::min(least, (processor_time() - begin) / static_cast<double>(all.size()));
        }
        return 1e9 * least;
    };
    fmt::print("series,one by one,{:.1f} ns\n", time(one_series, 1));
    fmt::print("series,two in one loop,{:.1f} ns\n", time(two_series, 2));
    fmt::print("series,four in one loop,{:.1f} ns\n", time(four_series, 4));
}

} // namespace
} // namespace tribode::bench

int main() {
    using namespace tribode::bench;
    fmt::print("runs,way,us/sample,to one by one\n");
    std::vector<Scenario> many;
    for (int i = 0; i < 64; ++i) {
        many.push_back(s1());
        many.back().frequency_hz *= 1 + 0.002 * i;
    }
    measure_runs("S1 x 64", many);
    measure_runs("S3", s3());
    measure_series();
    return 0;
}
