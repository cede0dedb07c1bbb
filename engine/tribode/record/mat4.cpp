#include "tribode/record/mat4.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <fmt/format.h>
#include <limits>
#include <map>
#include <optional>

namespace tribode {

namespace {

constexpr std::size_t matrix_header_size = 20;

// Column-major numbers in the file.
struct Matrix {
    enum class Kind { numbers, text, sparse };

    std::string_view name, data;
    std::size_t rows = 0, columns = 0;
    Kind kind = Kind::numbers;
    unsigned type = 0; // 0: double, 1: single, 2: int32, 3: int16, 4: uint16, 5: uint8
    bool is_complex = false, big_endian = false;

    template <class Number>
    double element(std::size_t index) const {
        std::array<char, sizeof(Number)> raw;
        std::copy_n(data.begin() + static_cast<std::ptrdiff_t>(index * sizeof(Number)), sizeof(Number), raw.begin());
        if (big_endian != (std::endian::native == std::endian::big)) std::reverse(raw.begin(), raw.end());
        return static_cast<double>(std::bit_cast<Number>(raw));
    }

    double operator[](std::size_t index) const {
        switch (type) {
        case 0: return element<double>(index);
        case 1: return element<float>(index);
        case 2: return element<std::int32_t>(index);
        case 3: return element<std::int16_t>(index);
        case 4: return element<std::uint16_t>(index);
        default: return element<std::uint8_t>(index);
        }
    }
    double at(std::size_t row, std::size_t column) const { return (*this)[column * rows + row]; }
    std::size_t size() const { return rows * columns; }
};

constexpr std::size_t type_sizes[] = {8, 4, 4, 2, 2, 1};

// Takes the next matrix off the front; nothing where the bytes are none.
std::optional<Matrix> next_matrix(std::string_view& rest, bool big_endian) {
    if (rest.size() < matrix_header_size) return std::nullopt;
    Matrix header;
    header.big_endian = big_endian;
    header.data = rest.substr(0, matrix_header_size);
    std::array<std::int32_t, 5> words;
    for (std::size_t i = 0; i < words.size(); ++i)
        words[i] = static_cast<std::int32_t>(header.element<std::int32_t>(i));
    const auto [mopt, rows, columns, imaginary, length] = words;
    if (mopt < 0 || mopt / 1000 != (big_endian ? 1 : 0) || mopt / 100 % 10 != 0) return std::nullopt;
    Matrix matrix;
    matrix.big_endian = big_endian;
    matrix.type = static_cast<unsigned>(mopt / 10 % 10);
    if (matrix.type > 5 || mopt % 10 > 2 || rows < 0 || columns < 0 || imaginary < 0 || imaginary > 1 || length < 2) {
        return std::nullopt;
    }
    matrix.kind = static_cast<Matrix::Kind>(mopt % 10);
    matrix.rows = static_cast<std::size_t>(rows);
    matrix.columns = static_cast<std::size_t>(columns);
    matrix.is_complex = imaginary != 0;
    std::string_view behind = rest.substr(matrix_header_size);
    const auto name_size = static_cast<std::size_t>(length);
    if (name_size > behind.size() || behind[name_size - 1] != '\0') return std::nullopt;
    matrix.name = behind.substr(0, name_size - 1);
    matrix.name = matrix.name.substr(0, matrix.name.find('\0'));
    behind.remove_prefix(name_size);
    // Both below 2^31, so that the product fits.
    const std::size_t count = matrix.size() * (matrix.is_complex ? 2 : 1), size = type_sizes[matrix.type];
    if (matrix.name.empty() || count > behind.size() / size) return std::nullopt;
    matrix.data = behind.substr(0, count * size);
    rest = behind.substr(count * size);
    return matrix;
}

std::optional<bool> byte_order(std::string_view bytes) {
    for (const bool big_endian : {false, true}) {
        std::string_view rest = bytes;
        if (next_matrix(rest, big_endian)) return big_endian;
    }
    return std::nullopt;
}

[[noreturn]] void fail_damaged(const std::string& source) {
    throw InputError(fmt::format("{}: is a MAT file that is damaged or cut short", source));
}

Variable plain_variable(const Matrix& matrix) {
    Variable variable{std::string(matrix.name), "", {}, ""};
    if (matrix.kind == Matrix::Kind::text) {
        variable.refusal = "is a text, must be a vector of numbers";
    } else if (matrix.kind == Matrix::Kind::sparse) {
        variable.refusal = "is a sparse matrix, must be a vector";
    } else if (matrix.is_complex) {
        variable.refusal = "is complex, must be real";
    } else if (matrix.rows != 1 && matrix.columns != 1) {
        variable.refusal = fmt::format("is a matrix ({} x {}), must be a vector", matrix.rows, matrix.columns);
    } else {
        for (std::size_t i = 0; i < matrix.size(); ++i) variable.values.push_back(matrix[i]);
    }
    return variable;
}

// ---- trajectories of Dymola and OpenModelica ---------------------------------------------------------------------

// The rows or columns of a matrix, whichever are the entries of this layout.
struct Entries {
    const Matrix& matrix;
    bool transposed;

