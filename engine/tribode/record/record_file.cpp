#include "tribode/record/record_file.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/record/csv.hpp"
#include "tribode/record/file_units.hpp"
#include "tribode/record/hdf5.hpp"
#include "tribode/record/mat.hpp"
#include "tribode/record/mat4.hpp"
#include "tribode/record/output_file.hpp"
#include "tribode/record/zip.hpp"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <set>
#include <utility>

namespace tribode {

namespace {

// ---- what the user says ------------------------------------------------------------------------------------------

std::map<std::string, std::string> pairs_of(std::string_view text, const char* option) {
    std::map<std::string, std::string> pairs;
    for (std::size_t begin = 0; begin < text.size();) {
        const std::size_t end = std::min(text.find(',', begin), text.size());
        const std::string_view pair = text.substr(begin, end - begin);
        const std::size_t equals = pair.find('=');
        if (equals == 0 || equals == std::string::npos || equals + 1 == pair.size()) {
            throw InputError(fmt::format("{} {}: \"{}\" must be name=value", option, text, pair));
        }
        if (!pairs.emplace(pair.substr(0, equals), pair.substr(equals + 1)).second) {
            throw InputError(fmt::format("{} {}: {} stands twice", option, text, pair.substr(0, equals)));
        }
        begin = end + 1;
    }
    return pairs;
}

// ---- from the file to columns ------------------------------------------------------------------------------------

struct Content {
    std::vector<Variable> variables;
    bool may_hold_more = true;   // than the record: what nobody asks for is passed over
    std::size_t first_line = 0;  // of row 0 in a text
    bool has_file_units = false; // units are as the file has them, not SI
};

std::vector<std::string> names_of(const std::vector<Variable>& variables) {
    std::vector<std::string> names;
    for (const auto& variable : variables) names.push_back(variable.name);
    return names;
}

// Where one group holds all the vectors of a file, its name is left out.
void drop_only_group(std::vector<Variable>& variables) {
    std::set<std::string> groups;
    for (const auto& variable : variables) {
        if (!variable.refusal.empty()) continue;
        const auto slash = variable.name.find('/');
        groups.insert(slash == std::string::npos ? "" : variable.name.substr(0, slash + 1));
    }
    if (groups.size() != 1) return;
    for (auto& variable : variables) {
        if (variable.name.starts_with(*groups.begin())) variable.name.erase(0, groups.begin()->size());
    }
}

bool contains(const std::vector<std::string>& names, std::string_view name) {
    return std::find(names.begin(), names.end(), name) != names.end();
}

// Columns may be named as the header line has them, with their units.
RecordOptions with_plain_names(RecordOptions options, const std::vector<CsvName>& names) {
    for (auto& [ours, theirs] : options.columns) {
        for (const auto& name : names) {
            if (theirs == name.in_header) theirs = name.name;
        }
    }
    return options;
}

// All columns; or, where the user names some, these and the wanted: others may hold texts.
void read_text(Content& content, std::string_view text, const std::string& source, RecordOptions& options,
               const std::vector<std::string>& wanted) {
    content.may_hold_more = false;
    content.has_file_units = true;
    CsvOptions choice;
    std::vector<std::string> passed_over;
    if (!options.columns.empty()) {
        const auto names = csv_names(text, source);
        options = with_plain_names(options, names);
        for (const auto& [name, in_header] : names) {
            const bool is_named = std::any_of(options.columns.begin(), options.columns.end(),
                                              [&, &column = name](const auto& pair) { return pair.second == column; });
            (is_named || contains(wanted, name) ? choice.columns : passed_over).push_back(name);
        }
    }
    if (choice.columns.size() + passed_over.size() == 0 || !choice.columns.empty()) {
        Table table = parse_csv(text, source, choice);
        content.first_line = table.first_line;
        for (auto& column : table.columns) {
            content.variables.push_back({column.name, column.unit, std::move(column.values), ""});
        }
    }
    for (const auto& name : passed_over) content.variables.push_back({name, "", {}, "is not among those asked for"});
}

// `packed`: bytes of the file itself.
Content content_of(std::string_view bytes, std::size_t packed, const std::string& source, RecordOptions& options,
                   const std::vector<std::string>& wanted) {
    Content content;
    if (is_hdf5(bytes)) {
        content.variables = hdf5_variables(bytes, source);
        drop_only_group(content.variables);
        return content;
    }
    if (is_mat5(bytes)) {
        content.variables = mat_variables(bytes, max_unpacked_of(packed), source);
        return content;
    }
    if (is_mat4(bytes)) {
        std::vector<std::string> asked;
        for (const auto& [ours, theirs] : options.columns) asked.push_back(theirs);
        if (!asked.empty() || !wanted.empty()) asked.insert(asked.end(), wanted.begin(), wanted.end());
        content.variables = mat4_variables(bytes, asked, max_unpacked_of(packed), source);
        return content;
    }
    constexpr std::size_t beginning = 4096;
    if (bytes.substr(0, beginning).find('\0') != std::string_view::npos) {
        throw InputError(fmt::format("{}: is not a record that can be read, must be CSV, MAT (version 5, made by save "
                                     "-v7 or -v6, 4 or 7.3), HDF5, or one of them packed by gzip",
                                     source));
    }
    read_text(content, bytes, source, options, wanted);
    return content;
}

// The end of a sentence: the vectors there are.
std::string vectors_of(const Content& content) {
    std::vector<std::string> names;
    for (const auto& variable : content.variables) {
        if (variable.refusal.empty()) names.push_back(variable.name);
    }
    if (names.empty()) return "the file has no vector of doubles";
    return fmt::format("vectors in the file: {}", fmt::join(names, ", "));
}

Content unpacked_content(std::string_view bytes, const std::string& source, RecordOptions& options,
                         const std::vector<std::string>& wanted) {
    if (!is_gzip(bytes)) return content_of(bytes, bytes.size(), source, options, wanted);
    return content_of(gunzip(bytes, source), bytes.size(), source, options, wanted);
}

// Chooses variables and makes columns of them.
class Chooser {
  public:
    Chooser(const Content& content, const std::string& source, const RecordOptions& options,
            const std::vector<std::string>& wanted)
        : content_(content),
          source_(source),
          options_(options),
          wanted_(wanted) {
        table_.source = source;
        table_.first_line = content.first_line;
    }

