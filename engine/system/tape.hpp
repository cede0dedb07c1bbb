#pragma once
#include "system/expressions.hpp"

#include <initializer_list>
#include <span>
#include <vector>

namespace tribode {

// Expressions as a list of instructions on numbered registers, operands first. A sum of products is one instruction;
// instructions of the same kind that do not need one another stand in runs, so that what to do is asked once a run.
// Every operation is rounded as it was written. Evaluating allocates nothing and calls nothing but the functions of
// <cmath>; a tape is constant and may be shared by threads.
class Tape {
  public:
    Tape() = default; // no outputs
    // Throws InputError where an output depends on a variable that is no input.
    Tape(const Expressions& graph, const std::vector<Term>& inputs, const std::vector<Term>& outputs);

    // The values of the inputs, in order, in any number of parts; one value per output.
    void evaluate(std::initializer_list<std::span<const double>> inputs, std::span<double> outputs) const;

    std::size_t output_count() const { return outputs_.size(); }
    std::size_t instruction_count() const { return register_count_ - 1 - input_count_ - constants_.size(); }

  private:
    // Registers: the number 1, inputs, constants, then the results of all instructions, in order.
    static constexpr std::uint32_t one = 0;

    struct Operands {
        std::uint32_t a = 0, b = 0, c = 0;
    };

    struct Summand { // factor a b
        double factor;
        std::uint32_t a, b;
    };

    // Operations of a kind, or sums of one length.
    struct Run {
        std::uint32_t code; // an Op, or that of a sum
        std::uint32_t count, length;
    };

    std::vector<double> constants_;
    std::size_t input_count_ = 0, register_count_ = 1;
    std::vector<Run> runs_;
    std::vector<Operands> operands_; // of all operations
    std::vector<Summand> summands_;  // of all sums
    std::vector<std::uint32_t> outputs_;
};

} // namespace tribode
