#include "tribode/record/csv.hpp"
#include "target.hpp"
#include "tribode/base/error.hpp"
#include "tribode/record/record_file.hpp"

#include <bit>
#include <cmath>

namespace tribode::fuzz {

namespace {

bool same(double a, double b) { return std::bit_cast<long>(a) == std::bit_cast<long>(b) || (a != a && b != b); }

// What was read is written as a text that reads back to the same.
void require_round_trip(const Table& table) {
    std::string text;
    try {
        text = to_csv(table);
    } catch (const InputError&) {
        return; // a name that only a quoted header line can hold
    }
    const Table again = parse_csv(text, "again.csv", {{}, false});
    require(again.columns.size() == table.columns.size(), "the same columns");
    for (std::size_t i = 0; i < table.columns.size(); ++i) {
        const Column &one = table.columns[i], &other = again.columns[i];
        require(one.name == other.name && one.values.size() == other.values.size(), "the same names and rows");
        for (std::size_t k = 0; k < one.values.size(); ++k)
            require(same(one.values[k], other.values[k]), "the numbers");
    }
}

} // namespace

void run_csv(std::string_view bytes) {
    try {
        const Table table = parse_csv(bytes, "a.csv", {{}, false});
        for (const auto& column : table.columns) require(column.values.size() == table.rows(), "columns of one length");
        require_round_trip(table);
    } catch (const InputError&) {
    }
    try {
        const Record record = record_from_bytes(bytes, "a.csv", {{{"u", "force"}}, {{"u", 2}}}, {"t", "u", "r", "exc"});
        for (const auto& column : record.table.columns) {
            for (const double value : column.values) require(std::isfinite(value), "a record of finite numbers");
        }
    } catch (const InputError&) {
    }
    try {
        record_from_bytes(bytes, "a.csv");
    } catch (const InputError&) {
    }
}

} // namespace tribode::fuzz
