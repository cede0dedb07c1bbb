#pragma once
#include "tribode/base/json.hpp"

#include <optional>
#include <string>
#include <utility>

namespace tribode {

// The elements of a vector x are variables with the names "x[1]", "x[2]", ...
std::string element_name(const std::string& vector, std::size_t index);

// "p.x", 3 of "p.x[3]"; nothing where the name is no such name.
std::optional<std::pair<std::string, std::size_t>> element_of(const std::string& name);

// x[2] before x[10].
struct ElementOrder {
    bool operator()(const std::string& a, const std::string& b) const;
};

// { x = { 1, 2 } } as { "x[1]" = 1, "x[2]" = 2 }. Throws InputError where the list of a vector has not as many values as the
// vector has elements among `names`.
Json flattened(const Json& values, const std::vector<std::string>& names, const std::string& where);

// The other way: one value of many, at its place in the list of its vector.
void set_element(Json& values, const std::string& name, Json value);

} // namespace tribode
