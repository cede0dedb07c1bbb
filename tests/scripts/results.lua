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

-- Packed where the name says so; the same doubles come back.
tb.write_csv { file = "deep/table.csv.gz", columns = columns }
assert(read("deep/table.csv.gz"):sub(1, 2) == "\31\139")
local back = tb.read_record { file = "deep/table.csv.gz" }.data
for _, column in ipairs(columns) do
  for i, value in ipairs(column.values) do assert(back[column.name][i] == value) end
end
assert(table.concat(tb.list_folder { folder = "out/deep" }, " ") == "table.csv table.csv.gz")

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

tb.write_text { file = "words.csv", text = "name,value\nmüde,1\n" }
assert(read("words.csv") == "name,value\nmüde,1\n")

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
refused("missing: cannot be listed", tb.list_folder, { folder = "out/missing" })
refused("outside the run folder", tb.list_folder, { folder = "/etc" })
refused("plain data", tb.write_json, { file = "a.json", value = print })
assert(not io.open("out/uneven.csv") and not io.open("out/a.json"))

-- Records: what is written reads back, by the names of the user and in SI.
local two = { { name = "t_ms", unit = "ms", values = { 0, 0.5, 1, 2 } }, { name = "u_V", values = { 1, 2, 3, 4 } } }
tb.write_mat { file = "record.mat", columns = two }
tb.write_mat { file = "record73.mat", columns = two, version = "7.3" }
tb.write_csv { file = "record.csv", columns = two }
tb.write_hdf5 { file = "record.h5", tables = { { name = "run", columns = two } } }
for _, file in ipairs { "record.mat", "out/record73.mat", "out/record.csv", "out/record.h5" } do
  local record = tb.read_record { file = file, columns = { t = "t_ms", u = "u_V" }, scale = { t = 1e-3, u = 35.15 } }
  assert(record.data.u[4] == 4 * 35.15 and record.data.t[2] == 0.5e-3)
  assert(record.time.dropped == 1 and #record.time.gaps == 1)
  assert(record.time.gaps[1].row == 4 and record.time.gaps[1].missing == 1)
  assert(math.abs(record.time.sample_time_s - 0.5e-3) < 1e-15)
  record = tb.read_record { file = file }
  assert(record.data.t_ms[4] == 2 and not record.time)
end
assert(tb.read_record { file = "out/record.h5" }.units.t_ms == "ms")
tb.write_mat { file = "dymola.mat", columns = two, version = "dymola" }
local result = tb.read_record { file = "out/dymola.mat" }
assert(result.units.Time == "ms" and result.data.Time[2] == 0.5 and result.data.u_V[4] == 4)
refused("must not decrease; row 2 is 0.5", tb.write_mat,
  { file = "x.mat", columns = { { name = "t", values = { 1, 0.5 } } }, version = "dymola" })
refused("did you mean \"u_V\"?", tb.read_record, { file = "out/record.mat", columns = { u = "u_N" } })
refused("columns.u must be a text", tb.read_record, { file = "out/record.mat", columns = { u = 1 } })
refused("version = \"4\", must be one of 5, 7.3", tb.write_mat, { file = "x.mat", columns = two, version = "4" })
refused("is not a name that a MAT file can hold", tb.write_mat,
  { file = "x.mat", columns = { { name = "u V", values = { 1 } } } })
refused("outside", tb.read_record, { file = "/etc/hostname" })

-- A run takes its input from a record as from lists.
local even = { { name = "t_ms", values = { 0, 0.5, 1, 1.5 } }, { name = "u_V", values = { 1, 2, 3, 4 } } }
tb.write_mat { file = "even.mat", columns = even }
local mass = { rigid_gain_per_kg = 0.1 }
local from_file = tb.simulate {
  machine = mass, input = "out/even.mat", columns = { t = "t_ms", u = "u_V" }, scale = { t = 1e-3, u = 2 },
}
local from_lists = tb.simulate { machine = mass, u = { 2, 4, 6, 8 } }
for k, x in ipairs(from_lists.x) do assert(from_file.x[k] == x) end
refused("gap in time", tb.simulate,
  { machine = mass, input = "out/record.mat", columns = { t = "t_ms", u = "u_V" }, scale = { t = 1e-3 } })
refused("u is not a known field", tb.simulate, { machine = mass, input = "out/even.mat", u = { 1 },
  columns = { t = "t_ms", u = "u_V" }, scale = { t = 1e-3 } })
assert(not io.open("out/x.mat"))
