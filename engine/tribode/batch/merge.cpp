#include "tribode/batch/merge.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/batch/batch_files.hpp"
#include "tribode/batch/shard_file.hpp"
#include "tribode/record/hdf5.hpp"
#include "tribode/record/mat.hpp"
#include "tribode/record/output_file.hpp"

#include <algorithm>
#include <cctype>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <limits>
#include <map>
#include <memory>

namespace tribode {

namespace fs = std::filesystem;

namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

// "1-40, 81-100", at most ten ranges.
std::string text_of(const std::vector<ShardRange>& ranges) {
    std::string text;
    constexpr std::size_t most = 10;
    for (std::size_t i = 0; i < std::min(most, ranges.size()); ++i) {
        text += fmt::format("{}{}-{}", i ? ", " : "", ranges[i].first, ranges[i].last);
    }
    return ranges.size() > most ? text + ", ..." : text;
}

// As `tribode batch status` counts them: the points that an attempt has kept are there.
[[noreturn]] void refuse_incomplete(const fs::path& folder, const Manifest& manifest, const RunControl& control) {
    const auto there = BatchFiles(folder, manifest).look(control);
    std::vector<ShardRange> missing;
    std::size_t points = 0, shards = 0;
    for (std::size_t shard = 1; shard <= manifest.shards; ++shard) {
        const auto found = there.find(shard);
        if (found != there.end() && found->second.complete) continue;
        ++shards;
        ShardRange range = manifest.range(shard);
        if (found != there.end()) range.first += found->second.done;
        if (range.first > range.last) continue; // all are kept, but the file has not its name yet
        points += range.size();
        if (!missing.empty() && missing.back().last + 1 == range.first) {
            missing.back().last = range.last;
        } else {
            missing.push_back(range);
        }
    }
    throw InputError(fmt::format(
        "{}: {} of {} points are missing ({}{}{} of {} shards); tribode batch resume runs them", folder.string(),
        points, manifest.count, text_of(missing), points ? "; " : "", shards, manifest.shards));
}

void require_complete(const fs::path& folder, const Manifest& manifest, const RunControl& control) {
    for (std::size_t shard = 1; shard <= manifest.shards; ++shard) {
        if (control.stop_requested()) throw EndedEarly("interrupted while the files of the batch were read");
        if (!read_shard_header(rows_path(folder, shard), manifest, shard)) refuse_incomplete(folder, manifest, control);
    }
}

// What a format makes of the rows.
class RowSink {
  public:
    virtual ~RowSink() = default;
    virtual void add(const PointRow& row, const std::vector<double>& numbers) = 0; // numbers: see `spread`
    virtual void commit() = 0;
};

// index, failed, parameters, then each kept column filled up to its width.
void spread(const PointRow& row, const std::vector<KeptColumn>& columns, std::vector<double>& numbers) {
    numbers.clear();
    numbers.push_back(static_cast<double>(row.index));
    numbers.push_back(row.failure.empty() ? 0 : 1);
    numbers.insert(numbers.end(), row.parameters.begin(), row.parameters.end());
    auto field = row.fields.begin();
    for (const auto& column : columns) {
        std::size_t filled = 0;
        if (field != row.fields.end() && field->name == column.name) {
            numbers.insert(numbers.end(), field->values.begin(), field->values.end());
            filled = field->values.size();
            ++field;
        }
        numbers.insert(numbers.end(), column.width - filled, nan);
    }
}

std::string unit_of(const Manifest& manifest, const std::string& name) {
    const auto unit = manifest.units.find(name);
    return unit == manifest.units.end() ? "" : unit->second;
}

class Hdf5Sink : public RowSink {
  public:
    Hdf5Sink(const fs::path& output, const Manifest& manifest, const std::vector<KeptColumn>& columns)
        : file_(output, manifest.count, datasets(manifest, columns), attributes(manifest)) {}

    void add(const PointRow& row, const std::vector<double>& numbers) override {
        file_.add_row(numbers);
        if (row.failure.empty()) return;
        failed_.push_back(static_cast<double>(row.index));
        reasons_.push_back(row.failure);
    }

    void commit() override {
        file_.add_group("failures", {"index", "", failed_}, "reason", reasons_);
        file_.commit();
    }

  private:
    static std::vector<Hdf5RowFile::Dataset> datasets(const Manifest& manifest,
                                                      const std::vector<KeptColumn>& columns) {
        std::vector<Hdf5RowFile::Dataset> datasets = {{"index", "", 0}, {"failed", "", 0}};
        for (const auto& name : manifest.parameters) datasets.push_back({name, unit_of(manifest, name), 0});
        for (const auto& column : columns) {
            datasets.push_back({column.name, unit_of(manifest, column.name), column.list ? column.width : 0});
        }
        return datasets;
    }

    static Json attributes(const Manifest& manifest) {
        return {{"batch", manifest.name},
                {"identity", manifest.identity()},
                {"version", manifest.version},
                {"seed", manifest.seed},
                {"parameters", manifest.parameters}};
    }

    Hdf5RowFile file_;
    std::vector<double> failed_;
    std::vector<std::string> reasons_;
};

// The columns of a table with one number in a cell: a list becomes name_1, name_2, ..., as long as there is room.
struct FlatColumns {
    std::vector<std::string> names; // of those that are taken
    std::vector<bool> taken;        // which numbers of `spread`

