#pragma once

namespace tribode {

// From now on a machine may have forces written in Lua (effect own_force). Each run has a Lua state of its own for
// them, sandboxed as scripts are, without access to any file.
void enable_lua_forces();

} // namespace tribode
