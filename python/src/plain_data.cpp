#include "plain_data.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <fmt/format.h>
#include <nanobind/stl/string.h>

namespace tribode::python {

namespace {

constexpr int max_depth = 64; // a list may contain itself

std::string type_of(nb::handle value) { return nb::cast<std::string>(nb::handle(value.type()).attr("__name__")); }

// The text of a str. Lone surrogates, which UTF-8 has no place for, are refused.
std::string text_of(nb::handle value, const std::string& name) {
    Py_ssize_t size = 0;
    const char* text = PyUnicode_AsUTF8AndSize(value.ptr(), &size);
    if (text) return {text, static_cast<std::size_t>(size)};
    PyErr_Clear();
    throw InputError(fmt::format("{} is a text that cannot be written as UTF-8", name));
}

Json to_json(nb::handle value, const std::string& name, int depth) {
    if (depth > max_depth) throw InputError(fmt::format("{} has more than {} levels", name, max_depth));
    if (value.is_none()) return nullptr;
    if (PyBool_Check(value.ptr())) return value.ptr() == Py_True;
    if (PyLong_Check(value.ptr())) {
        int overflow = 0;
        const long long whole = PyLong_AsLongLongAndOverflow(value.ptr(), &overflow);
        if (overflow) throw InputError(fmt::format("{} is a whole number beyond 64 bits", name));
        return static_cast<std::int64_t>(whole);
    }
    if (PyFloat_Check(value.ptr())) return PyFloat_AsDouble(value.ptr());
    if (PyUnicode_Check(value.ptr())) return text_of(value, name);
    if (PyList_Check(value.ptr()) || PyTuple_Check(value.ptr())) {
        Json list = Json::array();
        for (const nb::handle entry : nb::borrow<nb::sequence>(value)) {
            list.push_back(to_json(entry, fmt::format("{}[{}]", name, list.size() + 1), depth + 1));
        }
        return list;
    }
    if (PyDict_Check(value.ptr())) {
        Json table = Json::object();
        for (const auto [key, entry] : nb::borrow<nb::dict>(value)) {
            if (!PyUnicode_Check(key.ptr())) {
                throw InputError(fmt::format("{} has a key that is a {}, must be a str", name, type_of(key)));
            }
            const std::string text = text_of(key, name);
            table[text] = to_json(entry, name + "." + text, depth + 1);
        }
        return table;
    }
    for (const char* method : {"tolist", "__fspath__"}) {
        if (nb::hasattr(value, method)) return to_json(value.attr(method)(), name, depth + 1);
    }
    throw InputError(
        fmt::format("{} is a {}, must be plain data: a number, text, list, dict or array", name, type_of(value)));
}

// The list as an array, where all its entries are numbers; else null.
nb::object array_of(const Json& list) {
    const auto all = [&](auto kind) { return std::all_of(list.begin(), list.end(), kind); };
    if (list.empty()) return {};
    if (all([](const Json& x) { return x.is_number_integer(); }))
        return nb::cast(to_array(list.get<std::vector<std::int64_t>>()));
    if (all([](const Json& x) { return x.is_number(); })) return nb::cast(to_array(list.get<std::vector<double>>()));
    return {};
}

} // namespace

Json to_json(nb::handle value, const std::string& name) { return to_json(value, name, 0); }

nb::object to_python(const Json& json, Lists lists) {
    switch (json.type()) {
    case Json::value_t::boolean: return nb::bool_(json.get<bool>());
    case Json::value_t::number_integer: return nb::int_(json.get<std::int64_t>());
    case Json::value_t::number_unsigned: return nb::int_(json.get<std::uint64_t>());
    case Json::value_t::number_float: return nb::float_(json.get<double>());
    case Json::value_t::string: return nb::cast(json.get<std::string>());
    case Json::value_t::array: {
        if (lists == Lists::arrays) {
            if (nb::object array = array_of(json)) return array;
        }
        nb::list list;
        for (const auto& entry : json) list.append(to_python(entry, lists));
        return list;
    }
    case Json::value_t::object: {
        nb::dict table;
        for (const auto& [key, entry] : json.items()) table[nb::cast(key)] = to_python(entry, lists);
        return table;
    }
    default: return nb::none();
    }
}

std::vector<double> finite_numbers(const Signal& signal, const char* where, const char* name) {
    std::vector<double> numbers(signal.data(), signal.data() + signal.shape(0));
    const auto bad = std::find_if(numbers.begin(), numbers.end(), [](double x) { return !std::isfinite(x); });
    if (bad == numbers.end()) return numbers;
    throw InputError(fmt::format("{}: {}[{}] = {}, must be finite", where, name, bad - numbers.begin(), to_text(*bad)));
}

Table to_table(nb::handle columns, const std::string& where) {
    Table table;
    for (const auto [key, value] : nb::cast<nb::dict>(columns)) {
        const std::string name = text_of(key, where);
        const auto signal = nb::cast<Signal>(value);
        table.add(name, "", {signal.data(), signal.data() + signal.shape(0)});
    }
    table.source = where;
    return table;
}

bool is_path(nb::handle value) { return PyUnicode_Check(value.ptr()) || nb::hasattr(value, "__fspath__"); }

std::string to_path(nb::handle value) {
    const nb::object path = nb::steal(PyOS_FSPath(value.ptr()));
    if (!path.is_valid()) throw nb::python_error();
    if (!PyUnicode_Check(path.ptr())) throw InputError("a path must be a str, not bytes");
    std::string text = text_of(path, "the path");
    if (text.find('\0') != std::string::npos) throw InputError("a path must not contain a zero byte");
    return text;
}

} // namespace tribode::python
