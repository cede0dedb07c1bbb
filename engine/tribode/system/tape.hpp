#pragma once
#include "tribode/base/aligned_vector.hpp"
#include "tribode/system/block_operations.hpp"
#include "tribode/system/enclosed_operations.hpp"
#include "tribode/system/expressions.hpp"

#include <array>
#include <cassert>
#include <cstring>
#include <initializer_list>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace tribode {

// Expressions as a list of instructions on numbered registers, operands first. A sum of products is one instruction. Where the
// same is done to operands that stand side by side, as where a loop of the script has written it for each element, several
// instructions are carried out at one time. Every operation is rounded as it was written. Evaluating calls nothing but the
// functions of <cmath>, and allocates nothing unless the tape is very long; a tape is constant and may be shared by threads.
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
    [[gnu::always_inline]] void evaluate(std::initializer_list<std::span<const double>> inputs,
                                         std::span<double> outputs) const {
        const auto part = [&](std::size_t i) { return i < inputs.size() ? inputs.begin()[i].data() : nullptr; };
        assert(outputs.size() == outputs_.size());
        if (!function_) return evaluate_one({part(0), part(1), part(2)}, outputs.data());
        function_(part(0), part(1), part(2), function_constants_.data(), outputs.data());
    }

    // For several sets of inputs side by side, 1, 4 or 8, to the same bits: value i of set l stands in place i * lanes + l, of the
    // inputs as of the outputs. They are those of evaluate() but for sine, cosine, exp and tanh, see lane_functions.hpp. The
    // inputs of the third part are constant: what needs no others is computed once. The tape has to outlive it.
    template <std::size_t lanes>
    class SideBySide {
        static_assert(lanes == 1 || lanes == 4 || lanes == 8);

      public:
        // `constant`: the third part. What evaluate() takes are the other two.
        SideBySide(const Tape& tape, const double* constant);
        void evaluate(const double* part0, const double* part1, double* outputs);

      private:
        const Tape& tape_;
        AlignedVector<double> registers_;
    };

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
    struct Cell;

    template <std::size_t lanes, bool by_lane_functions>
    void interpret(const Cell* begin, const Cell* end, double* registers, double* next) const;
    template <std::size_t lanes>
    double* read(std::size_t part, const double* inputs, double* next) const;
    template <std::size_t lanes>
    void write(const double* registers, double* outputs) const;
    template <std::size_t lanes>
    void prepare(const double* constant, double* registers) const;
    template <std::size_t lanes>
    void go_on(const double* part0, const double* part1, double* registers, double* outputs) const;
    void evaluate_one(const std::array<const double*, 3>& inputs, double* outputs) const;
    void prepare_four(const double* constant, double* registers) const;
    void prepare_eight(const double* constant, double* registers) const;
    void evaluate_four(const double* part0, const double* part1, double* registers, double* outputs) const;
    void evaluate_eight(const double* part0, const double* part1, double* registers, double* outputs) const;

    // Registers: the number 1, the inputs that are read, constants, then the results of all instructions, in order. Those that need
    // none but constant inputs come first.
    static constexpr std::uint32_t one = 0;

    // What is done, one after the other: an operation with its operands; the head of a sum, which its summands follow, factor a b; or
    // the head of a block, which its instructions follow, of one kind, which do not need one another.
    struct Cell {
        // The kind; above it, of a lookup, the place of its table, of a block how many instructions it has.
        std::uint32_t code = 0;
        // Operands. Of a long sum, a: how many summands it has. Of a block, a: its BlockOperation, or the place of its factors; b, c: the
        // steps of its operands, two bits each. Of a summand, code and a: the factor; b, c: the operands.
        std::uint32_t a = 0, b = 0, c = 0;

        std::uint32_t kind() const { return code % 256; } // an Op, or one of those in tape.cpp
        std::uint32_t extra() const { return code / 256; }
        std::uint32_t summand_count() const;

        static Cell summand(double factor, std::uint32_t a, std::uint32_t b);
        double factor() const {
            double value = 0;
            std::memcpy(&value, this, sizeof value);
            return value;
        }
        bool is_signed() const { return (factor() == 1 || factor() == -1) && b != one; } // C needs no factor then
    };

    struct Placed {
        const Cell* head;
        std::span<const Cell> summands;
    };
    std::vector<Placed> instructions() const;
    // visit(head, summands) for each instruction, in order.
    template <class Visit>
    void for_instructions(const Visit& visit) const;
    void find_blocks();
    void operate(const Cell& block, const Cell* first, const double* registers, double* results) const;

    std::array<std::uint32_t, 3> read_counts_{}; // of each part
    std::vector<std::uint32_t> reads_;           // places in the parts, part by part
    std::vector<double> constants_;
    std::size_t register_count_ = 1, instruction_count_ = 0;
    std::vector<Cell> code_;
    std::size_t constant_count_ = 0, constant_code_ = 0; // of the instructions that come first, and their cells
    std::vector<double> factors_;                        // of sums in blocks, those of the first summands first
    std::vector<std::shared_ptr<const LookupTable>> tables_;
    std::vector<TableSlopes> slopes_; // of each table
    std::vector<std::uint32_t> outputs_;

    CFunction function_ = nullptr;
    std::shared_ptr<const void> owner_;
    std::vector<double> function_constants_;
};

} // namespace tribode
