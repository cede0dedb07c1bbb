#include "tribode/base/field_path.hpp"

#include <algorithm>
#include <charconv>
#include <string_view>

namespace tribode {

std::vector<PathStep> path_steps(const std::string& path, const std::string& where) {
    const auto refuse = [&]() -> std::vector<PathStep> {
        throw InputError(fmt::format("{}: \"{}\" is no path of a field, such as friction.elements[3].K", where, path));
    };
    std::vector<PathStep> steps;
    for (std::size_t start = 0; start <= path.size();) {
        const std::size_t end = std::min(path.find('.', start), path.size());
        std::string_view text = std::string_view(path).substr(start, end - start);
        PathStep step;
        if (const auto bracket = text.find('['); bracket != std::string_view::npos) {
            const std::string_view index = text.substr(bracket + 1);
            if (index == "*]") {
                step.every = true;
            } else {
                const auto [rest, failure] = std::from_chars(index.data(), index.data() + index.size(), step.index);
                const bool closed = rest + 1 == index.data() + index.size() && *rest == ']';
                if (failure != std::errc() || !closed || step.index == 0) return refuse();
            }
            text = text.substr(0, bracket);
        }
        step.name = std::string(text);
        if (step.name.empty()) return refuse();
        steps.push_back(std::move(step));
        start = end + 1;
    }
    return steps;
}

} // namespace tribode
