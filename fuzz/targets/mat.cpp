#include "tribode/record/mat.hpp"
#include "target.hpp"
#include "tribode/base/error.hpp"
#include "tribode/record/mat4.hpp"
#include "tribode/record/record_file.hpp"
#include "tribode/record/zip.hpp"

namespace tribode::fuzz {

void run_mat(std::string_view bytes) {
    try {
        const auto variables = mat_variables(bytes, max_unpacked_of(bytes.size()), "a.mat");
        Table table;
        for (const auto& variable : variables) {
            if (!variable.refusal.empty()) continue;
            if (table.columns.empty() || variable.values.size() == table.rows()) {
                table.add(variable.name, "", variable.values);
            }
        }
        const std::string written = to_mat(table);
        const auto again = mat_variables(written, max_unpacked_of(written.size()), "again.mat");
        require(again.size() == table.columns.size(), "the same variables");
    } catch (const InputError&) {
    }
    try {
        if (is_mat5(bytes) || is_mat4(bytes)) record_from_bytes(bytes, "a.mat");
    } catch (const InputError&) {
    }
}

} // namespace tribode::fuzz
