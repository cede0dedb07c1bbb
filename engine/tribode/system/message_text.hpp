#pragma once
#include <string>

namespace tribode {

// An expression for a message: the end of a long one is cut.
inline std::string shortened(const std::string& text) {
    constexpr std::size_t longest = 60;
    return text.size() <= longest ? text : text.substr(0, longest - 3) + "...";
}

} // namespace tribode
