#pragma once
#include "system/expressions.hpp"

#include <initializer_list>
#include <span>
#include <vector>

namespace tribode {

// Expressions as a list of instructions on numbered registers, each term once, operands first. Evaluating allocates
// nothing and calls nothing but the functions of <cmath>; a tape is constant and may be shared by threads.
class Tape {
  public:
    Tape() = default; // no outputs
    // Throws InputError where an output depends on a variable that is no input.
    Tape(const Expressions& graph, const std::vector<Term>& inputs, const std::vector<Term>& outputs);

    // The values of the inputs, in order, in any number of parts; one value per output.
    void evaluate(std::initializer_list<std::span<const double>> inputs, std::span<double> outputs) const;

    std::size_t output_count() const { return outputs_.size(); }
    std::size_t instruction_count() const { return code_.size(); }

  private:
    // The result of instruction k goes to register first_result_ + k.
    struct Instruction {
        std::uint32_t code; // an Op, or one of those that tape.cpp adds
        std::uint32_t a, b, c;
    };

    std::vector<double> constants_;
    std::size_t input_count_ = 0;
    std::vector<Instruction> code_;
    std::vector<std::uint32_t> outputs_; // registers
};

} // namespace tribode