    Table table() {
        for (const auto& [ours, theirs] : options_.columns) take(ours, named(theirs));
        const bool keep_all = options_.columns.empty() && (wanted_.empty() || !content_.may_hold_more);
        for (const auto& variable : content_.variables) {
            // One that the user has named is there already.
            if (contains(wanted_, variable.name) && !table_.find(variable.name)) take(variable.name, variable);
        }
        if (contains(wanted_, "t") && !table_.find("t")) fail_without_time();
        if (keep_all) {
            for (const auto& variable : content_.variables) take_if_it_fits(variable);
        }
        if (table_.columns.empty()) fail(fmt::format("there is no vector of numbers{}", refusals()));
        in_order_of_the_file();
        return std::move(table_);
    }

  private:
    [[noreturn]] void fail(const std::string& problem) const {
        throw InputError(fmt::format("{}: {}", source_, problem));
    }

    const Variable& named(const std::string& name) const {
        const auto it = std::find_if(content_.variables.begin(), content_.variables.end(),
                                     [&](const Variable& v) { return v.name == name; });
        if (it != content_.variables.end()) return *it;
        fail(fmt::format("there is no column {}{}", name, suggestion(name, names_of(content_.variables))));
    }

    // The line that the user should have written, as far as it can be known.
    [[noreturn]] void fail_without_time() const {
        const auto names = names_of(content_.variables);
        if (!nearest_name("t", names).empty()) named("t");
        std::string time = "NAME";
        for (const auto& variable : content_.variables) {
            const auto& name = variable.name;
            const bool is_time = variable.unit == "s" || variable.unit == "ms" || name.starts_with("T") ||
                                 name.find("time") != std::string::npos;
            if (time == "NAME" && is_time) time = name;
        }
        constexpr std::size_t readable = 20;
        fail(fmt::format("there is no column t{}; give the columns their names: --columns t={},u=NAME,y=NAME",
                         names.size() > readable ? fmt::format(" among {}", names.size()) : suggestion("t", names),
                         time));
    }

