"""What type checkers say of the package, and of calls."""

import ast
import pathlib
import subprocess
import sys

import numpy as np
import pytest

import tribode

USE = """
import numpy as np
import tribode
machine = tribode.Machine("axis.lua")
run = tribode.simulate(machine, r=np.zeros(3), solver="erk", relative_tolerance=1e-6)
y = run.y * machine.Ts
sweep = tribode.sweep({"Ts": 1e-3}, [1, 2], amplitude_N=3)
fit = tribode.fit_modal(sweep.responses["Proposed"], modes=2)
x = tribode.System.from_lua("text").run(duration_s=3)["x"]
try:
    LINE
except tribode.EndedEarly as problem:
    print(problem.result)
"""


@pytest.mark.parametrize(
    "line, error",
    [
        ("tribode.simulate(machine, np.zeros(3), seed=3)", None),
        ('tribode.simulate(machine, np.zeros(3), sovler="erk")', 'did you mean "solver"'),
        ('tribode.simulate(machine, np.zeros(3), solver="magic")', "Literal['auto'"),
        ("tribode.fit_modal(3)", "FrequencyResponse"),
        ("tribode.no_such", "no_such"),
        ('tribode.System.from_lua("text").linearize()["A"].shape', None),
        ('tribode.System.from_lua("text").linearize()["poels"]', 'has no key "poels"'),
        ('tribode.fra(machine, "log.csv")["analyses"]["FRA-1"]["coherence"].max()', None),
        ('tribode.fra(machine, "log.csv")["analyses"]["FRA-1"]["coherense"]', "coherence"),
        ('tribode.diagnose(machine, "log.csv")["machine"].hash.upper()', None),
        ('tribode.read_batch("batch")["count"].shape', '"int" has no attribute "shape"'),
        ('tribode.System.from_lua("text").run().t_end.upper()', '"float" has no attribute "upper"'),
    ],
)
def test_types(line, error, tmp_path):
    (tmp_path / "use.py").write_text(USE.replace("LINE", line))
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--no-error-summary", "--cache-dir", "mypy", "use.py"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    if error is None:
        assert done.returncode == 0 and done.stdout == "", done.stdout + done.stderr
    else:
        assert done.returncode == 1 and error in done.stdout and done.stdout.count("error:") == 1, (
            done.stdout + done.stderr
        )


def types_of(title):
    """The fields that a result is said to have: by their names, whether it always has them."""
    stub = ast.parse((pathlib.Path(tribode.__file__).parent / "_options.pyi").read_text())
    (kind,) = [node for node in stub.body if isinstance(node, ast.ClassDef) and node.name == title]
    return {field.target.id: "NotRequired" not in ast.unparse(field.annotation) for field in kind.body}


SYSTEM = """
local tb = require "tribode"
return tb.system {
  states = { x = 1, v = 0 }, inputs = { u = 0 }, parameters = { k = 2 },
  der = function(s) return { x = s.v, v = s.u - s.k * s.x - s.v } end, outputs = function(s) return { y = s.x } end }
"""
BATCH = 'require("tribode").batch { points = { { a = 1 }, { a = 2 } }, run = function(point) return { b = point.a } end }'


def test_results_have_the_fields_of_their_types(program, table, reference, tmp_path):
    def check(result, title, every=True):
        fields = types_of(title)
        assert set(result) <= set(fields)
        assert {name for name, always in fields.items() if always or every} <= set(result)

    system = tribode.System.from_lua(SYSTEM)
    check(system.linearize(frequency_hz=[0.1, 1.0]), "LinearSystem")
    check(system.linearize(), "LinearSystem", every=False)
    check(system.steady_state(), "SteadyState")
    run = system.run(duration_s=1)
    declared = tribode.SystemRun.__annotations__
    assert {name for name in declared if name != "table"} == set(run.info)
    excitation = 15 * np.sin(2 * np.pi * 25 * np.arange(4000) * table.Ts)
    record = tribode.simulate(table, exc=excitation)
    found = tribode.fra(table, {"u": record.u, "y": record.y, "exc": excitation}, methods=["fra1"], delay_s=1.38e-3)
    check(found, "MeasuredResponses")
    check(found["analyses"]["FRA-1"], "FraAnalysis")
    spectrum = tribode.spectrum(record.y, record.u)
    check(spectrum, "Spectrum")
    check(spectrum["inputs"][0], "InputSpectra")
    start, log = table.with_(friction__viscous=3), {"u": record.u, "y": record.y}
    check(tribode.identify(start, log, parameters=["friction.viscous"]), "Identified")
    run = tribode.simulate(table.with_(noise_rms_m=1e-8), r=np.tile(reference, 2))
    model = table.with_(noise_rms_m=1e-8)
    check(tribode.diagnose(model, {name: getattr(run, name) for name in "truy"}, max_effects=1), "Diagnosis")
    (tmp_path / "points.lua").write_text(BATCH)
    program("batch", "plan", tmp_path / "points.lua", "-o", tmp_path / "batch", "--quiet")
    program("batch", "run", tmp_path / "batch", "--quiet")
    check(tribode.read_batch(tmp_path / "batch"), "MergedBatch")
