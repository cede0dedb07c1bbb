#include "tribode/base/error.hpp"
#include "tribode/system/compiled_c.hpp"
#include "tribode/system/tape.hpp"
#include "unit/system/random_expressions.hpp"

#include <bit>
#include <fmt/format.h>
#include <fstream>
#include <gtest/gtest.h>
#include <thread>
#include <unistd.h>

namespace tribode {
namespace {

namespace fs = std::filesystem;

class CompiledC : public testing::Test {
  protected:
    CompiledC() { fs::create_directories(folder); }
    ~CompiledC() override { fs::remove_all(folder); }

    // A compiler that leaves a line in `calls` each time.
    CCompiler counting() const {
        std::ofstream(folder / "counting-cc") << "#!/bin/sh\necho >> " << calls.string() << "\nexec cc \"$@\"\n";
        fs::permissions(folder / "counting-cc", fs::perms::owner_all);
        return {(folder / "counting-cc").string(), cache};
    }
    long call_count() const {
        std::ifstream in(calls);
        return std::count(std::istreambuf_iterator<char>(in), {}, '\n');
    }
    std::vector<std::string> cached() const {
        std::vector<std::string> names;
        for (const auto& entry : fs::directory_iterator(cache)) names.push_back(entry.path().filename());
        return names;
    }
    static int answer_of(const CCompiler::Library& library) {
        return reinterpret_cast<int (*)()>(library.function("answer"))();
    }
    static std::string sentence_of(const CCompiler& compiler, const std::string& text) {
        try {
            compiler.load(text);
        } catch (const Error& error) {
            return error.what();
        }
        return "";
    }