    std::size_t count() const { return transposed ? matrix.columns : matrix.rows; }
    std::size_t width() const { return transposed ? matrix.rows : matrix.columns; }
    double at(std::size_t entry, std::size_t place) const {
        return transposed ? matrix.at(place, entry) : matrix.at(entry, place);
    }
    std::string text(std::size_t entry) const {
        std::string text;
        for (std::size_t place = 0; place < width(); ++place) {
            text += static_cast<char>(static_cast<unsigned char>(at(entry, place)));
        }
        text.resize(std::min(text.find('\0'), text.size()));
        return std::string(trim(text));
    }
};

// "Angle of the shaft [rad|deg]": rad.
std::string unit_in(std::string_view description) {
    if (!description.ends_with(']')) return "";
    const auto begin = description.rfind('[');
    if (begin == std::string_view::npos) return "";
    const std::string_view inside = description.substr(begin + 1, description.size() - begin - 2);
    return std::string(trim(inside.substr(0, inside.find('|'))));
}

class Trajectory {
  public:
    Trajectory(const std::vector<Matrix>& matrices, const std::string& source) : matrices_(matrices), source_(source) {
        const Matrix& about = matrix("Aclass");
        for (std::size_t row = 0; row < about.rows; ++row) {
            if (Entries{about, false}.text(row) == "binTrans") transposed_ = true;
        }
    }

    std::vector<Variable> variables(const std::vector<std::string>& asked, std::size_t most) const {
        const Entries names{matrix("name"), transposed_}, info{matrix("dataInfo"), transposed_};
        const Matrix* descriptions = find("description");
        if (info.count() != names.count() || info.width() < 2) fail_damaged(source_);
        std::vector<Variable> variables;
        std::size_t used = 0;
        for (std::size_t i = 0; i < names.count(); ++i) {
            Variable variable{names.text(i), "", {}, ""};
            if (descriptions && Entries{*descriptions, transposed_}.count() == names.count()) {
                variable.unit = unit_in(Entries{*descriptions, transposed_}.text(i));
            }
            const bool is_asked = std::find(asked.begin(), asked.end(), variable.name) != asked.end();
            const bool is_constant = info.at(i, 0) == 1;
            if (!asked.empty() && !is_asked) {
                variable.refusal = "is not among those asked for";
            } else if (is_constant && !is_asked) {
                variable.refusal = "is constant; it is read where it is asked for by its name";
            } else {
                used += rows() * sizeof(double);
                if (used > most) {
                    throw InputError(
                        fmt::format("{}: all variables together take more than {} MiB; name those that are "
                                    "wanted by --columns",
                                    source_, most >> 20));
                }
                variable.values = values(info.at(i, 0), info.at(i, 1));
            }
            variables.push_back(std::move(variable));
        }
        return variables;
    }

  private:
    const Matrix* find(std::string_view name) const {
        const auto it =
            std::find_if(matrices_.begin(), matrices_.end(), [&](const Matrix& m) { return m.name == name; });
        return it == matrices_.end() || it->is_complex || it->kind == Matrix::Kind::sparse ? nullptr : &*it;
    }
    const Matrix& matrix(std::string_view name) const {
        if (const Matrix* found = find(name)) return *found;
        throw InputError(fmt::format("{}: is a result of Dymola or OpenModelica without the matrix {}", source_, name));
    }
    std::size_t rows() const { return Entries{matrix("data_2"), transposed_}.count(); }

    // Table 0 is the time of the others. A column is counted from 1; below zero it is taken with the other sign.
    std::vector<double> values(double table, double column) const {
        const bool is_constant = table == 1;
        const Entries data{matrix(is_constant ? "data_1" : "data_2"), transposed_};
        const double place = std::abs(column);
        if (!(table == 0 || table == 1 || table == 2) || !(place >= 1) || place > static_cast<double>(data.width()) ||
            place != std::floor(place) || (is_constant && data.count() == 0)) {
            fail_damaged(source_);
        }
        std::vector<double> list(rows());
        for (std::size_t row = 0; row < list.size(); ++row) {
            const double value = data.at(is_constant ? 0 : row, static_cast<std::size_t>(place) - 1);
            list[row] = column < 0 ? -value : value;
        }
        return list;
    }

