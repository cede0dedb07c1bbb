#include "tribode/script/called_functions.hpp"
#include "tribode/script/trampoline.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <fmt/format.h>
#include <fstream>
#include <lua.hpp>

namespace tribode {

namespace {

constexpr std::size_t most_numbers = 60; // that constants and tables add
constexpr int most_entries = 1000;       // of a table, that are looked at
constexpr std::size_t most_keys = 2;     // of a table

const char watched = 0; // its address is the place in the registry

bool compares(const std::string& line) {
    return line.find("==") != std::string::npos || line.find("~=") != std::string::npos;
}

bool is_digit(char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; }
bool is_letter(char c) { return std::isalnum(static_cast<unsigned char>(c)) || c == '_'; }

// Calls name(text, rest) and number(value, before, rest) for what stands in a line, with the character before, blanks aside, and
// the rest of the line; comments and texts are not told apart.
template <class Name, class Number>
void go_through(const std::string& line, const Name& name, const Number& number) {
    char before = ' ';
    for (std::size_t i = 0; i < line.size();) {
        const auto rest_from = [&](std::size_t place) { return std::string_view(line).substr(place); };
        const std::size_t begin = i++;
        if (is_digit(line[begin])) {
            char* end = nullptr;
            const double value = std::strtod(line.c_str() + begin, &end);
            i = static_cast<std::size_t>(end - line.c_str());
            number(value, before, rest_from(i));
        } else if (is_letter(line[begin])) {
            while (i < line.size() && is_letter(line[i])) ++i;
            name(std::string_view(line).substr(begin, i - begin), rest_from(i));
        }
        if (line[i - 1] != ' ') before = line[i - 1];
    }
}

// Whether what stands before the rest of a line is given a value, "= 3", after `close`, which need not be there.
bool is_assigned(std::string_view rest, std::string_view close) {
    const auto skip_blanks = [&] { rest.remove_prefix(std::min(rest.find_first_not_of(' '), rest.size())); };
    skip_blanks();
    if (rest.starts_with(close)) rest.remove_prefix(close.size());
    skip_blanks();
    return rest.starts_with('=') && !rest.starts_with("==");
}

// Puts a watcher into the place of another one, and counts what runs meanwhile as before; an error of Lua ends it too.
class Watch {
  public:
    Watch(lua_State* lua, lua_Hook on_event, void* watcher)
        : lua_(lua),
          on_event_(on_event),
          hook_(lua_gethook(lua)),
          mask_(lua_gethookmask(lua)),
          count_(lua_gethookcount(lua)),
          outer_(current(lua)) {
        set(watcher);
        lua_sethook(lua, on_event, mask_ | LUA_MASKCALL, count_);
    }
    ~Watch() {
        set(outer_);
        // Where the script is being ended, another hook has been set.
        if (lua_gethook(lua_) == on_event_) lua_sethook(lua_, hook_, mask_, count_);
    }
    Watch(const Watch&) = delete;
    Watch& operator=(const Watch&) = delete;

    static void* current(lua_State* lua) {
        lua_rawgetp(lua, LUA_REGISTRYINDEX, &watched);
        void* watcher = lua_touserdata(lua, -1);
        lua_pop(lua, 1);
        return watcher;
    }

  private:
    void set(void* watcher) const {
        lua_pushlightuserdata(lua_, watcher);
        lua_rawsetp(lua_, LUA_REGISTRYINDEX, &watched);
    }

