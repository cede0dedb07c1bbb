#pragma once
#include <algorithm>
#include <bit>
#include <cstring>
#include <string>

namespace tribode {

// A number as a file has it.
template <class Number>
std::string raw_bytes(Number number, bool big_endian) {
    std::string text(sizeof number, '\0');
    std::memcpy(text.data(), &number, sizeof number);
    if (big_endian != (std::endian::native == std::endian::big)) std::reverse(text.begin(), text.end());
    return text;
}

} // namespace tribode
