#pragma once
#include "tribode/base/json.hpp"
#include "tribode/record/table.hpp"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <string>
#include <utility>
#include <vector>

namespace tribode::python {

namespace nb = nanobind;

using Signal = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// Plain data of Python: None, bool, int, float, str, paths, lists, tuples, dicts, and what has a method tolist() or item(), as
// NumPy's arrays and numbers do. Throws InputError, which names the value by `name`.
Json to_json(nb::handle value, const std::string& name);

// Lists of numbers as lists, or as NumPy arrays, where they are data rather than a description.
enum class Lists { lists, arrays };
nb::object to_python(const Json& json, Lists lists = Lists::lists);
inline nb::dict to_dict(const Json& table, Lists lists = Lists::lists) {
    return nb::cast<nb::dict>(to_python(table, lists));
}

template <class Number>
using Array = nb::ndarray<nb::numpy, Number, nb::ndim<1>>;

// An array that shows the numbers of `owner`, and keeps it alive.
template <class Number>
Array<Number> view(std::vector<Number>& numbers, nb::handle owner) {
    static Number none{};
    return Array<Number>(numbers.empty() ? &none : numbers.data(), {numbers.size()}, owner);
}

// An array that owns its numbers.
template <class Number>
Array<Number> to_array(std::vector<Number> numbers) {
    auto* kept = new std::vector<Number>(std::move(numbers));
    const nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<Number>*>(p); });
    return view(*kept, owner);
}

// The numbers of an array, all of which must be finite: the InputError says `where: name[3] = nan, must be finite`.
std::vector<double> finite_numbers(const Signal& signal, const char* where, const char* name);

// A mapping from names to arrays of equal length.
Table to_table(nb::handle columns, const std::string& where);

bool is_path(nb::handle value); // a str or what has __fspath__
std::string to_path(nb::handle value);

} // namespace tribode::python
