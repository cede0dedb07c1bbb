#include "tribode/record/given_record.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/record/output_file.hpp"

#include <fmt/format.h>
#include <utility>

namespace tribode {

Table GivenRecord::read(const RecordOptions& options, const std::vector<std::string>& wanted,
                        double sample_time) const& {
    return GivenRecord(*this).read(options, wanted, sample_time);
}

Table GivenRecord::read(const RecordOptions& options, const std::vector<std::string>& wanted, double sample_time) && {
    if (!file.empty()) return read_record(file, options, wanted).table;
    Table complete = std::move(table);
    if (!complete.find("t")) {
        std::vector<double> t(complete.rows());
        for (std::size_t k = 0; k < t.size(); ++k) t[k] = static_cast<double>(k) * sample_time;
        complete.add("t", "s", std::move(t));
    }
    return complete;
}

std::string GivenRecord::hash() const {
    if (!file.empty()) return sha256(read_file(file));
    std::string bytes;
    for (const auto& column : table.columns) {
        bytes += column.name;
        bytes.append(reinterpret_cast<const char*>(column.values.data()), column.values.size() * sizeof(double));
    }
    return sha256(bytes);
}

void refuse_repeated_record(const std::string& name, const std::vector<double>& position,
                            const std::string& earlier_name, const std::vector<double>& earlier_position) {
    if (position != earlier_position) return;
    throw InputError(fmt::format("{} has the same samples as {}: a record that is given again is no repetition", name,
                                 name == earlier_name ? "one before it" : earlier_name));
}

} // namespace tribode
