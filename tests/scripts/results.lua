-- tb.write_csv, tb.write_json, tb.write_hdf5 and tb.plot write into the run folder what was given.
local tb = require "tribode"

-- The test runs this script with the run folder `out`.
local function read(name)
  local file <close> = assert(io.open("out/" .. name, "rb"))
  return file:read("a")
end

local columns = {
  { name = "time_s", unit = "s", values = { 0, 0.1, 1 / 3 } },
  { name = "force_N", unit = "N", values = { -1e-300, 2, 1e22 } },
}
tb.write_csv { file = "deep/table.csv", columns = columns }
local text = read("deep/table.csv")
assert(text:match("^time_s,force_N\n"), text)
local row = 0
for left, right in text:gsub("^[^\n]*\n", ""):gmatch("([^,\n]+),([^,\n]+)\n") do
  row = row + 1
  -- The same doubles.
  assert(tonumber(left) == columns[1].values[row] and tonumber(right) == columns[2].values[row])
end
assert(row == 3)

tb.write_json { file = "value.json", value = { name = "axis", list = { 1, 2.5 }, inner = { deep = true } } }
text = read("value.json")
for _, part in ipairs { '"name": "axis"', "2.5", '"deep": true' } do assert(text:find(part, 1, true), text) end

tb.write_hdf5 {
  file = "tables.h5",
  tables = { { name = "first", columns = columns }, { name = "second", columns = columns } },
  attributes = { amplitude_N = 15, machine = "table" },
}
text = read("tables.h5")
assert(text:sub(1, 8) == "\137HDF\r\n\26\n", "not an HDF5 file")
for _, part in ipairs { "first", "second", "time_s", "force_N", "amplitude_N" } do assert(text:find(part, 1,
  true), part) end

tb.plot {
  file = "figure",
  title = "A line",
  panels = { { x_label = "x", y_label = "y", series = { { name = "line", x = { 0, 1, 2 }, y = { 0, 1, 4 } } } } },
}
assert(read("figure.png"):sub(1, 4) == "\137PNG")
assert(read("figure.svg"):find("A line", 1, true))

-- A second write under the same name takes the place of the first.
tb.write_json { file = "value.json", value = 7 }
assert(read("value.json") == "7\n")

local function refused(message, action, options)
  local ok, problem = pcall(action, options)
  assert(not ok and problem:find(message, 1, true), problem)
end
columns[2].values[4] = 0
refused("has 4 values, must have 3", tb.write_csv, { file = "uneven.csv", columns = columns })
refused("stands twice", tb.write_csv, { file = "twice.csv", columns = { columns[1], columns[1] } })
refused("file is missing", tb.write_json, { value = 1 })
refused("did you mean \"value\"?", tb.write_json, { file = "a.json", valeu = 1 })
refused("plain data", tb.write_json, { file = "a.json", value = print })
assert(not io.open("out/uneven.csv") and not io.open("out/a.json"))
