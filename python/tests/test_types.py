"""What type checkers say of the package, and of calls."""

import subprocess
import sys

import pytest

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