    FlatColumns(const Manifest& manifest, const std::vector<KeptColumn>& columns, std::vector<std::string>& left_out)
        : names{"index", "failed"} {
        constexpr std::size_t most = 1000;
        names.insert(names.end(), manifest.parameters.begin(), manifest.parameters.end());
        taken.assign(names.size(), true);
        for (const auto& column : columns) {
            const bool has_room = !column.list || names.size() + column.width <= most;
            if (!has_room) left_out.push_back(column.name);
            taken.insert(taken.end(), column.width, has_room);
            for (std::size_t i = 1; has_room && i <= column.width; ++i) {
                names.push_back(column.list ? fmt::format("{}_{}", column.name, i) : column.name);
            }
        }
    }
};

class CsvSink : public RowSink {
  public:
    CsvSink(const fs::path& output, FlatColumns columns) : file_(output), columns_(std::move(columns)) {
        file_.write(fmt::format("{},reason\n", fmt::join(columns_.names, ",")));
    }

    void add(const PointRow& row, const std::vector<double>& numbers) override {
        line_.clear();
        for (std::size_t i = 0; i < numbers.size(); ++i) {
            if (!columns_.taken[i]) continue;
            append_text(line_, numbers[i]);
            line_ += ',';
        }
        // Without the characters that would need quotes.
        for (const char c : row.failure) line_ += c == ',' ? ';' : c == '"' ? '\'' : c == '\n' || c == '\r' ? ' ' : c;
        line_ += '\n';
        file_.write(line_);
    }

    void commit() override { file_.commit(); }

  private:
    OutputFile file_;
    FlatColumns columns_;
    std::string line_;
};

// The only one that holds all rows: the format has the length of a column before its numbers.
class MatSink : public RowSink {
  public:
    MatSink(fs::path output, const Manifest& manifest, FlatColumns columns)
        : output_(std::move(output)),
          taken_(std::move(columns.taken)) {
        for (std::string name : columns.names) {
            const std::string unit = unit_of(manifest, name);
            for (char& c : name) {
                if (!std::isalnum(static_cast<unsigned char>(c))) c = '_';
            }
            if (!std::isalpha(static_cast<unsigned char>(name.front()))) name = "x" + name;
            table_.add(std::move(name), unit, {});
        }
        for (auto& column : table_.columns) column.values.reserve(manifest.count);
    }

    void add(const PointRow&, const std::vector<double>& numbers) override {
        auto column = table_.columns.begin();
        for (std::size_t i = 0; i < numbers.size(); ++i) {
            if (taken_[i]) (column++)->values.push_back(numbers[i]);
        }
    }

    void commit() override { write_mat(output_, table_); }

  private:
    fs::path output_;
    std::vector<bool> taken_;
    Table table_;
};

} // namespace

void for_each_point(const fs::path& folder, const Manifest& manifest, const std::function<void(const PointRow&)>& use,
                    const RunControl& control) {
    require_complete(folder, manifest, control);
    PointRow row;
    for (std::size_t shard = 1; shard <= manifest.shards; ++shard) {
        const fs::path path = rows_path(folder, shard);
        ShardReader reader(path, manifest, shard);
        const std::size_t wanted = manifest.range(shard).size();
        while (reader.points() < wanted && reader.next(row)) {
            if (control.stop_requested()) throw EndedEarly("interrupted while the batch was read");
            use(row);
        }
        if (reader.points() < wanted) {
            throw InputError(
                fmt::format("{}: is damaged after {} of {} points; tribode batch resume runs the others again",
                            path.string(), reader.points(), wanted));
        }
    }
}

MergeSummary merge_batch(const fs::path& folder, const Manifest& manifest, const fs::path& output,
                         const RunControl& control) {
    const std::string kind = output == standard_output ? ".csv" : output.extension().string();
    if (kind != ".h5" && kind != ".hdf5" && kind != ".csv" && kind != ".mat") {
        throw InputError(fmt::format("{}: a merged batch is a .h5, a .csv or a .mat", output.string()));
    }

    // First what there is, and whether it is what was planned.
    MergeSummary summary;
    std::map<std::string, KeptColumn> kept;
    Sha256 points;
    std::string text = points_header(manifest.parameters);
    for_each_point(
        folder, manifest,
        [&](const PointRow& row) {
            ++summary.points;
            summary.failed += !row.failure.empty();
            for (const auto& field : row.fields) {
                KeptColumn& column = kept.try_emplace(field.name, KeptColumn{field.name, 1, false}).first->second;
                column.width = std::max(column.width, field.values.size());
                column.list = column.list || field.list;
            }
            append_point_line(text, row.index, row.parameters);
            if (text.size() < (1 << 16)) return;
            points.add(text);
            text.clear();
        },
        control);
    points.add(text);
    if (points.hex() != manifest.points_sha256) {
        throw InputError(fmt::format("{}: the points that were run are not the planned ones of points.csv: the script "
                                     "makes other points each time it is read",
                                     folder.string()));
    }
    for (auto& [name, column] : kept) {
        if (std::find(manifest.parameters.begin(), manifest.parameters.end(), name) != manifest.parameters.end()) {
            throw InputError(fmt::format("{}: \"{}\" is a parameter of the points and a result; give one of them "
                                         "another name",
                                         folder.string(), name));
        }
        summary.columns.push_back(column);
    }

    std::unique_ptr<RowSink> sink;
    if (kind == ".csv") {
        sink = std::make_unique<CsvSink>(output, FlatColumns(manifest, summary.columns, summary.left_out));
    } else if (kind == ".mat") {
        sink = std::make_unique<MatSink>(output, manifest, FlatColumns(manifest, summary.columns, summary.left_out));
    } else {
        sink = std::make_unique<Hdf5Sink>(output, manifest, summary.columns);
    }
    std::vector<double> numbers;
    for_each_point(
        folder, manifest,
        [&](const PointRow& row) {
            spread(row, summary.columns, numbers);
            sink->add(row, numbers);
        },
        control);
    sink->commit();
    return summary;
}

} // namespace tribode
