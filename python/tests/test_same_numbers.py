"""The same run gives the same numbers, to the last bit, from Python, from Lua and from the command line."""

import json

import numpy as np
import pytest

import tribode


def write_csv(path, **columns):
    rows = zip(*columns.values())
    text = ",".join(columns) + "\n" + "".join(",".join(repr(float(x)) for x in row) + "\n" for row in rows)
    path.write_text(text)


def same(a, b):
    """Equal doubles, a NaN like a NaN; the arrays must have the same length."""
    return np.asarray(a).shape == np.asarray(b).shape and np.array_equal(
        np.asarray(a, float), np.asarray(b, float), equal_nan=True
    )


@pytest.mark.parametrize("solver", ["exact", "erk", "fixed"])
def test_simulate_closed_loop(program, table, reference, tmp_path, solver):
    machine = table.with_(noise_rms_m=1e-8)
    (tmp_path / "machine.json").write_text(json.dumps(machine.to_dict()))
    excitation = 3.0 * np.cos(0.1 * np.arange(len(reference)))
    t = np.arange(len(reference)) * machine.Ts
    write_csv(tmp_path / "in.csv", t=t, r=reference, exc=excitation)
    program(
        "simulate",
        "--machine",
        tmp_path / "machine.json",
        "--input",
        tmp_path / "in.csv",
        "-o",
        tmp_path / "out.csv",
        "--events",
        tmp_path / "events.csv",
        "--solver",
        solver,
        "--seed",
        7,
        "--quiet",
    )
    options = {"fixed_step_s": machine.Ts / 10} if solver == "fixed" else {}
    run = tribode.simulate(machine, r=reference, exc=excitation, solver=solver, seed=7, **options)
    written = tribode.read_record(tmp_path / "out.csv")
    for name in "truyxvf":
        assert same(getattr(run, name), written[name]), name
    lines = (tmp_path / "events.csv").read_text().splitlines()[1:]
    assert len(lines) == len(run.events) > 0
    for line, event in zip(lines, run.events):
        instant, element, kind = line.split(",")
        assert (float(instant), int(element), kind) == (event["t"], event["element"], event["kind"])


SCRIPT = """
local tb = require "tribode"
local option = tb.options { machine = { default = "" }, data = { default = "" } }
local machine = tb.machine(option.machine)
local input = tb.read_record { file = option.data }.data
local run = tb.simulate { machine = machine, r = input.r, exc = input.exc, seed = 7 }
local columns = {}
for i, name in ipairs { "t", "r", "u", "y", "x", "v", "f" } do columns[i] = { name = name, values = run[name] } end
tb.write_csv { file = "out.csv", columns = columns }
"""


def test_the_same_bytes_from_command_line_lua_and_python(program, table, reference, tmp_path):
    machine = table.with_(noise_rms_m=1e-8)
    (tmp_path / "machine.json").write_text(json.dumps(machine.to_dict()))
    (tmp_path / "script.lua").write_text(SCRIPT)
    excitation = 3.0 * np.cos(0.1 * np.arange(len(reference)))
    write_csv(tmp_path / "in.csv", t=np.arange(len(reference)) * machine.Ts, r=reference, exc=excitation)
    files = ["--machine", tmp_path / "machine.json"]
    program("simulate", *files, "--input", tmp_path / "in.csv", "-o", tmp_path / "out.csv", "--seed", 7, "--quiet")
    program("run", tmp_path / "script.lua", *files, "--data", tmp_path / "in.csv", "-o", tmp_path / "run", "--quiet")
    assert (tmp_path / "out.csv").read_bytes() == (tmp_path / "run/out.csv").read_bytes()
    run = tribode.simulate(machine, r=reference, exc=excitation, seed=7)
    written = tribode.read_record(tmp_path / "out.csv")
    for name in "truyxvf":
        assert getattr(run, name).tobytes() == written[name].tobytes(), name


def test_simulate_open_loop(program, open_axis, tmp_path):
    u = 5.0 * np.sin(2 * np.pi * 3 * np.arange(1500) * open_axis.Ts)
    (tmp_path / "machine.json").write_text(json.dumps(open_axis.to_dict()))
    write_csv(tmp_path / "in.csv", t=np.arange(1500) * open_axis.Ts, u=u)
    program(
        "simulate",
        "--machine",
        tmp_path / "machine.json",
        "--input",
        tmp_path / "in.csv",
        "-o",
        tmp_path / "out.csv",
        "--quiet",
    )
    run = tribode.simulate(open_axis, u)
    written = tribode.read_record(tmp_path / "out.csv")
    for name in "tuyxvf":
        assert same(getattr(run, name), written[name]), name
    assert np.ptp(run.x) > 1e-3


