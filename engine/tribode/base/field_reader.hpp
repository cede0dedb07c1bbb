#pragma once
#include "tribode/base/about.hpp"
#include "tribode/base/json.hpp"

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tribode {

// What a number may be.
enum class Allowed { finite, positive, non_negative, fraction }; // fraction: 0 < x < 1
bool is_allowed(double x, Allowed allowed);
const char* requirement(Allowed allowed); // as error messages say it: "must be finite"

// "erk, bdf (also cvode), ida", for messages and help.
std::string name_list(const std::vector<std::string>& names, Alias alias = {});

// Reads a table of named fields (a machine description, an options table) and refuses what it does not know.
//
//     FieldReader options(json, "sweep");
//     settings.amplitude = options.number("amplitude", "N", Allowed::positive, settings.amplitude);
//     options.finish();            // throws on any key that nobody asked for, with the nearest known one
//
// All functions throw InputError with the full path of the field, e.g.
// `models/table.lua: friction.elements[3].K = -2.1e5 N/m, must be positive and finite`. Indices count from 1.
// A field that is null is absent. Notes (comment, units, conventions, records, equations) are allowed anywhere.
class FieldReader {
  public:
    // `where`: the file or function, `path`: the field path so far ("" at the top). `fields` is not copied.
    FieldReader(const Json& fields, std::string where, std::string path = "");

    bool has(std::string_view key) const;

    // Whether the key names a note.
    static bool is_note(std::string_view key);

    double number(std::string_view key, std::string_view unit, Allowed allowed);                  // required
    double number(std::string_view key, std::string_view unit, Allowed allowed, double fallback); // optional
    std::optional<double> optional_number(std::string_view key, std::string_view unit, Allowed allowed);
    long integer(std::string_view key, long least, long most, long fallback);
    std::vector<long> integers(std::string_view key, long least, long most, std::vector<long> fallback);
    bool boolean(std::string_view key, bool fallback);
    std::string text(std::string_view key);
    std::string text(std::string_view key, std::string_view fallback);
    // One of the names; the error lists them.
    std::string choice(std::string_view key, const std::vector<std::string>& names, std::string_view fallback,
                       Alias alias = {});
    std::vector<double> numbers(std::string_view key, std::string_view unit, Allowed allowed,
                                std::vector<double> fallback);
    std::vector<std::string> texts(std::string_view key, std::vector<std::string> fallback);

    // A table inside; absent or null: an empty one, unless required.
    FieldReader table(std::string_view key, bool required = false);
    // Calls `read` for each entry of a list of tables; an absent list has none.
    void each(std::string_view key, const std::function<void(FieldReader&)>& read);
    // Any value, unread: null where absent.
    const Json& value(std::string_view key);

    // Throws on keys that nobody asked for.
    void finish() const;

    // The path of a field, as in messages.
    std::string path_of(std::string_view key) const;
    // The beginning of a message about one field: `where: path.key`.
    std::string name_of(std::string_view key) const;
    [[noreturn]] void fail(std::string_view key, std::string_view problem) const;

  private:
    const Json* find(std::string_view key);

    const Json* fields_;
    std::string where_, path_;
    std::vector<std::string> known_;
};

} // namespace tribode