    void take(const std::string& ours, const Variable& variable) {
        if (!variable.refusal.empty()) {
            fail(fmt::format("{} {}; {}", variable.name, variable.refusal, vectors_of(content_)));
        }
        if (!table_.columns.empty() && variable.values.size() != table_.rows()) {
            fail(fmt::format("{} has {} values, must have {} like {}", variable.name, variable.values.size(),
                             table_.rows(), taken_.front()->name));
        }
        table_.add(ours, variable.unit, variable.values);
        taken_.push_back(&variable);
    }

    // One that nobody asked for: not where it is no vector or of another length than t, or the longest.
    void take_if_it_fits(const Variable& variable) {
        if (!variable.refusal.empty() || table_.find(variable.name)) return;
        std::size_t length = 0;
        for (const auto& other : content_.variables) length = std::max(length, other.values.size());
        for (const auto& other : content_.variables) {
            if (other.name == "t" && other.refusal.empty()) length = other.values.size();
        }
        if (variable.values.size() == length) take(variable.name, variable);
    }

    // Messages and results name the columns as the file has them, whatever was asked for first.
    void in_order_of_the_file() {
        std::vector<Column> sorted;
        for (const auto& variable : content_.variables) {
            for (std::size_t i = 0; i < taken_.size(); ++i) {
                if (taken_[i] == &variable) sorted.push_back(std::move(table_.columns[i]));
            }
        }
        table_.columns = std::move(sorted);
    }

    std::string refusals() const {
        std::vector<std::string> reasons;
        for (const auto& v : content_.variables) {
            reasons.push_back(fmt::format("{} {}", v.name, v.refusal.empty() ? "was not asked for" : v.refusal));
        }
        return reasons.empty() ? "" : fmt::format(" ({})", fmt::join(reasons, "; "));
    }

