#include "tribode/script/vector_names.hpp"
#include "tribode/base/error.hpp"

#include <algorithm>
#include <fmt/format.h>

namespace tribode {

std::string element_name(const std::string& vector, std::size_t index) { return fmt::format("{}[{}]", vector, index); }

std::optional<std::pair<std::string, std::size_t>> element_of(const std::string& name) {
    const auto open = name.rfind('[');
    if (open == std::string::npos || open == 0 || name.back() != ']') return std::nullopt;
    std::size_t index = 0;
    for (std::size_t i = open + 1; i + 1 < name.size(); ++i) {
        if (name[i] < '0' || name[i] > '9' || index > 100'000'000) return std::nullopt;
        index = 10 * index + static_cast<std::size_t>(name[i] - '0');
    }
    if (index == 0) return std::nullopt;
    return std::pair(name.substr(0, open), index);
}

bool ElementOrder::operator()(const std::string& a, const std::string& b) const {
    const auto of_a = element_of(a), of_b = element_of(b);
    if (of_a && of_b && of_a->first == of_b->first) return of_a->second < of_b->second;
    return a < b;
}

Json flattened(const Json& values, const std::vector<std::string>& names, const std::string& where) {
    if (!values.is_object()) return values;
    Json flat = Json::object();
    for (const auto& [name, value] : values.items()) {
        if (!value.is_array()) {
            flat[name] = value;
            continue;
        }
        const auto size = std::ranges::count_if(names, [&vector = name](const std::string& element) {
            const auto of = element_of(element);
            return of && of->first == vector;
        });
        if (size > 0 && value.size() != static_cast<std::size_t>(size)) {
            throw InputError(fmt::format("{}: {} has {} values, must have {}", where, name, value.size(), size));
        }
        std::size_t index = 0;
        for (const auto& entry : value) flat[element_name(name, ++index)] = entry;
    }
    return flat;
}

void set_element(Json& values, const std::string& name, Json value) {
    const auto element = element_of(name);
    if (!element) {
        values[name] = std::move(value);
        return;
    }
    values[element->first][element->second - 1] = std::move(value);
}

} // namespace tribode
