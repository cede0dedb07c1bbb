#pragma once
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

struct lua_State;
struct lua_Debug;

namespace tribode {

// The functions of a script that run while an equation is recorded: what they may compare a variable with, by their text and by
// the values that they hold. Text is that of files from which the script was loaded; of other functions there is none.
class CalledFunctions {
  public:
    explicit CalledFunctions(lua_State* lua) : lua_(lua) {}
    CalledFunctions(const CalledFunctions&) = delete;
    CalledFunctions& operator=(const CalledFunctions&) = delete;

    // Those that `call` runs, in place of earlier ones.
    void watch(const std::function<void()>& call);

    // Whether one of them has == or ~=.
    bool compare_for_equality() const;

    // Zero, one, the numbers in lines with a comparison for equality, first as they stand there and then with the other sign, the
    // constants that are named there, and keys of tables.
    std::vector<double> numbers() const;

    // `script.lua:7: ` of the first line that decides something.
    std::optional<std::string> deciding_line() const;

  private:
    struct Function {
        std::string file, short_name;
        int first_line = 0, last_line = 0;
        std::vector<double> values, keys; // numbers that it holds by itself or in tables; some keys of these
    };

    struct File {
        std::vector<std::string> lines;
        std::map<std::string, std::set<double>> constants; // names that are given numbers, and all of these
    };

    static void on_event(lua_State* lua, lua_Debug* event);
    void add(lua_State* lua);
    void add_values(lua_State* lua, Function& function) const;
    void add_entries(lua_State* lua, Function& function) const;
    const File& file(const std::string& name) const;
    std::span<const std::string> lines_of(const Function& function) const;

    lua_State* lua_;
    std::set<const void*> known_;
    std::vector<Function> functions_; // as they were called first
    mutable std::map<std::string, File> files_;
};

} // namespace tribode