SWEEP = """
local tb = require "tribode"
local machine = tb.machine "models/linear_motor_table.lua"
local sweep = tb.sweep { machine = machine, frequency_hz = { 20, 33, 50, 90, 120 }, amplitude_N = 12, improved = true }
tb.write_json { file = "out.json", value = {
  responses = sweep.responses, loop_gain = sweep.loop_gain, columns = sweep.columns,
  fit = tb.fit_modal { response = sweep.responses.Proposed, modes = 1, f_max_hz = 130 } } }
"""


def test_sweep_and_fit(program, table, tmp_path):
    (tmp_path / "sweep.lua").write_text(SWEEP)
    program("run", tmp_path / "sweep.lua", "-o", tmp_path / "out", "--quiet")
    lua = json.loads((tmp_path / "out/out.json").read_text())
    sweep = tribode.sweep(table, [20, 33, 50, 90, 120], amplitude_N=12.0, improved=True, workers=2)
    assert set(sweep.responses) == set(lua["responses"]) == {"FRA-1", "FRA-2", "Proposed", "Improved"}
    for name, response in [*sweep.responses.items(), ("loop_gain", sweep.loop_gain)]:
        expected = lua["loop_gain"] if name == "loop_gain" else lua["responses"][name]
        assert same(response.value.real, expected["real"]) and same(response.value.imag, expected["imag"]), name
        assert same(response.gain_db, expected["gain_db"]) and same(response.phase_deg, expected["phase_deg"]), name
    for column in lua["columns"]:
        assert same(sweep.table[column["name"]], [np.nan if x is None else x for x in column["values"]]), column["name"]
    fit = tribode.fit_modal(sweep.responses["Proposed"], modes=1, f_max_hz=130)
    assert fit == lua["fit"] and fit["f1_hz"] > 0


SYSTEM = """
local tb = require "tribode"
local system = dofile "models/systems/bouncing_ball.lua"
local run = tb.run_system { system = system, duration_s = 3, output_step_s = 0.01 }
tb.write_json { file = "out.json", value = { columns = run.columns, events = run.events, final = run.final } }
"""


def test_system(program, tmp_path):
    (tmp_path / "system.lua").write_text(SYSTEM)
    program("run", tmp_path / "system.lua", "-o", tmp_path / "out", "--quiet")
    lua = json.loads((tmp_path / "out/out.json").read_text())
    run = tribode.System.from_lua(tribode.models / "systems/bouncing_ball.lua").run(duration_s=3, output_step_s=0.01)
    assert [column["name"] for column in lua["columns"]] == list(run.keys())
    for column in lua["columns"]:
        assert same(run[column["name"]], column["values"]), column["name"]
        assert run.table.units[column["name"]] == column["unit"]
    assert [(event["t"], event["name"]) for event in lua["events"]] == [tuple(event) for event in run.events.tolist()]
    assert len(run.events) > 3 and run.final == lua["final"]


BATCH = """
local tb = require "tribode"
return tb.batch {
  points = tb.grid { factors = { { name = "a", values = { 1, 2, 3 } }, { name = "b", values = { 0.5, 0.25 } } } },
  run = function(point) return { sum = point.a + point.b, list = { point.a, point.b } } end,
}
"""


def test_read_batch(program, tmp_path):
    (tmp_path / "points.lua").write_text(BATCH)
    program("batch", "plan", tmp_path / "points.lua", "-o", tmp_path / "batch", "--quiet")
    program("batch", "run", tmp_path / "batch", "--quiet")
    batch = tribode.read_batch(tmp_path / "batch")
    assert batch["count"] == 6 and same(batch["index"], [1, 2, 3, 4, 5, 6])
    assert same(batch["results"]["sum"], batch["parameters"]["a"] + batch["parameters"]["b"])
    assert same(batch["parameters"]["a"], [1, 1, 2, 2, 3, 3])


def test_messages_are_those_of_the_program(program, table, tmp_path):
    """The sentence of an error is that of the command line, besides the name of the function."""
    description = table.to_dict()
    description["friction"]["elements"][1]["K"] = -1.0
    (tmp_path / "machine.json").write_text(json.dumps(description))
    import subprocess

    with pytest.raises(subprocess.CalledProcessError) as of_program:
        program("simulate", "--machine", tmp_path / "machine.json", "--input", "none.csv", "-o", tmp_path / "out.csv")
    with pytest.raises(tribode.InputError) as of_file:
        tribode.Machine(tmp_path / "machine.json")
    assert str(of_file.value) in of_program.value.stderr
    with pytest.raises(tribode.InputError) as of_dict:
        tribode.Machine(description)
    assert str(of_dict.value).split(": ", 1)[1] == str(of_file.value).split(": ", 1)[1]
