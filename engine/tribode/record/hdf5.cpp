#include "tribode/record/hdf5.hpp"
#include "tribode/base/error.hpp"
#include "tribode/record/guarded.hpp"
#include "tribode/record/output_file.hpp"

#include <algorithm>
#include <array>
#include <cassert>
#include <cstring>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <hdf5.h>
#include <mutex>
#include <optional>
#include <utility>

namespace tribode {

namespace {

// What the library refused, e.g. "H5Dcreate2". Becomes an InputError or OutputError with the file's name.
struct Refused {
    const char* function;
};

// Owns an HDF5 identifier of any kind.
class Handle {
  public:
    Handle(hid_t id, const char* function) : id_(id) {
        if (id < 0) throw Refused{function};
    }
    Handle(Handle&& other) noexcept : id_(std::exchange(other.id_, -1)) {}
    Handle& operator=(Handle&&) = delete;
    ~Handle() {
        if (id_ >= 0) H5Idec_ref(id_);
    }
    operator hid_t() const { return id_; }

  private:
    hid_t id_;
};

void check(herr_t status, const char* function) {
    if (status < 0) throw Refused{function};
}

// The library is not thread-safe in every build, and prints its errors unless told otherwise.
std::unique_lock<std::mutex> enter_library() {
    static std::mutex mutex;
    std::unique_lock lock(mutex);
    // At the end of the process the library would write once more what a full disk refused, and crash.
    [[maybe_unused]] static const herr_t nothing_at_exit = H5dont_atexit();
    // A file is read from memory and reaches nothing else: no link to other files, no filter loaded from a library.
    [[maybe_unused]] static const herr_t no_links_outside = H5Lunregister(H5L_TYPE_EXTERNAL);
    [[maybe_unused]] static const herr_t no_plugins = H5PLset_loading_state(0);
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
    return lock;
}

// A file that lives in memory alone. `growth`: bytes by which it grows.
Handle memory_access(std::size_t growth) {
    Handle access(H5Pcreate(H5P_FILE_ACCESS), "H5Pcreate");
    check(H5Pset_fapl_core(access, growth, false), "H5Pset_fapl_core");
    return access;
}

// Links keep the order in which they were made.
Handle ordered(hid_t kind) {
    Handle creation(H5Pcreate(kind), "H5Pcreate");
    check(H5Pset_link_creation_order(creation, H5P_CRT_ORDER_TRACKED | H5P_CRT_ORDER_INDEXED),
          "H5Pset_link_creation_order");
    // A time stamp would make the bytes differ from run to run.
    check(H5Pset_obj_track_times(creation, false), "H5Pset_obj_track_times");
    return creation;
}

void write_text_attribute(hid_t object, const std::string& name, const std::string& text) {
    const Handle type(H5Tcopy(H5T_C_S1), "H5Tcopy");
    check(H5Tset_size(type, text.size() + 1), "H5Tset_size"); // with the zero at its end
    check(H5Tset_cset(type, H5T_CSET_UTF8), "H5Tset_cset");
    const Handle space(H5Screate(H5S_SCALAR), "H5Screate");
    const Handle attribute(H5Acreate2(object, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT), "H5Acreate2");
    check(H5Awrite(attribute, type, text.c_str()), "H5Awrite");
}

template <class Number>
void write_number_attribute(hid_t object, const std::string& name, hid_t stored_as, hid_t type, Number number) {
    const Handle space(H5Screate(H5S_SCALAR), "H5Screate");
    const Handle attribute(H5Acreate2(object, name.c_str(), stored_as, space, H5P_DEFAULT, H5P_DEFAULT), "H5Acreate2");
    check(H5Awrite(attribute, type, &number), "H5Awrite");
}

void write_attribute(hid_t object, const std::string& name, const Json& value) {
    if (value.is_number_integer()) {
        write_number_attribute(object, name, H5T_STD_I64LE, H5T_NATIVE_INT64, value.get<std::int64_t>());
    } else if (value.is_number()) {
        write_number_attribute(object, name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, value.get<double>());
    } else {
        write_text_attribute(object, name, value.is_string() ? value.get<std::string>() : value.dump());
    }
}

void write_column(hid_t group, const Column& column) {
    const hsize_t length = column.values.size();
    const Handle space(H5Screate_simple(1, &length, nullptr), "H5Screate_simple");
    const Handle creation(H5Pcreate(H5P_DATASET_CREATE), "H5Pcreate");
    check(H5Pset_obj_track_times(creation, false), "H5Pset_obj_track_times");
    const Handle dataset(
        H5Dcreate2(group, column.name.c_str(), H5T_IEEE_F64LE, space, H5P_DEFAULT, creation, H5P_DEFAULT),
        "H5Dcreate2");
    check(H5Dwrite(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, column.values.data()), "H5Dwrite");
    write_text_attribute(dataset, "unit", column.unit);
}

// A column as MATLAB keeps one, an array of n x 1 doubles; its dimensions are reversed in HDF5.
void write_matlab_column(hid_t group, const Column& column) {
    const bool empty = column.values.empty();
    const std::array<std::uint64_t, 2> none = {0, 1}; // the dimensions, in place of the numbers
    const std::array<hsize_t, 2> shape = {1, column.values.size()};
    const hsize_t two = 2;
    const Handle space(empty ? H5Screate_simple(1, &two, nullptr) : H5Screate_simple(2, shape.data(), nullptr),
                       "H5Screate_simple");
    const Handle creation(H5Pcreate(H5P_DATASET_CREATE), "H5Pcreate");
    check(H5Pset_obj_track_times(creation, false), "H5Pset_obj_track_times");
    const Handle dataset(H5Dcreate2(group, column.name.c_str(), empty ? H5T_STD_U64LE : H5T_IEEE_F64LE, space,
                                    H5P_DEFAULT, creation, H5P_DEFAULT),
                         "H5Dcreate2");
    check(H5Dwrite(dataset, empty ? H5T_NATIVE_UINT64 : H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT,
                   empty ? static_cast<const void*>(none.data()) : column.values.data()),
          "H5Dwrite");
    constexpr std::string_view kind = "double"; // without a zero at its end
    const Handle type(H5Tcopy(H5T_C_S1), "H5Tcopy");
    check(H5Tset_size(type, kind.size()), "H5Tset_size");
    const Handle scalar(H5Screate(H5S_SCALAR), "H5Screate");
    const Handle attribute(H5Acreate2(dataset, "MATLAB_class", type, scalar, H5P_DEFAULT, H5P_DEFAULT), "H5Acreate2");
    check(H5Awrite(attribute, type, kind.data()), "H5Awrite");
    if (empty) write_number_attribute(dataset, "MATLAB_empty", H5T_STD_U8LE, H5T_NATIVE_UINT8, std::uint8_t{1});
}

void require_link_name(const std::string& name, std::vector<std::string>& taken) {
    if (name.empty() || name == "." || name.find('/') != std::string::npos) {
        throw InputError(fmt::format("\"{}\" is not a name that HDF5 can hold: empty, . and / are not allowed", name));
    }
    if (std::find(taken.begin(), taken.end(), name) != taken.end()) {
        throw InputError(fmt::format("the name {} stands twice in one HDF5 group, must stand once", name));
    }
    taken.push_back(name);
}

void require_link_names(const std::vector<NamedTable>& tables) {
    std::vector<std::string> at_root;
    for (const auto& [name, table] : tables) {
        if (!name.empty()) require_link_name(name, at_root);
        std::vector<std::string> in_group;
        for (const Column& column : table.columns) require_link_name(column.name, name.empty() ? at_root : in_group);
    }
}

std::size_t bytes_of(const std::vector<NamedTable>& tables) {
    std::size_t bytes = 65536;
    for (const NamedTable& entry : tables) bytes += sizeof(double) * entry.table.rows() * entry.table.columns.size();
    return bytes;
}

using ColumnWriter = void (*)(hid_t group, const Column& column);

std::string file_image(const std::vector<NamedTable>& tables, const Json& attributes, ColumnWriter write_one) {
    const Handle access = memory_access(bytes_of(tables));
    const Handle creation = ordered(H5P_FILE_CREATE);
    const Handle group_creation = ordered(H5P_GROUP_CREATE);
    const Handle file(H5Fcreate("tribode", H5F_ACC_TRUNC, creation, access), "H5Fcreate");
    for (const auto& [name, value] : attributes.items()) write_attribute(file, name, value);
    for (const auto& [name, table] : tables) {
        const Handle group(name.empty() ? H5Gopen2(file, "/", H5P_DEFAULT)
                                        : H5Gcreate2(file, name.c_str(), H5P_DEFAULT, group_creation, H5P_DEFAULT),
                           "H5Gcreate2");
        for (const Column& column : table.columns) write_one(group, column);
    }
    check(H5Fflush(file, H5F_SCOPE_GLOBAL), "H5Fflush");
    const ssize_t size = H5Fget_file_image(file, nullptr, 0);
    if (size < 0) throw Refused{"H5Fget_file_image"};
    std::string bytes(static_cast<std::size_t>(size), '\0');
    if (H5Fget_file_image(file, bytes.data(), bytes.size()) != size) throw Refused{"H5Fget_file_image"};
    return bytes;
}

// The names in a group and whether each is a group itself, in the order of creation where the file has kept it.
struct Link {
    std::string name;
    H5O_type_t type;
    bool is_inside; // the file itself
};

std::vector<Link> links_of(hid_t group) {
    const Handle creation(H5Gget_create_plist(group), "H5Gget_create_plist");
    unsigned order = 0;
    check(H5Pget_link_creation_order(creation, &order), "H5Pget_link_creation_order");
    const H5_index_t index = (order & H5P_CRT_ORDER_TRACKED) ? H5_INDEX_CRT_ORDER : H5_INDEX_NAME;

    std::vector<Link> links;
    const auto add = [](hid_t parent, const char* name, const H5L_info_t* link, void* list) -> herr_t {
        auto& found = *static_cast<std::vector<Link>*>(list);
        if (link->type != H5L_TYPE_HARD && link->type != H5L_TYPE_SOFT) {
            found.push_back({name, H5O_TYPE_UNKNOWN, false});
            return 0;
        }
        H5O_info_t about;
        // A link that leads nowhere is passed over like everything that is not a vector of numbers.
        if (H5Oget_info_by_name2(parent, name, &about, H5O_INFO_BASIC, H5P_DEFAULT) >= 0) {
            found.push_back({name, about.type, true});
        }
        return 0;
    };
    check(H5Literate(group, index, H5_ITER_INC, nullptr, add, &links), "H5Literate");
    return links;
}

std::string read_text_attribute(hid_t object, const char* name) {
    if (H5Aexists(object, name) <= 0) return "";
    const Handle attribute(H5Aopen(object, name, H5P_DEFAULT), "H5Aopen");
    const Handle type(H5Aget_type(attribute), "H5Aget_type");
    const Handle space(H5Aget_space(attribute), "H5Aget_space");
    if (H5Tget_class(type) != H5T_STRING || H5Sget_simple_extent_npoints(space) != 1) return "";
    if (H5Tis_variable_str(type) > 0) {
        char* text = nullptr;
        check(H5Aread(attribute, type, &text), "H5Aread");
        std::string unit = text ? text : "";
        check(H5Dvlen_reclaim(type, space, H5P_DEFAULT, &text), "H5Dvlen_reclaim");
        return unit;
    }
    std::string text(H5Tget_size(type) + 1, '\0');
    check(H5Aread(attribute, type, text.data()), "H5Aread");
    text.resize(text.find('\0'));
    return text;
}

Variable link_outside(std::string name) {
    return {std::move(name), "", {}, "is a link to another file, which is not followed"};
}

// The dataset as a column, or why it cannot be one.
Variable read_variable(hid_t group, const std::string& name, std::size_t file_size) {
    Variable variable{name, "", {}, ""};
    const auto refuse = [&](std::string reason) {
        variable.refusal = std::move(reason);
        return variable;
    };
    const Handle dataset(H5Dopen2(group, name.c_str(), H5P_DEFAULT), "H5Dopen2");
    // Before all else: asking for the shape of a virtual dataset opens its sources.
    const Handle creation(H5Dget_create_plist(dataset), "H5Dget_create_plist");
    if (H5Pget_layout(creation) == H5D_VIRTUAL || H5Pget_external_count(creation) != 0)
        return refuse("has its numbers in another file, which is not read");
    const Handle type(H5Dget_type(dataset), "H5Dget_type");
    const Handle space(H5Dget_space(dataset), "H5Dget_space");
    const H5T_class_t kind = H5Tget_class(type);
    // MATLAB says in an attribute what it means by the numbers.
    const std::string matlab = read_text_attribute(dataset, "MATLAB_class");
    if (kind == H5T_COMPOUND && (matlab.empty() || matlab == "double"))
        return refuse("is complex or a record, must be real");
    if (!matlab.empty() && matlab != "double")
        return refuse(fmt::format("is of class {}, must be one of doubles", matlab));
    if (H5Aexists(dataset, "MATLAB_empty") > 0) return refuse("is empty");
    if (kind != H5T_FLOAT && kind != H5T_INTEGER) return refuse("is no array of numbers");

    const int rank = H5Sget_simple_extent_ndims(space);
    if (rank < 0) throw Refused{"H5Sget_simple_extent_ndims"};
    std::vector<hsize_t> shape(static_cast<std::size_t>(rank));
    H5Sget_simple_extent_dims(space, shape.data(), nullptr);
    if (std::count_if(shape.begin(), shape.end(), [](hsize_t n) { return n != 1; }) > 1) {
        return refuse(fmt::format("is a matrix ({}), must be a vector", fmt::join(shape, " x ")));
    }
    const auto count = static_cast<std::size_t>(std::max<hssize_t>(H5Sget_simple_extent_npoints(space), 0));
    // Packing makes at most a thousandth of numbers that are all the same.
    constexpr std::size_t densest = 1100;
    if (count / densest > file_size)
        return refuse(fmt::format("claims {} numbers, more than the file can hold", count));
    variable.unit = read_text_attribute(dataset, "unit");
    variable.values.resize(count);
    check(H5Dread(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, variable.values.data()), "H5Dread");
    return variable;
}

Handle open_image(std::string_view bytes) {
    const Handle access = memory_access(65536);
    check(H5Pset_file_image(access, const_cast<char*>(bytes.data()), bytes.size()), "H5Pset_file_image");
    return Handle(H5Fopen("tribode", H5F_ACC_RDONLY, access), "H5Fopen");
}

std::vector<Variable> variables_of(std::string_view bytes) {
    const Handle file = open_image(bytes);
    const Handle root(H5Gopen2(file, "/", H5P_DEFAULT), "H5Gopen2");
    std::vector<Variable> variables;
    for (const Link& link : links_of(root)) {
        if (link.name.starts_with('#')) continue; // where MATLAB keeps the parts of cells and objects
        if (!link.is_inside) {
            variables.push_back(link_outside(link.name));
        } else if (link.type == H5O_TYPE_DATASET) {
            variables.push_back(read_variable(root, link.name, bytes.size()));
        } else if (link.type == H5O_TYPE_GROUP) {
            const Handle group(H5Gopen2(root, link.name.c_str(), H5P_DEFAULT), "H5Gopen2");
            if (const std::string matlab = read_text_attribute(group, "MATLAB_class"); !matlab.empty()) {
                variables.push_back({link.name, "", {}, fmt::format("is a {}, must be an array of doubles", matlab)});
                continue;
            }
            for (const Link& inner : links_of(group)) {
                if (inner.is_inside && inner.type != H5O_TYPE_DATASET) continue;
                variables.push_back(inner.is_inside ? read_variable(group, inner.name, bytes.size())
                                                    : link_outside(inner.name));
                variables.back().name = link.name + "/" + inner.name;
            }
        }
    }
    return variables;
}

// ---- out of the process that reads -------------------------------------------------------------------------------

void append_size(std::string& bytes, std::size_t size) {
    bytes.append(reinterpret_cast<const char*>(&size), sizeof size);
}

std::string to_bytes(const std::vector<Variable>& variables) {
    std::string bytes;
    for (const Variable& variable : variables) {
        for (const std::string* text : {&variable.name, &variable.unit, &variable.refusal}) {
            append_size(bytes, text->size());
            bytes += *text;
        }
        append_size(bytes, variable.values.size());
        bytes.append(reinterpret_cast<const char*>(variable.values.data()), sizeof(double) * variable.values.size());
    }
    return bytes;
}

std::vector<Variable> from_bytes(std::string_view bytes) {
    const auto take = [&bytes](void* place, std::size_t count) {
        assert(count <= bytes.size());
        if (count > 0) std::memcpy(place, bytes.data(), count);
        bytes.remove_prefix(count);
    };
    const auto take_size = [&take] {
        std::size_t size = 0;
        take(&size, sizeof size);
        return size;
    };
    std::vector<Variable> variables;
    while (!bytes.empty()) {
        Variable& variable = variables.emplace_back();
        for (std::string* text : {&variable.name, &variable.unit, &variable.refusal}) {
            text->resize(take_size());
            take(text->data(), text->size());
        }
        variable.values.resize(take_size());
        take(variable.values.data(), sizeof(double) * variable.values.size());
    }
    return variables;
}

} // namespace

static std::string guarded_image(const std::vector<NamedTable>& tables, const Json& attributes,
                                 ColumnWriter write_one) {
    require_link_names(tables);
    const auto lock = enter_library();
    try {
        return file_image(tables, attributes, write_one);
    } catch (const Refused& refused) {
        throw OutputError(fmt::format("HDF5: the data cannot be put into a file ({} failed)", refused.function));
    }
}

std::string to_hdf5(const std::vector<NamedTable>& tables, const Json& attributes) {
    return guarded_image(tables, attributes, write_column);
}

std::string to_matlab_hdf5(const Table& table) {
    return guarded_image({{"", table}}, Json::object(), write_matlab_column);
}

void write_hdf5(const std::filesystem::path& path, const std::vector<NamedTable>& tables, const Json& attributes) {
    write_file(path, to_hdf5(tables, attributes));
}

std::vector<NamedTable> read_hdf5(const std::filesystem::path& path) {
    const std::string source = path.string();
    std::vector<std::pair<std::string, std::vector<Variable>>> groups;
    for (Variable& variable : hdf5_variables(read_file(path), source)) {
        if (!variable.refusal.empty()) continue;
        const auto slash = variable.name.find('/');
        const std::string group = slash == std::string::npos ? "" : variable.name.substr(0, slash);
        if (slash != std::string::npos) variable.name.erase(0, slash + 1);
        auto it = std::find_if(groups.begin(), groups.end(), [&](const auto& g) { return g.first == group; });
        if (it == groups.end()) it = groups.insert(group.empty() ? groups.begin() : groups.end(), {group, {}});
        it->second.push_back(std::move(variable));
    }

    std::vector<NamedTable> tables;
    for (auto& [name, columns] : groups) {
        const bool has_vectors =
            std::any_of(columns.begin(), columns.end(), [](const Variable& c) { return c.values.size() > 1; });
        Table table;
        table.source = source;
        for (Variable& column : columns) {
            if (has_vectors && column.values.size() == 1) continue;
            try {
                table.add(std::move(column.name), std::move(column.unit), std::move(column.values));
            } catch (const InputError& problem) {
                throw InputError(fmt::format("{}: {}", source, problem.what()));
            }
        }
        tables.push_back({name, std::move(table)});
    }
    return tables;
}

bool is_hdf5(std::string_view bytes) {
    // At the start, or after a head of 512, 1024, 2048 ... bytes.
    for (std::size_t place = 0; place < bytes.size(); place = place == 0 ? 512 : 2 * place) {
        if (bytes.substr(place).starts_with("\x89HDF\r\n\x1a\n")) return true;
    }
    return false;
}

std::vector<Variable> hdf5_variables(std::string_view bytes, const std::string& source) {
    const auto lock = enter_library();
    // Far more than a sound file takes, of the processor and of the memory.
    const GuardLimits limits{static_cast<unsigned>(1 + bytes.size() / 20'000'000),
                             (std::size_t{256} << 20) + 40 * bytes.size()};
    const auto packed = run_guarded(limits, [&] {
        try {
            return to_bytes(variables_of(bytes));
        } catch (const Refused& refused) {
            throw InputError(fmt::format("{}: is not a readable HDF5 file ({} failed)", source, refused.function));
        }
    });
    if (!packed) throw InputError(fmt::format("{}: is a damaged HDF5 file", source));
    return from_bytes(*packed);
}

// ---- row by row --------------------------------------------------------------------------------------------------

struct Hdf5RowFile::Content {
    std::vector<Dataset> datasets;
    std::size_t rows = 0;
    std::filesystem::path part;
    std::optional<Handle> file;
    std::vector<Handle> sets;
    std::vector<std::vector<double>> gathered; // per dataset
    std::size_t written = 0, waiting = 0;      // rows