    const fs::path folder = fs::path(testing::TempDir()) / ("compiled_c_" + std::to_string(::getpid()));
    const fs::path cache = folder / "cache", calls = folder / "calls";
    const std::string text = "int answer(void) { return 42; }\n";
};

// All operations, in one program of many functions.
TEST_F(CompiledC, RandomExpressionsHaveTheBitsOfTheirTape) {
    constexpr std::size_t count = 30;
    Expressions graph;
    const std::vector<Term> variables = {graph.variable("t"), graph.variable("a"), graph.variable("b")};
    std::vector<Tape> tapes;
    LookupTable::Points points;
    points.x = {-1, 0, 2};
    points.values = {3, 1, 4};
    points.extrapolation = LookupTable::Extrapolation::linear;
    const auto table = std::make_shared<const LookupTable>(points);
    points.y = {0, 1};
    points.values = {1, 2, 3, 5, 8, 13};
    const auto surface = std::make_shared<const LookupTable>(points);
    std::string program = Tape::c_declarations();
    for (std::uint64_t seed = 1; seed <= count; ++seed) {
        RandomExpressions source(graph, variables, seed);
        std::vector<Term> roots;
        for (int i = 0; i < 20; ++i) roots.push_back(source.next());
        const Term less = graph.make(Op::less_equal, roots[3], roots[4]),
                   more = graph.make(Op::less, roots[5], roots[6]);
        roots.push_back(graph.make(Op::all, less, graph.make(Op::logical_not, more)));
        roots.push_back(graph.make(Op::any, less, graph.make(Op::equal, roots[7], roots[8])));
        roots.push_back(graph.make(Op::subtract, graph.constant(0.7), graph.make(Op::multiply, roots[9], roots[10])));
        roots.push_back(graph.make(Op::floor, graph.make(Op::multiply, graph.constant(10), roots[11])));
        roots.push_back(graph.look_up(surface, roots[12], roots[13]));
        roots.push_back(graph.make(Op::add, graph.look_up(table, roots.back(), 0), graph.look_up(table, roots[14], 0)));
        roots.push_back(graph.derivatives(roots, variables[1]).back());
        tapes.emplace_back(graph, variables, roots, Tape::Parts{1, 2, 0});
        program += tapes.back().c_function(fmt::format("f{}", seed));
    }
    const auto library = CCompiler{.cache = cache}.load(program);
    for (std::uint64_t seed = 1; seed <= count; ++seed) {
        const Tape& tape = tapes[seed - 1];
        Tape compiled = tape;
        compiled.use(reinterpret_cast<Tape::CFunction>(library->function(fmt::format("f{}", seed))), library);
        for (std::uint64_t draw = 0; draw < 20; ++draw) {
            const double t = 4 * uniform(seed, draw, 0) - 2;
            const std::vector<double> x = {8 * uniform(seed, draw, 1) - 4, 4 * uniform(seed, draw, 2) - 2};
            std::vector<double> wanted(tape.output_count()), found(tape.output_count());
            tape.evaluate({std::span(&t, 1), x, {}}, wanted);
            compiled.evaluate({std::span(&t, 1), x, {}}, found);
            for (std::size_t i = 0; i < wanted.size(); ++i) {
                EXPECT_TRUE(wanted[i] == found[i] || (std::isnan(wanted[i]) && std::isnan(found[i])))
                    << seed << ", " << i << ": " << wanted[i] << " and " << found[i];
            }
        }
    }
}

TEST_F(CompiledC, OtherNumbersAreTheSameText) {
    Expressions graph;
    const Term x = graph.variable("x"), y = graph.variable("y");
    const auto text_with = [&](double k) {
        const Term sum = graph.make(Op::add, graph.make(Op::multiply, graph.constant(k), x), y);
        const Term power = graph.make(Op::power, sum, graph.constant(k + 1));
        return Tape(graph, {x, y}, {power}).c_function("f");
    };
    EXPECT_EQ(text_with(2.5), text_with(7.25));
}

TEST_F(CompiledC, AnEqualTextIsCompiledOnce) {
    const CCompiler compiler = counting();
    EXPECT_EQ(answer_of(*compiler.load(text)), 42);
    EXPECT_EQ(answer_of(*compiler.load(text)), 42);
    EXPECT_EQ(call_count(), 1);
    EXPECT_EQ(answer_of(*compiler.load("int answer(void) { return 7; }\n")), 7);
    EXPECT_EQ(call_count(), 2);
    EXPECT_EQ(cached().size(), 2u) << "nothing is left of what was in between";
}

TEST_F(CompiledC, ADamagedFileOfTheCacheIsMadeAnew) {
    const CCompiler compiler = counting();
    compiler.load(text);
    fs::resize_file(cache / cached().at(0), 0);
    EXPECT_EQ(answer_of(*compiler.load(text)), 42);
    EXPECT_EQ(call_count(), 2);
}

TEST_F(CompiledC, ManyAtOnceShareACache) {
    const CCompiler compiler = counting();
    std::atomic<int> right{0};
    std::vector<std::thread> threads;
    for (int i = 0; i < 8; ++i) {
        threads.emplace_back([&] { right += answer_of(*compiler.load(text)) == 42; });
    }
    for (auto& thread : threads) thread.join();
    EXPECT_EQ(right, 8);
    EXPECT_EQ(call_count(), 1) << "the others wait for the first";
    EXPECT_EQ(cached().size(), 1u);
}

TEST_F(CompiledC, WhatCannotBeHadIsOneSentence) {
    EXPECT_EQ(sentence_of({"no-such-compiler", cache}, text),
              "there is no C compiler no-such-compiler: No such file or directory");
    const std::string failing = sentence_of({"cc", cache}, "#error not today\n");
    EXPECT_NE(failing.find("the C compiler cc fails: "), std::string::npos) << failing;
    EXPECT_NE(failing.find("not today"), std::string::npos) << failing;
    EXPECT_EQ(failing.find('\n'), std::string::npos) << failing;
    EXPECT_TRUE(cached().empty());
    std::ofstream(folder / "file") << "no folder\n";
    EXPECT_NE(sentence_of({"cc", folder / "file" / "below"}, text).find("cannot be made"), std::string::npos);
}

// Whoever may write there could have this program run what they like.
TEST_F(CompiledC, AFolderThatOthersMayWriteToIsRefused) {
    fs::create_directories(cache);
    fs::permissions(cache, fs::perms::all);
    EXPECT_NE(sentence_of({"cc", cache}, text).find("none else may write there"), std::string::npos);
}

} // namespace
} // namespace tribode
