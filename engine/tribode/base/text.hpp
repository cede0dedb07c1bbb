#pragma once
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tribode {

// Shortest text that reads back to the same double: 0.1, 5e-07, nan, inf.
std::string to_text(double value);

// Appends the same to a buffer without an allocation of its own.
void append_text(std::string& buffer, double value);

// The whole text as a number (leading and trailing blanks allowed), or nothing.
std::optional<double> parse_number(std::string_view text);

// The candidate with the least edit distance to `name` among those that begin with it or are near (a distance of at
// most half the length of `name`); empty where there is none.
std::string nearest_name(std::string_view name, const std::vector<std::string>& candidates);

// ` (did you mean "x"?)` or the list of what is allowed: the end of a sentence on an unknown name.
std::string suggestion(std::string_view name, const std::vector<std::string>& candidates);

std::string_view trim(std::string_view text);

// The text with control characters but `kept` as \x1b, so that what a file holds does nothing to a terminal.
std::string printable(std::string_view text, std::string_view kept = {});

// SHA-256 of the bytes, 64 hexadecimal digits.
std::string sha256(std::string_view bytes);

// The same of bytes that come in parts.
class Sha256 {
  public:
    Sha256();
    ~Sha256();
    Sha256(const Sha256&) = delete;
    Sha256& operator=(const Sha256&) = delete;

    void add(std::string_view bytes);
    std::string hex() const; // of all so far

  private:
    void* context_;
};

// The version of the program, "0.1.0".
std::string version();

} // namespace tribode
