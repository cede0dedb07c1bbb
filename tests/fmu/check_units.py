"""Functional mock-up units in other programs: exports machines and systems, validates them with FMPy, runs them there and in
Ecos, an importer in C++ on the library fmi4c, and compares the results with those of the program.

    check_units.py TRIBODE SOURCES        exit code 77: FMPy is not installed, nothing was checked
"""
import csv
import json
import math
import pathlib
import subprocess
import sys
import tempfile

try:
    import fmpy
    import numpy as np
    from fmpy.validation import validate_fmu
except ImportError:
    print("left out: FMPy is not installed (pip install fmpy)")
    sys.exit(77)
try:
    import ecospy
except (ImportError, OSError) as reason:  # its library needs libtbb12 of the system
    print(f"left out: no second importer (pip install ecospy): {reason}")
    ecospy = None

program, sources = sys.argv[1], pathlib.Path(sys.argv[2])
failures = 0


def check(what, good, found=""):
    global failures
    failures += not good
    print(f"{'ok  ' if good else 'FAIL'} {what} {found}")


def tribode(*arguments):
    done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError(done.stderr)


def table(path):
    with open(path) as file:
        rows = list(csv.reader(file))
    return {name: np.array([float(row[i]) for row in rows[1:]]) for i, name in enumerate(rows[0])}


def export(folder, model, fmi, kind="cs"):
    unit = folder / f"{model.stem}_{fmi}_{kind}.fmu"
    tribode("export-fmu", model, "--fmi", fmi, "--kind", kind, "-o", unit, "--quiet")
    problems = validate_fmu(str(unit))
    check(f"{unit.name} is valid", not problems, "; ".join(problems)[:300])
    return unit


def compare(what, found, own, tolerance):
    worst = max(float(np.max(np.abs(found[name] - own[name]))) for name in own)
    check(what, worst <= tolerance, f"differs by {worst:.3g}, allowed {tolerance:g}")


def compare_in_ecos(unit, own, step, tolerances, inputs=()):
    """Co-simulation with the communication step of the rows; inputs: (name, values), each set at the instant of its row."""
    if not ecospy:
        return
    structure = ecospy.EcosSimulationStructure()
    structure.add_model("unit", str(unit))
    simulation = ecospy.EcosSimulation(structure=structure, step_size=step)
    simulation.init()
    count = len(own["t"])
    found = {name: np.empty(count) for name in tolerances}
    for k in range(count):
        for name, values in found.items():
            values[k] = simulation.get_real(f"unit::{name}")
        for name, values in inputs:
            simulation.set_real(f"unit::{name}", float(values[k]))
        simulation.step()
    simulation.terminate()
    simulation.free()
    structure.free()
    for tolerance in sorted(set(tolerances.values())):
        names = [name for name in tolerances if tolerances[name] == tolerance]
        compare(f"{unit.name} in Ecos, {', '.join(names)}", found, {name: own[name] for name in names}, tolerance)


def machine(folder, model, closed):
    ts, count = 5e-4, 2000
    t = np.arange(count) * ts
    column, unit_size = ("r", 1e-3) if closed else ("u", 8.0)
    values = unit_size * np.sin(2 * math.pi * 4 * t)
    with open(folder / "input.csv", "w") as file:
        file.write(f"t,{column}\n" + "".join(f"{a!r},{b!r}\n" for a, b in zip(t.tolist(), values.tolist())))
    tribode("simulate", "--machine", model, "--input", folder / "input.csv", "-o", folder / "own.csv", "--quiet")
    own = table(folder / "own.csv")
    # Held values, given half a sample early, so that the importing program's rounding of time does not matter.
    given = np.array(list(zip(t - ts / 2, values)), dtype=[("time", float), (column, float)])
    given["time"][0] = 0
    for fmi in (2, 3):
        unit = export(folder, model, fmi)
        run = fmpy.simulate_fmu(str(unit), stop_time=t[-1], output_interval=ts, input=given, output=["y", "x", "v", "f"])
        # Where an input changes, FMPy ends a step and adds a row.
        run = run[np.abs(run["time"] / ts - np.round(run["time"] / ts)) < 0.25]
        rows = len(run)
        check(f"{unit.name} in FMPy, rows", rows == count, rows)
        found = {name: run[name] for name in ("y", "x", "v")}
        compare(f"{unit.name} in FMPy", found, {name: own[name][:rows] for name in found}, 1e-12)
        compare(f"{unit.name} in FMPy, friction", {"f": run["f"]}, {"f": own["f"][:rows]}, 1e-9)
        compare_in_ecos(unit, own, ts, {"y": 1e-12, "x": 1e-12, "v": 1e-12, "f": 1e-9}, [(column, values)])


def system(folder, name, duration, step, tolerance, kinds):
    script = folder / f"{name}.lua"
    script.write_text(f'''local tb = require "tribode"
local run = tb.run_system {{ system = require "systems.{name}", duration_s = {duration}, output_step_s = {step} }}
assert(run.ok, run.message)
tb.write_csv {{ file = "own.csv", columns = run.columns }}
''')
    tribode("run", script, "-o", folder / name, "--quiet")
    own = table(folder / name / "own.csv")
    model = sources / "models" / "systems" / f"{name}.lua"
    for fmi in (2, 3):
        for kind in kinds:
            unit = export(folder, model, fmi, kind)
            known = {v.name for v in fmpy.read_model_description(str(unit)).modelVariables}
            names = [n for n in own if n in known]
            more = {"relative_tolerance": 1e-9} if kind == "me" else {}
            run = fmpy.simulate_fmu(str(unit), stop_time=duration, output_interval=step, output=names,
                                    fmi_type="ModelExchange" if kind == "me" else "CoSimulation",
                                    record_events=False, **more)
            count = min(len(run), len(own["t"]))
            compare(f"{unit.name} in FMPy", {n: run[n][:count] for n in names}, {n: own[n][:count] for n in names},
                    1e-12 if tolerance is None else (tolerance if kind == "cs" else 100 * tolerance))
            if kind == "cs":
                compare_in_ecos(unit, own, step, dict.fromkeys(names, tolerance or 1e-12))
    return folder / f"{name}_2_cs.fmu"


with tempfile.TemporaryDirectory() as place:
    folder = pathlib.Path(place)
    open_loop = folder / "axis.json"
    open_loop.write_text(json.dumps({"rigid_gain_per_kg": 0.1, "input_delay_s": 4e-4, "output_delay_s": 3e-4,
                                     "modes": [{"gain": 0.02, "freq_hz": 40, "zeta": 0.02}], "current_loop_hz": 700,
                                     "friction": {"coulomb": 2, "viscous": 3, "elements": [{"K": 1e5, "F": 1.5}]}}))
    machine(folder, open_loop, closed=False)
    machine(folder, sources / "models" / "linear_motor_table.lua", closed=True)
    system(folder, "bouncing_ball", 1.5, 0.01, None, ["cs"])
    system(folder, "van_der_pol", 5, 0.05, 2e-6, ["cs", "me"])
    system(folder, "thermostat", 20, 0.1, None, ["cs"])
    system(folder, "dc_motor", 0.5, 0.005, 1e-6, ["cs"])
sys.exit(1 if failures else 0)