    lua_State* lua_;
    lua_Hook on_event_, hook_;
    int mask_, count_;
    void* outer_;
};

} // namespace

void CalledFunctions::watch(const std::function<void()>& call) {
    known_.clear();
    functions_.clear();
    const Watch here(lua_, on_event, this);
    call();
}

void CalledFunctions::on_event(lua_State* lua, lua_Debug* event) {
    if (event->event == LUA_HOOKCOUNT) {
        // Also in a coroutine that has outlived the watch.
        charge_instructions(lua, static_cast<std::uint64_t>(lua_gethookcount(lua)));
    } else if (auto* functions = static_cast<CalledFunctions*>(Watch::current(lua))) {
        lua_getinfo(lua, "f", event);
        functions->add(lua);
        lua_pop(lua, 1);
    }
}

// The function on top of the stack. [-0, +0]
void CalledFunctions::add(lua_State* lua) {
    if (lua_iscfunction(lua, -1) || !known_.insert(lua_topointer(lua, -1)).second) return;
    lua_Debug info;
    lua_pushvalue(lua, -1);
    lua_getinfo(lua, ">S", &info);
    Function function{
        info.source[0] == '@' ? info.source + 1 : "", info.short_src, info.linedefined, info.lastlinedefined, {}, {}};
    const ScriptHost& host = host_of(lua);
    if (!host.access.allow_all && !host.loaded_files.contains(function.file)) function.file.clear();
    add_values(lua, function);
    functions_.push_back(std::move(function));
}

// What the function on top of the stack holds. [-0, +0]
void CalledFunctions::add_values(lua_State* lua, Function& function) const {
    if (!lua_checkstack(lua, 5)) return;
    const int place = lua_gettop(lua);
    for (int i = 1; lua_getupvalue(lua, place, i); ++i) {
        if (lua_type(lua, -1) == LUA_TNUMBER) function.values.push_back(lua_tonumber(lua, -1));
        if (lua_istable(lua, -1)) add_entries(lua, function);
        lua_pop(lua, 1);
    }
}

// Of the table on top of the stack. A lookup in one with the keys 0 or 1 shows there, as these are always tried. [-0, +0]
void CalledFunctions::add_entries(lua_State* lua, Function& function) const {
    const int table = lua_gettop(lua);
    std::size_t keys = 0;
    for (const lua_Integer key : {0, 1}) {
        if (lua_rawgeti(lua, table, key) != LUA_TNIL) keys = most_keys;
    }
    lua_settop(lua, table);
    lua_pushnil(lua);
    for (int entries = 0; entries < most_entries && lua_next(lua, table); ++entries) {
        if (lua_type(lua, -2) == LUA_TNUMBER) {
            if (keys++ < most_keys) function.keys.push_back(lua_tonumber(lua, -2));
        } else if (lua_type(lua, -1) == LUA_TNUMBER) {
            function.values.push_back(lua_tonumber(lua, -1));
        }
        lua_pop(lua, 1);
    }
    lua_settop(lua, table);
}

const CalledFunctions::File& CalledFunctions::file(const std::string& name) const {
    const auto [known, is_new] = files_.try_emplace(name);
    File& made = known->second;
    if (!is_new || name.empty()) return made;
    std::ifstream text(name);
    for (std::string line; std::getline(text, line); made.lines.push_back(line)) {
        if (line.find('=') == std::string::npos) continue;
        std::vector<std::string> names;
        std::set<double> numbers;
        go_through(
            line,
            [&](std::string_view word, std::string_view rest) {
                if (is_assigned(rest, "<const>")) names.emplace_back(word);
            },
            [&](double value, char before, std::string_view) { numbers.insert(before == '-' ? -value : value); });
        for (const auto& of : names) made.constants[of].insert(numbers.begin(), numbers.end());
    }
    return made;
}

std::span<const std::string> CalledFunctions::lines_of(const Function& function) const {
    const std::span all(file(function.file).lines);
    const std::size_t first = std::min(static_cast<std::size_t>(std::max(function.first_line - 1, 0)), all.size());
    const std::size_t last = std::clamp(static_cast<std::size_t>(std::max(function.last_line, 0)), first, all.size());
    return all.subspan(first, last - first);
}

bool CalledFunctions::compare_for_equality() const {
    return std::any_of(functions_.begin(), functions_.end(), [&](const Function& function) {
        const auto lines = lines_of(function);
        return std::any_of(lines.begin(), lines.end(), compares);
    });
}

std::vector<double> CalledFunctions::numbers() const {
    std::set<double> found = {0, 1}, others;
    const auto add = [&](double value) {
        found.insert(value);
        if (found.size() < 20) found.insert(-value);
    };
    for (const auto& function : functions_) {
        const auto lines = lines_of(function);
        bool compares_any = lines.empty(), looks_up = lines.empty();
        // A local constant is no value that the function holds: its line in the file tells it.
        const auto& constants = file(function.file).constants;
        for (const auto& line : lines) {
            const bool here = compares(line);
            compares_any = compares_any || here;
            looks_up = looks_up || line.find('[') != std::string::npos;
            go_through(
                line,
                [&](std::string_view name, std::string_view) {
                    if (!here) return;
                    const auto constant = constants.find(std::string(name));
                    if (constant != constants.end()) {
                        others.insert(constant->second.begin(), constant->second.end());
                    }
                },
                [&](double value, char before, std::string_view rest) {
                    if (here || (before == '[' && is_assigned(rest, "]"))) add(value);
                });
        }
        if (compares_any) others.insert(function.values.begin(), function.values.end());
        if (looks_up) others.insert(function.keys.begin(), function.keys.end());
    }
    std::erase_if(others, [&](double value) { return !std::isfinite(value) || found.contains(value); });
    std::vector<double> list(found.begin(), found.end());
    std::stable_partition(list.begin(), list.end(), [](double value) { return value >= 0; });
    for (const double value : others) {
        if (list.size() < found.size() + most_numbers) list.push_back(value);
    }
    return list;
}

std::optional<std::string> CalledFunctions::deciding_line() const {
    for (const auto& function : functions_) {
        const auto lines = lines_of(function);
        for (std::size_t i = 0; i < lines.size(); ++i) {
            const std::string padded = " " + lines[i] + " ";
            const auto has = [&](const char* text) { return padded.find(text) != std::string::npos; };
            const bool decides =
                compares(padded) || has(" if ") || has(" and ") || has(" or ") || has(" not ") || has(" while ");
            if (decides) return fmt::format("{}:{}: ", function.short_name, function.first_line + static_cast<int>(i));
        }
    }
    return std::nullopt;
}

} // namespace tribode
