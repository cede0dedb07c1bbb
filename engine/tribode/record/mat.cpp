#include "tribode/record/mat.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/record/hdf5.hpp"
#include "tribode/record/output_file.hpp"
#include "tribode/record/zip.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <optional>

namespace tribode {

namespace {

constexpr std::size_t header_size = 128, subsystem_place = 116, version_place = 124;

// Types of data elements and classes of arrays, by the numbers of the format.
enum ElementType : std::uint32_t {
    int8 = 1,
    uint8 = 2,
    int16 = 3,
    uint16 = 4,
    int32 = 5,
    uint32 = 6,
    single = 7,
    real = 9,
    int64 = 12,
    uint64 = 13,
    matrix = 14,
    compressed = 15
};
constexpr std::array<const char*, 18> class_names = {"",       "cell",   "struct", "object", "char",     "sparse",
                                                     "double", "single", "int8",   "uint8",  "int16",    "uint16",
                                                     "int32",  "uint32", "int64",  "uint64", "function", "object"};
constexpr unsigned double_class = 6, opaque_class = 17;
constexpr std::uint32_t complex_flag = 0x0800, logical_flag = 0x0200;

// What an element holds, and the bytes of its data.
struct Element {
    std::uint32_t type = 0;
    std::string_view data;
};

// Takes elements off the front of a run of bytes. Every length is compared with what there is.
class Cursor {
  public:
    Cursor(std::string_view bytes, bool big_endian, const std::string& source)
        : rest_(bytes),
          big_endian_(big_endian),
          source_(source) {}

    bool at_end() const { return rest_.empty(); }
    Cursor inside(std::string_view bytes) const { return {bytes, big_endian_, source_}; }
    const std::string& source() const { return source_; }

    template <class Number>
    Number number(std::string_view bytes, std::size_t index = 0) const {
        std::array<char, sizeof(Number)> raw;
        std::copy_n(bytes.begin() + static_cast<std::ptrdiff_t>(index * sizeof(Number)), sizeof(Number), raw.begin());
        if (big_endian_ != (std::endian::native == std::endian::big)) std::reverse(raw.begin(), raw.end());
        return std::bit_cast<Number>(raw);
    }

    Element next() {
        const std::uint32_t word = number<std::uint32_t>(take(4));
        // The short form has type and length in one word and up to four bytes of data in the next.
        if (const std::uint32_t length = word >> 16; length != 0) {
            if (length > 4) fail();
            return {word & 0xffffu, take(4).substr(0, length)};
        }
        const std::size_t length = number<std::uint32_t>(take(4));
        const Element element{word, take(length)};
        // Data end at a multiple of eight bytes, but packed ones and, in some files, the last.
        if (word != compressed) rest_.remove_prefix(std::min((8 - length % 8) % 8, rest_.size()));
        return element;
    }

    [[noreturn]] void fail() const {
        throw InputError(fmt::format("{}: is a MAT file that is damaged or cut short", source_));
    }

  private:
    std::string_view take(std::size_t count) {
        if (count > rest_.size()) fail();
        const std::string_view taken = rest_.substr(0, count);
        rest_.remove_prefix(count);
        return taken;
    }

