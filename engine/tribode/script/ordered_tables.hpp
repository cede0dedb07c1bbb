#pragma once

struct lua_State;

namespace tribode {

// Puts `pairs` and `next` into the globals that go through a table in an order that depends on its keys alone: 1, 2, 3 ...,
// other numbers ascending, false and true, texts byte by byte. Lua's own order of texts differs from process to process, and
// with it sums and files. Tables, functions and userdata as keys come last, in the order of Lua.
// And a `table.sort` that leaves equal elements in their order: Lua's own may choose where it divides a long list by the
// clock, and with that where equal elements come to stand. [-0, +0]
void order_tables(lua_State* lua);

} // namespace tribode
