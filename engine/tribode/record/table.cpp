#include "tribode/record/table.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/record/time_grid.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>

namespace tribode {

void Table::add(std::string name, std::string unit, std::vector<double> values) {
    if (find(name)) throw InputError(fmt::format("column {} stands twice, each name must stand once", name));
    if (!columns.empty() && values.size() != rows()) {
        throw InputError(fmt::format("column {} has {} values, must have {} like column {}", name, values.size(),
                                     rows(), columns.front().name));
    }
    columns.push_back({std::move(name), std::move(unit), std::move(values)});
}

const Column* Table::find(std::string_view name) const {
    const auto it = std::find_if(columns.begin(), columns.end(), [&](const Column& c) { return c.name == name; });
    return it == columns.end() ? nullptr : &*it;
}

const Column& Table::operator[](std::string_view name) const {
    if (const Column* column = find(name)) return *column;
    throw InputError(fmt::format("{}{}there is no column {}{}", source, source.empty() ? "" : ": ", name,
                                 suggestion(name, names())));
}

std::vector<std::string> Table::names() const {
    std::vector<std::string> list;
    for (const Column& column : columns) list.push_back(column.name);
    return list;
}

std::string Table::place(std::size_t row) const {
    if (source.empty()) return fmt::format("row {}", row + 1);
    if (first_line == 0) return fmt::format("{}: row {}", source, row + 1);
    return fmt::format("{}:{}", source, first_line + row);
}

void require_uniform_time(const Table& table, double sample_time, std::string_view column) {
    const std::vector<double>& t = table[column].values;
    for (std::size_t k = 1; k < t.size(); ++k) {
        const double expected = t[0] + static_cast<double>(k) * sample_time;
        if (std::abs(t[k] - expected) <= 1e-3 * sample_time) continue;

        const TimeGrid grid = time_grid(table, column); // throws where time does not increase
        std::string finding =
            fmt::format("the record has another sample time ({:.6g} s) or is not uniform (jitter {:.2g} s rms)",
                        grid.sample_time, grid.jitter_rms);
        // Where the median step is the sample time, single steps are what is wrong.
        if (grid.dropped > 0 && std::abs(grid.sample_time - sample_time) <= 1e-2 * sample_time) {
            finding = fmt::format("the record has a gap in time ({} sample{} missing in {} gap{} in all)", grid.dropped,
                                  grid.dropped == 1 ? "" : "s", grid.gaps.size(), grid.gaps.size() == 1 ? "" : "s");
        }
        // Rounded: the sum t0 + k Ts has an error in its last digits that nobody wants to read.
        throw InputError(fmt::format("{}: {} = {} s, expected {:.10g} s (sample time {} s): {}", table.place(k), column,
                                     to_text(t[k]), expected, to_text(sample_time), finding));
    }
}

} // namespace tribode
