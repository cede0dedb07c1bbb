#include "tribode/base/json.hpp"
#include "tribode/script/lua_state.hpp"
#include "unit/script/messages.hpp"

#include <gtest/gtest.h>

namespace tribode {
namespace {

Json run(const std::string& program) { return LuaState({}, {}, {}).run_text(program, "t"); }

// Each program returns its keys, or what it made of them, as one text.
const std::string mixed =
    "local t = {10, 20, 30, beta = 1, alpha = 2, [''] = 3, [2.5] = 4, [-1] = 5, [0] = 6, [1000] = 7,\n"
    "  [true] = 8, [false] = 9, ['\\0'] = 1, ['\\255'] = 2}\n";

TEST(OrderedTables, PairsGoesByTheKeysAlone) {
    const std::string collect = "local s = {} for k in pairs(t) do s[#s + 1] = tostring(k) end\n"
                                "return (table.concat(s, ' '):gsub('%z', '\\\\0'):gsub('\\255', '\\\\255'))";
    const std::string expected = "1 2 3 1000 -1 0 2.5 false true  \\0 alpha beta \\255";
    EXPECT_EQ(run(mixed + collect), Json(expected));
    // The same keys, made in another order, by way of others.
    EXPECT_EQ(
        run("local t = {} for i = 1, 500 do t['k' .. i] = i end for i = 1, 500 do t['k' .. i] = nil end\n"
            "for _, k in ipairs {'\\255', true, 'beta', 2, 0, '', 2.5, -1, 3, 1000, '\\0', false, 1, 'alpha'} do\n"
            "  t[k] = 1 end\n" +
            collect),
        Json(expected));
    EXPECT_EQ(run("local t = {} " + collect), Json(""));
    EXPECT_EQ(run("local t = {'a', 'b', 'c'} " + collect), Json("1 2 3"));
}

TEST(OrderedTables, NextGoesTheSameWay) {
    EXPECT_EQ(run(mixed +
                  "local k\nfor q, v in pairs(t) do local w k, w = next(t, k) assert(k == q and w == v) end\n"
                  "assert(next(t, k) == nil) assert(next({}) == nil) local a, b = next {5} assert(a == 1 and b == 5)\n"
                  "assert(next {y = 1, x = 2} == 'x')\n"
                  "return 'same'"),
              Json("same"));
    // Two at a time, and a key that is gone.
    EXPECT_EQ(run("local t, s = {a = 1, b = 2, c = 3, d = 4}, ''\n"
                  "for k in next, t do s = s .. k for q in next, t do s = s .. q end end\n"
                  "t.b = nil\n"
                  "return s .. next(t, 'b') .. next(t, 'a')"),
              Json("aabcdbabcdcabcddabcdcc"));
}

TEST(OrderedTables, FieldsMayBeClearedAndSetOnTheWay) {
    EXPECT_EQ(
        run("local t, s = {}, '' for i = 1, 100 do t['k' .. i] = i end\n"
            "for k, v in pairs(t) do t[k] = nil s = s .. v .. ' ' if v == 10 then t.k100, t.k11 = nil, nil end end\n"
            "assert(next(t) == nil) return s:sub(1, 20)"),
        Json("1 10 12 13 14 15 16 "));
    EXPECT_EQ(run("local t = {a = 1, b = 2} for k, v in pairs(t) do t[k] = v * 10 end return t.a + t.b"), Json(30));
    EXPECT_EQ(run("local t, n = {}, 0 for i = 1, 100 do t['k' .. i] = i end\n"
                  "while next(t) do t[next(t)] = nil n = n + 1 end return n"),
              Json(100));
}

TEST(OrderedTables, KeepsWhatLuaPromises) {
    EXPECT_EQ(run("local t = setmetatable({}, {__pairs = function() return next, {x = 1} end})\n"
                  "for k in pairs(t) do return k end"),
              Json("x"));
    EXPECT_EQ(run("local t = setmetatable({a = 1}, {__index = function() return 5 end})\n"
                  "local n = 0 for _ in pairs(t) do n = n + 1 end return n"),
              Json(1));
    EXPECT_EQ(run("local keys, n = {}, 0 for i = 1, 3 do keys[{}] = i end\n"
                  "for k, v in pairs(keys) do assert(keys[k] == v) n = n + v end return n"),
              Json(6));
    EXPECT_NE(problem_of([] { run("pairs(nil)"); }).find("bad argument #1 to 'pairs' (table expected, got nil)"),
              std::string::npos);
    EXPECT_NE(problem_of([] { run("next()"); }).find("bad argument #1 to 'next' (table expected, got no value)"),
              std::string::npos);
    // With the whole library, too.
    ScriptAccess access;
    access.allow_all = true;
    EXPECT_EQ(
        LuaState({}, access, {}).run_text("local s = '' for k in pairs {b = 1, a = 2} do s = s .. k end return s", "t"),
        Json("ab"));
}

// Lua's own would divide such a list at places that the clock chooses, after a few bad ones.
TEST(OrderedTables, SortLeavesEqualElementsInTheirOrder) {
    const std::string check = "for i = 2, #t do local a, b = t[i - 1], t[i]\n"
                              "  assert(a.key < b.key or a.key == b.key and a.place < b.place, i) end\n";
    for (const char* key : {"0", "i % 3", "-i", "i", "(i * 7919) % 101", "i < 2500 and i or 5000 - i"}) {
        EXPECT_EQ(run(std::string("local t = {} for i = 1, 5000 do t[i] = { key = ") + key +
                      ", place = i } end\n"
                      "table.sort(t, function(a, b) return a.key < b.key end) assert(#t == 5000)\n" +
                      check + "return 'sorted'"),
                  Json("sorted"))
            << key;
    }
    EXPECT_EQ(run("local t = {3, 1, 2} table.sort(t) local s = {'b', 'a'} table.sort(s, nil)\n"
                  "table.sort({}) table.sort({1})\n"
                  "return table.concat(t) .. table.concat(s)"),
              Json("123ab"));
    EXPECT_EQ(run("local log = {}\n"
                  "local t = setmetatable({}, {__len = function() return 3 end,\n"
                  "  __index = function(_, i) return 10 - i end,\n"
                  "  __newindex = function(t, i, v) log[#log + 1] = i .. '=' .. v end})\n"
                  "table.sort(t) return table.concat(log, ' ')"),
              Json("1=7 2=8 3=9"));
}

TEST(OrderedTables, SortByWhatIsNoOrderEnds) {
    for (const char* order : {"true", "a ~= b", "a % 3 < 2", "next({}) == nil"}) {
        EXPECT_EQ(run(std::string("local t = {} for i = 1, 999 do t[i] = i end\n"
                                  "table.sort(t, function(a, b) return ") +
                      order + " end)\nlocal sum = 0 for _, v in ipairs(t) do sum = sum + v end return sum"),
                  Json(999 * 500));
    }
    EXPECT_NE(problem_of([] { run("table.sort({1, 'a', {}})"); }).find("attempt to compare"), std::string::npos);
    EXPECT_NE(problem_of([] { run("table.sort({3, 2}, function() error('why') end)"); }).find("t:1: why"),
              std::string::npos);
    EXPECT_EQ(run("local _, e = pcall(table.sort, {3, 2}, function() error({7}) end) return e[1]"), Json(7));
    EXPECT_EQ(problem_of([] { run("table.sort({}, 3)"); }),
              "input: t:1: bad argument #2 to 'sort' (function expected, got number)");
    EXPECT_NE(problem_of([] {
                  run("table.sort(setmetatable({}, {__len = function() return 1 << 40 end}))");
              }).find("array too big"),
              std::string::npos);
    ScriptLimits limits;
    limits.instructions = 1'000'000;
    EXPECT_NE(problem_of([&] {
                  LuaState(limits, {}, {})
                      .run_text("local t = {} for i = 1, 20000 do t[i] = -i end while true do table.sort(t) end", "t");
              }).find("more than 1000000 instructions"),
              std::string::npos);
}

} // namespace
} // namespace tribode
