#include "base/json.hpp"
#include "script/lua_state.hpp"
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

} // namespace
} // namespace tribode