    // The handles before the file, so that it is closed.
    void close() {
        sets.clear();
        file.reset();
    }
};

namespace {

template <class Work>
void refused_is_output_error(const std::filesystem::path& path, const Work& work) {
    try {
        work();
    } catch (const Refused& problem) {
        throw OutputError(
            fmt::format("{}: cannot be written (HDF5 refused {}; is the disk full?)", path.string(), problem.function));
    }
}

Handle make_dataset(hid_t group, const std::string& name, hid_t type, const std::vector<hsize_t>& shape) {
    const Handle space(H5Screate_simple(static_cast<int>(shape.size()), shape.data(), nullptr), "H5Screate_simple");
    const Handle creation(H5Pcreate(H5P_DATASET_CREATE), "H5Pcreate");
    check(H5Pset_obj_track_times(creation, false), "H5Pset_obj_track_times");
    return {H5Dcreate2(group, name.c_str(), type, space, H5P_DEFAULT, creation, H5P_DEFAULT), "H5Dcreate2"};
}

} // namespace

Hdf5RowFile::Hdf5RowFile(std::filesystem::path path, std::size_t rows, std::vector<Dataset> datasets,
                         const Json& attributes)
    : path_(std::move(path)),
      content_(std::make_unique<Content>()) {
    std::vector<std::string> taken;
    for (const auto& set : datasets) require_link_name(set.name, taken);
    Content& c = *content_;
    c.datasets = std::move(datasets);
    c.rows = rows;
    c.part = path_;
    c.part += ".part";
    c.gathered.resize(c.datasets.size());
    std::error_code problem;
    if (path_.has_parent_path()) std::filesystem::create_directories(path_.parent_path(), problem);
    const auto lock = enter_library();
    try {
        refused_is_output_error(path_, [&] {
            const Handle creation = ordered(H5P_FILE_CREATE);
            std::filesystem::remove(c.part, problem); // a link of this name is not written through
            c.file.emplace(H5Fcreate(c.part.c_str(), H5F_ACC_TRUNC, creation, H5P_DEFAULT), "H5Fcreate");
            for (const auto& [name, value] : attributes.items()) write_attribute(*c.file, name, value);
            for (const auto& set : c.datasets) {
                std::vector<hsize_t> shape = {rows};
                if (set.width) shape.push_back(set.width);
                c.sets.push_back(make_dataset(*c.file, set.name, H5T_IEEE_F64LE, shape));
                write_text_attribute(c.sets.back(), "unit", set.unit);
            }
        });
    } catch (const OutputError&) {
        abandon();
        throw;
    }
}

Hdf5RowFile::~Hdf5RowFile() {
    if (content_->file) abandon();
}

void Hdf5RowFile::abandon() {
    std::error_code problem;
    std::filesystem::remove(content_->part, problem);
    // Never closed: that would write the rest once more, and the library crashes where the disk refuses it.
    static auto& never_closed = *new std::vector<std::unique_ptr<Content>>;
    never_closed.push_back(std::move(content_));
}

void Hdf5RowFile::add_row(const std::vector<double>& numbers) {
    constexpr std::size_t worth_writing = 1 << 19; // numbers
    Content& c = *content_;
    auto next = numbers.begin();
    for (std::size_t i = 0; i < c.datasets.size(); ++i) {
        const auto width = static_cast<std::ptrdiff_t>(std::max<std::size_t>(c.datasets[i].width, 1));
        c.gathered[i].insert(c.gathered[i].end(), next, next + width);
        next += width;
    }
    assert(next == numbers.end());
    ++c.waiting;
    if (c.waiting * numbers.size() >= worth_writing) flush();
}

void Hdf5RowFile::flush() {
    Content& c = *content_;
    const auto lock = enter_library();
    refused_is_output_error(path_, [&] {
        for (std::size_t i = 0; i < c.sets.size() && c.waiting > 0; ++i) {
            std::vector<hsize_t> begin = {c.written}, count = {c.waiting};
            if (c.datasets[i].width) {
                begin.push_back(0);
                count.push_back(c.datasets[i].width);
            }
            const Handle in_file(H5Dget_space(c.sets[i]), "H5Dget_space");
            check(H5Sselect_hyperslab(in_file, H5S_SELECT_SET, begin.data(), nullptr, count.data(), nullptr),
                  "H5Sselect_hyperslab");
            const Handle in_memory(H5Screate_simple(static_cast<int>(count.size()), count.data(), nullptr),
                                   "H5Screate_simple");
            check(H5Dwrite(c.sets[i], H5T_NATIVE_DOUBLE, in_memory, in_file, H5P_DEFAULT, c.gathered[i].data()),
                  "H5Dwrite");
            c.gathered[i].clear();
        }
    });
    c.written += c.waiting;
    c.waiting = 0;
}

void Hdf5RowFile::add_group(const std::string& name, const Column& numbers, const std::string& texts_name,
                            const std::vector<std::string>& texts) {
    assert(numbers.values.size() == texts.size());
    Content& c = *content_;
    std::size_t longest = 1;
    for (const auto& text : texts) longest = std::max(longest, text.size());
    std::string bytes;
    for (const auto& text : texts) bytes += text + std::string(longest - text.size(), '\0');
    const auto lock = enter_library();
    refused_is_output_error(path_, [&] {
        const Handle creation = ordered(H5P_GROUP_CREATE);
        const Handle group(H5Gcreate2(*c.file, name.c_str(), H5P_DEFAULT, creation, H5P_DEFAULT), "H5Gcreate2");
        write_column(group, numbers);
        const Handle type(H5Tcopy(H5T_C_S1), "H5Tcopy");
        check(H5Tset_size(type, longest), "H5Tset_size");
        check(H5Tset_strpad(type, H5T_STR_NULLPAD), "H5Tset_strpad");
        check(H5Tset_cset(type, H5T_CSET_UTF8), "H5Tset_cset");
        const Handle set = make_dataset(group, texts_name, type, {texts.size()});
        if (!texts.empty()) check(H5Dwrite(set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, bytes.data()), "H5Dwrite");
    });
}

void Hdf5RowFile::commit() {
    flush();
    Content& c = *content_;
    assert(c.written == c.rows);
    {
        const auto lock = enter_library();
        refused_is_output_error(path_, [&] { check(H5Fflush(*c.file, H5F_SCOPE_GLOBAL), "H5Fflush"); });
        c.close();
    }
    commit_file(c.part, path_);
}

} // namespace tribode