    const std::vector<Matrix>& matrices_;
    const std::string& source_;
    bool transposed_ = false;
};

// ---- writing -----------------------------------------------------------------------------------------------------

template <class Number>
void append_number(std::string& bytes, Number number) {
    auto raw = std::bit_cast<std::array<char, sizeof(Number)>>(number);
    if (std::endian::native == std::endian::big) std::reverse(raw.begin(), raw.end());
    bytes.append(raw.data(), raw.size());
}

constexpr int double_type = 0, int_type = 20, text_type = 51; // as the header counts them, low byte first

void append_header(std::string& bytes, std::string_view name, int type, std::size_t rows, std::size_t columns) {
    constexpr std::size_t most = std::numeric_limits<std::int32_t>::max();
    if (rows > most || columns > most) {
        throw InputError(fmt::format("the table has {} rows, a result of Dymola can hold {} at most", columns, most));
    }
    for (const std::size_t word : {std::size_t(type), rows, columns, std::size_t{0}, name.size() + 1}) {
        append_number(bytes, static_cast<std::int32_t>(word));
    }
    bytes += name;
    bytes += '\0';
}

// One text a column.
void append_texts(std::string& bytes, std::string_view name, const std::vector<std::string>& texts) {
    std::size_t width = 1;
    for (const auto& text : texts) width = std::max(width, text.size());
    append_header(bytes, name, text_type, width, texts.size());
    for (const auto& text : texts) bytes += text + std::string(width - text.size(), ' ');
}

} // namespace

std::string to_trajectory(const Table& table) {
    if (table.rows() == 0) throw InputError("there are no rows, a result of Dymola must have one at least");
    const std::vector<double>& time = table.columns.front().values;
    for (std::size_t k = 0; k < time.size(); ++k) {
        if (std::isfinite(time[k]) && (k == 0 || time[k] >= time[k - 1])) continue;
        throw InputError(fmt::format("column {} is the time of a result of Dymola and must not decrease; row {} is {}",
                                     table.columns.front().name, k + 1, to_text(time[k])));
    }
    std::vector<std::string> names, descriptions;
    for (const Column& column : table.columns) {
        names.push_back(names.empty() ? "Time" : column.name);
        descriptions.push_back(column.unit.empty() ? "" : "[" + column.unit + "]");
    }
    std::string bytes;
    // Four rows of eleven characters, column by column.
    constexpr std::string_view about[] = {"Atrajectory", "1.1        ", "           ", "binTrans   "};
    append_header(bytes, "Aclass", text_type, std::size(about), about[0].size());
    for (std::size_t place = 0; place < about[0].size(); ++place) {
        for (const auto row : about) bytes += row[place];
    }
    append_texts(bytes, "name", names);
    append_texts(bytes, "description", descriptions);
    // Of each variable: its table (0: the time of all), its column there, linear between the rows, not defined beyond them.
    append_header(bytes, "dataInfo", int_type, 4, names.size());
    for (std::int32_t i = 0; i < static_cast<std::int32_t>(names.size()); ++i) {
        for (const std::int32_t entry : {i == 0 ? 0 : 2, i + 1, 0, -1}) append_number(bytes, entry);
    }
    // What is constant would stand in data_1: only the time, first and last.
    append_header(bytes, "data_1", double_type, 1, 2);
    append_number(bytes, time.front());
    append_number(bytes, time.back());
    append_header(bytes, "data_2", double_type, names.size(), time.size());
    for (std::size_t k = 0; k < time.size(); ++k) {
        for (const Column& column : table.columns) append_number(bytes, column.values[k]);
    }
    return bytes;
}

bool is_mat4(std::string_view bytes) { return byte_order(bytes).has_value(); }

std::vector<Variable> mat4_variables(std::string_view bytes, const std::vector<std::string>& asked, std::size_t most,
                                     const std::string& source) {
    const auto big_endian = byte_order(bytes);
    if (!big_endian) fail_damaged(source);
    std::vector<Matrix> matrices;
    std::map<std::string_view, std::size_t> last; // of each name
    for (std::string_view rest = bytes; !rest.empty();) {
        const auto matrix = next_matrix(rest, *big_endian);
        if (!matrix) fail_damaged(source);
        last[matrix->name] = matrices.size();
        matrices.push_back(*matrix);
    }
    if (matrices.front().name == "Aclass") return Trajectory(matrices, source).variables(asked, most);
    std::vector<Variable> variables;
    for (std::size_t i = 0; i < matrices.size(); ++i) {
        if (last[matrices[i].name] == i) variables.push_back(plain_variable(matrices[i]));
    }
    return variables;
}

} // namespace tribode
