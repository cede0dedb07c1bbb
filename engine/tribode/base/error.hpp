#pragma once
#include <stdexcept>
#include <string>

namespace tribode {

// What a user is told. The text is one sentence: where (file, line or field), what was found, what is allowed.
// Our own bugs are asserts; a run that may end otherwise returns a RunOutcome.
class Error : public std::runtime_error {
  public:
    using std::runtime_error::runtime_error;
};

// Wrong usage, model, option or data file. The program ends with exit code 2.
class InputError : public Error {
  public:
    using Error::Error;
};

// Algebraic equations have no solution that is found: at the start of a run wrong input, later an outcome of the run.
class NoSolution : public InputError {
  public:
    using InputError::InputError;
};

// A result could not be written (disk full, no permission). The program ends with exit code 1.
class OutputError : public Error {
  public:
    using Error::Error;
};

// The user (Ctrl-C) or a limit ended the work early; what was done is kept. Exit code 3.
class EndedEarly : public Error {
  public:
    using Error::Error;
};

} // namespace tribode
