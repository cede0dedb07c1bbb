#pragma once
#include "tribode/system/enclosed_operations.hpp"
#include "tribode/system/expressions.hpp"

#include <array>
#include <cassert>
#include <initializer_list>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace tribode {

// Expressions as a list of instructions on numbered registers, operands first. A sum of products is one instruction;
// instructions of the same kind that do not need one another stand in runs, so that what to do is asked once a run.
// Every operation is rounded as it was written. Evaluating calls nothing but the functions of <cmath>, and allocates nothing
// unless the tape is very long; a tape is constant and may be shared by threads.
class Tape {
  public:
    Tape() = default; // no outputs
    // The inputs come in parts, `parts` says of how many each: by default one of all. Throws InputError where an output
    // depends on a variable that is no input.
    using Parts = std::array<std::size_t, 3>;
    Tape(const Expressions& graph, const std::vector<Term>& inputs, const std::vector<Term>& outputs);
    Tape(const Expressions& graph, const std::vector<Term>& inputs, const std::vector<Term>& outputs,
         const Parts& parts);

    // The values of the inputs, part by part; one value per output, in no place that is also read.
    void evaluate(std::initializer_list<std::span<const double>> inputs, std::span<double> outputs) const {
        const auto part = [&](std::size_t i) { return i < inputs.size() ? inputs.begin()[i].data() : nullptr; };
        assert(outputs.size() == outputs_.size());
        if (!function_) return evaluate_one({part(0), part(1), part(2)}, outputs.data());
        function_(part(0), part(1), part(2), function_constants_.data(), outputs.data());
    }

    // For several sets of inputs at once, 1, 4 or 8, to the same bits: value i of set l stands in place i * lanes + l, of the
    // inputs as of the outputs. They are those of evaluate() but for sine, cosine, exp and tanh, see lane_functions.hpp.
    template <std::size_t lanes>
    void evaluate_lanes(const std::array<const double*, 3>& inputs, double* outputs) const {
        static_assert(lanes == 1 || lanes == 4 || lanes == 8);
        if constexpr (lanes == 1) evaluate_single_lane(inputs, outputs);
        if constexpr (lanes == 4) evaluate_four(inputs, outputs);
        if constexpr (lanes == 8) evaluate_eight(inputs, outputs);
    }

    // Bounds of the outputs and their rates of change from those of the inputs, part by part, by interval arithmetic. The
    // inputs of the third part are constant.
    struct EnclosedInputs {
        std::array<std::span<const Enclosure>, 2> moving;
        std::span<const double> constant;
    };
    void enclose(const EnclosedInputs& inputs, std::span<Enclosure> outputs) const;

    // The instructions that these outputs need, given by their places, as they are: to the same bits.
    Tape part(std::span<const std::size_t> outputs) const;

    // The same as a function of a C program, without its constants, which the tape keeps: where only numbers differ, the
    // texts are equal. By the rules of C it gives the same bits.
    std::string c_function(const std::string& name) const;
    static const char* c_declarations(); // what stands before the functions of the program

    // From now on `evaluate` calls what has become of c_function(). `owner` is kept as long.
    using CFunction = void (*)(const double* part0, const double* part1, const double* part2, const double* constants,
                               double* outputs);
    void use(CFunction function, std::shared_ptr<const void> owner);

    std::size_t output_count() const { return outputs_.size(); }
    std::size_t instruction_count() const { return instruction_count_; }

  private:
    template <std::size_t lanes, bool by_lane_functions>
    void interpret(const std::array<const double*, 3>& inputs, double* outputs) const;
    void evaluate_one(const std::array<const double*, 3>& inputs, double* outputs) const;
    void evaluate_single_lane(const std::array<const double*, 3>& inputs, double* outputs) const;
    void evaluate_four(const std::array<const double*, 3>& inputs, double* outputs) const;
    void evaluate_eight(const std::array<const double*, 3>& inputs, double* outputs) const;

    // Registers: the number 1, the inputs that are read, constants, then the results of all instructions, in order.
    static constexpr std::uint32_t one = 0;

    struct Operands {
        std::uint32_t a = 0, b = 0, c = 0;
    };

    struct Summand { // factor a b
        double factor;
        std::uint32_t a, b;

        bool is_signed() const { return (factor == 1 || factor == -1) && a != one; } // C needs no factor then
    };

    // Operations of a kind, lookups in one table, or sums of one length.
    struct Run {
        std::uint32_t code;          // an Op, or that of a sum
        std::uint32_t count, length; // of a lookup the place of its table
    };

    struct Read {
        std::uint32_t part, index;
    };

    std::vector<Read> reads_;
    std::vector<double> constants_;
    std::size_t register_count_ = 1, instruction_count_ = 0;
    std::vector<Run> runs_;
    std::vector<Operands> operands_; // of all operations
    std::vector<Summand> summands_;  // of all sums
    std::vector<std::shared_ptr<const LookupTable>> tables_;
    std::vector<TableSlopes> slopes_; // of each table
    std::vector<std::uint32_t> outputs_;

    CFunction function_ = nullptr;
    std::shared_ptr<const void> owner_;
    std::vector<double> function_constants_;
};

} // namespace tribode