    const Content& content_;
    const std::string& source_;
    const RecordOptions& options_;
    const std::vector<std::string>& wanted_;
    Table table_;
    std::vector<const Variable*> taken_; // what the columns of table_ are in the file
};

// In which machines count what records hold.
const std::map<std::string, std::string>& units_of_machines() {
    static const std::map<std::string, std::string> units = {
        {"t", "s"}, {"r", "m"}, {"u", "N"}, {"exc", "N"}, {"y", "m"}};
    return units;
}

// Brings a column from the unit that the file gives it to the wanted one; to SI where none is wanted.
void convert(Column& column, const std::string& wanted, const std::string& source) {
    if (column.unit == wanted) return;
    const auto unit = file_unit(column.unit);
    if (wanted.empty()) {
        if (!unit) {
            throw InputError(
                fmt::format("{}: column {} has the unit \"{}\", which is not known; give its factor to SI: "
                            "--scale {}=FACTOR",
                            source, column.name, column.unit, column.name));
        }
        unit->convert(column.values);
        column.unit = unit->si;
        return;
    }
    const auto other = file_unit(wanted);
    const auto is = [&](const char* one, const char* another) {
        return unit && other && unit->si == one && other->si == another;
    };
    if (is("degC", "K") || is("K", "degC")) {
        throw InputError(fmt::format("{}: column {} is in {}, must be in {}, whose zero is another: add or subtract "
                                     "273.15 in the file, or give {} the unit {}",
                                     source, column.name, column.unit, wanted, column.name, column.unit));
    }
    if (!unit || !other || unit->si != other->si) {
        throw InputError(fmt::format("{}: column {} is in {}, must be in {}; give its factor: --scale {}=FACTOR",
                                     source, column.name, column.unit, wanted, column.name));
    }
    FileUnit{"", unit->factor * other->divisor, unit->divisor * other->factor}.convert(column.values);
    column.unit = wanted;
}

void require_finite(const Table& table) {
    if (table.rows() == 0) throw InputError(fmt::format("{}: there are no rows, must be one at least", table.source));
    for (const Column& column : table.columns) {
        for (std::size_t row = 0; row < column.values.size(); ++row) {
            if (std::isfinite(column.values[row])) continue;
            throw InputError(fmt::format("{}: column {} is {}, must be a finite number", table.place(row), column.name,
                                         to_text(column.values[row])));
        }
    }
}

} // namespace

RecordOptions RecordOptions::parse(std::string_view columns, std::string_view scale) {
    RecordOptions options;
    options.columns = pairs_of(columns, "--columns");
    for (const auto& [name, text] : pairs_of(scale, "--scale")) {
        const auto factor = parse_number(text);
        if (!factor || !std::isfinite(*factor)) {
            throw InputError(fmt::format("--scale {}={}: must be a number", name, text));
        }
        options.scale[name] = *factor;
    }
    return options;
}

RecordOptions RecordOptions::read(FieldReader& fields) {
    RecordOptions options;
    const auto each = [&](const char* key, auto use) {
        const Json& map = fields.value(key);
        if (map.is_null()) return;
        if (!map.is_object()) fields.fail(key, "must be a table {name = value}");
        for (const auto& [name, value] : map.items()) use(name, value);
    };
    each("columns", [&](const std::string& name, const Json& value) {
        if (!value.is_string()) fields.fail("columns." + name, "must be a text, the name in the file");
        options.columns[name] = value.get<std::string>();
    });
    each("scale", [&](const std::string& name, const Json& value) {
        if (!value.is_number() || !std::isfinite(value.get<double>())) {
            fields.fail("scale." + name, "must be a finite number");
        }
        options.scale[name] = value.get<double>();
    });
    return options;
}

Record record_from_bytes(std::string_view bytes, const std::string& source, const RecordOptions& asked,
                         const std::vector<std::string>& wanted) {
    RecordOptions options = asked;
    const Content content = unpacked_content(bytes, source, options, wanted);
    Record record{Chooser(content, source, options, wanted).table(), std::nullopt};
    for (const auto& [name, factor] : options.scale) {
        record.table[name]; // a name that is not there is refused
        for (Column& column : record.table.columns) {
            if (column.name != name) continue;
            for (double& value : column.values) value *= factor;
            if (content.has_file_units) column.unit.clear(); // whoever gives the factor knows it
        }
    }
    const auto& units = options.units ? *options.units : units_of_machines();
    for (Column& column : record.table.columns) {
        if (column.unit.empty() || options.scale.contains(column.name)) continue;
        const auto unit = contains(wanted, column.name) ? units.find(column.name) : units.end();
        if (unit != units.end()) {
            convert(column, unit->second, source);
        } else if (content.has_file_units) {
            convert(column, "", source);
        }
    }
    require_finite(record.table);
    if (record.table.find("t")) record.time = time_grid(record.table);
    return record;
}

Record read_record(const std::filesystem::path& path, const RecordOptions& options,
                   const std::vector<std::string>& wanted) {
    return record_from_bytes(read_file(path), path.string(), options, wanted);
}

std::vector<std::string> column_names(const std::filesystem::path& path) {
    RecordOptions options;
    std::vector<std::string> names;
    for (const auto& variable : unpacked_content(read_file(path), path.string(), options, {}).variables) {
        if (variable.refusal.empty()) names.push_back(variable.name);
    }
    return names;
}

void write_record(const std::filesystem::path& path, const Table& table) {
    const std::string name = path.string();
    if (name.ends_with(".mat")) {
        write_mat(path, table);
    } else if (name.ends_with(".h5") || name.ends_with(".hdf5")) {
        write_hdf5(path, {{"", table}});
    } else if (name.ends_with(".csv.gz")) {
        write_file(path, gzip(to_csv(table)));
    } else {
        write_csv(path, table);
    }
}

} // namespace tribode