    std::string_view rest_;
    bool big_endian_;
    const std::string& source_;
};

template <class Number>
std::vector<double> numbers(const Cursor& cursor, std::string_view data) {
    if (data.size() % sizeof(Number) != 0) cursor.fail();
    std::vector<double> values(data.size() / sizeof(Number));
    for (std::size_t i = 0; i < values.size(); ++i) {
        values[i] = static_cast<double>(cursor.number<Number>(data, i));
    }
    return values;
}

// Doubles that are small whole numbers may be stored as such.
std::vector<double> values_of(const Cursor& cursor, const Element& element) {
    switch (element.type) {
    case int8: return numbers<std::int8_t>(cursor, element.data);
    case uint8: return numbers<std::uint8_t>(cursor, element.data);
    case int16: return numbers<std::int16_t>(cursor, element.data);
    case uint16: return numbers<std::uint16_t>(cursor, element.data);
    case int32: return numbers<std::int32_t>(cursor, element.data);
    case uint32: return numbers<std::uint32_t>(cursor, element.data);
    case single: return numbers<float>(cursor, element.data);
    case real: return numbers<double>(cursor, element.data);
    case int64: return numbers<std::int64_t>(cursor, element.data);
    case uint64: return numbers<std::uint64_t>(cursor, element.data);
    default: cursor.fail();
    }
}

std::string article(std::string_view noun) { return std::string("aeiou").find(noun[0]) < 5 ? "an" : "a"; }

// One array; nothing for an entry without a name, which holds data of the system.
std::optional<Variable> read_array(Cursor cursor) {
    const Element about = cursor.next();
    if (about.type != uint32 || about.data.size() != 8) cursor.fail();
    const auto flags = cursor.number<std::uint32_t>(about.data);
    const unsigned kind = flags & 0xffu;
    if (kind == 0 || kind >= class_names.size()) cursor.fail();

    std::vector<double> shape;
    if (kind != opaque_class) {
        const Element dimensions = cursor.next();
        if (dimensions.type != int32 || dimensions.data.size() < 8) cursor.fail();
        shape = numbers<std::int32_t>(cursor, dimensions.data);
        if (*std::min_element(shape.begin(), shape.end()) < 0) cursor.fail();
    }
    const Element name = cursor.next();
    if (name.type != int8 && name.type != uint8) cursor.fail();
    if (name.data.empty()) return std::nullopt;

    Variable variable{std::string(name.data), "", {}, ""};
    if (kind != double_class) {
        const std::string_view noun = flags & logical_flag ? "logical" : class_names[kind];
        const bool is_number = kind > double_class && kind < 16 && noun != "logical";
        variable.refusal = is_number ? fmt::format("is an array of class {}, must be one of doubles", noun)
                                     : fmt::format("is {} {}, must be an array of doubles", article(noun), noun);
    } else if (flags & complex_flag) {
        variable.refusal = "is complex, must be real";
    } else if (std::count_if(shape.begin(), shape.end(), [](double n) { return n != 1; }) > 1) {
        variable.refusal = fmt::format("is a matrix ({}), must be a vector", fmt::join(shape, " x "));
    } else {
        variable.values = values_of(cursor, cursor.next());
        double count = 1;
        for (const double n : shape) count *= n;
        if (static_cast<double>(variable.values.size()) != count) cursor.fail();
    }
    return variable;
}

// ---- writing -----------------------------------------------------------------------------------------------------

// Little-endian on every machine.
template <class Number>
void append(std::string& bytes, Number number) {
    auto raw = std::bit_cast<std::array<char, sizeof(Number)>>(number);
    if constexpr (std::endian::native == std::endian::big) std::reverse(raw.begin(), raw.end());
    bytes.append(raw.data(), raw.size());
}

void append_tag(std::string& bytes, std::uint32_t type, std::size_t length) {
    append(bytes, type);
    append(bytes, static_cast<std::uint32_t>(length));
}

std::string element_of(const Column& column) {
    std::string bytes;
    bytes.reserve(64 + column.name.size() + sizeof(double) * column.values.size());
    append_tag(bytes, uint32, 8);
    append(bytes, std::uint32_t{double_class});
    append(bytes, std::uint32_t{0});
    append_tag(bytes, int32, 8);
    append(bytes, static_cast<std::int32_t>(column.values.size()));
    append(bytes, std::int32_t{1});
    append_tag(bytes, int8, column.name.size());
    bytes += column.name;
    bytes.resize((bytes.size() + 7) / 8 * 8);
    append_tag(bytes, real, sizeof(double) * column.values.size());
    for (const double value : column.values) append(bytes, value);
    return bytes;
}

void require_name(const std::string& name) {
    constexpr std::size_t longest = 63;
    const auto is_letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); };
    const auto is_allowed = [&](char c) { return is_letter(c) || (c >= '0' && c <= '9') || c == '_'; };
    if (name.empty() || name.size() > longest || !is_letter(name[0]) ||
        !std::all_of(name.begin(), name.end(), is_allowed)) {
        throw InputError(
            fmt::format("\"{}\" is not a name that a MAT file can hold: it must be a letter, then letters, "
                        "digits or _, {} in all at most",
                        name, longest));
    }
}

} // namespace

bool is_mat5(std::string_view bytes) {
    if (bytes.size() < header_size) return false;
    const std::string_view mark = bytes.substr(version_place, 4);
    return mark == std::string_view("\0\1IM", 4) || mark == std::string_view("\1\0MI", 4);
}

std::vector<Variable> mat_variables(std::string_view bytes, std::size_t most, const std::string& source) {
    const bool big_endian = bytes.size() >= header_size && bytes[version_place + 2] == 'M';
    Cursor cursor(bytes.substr(std::min(bytes.size(), header_size)), big_endian, source);
    if (!is_mat5(bytes)) cursor.fail();

    std::vector<Variable> variables;
    while (!cursor.at_end()) {
        Element element = cursor.next();
        std::string unpacked;
        if (element.type == compressed) {
            unpacked = inflate_zlib(element.data, most, source);
            most -= unpacked.size();
            element = cursor.inside(unpacked).next();
        }
        if (element.type != matrix || element.data.empty()) continue;
        auto variable = read_array(cursor.inside(element.data));
        if (!variable) continue;
        std::erase_if(variables, [&](const Variable& v) { return v.name == variable->name; });
        variables.push_back(std::move(*variable));
    }
    return variables;
}

static void require_names(const Table& table) {
    for (const Column& column : table.columns) {
        require_name(column.name);
        if (table.find(column.name) != &column) {
            throw InputError(fmt::format("column {} stands twice, each name must stand once", column.name));
        }
    }
}

// The first 128 bytes of a file.
static std::string head(std::string_view version, char number) {
    std::string bytes =
        fmt::format("{:<{}}", fmt::format("MATLAB {} MAT-file, written by Tribode {}", version, tribode::version()),
                    subsystem_place);
    bytes.resize(version_place);
    return bytes + std::string{'\0', number, 'I', 'M'};
}

std::string to_mat(const Table& table, MatVersion version) {
    require_names(table);
    if (version == MatVersion::v7_3) {
        constexpr std::size_t before_hdf5 = 512;
        std::string bytes = head("7.3", '\2');
        bytes.resize(before_hdf5);
        return bytes + to_matlab_hdf5(table);
    }
    std::string bytes = head("5.0", '\1');
    for (const Column& column : table.columns) {
        constexpr std::size_t max_rows = (std::size_t{1} << 28) - 32; // 2 GiB with the head of the array
        if (column.values.size() > max_rows) {
            throw InputError(fmt::format("column {} has {} values, a MAT file of version 5 can hold {} at most; "
                                         "write version 7.3 or HDF5",
                                         column.name, column.values.size(), max_rows));
        }
        const std::string element = element_of(column);
        append_tag(bytes, matrix, element.size());
        bytes += element;
    }
    return bytes;
}

void write_mat(const std::filesystem::path& path, const Table& table) { write_file(path, to_mat(table)); }

} // namespace tribode
