-- tb.options: without -D each option has its default, of the default's type.
local tb = require "tribode"

local option = tb.options {
  amplitude = 15,
  count = { default = 40, help = "how many" },
  name = "table",
  loud = false,
  list = { default = { 1, 2.5, 3 }, unit = "Hz" },
  way = { default = "up", choices = { "up", "down" } },
}

assert(option.amplitude == 15 and math.type(option.amplitude) == "integer")
assert(option.count == 40)
assert(option.name == "table")
assert(option.loud == false)
assert(#option.list == 3 and option.list[2] == 2.5)
assert(option.way == "up")
assert(option.other == nil)

local ok, text = pcall(tb.options, { way = { default = "up", choises = { "up" } } })
assert(not ok and text:find("choises", 1, true) and text:find("did you mean \"choices\"?", 1, true), text)

assert(type(tb.version) == "string" and tb.version:match("^%d+%.%d+%.%d+$"), tb.version)
assert(tb.quick == false)
