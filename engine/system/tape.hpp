#pragma once
#include "system/expressions.hpp"

#include <initializer_list>
#include <span>
#include <vector>

namespace tribode {

// Expressions as a list of instructions on numbered registers, each term once, operands first. Instructions of the same
// kind that do not need one another stand in runs, so that what to do is asked once a run. Evaluating allocates nothing
// and calls nothing but the functions of <cmath>; a tape is constant and may be shared by threads.
class Tape {
  public:
    Tape() = default; // no outputs
    // Throws InputError where an output depends on a variable that is no input.
    Tape(const Expressions& graph, const std::vector<Term>& inputs, const std::vector<Term>& outputs);

    // The values of the inputs, in order, in any number of parts; one value per output.
    void evaluate(std::initializer_list<std::span<const double>> inputs, std::span<double> outputs) const;

    std::size_t output_count() const { return outputs_.size(); }
    std::size_t instruction_count() const { return operands_.size(); }

  private:
    // Registers; the results of all instructions go to those behind the inputs and constants, in order.
    struct Operands {
        std::uint32_t a = 0, b = 0, c = 0;
    };

    struct Run {
        std::uint32_t code; // an Op, or one of those that tape.cpp adds
        std::uint32_t count;
    };

    std::vector<double> constants_;
    std::size_t input_count_ = 0;
    std::vector<Run> runs_;
    std::vector<Operands> operands_;     // of all instructions
    std::vector<std::uint32_t> outputs_; // registers
};

} // namespace tribode
