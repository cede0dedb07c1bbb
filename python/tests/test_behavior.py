"""Arrays without copies, threads, Ctrl-C, references, pickling."""

import gc
import pickle
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest

import tribode


def test_arrays_are_views_that_keep_their_result_alive(table, reference):
    run = tribode.simulate(table, r=reference)
    first, again = run.y, run.y
    assert np.shares_memory(first, again) and first.dtype == np.float64 and first.flags.c_contiguous
    copy, detected = first.copy(), run.y
    del run, first, again
    gc.collect()
    for _ in range(5):  # memory that was given back would be used again
        tribode.simulate(table, r=0 * reference)
    assert np.array_equal(detected, copy)


def test_table_columns_are_views(table):
    sweep = tribode.sweep(table, [20.0, 30.0], settle_time_limit_s=0.6)
    columns = sweep.table
    assert np.shares_memory(columns["frequency_hz"], columns["frequency_hz"])
    assert set(dict(columns)) == set(columns.keys()) and "no_such" not in columns and 3 not in columns
    value = columns["frequency_hz"]
    del sweep, columns
    gc.collect()
    assert list(value) == [20.0, 30.0]


def test_inputs_of_any_layout(open_axis):
    u = np.sin(0.02 * np.arange(600))
    expected = tribode.simulate(open_axis, u).x
    two = np.stack([u, u], axis=1)
    for same in (list(u), tuple(u), two[:, 0], u[::-1][::-1], u.astype(">f8"), np.asfortranarray(two)[:, 1]):
        assert np.array_equal(tribode.simulate(open_axis, same).x, expected)
    assert np.array_equal(
        tribode.simulate(open_axis, np.ones(9, dtype=np.int8)).x, tribode.simulate(open_axis, np.ones(9)).x
    )


def test_machine(table):
    assert table.Ts == table.sample_time == 0.0005 and table.friction["viscous"] > 0 and "Ts" in dir(table)
    stiffer = table.with_({"friction.elements[1].K": 3e5}, noise_rms_m=1e-8, friction__viscous=3.0)
    assert stiffer.noise_rms_m == 1e-8 and stiffer.friction["viscous"] == 3.0
    assert stiffer.friction["elements"][0]["K"] == 3e5 != table.friction["elements"][0]["K"]
    louder = table.with_(scale={"friction.elements[*].F": 2.0})
    assert louder.friction["elements"][4]["F"] == 2 * table.friction["elements"][4]["F"]
    assert tribode.Machine(table.to_dict()) == table == pickle.loads(pickle.dumps(table)) != stiffer
    assert hash(tribode.Machine(table.to_dict())) == hash(table)
    changed = table.to_dict()
    changed["friction"]["viscous"] = 99
    assert table.friction["viscous"] != 99


def test_responses_can_be_pickled(table):
    response = tribode.plant_response(table, np.linspace(10, 100, 7))
    again = pickle.loads(pickle.dumps(response))
    assert np.array_equal(again.value, response.value) and np.array_equal(again.frequency_hz, response.frequency_hz)
    assert response.at(10.0) == response.value[0] and len(response) == 7


def test_seeds_and_noise(table, reference):
    noisy = table.with_(noise_rms_m=1e-7)
    runs = [tribode.simulate(noisy, r=reference, seed=seed).y for seed in (1, 1, 2)]
    assert np.array_equal(runs[0], runs[1]) and not np.array_equal(runs[0], runs[2])


def test_threads_run_at_the_same_time_and_give_the_same(table, reference):
    system = tribode.System.from_lua(tribode.models / "systems/stick_slip.lua")
    expected = tribode.simulate(table, r=reference).x
    expected_system = system.run(duration_s=2)
    results = []

    def work():
        for _ in range(5):
            results.append(np.array_equal(tribode.simulate(table, r=reference).x, expected))
            run = system.run(duration_s=2)
            results.append(all(np.array_equal(run[name], expected_system[name]) for name in run.keys()))

    threads = [threading.Thread(target=work) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(results) == 80 and all(results)


def test_python_goes_on_while_the_engine_works(table):
    """The GIL is free: this thread counts between the first and the last report of a run in another."""
    started, ended = threading.Event(), threading.Event()

    def report(what, done, of):
        (ended if done == of else started).set()

    thread = threading.Thread(
        target=lambda: tribode.simulate(table, r=1e-3 * np.sin(0.01 * np.arange(20000)), solver="erk", progress=report)
    )
    thread.start()
    started.wait()
    count = 0
    while not ended.is_set():
        count += 1
    thread.join()
    # With the GIL held, this thread would have its turn only inside the hundred calls of `report`.
    assert count > 10000


def test_progress(table, reference, capsys):
    calls = []
    tribode.simulate(table, r=reference, progress=lambda *call: calls.append(call))
    assert calls[0][0] == "simulate" and calls[-1][1] == calls[-1][2] and len(calls) > 50
    calls.clear()
    tribode.sweep(table, [20.0, 30.0, 40.0], workers=2, progress=lambda *call: calls.append(call))
    assert [done for _, done, _ in calls] == [1, 2, 3]
    tribode.simulate(table, r=reference, progress=True)
    assert "simulate" in "".join(capsys.readouterr())


def test_calls_within_a_progress_function(table, reference):
    inner = []
    tribode.simulate(
        table, r=reference, progress=lambda what, done, of: inner.append(tribode.simulate(table, r=reference[:20]))
    )
    assert len(inner) > 50


LONG_WORK = {
    "simulate": "tribode.simulate(machine, r=1e-3 * np.sin(0.01 * np.arange(4_000_000)), solver='erk', relative_tolerance=1e-12)",
    "sweep": "tribode.sweep(machine, np.linspace(10, 400, 50000), workers=2)",
    "system": "tribode.System.from_lua(tribode.models / 'systems/van_der_pol.lua').run(duration_s=1e9, output_step_s=1e6, max_steps=10**12)",
}
INTERRUPTED = """
import numpy as np, sys, tribode
machine = tribode.Machine(tribode.models / "linear_motor_table.lua")
print("begin", flush=True)
try:
    WORK
    print("done")
except KeyboardInterrupt:
    print("interrupted")
result = tribode.simulate(machine, r=np.zeros(10))
print(len(result.t))
"""


@pytest.mark.parametrize("what", LONG_WORK)
def test_ctrl_c(what, tmp_path):
    """The work takes minutes where nothing ends it; afterwards the interpreter is as before."""
    process = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED.replace("WORK", LONG_WORK[what])],
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=tmp_path,
        # A shell's background work inherits that it ignores Ctrl-C.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert process.stdout.readline() == "begin\n"
    # Mostly the engine is at work by then; where it is not yet, Python itself is interrupted, which passes, too.
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.5)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate()
    assert out.split() == ["interrupted", "10"], err


def test_no_references_are_lost(table, reference):
    options, report = {"solver": "exact"}, (lambda what, done, of: None)
    objects = [options, report, reference, table, tribode.InputError]
    before = [sys.getrefcount(x) for x in objects]
    for _ in range(50):
        run = tribode.simulate(table, r=reference, progress=report, **options)
        run.y, run.events, run.statistics
        for wrong in ({"solver": "magic"}, {"sovler": 1}):
            with pytest.raises(tribode.InputError):
                tribode.simulate(table, r=reference, **wrong)
    del run, _, wrong
    gc.collect()
    assert [sys.getrefcount(x) for x in objects] == before


def resident_mb():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096 / 1e6


def test_memory_is_given_back(open_axis):
    """400 runs of 7 columns of 20000 doubles: 450 MB, if their memory were kept."""
    u = np.sin(0.01 * np.arange(20000))
    for _ in range(20):
        tribode.simulate(open_axis, u).y
    before = resident_mb()
    for _ in range(400):
        run = tribode.simulate(open_axis, u)
        run.t, run.y, run.f, run.events
    assert resident_mb() - before < 60


def test_nothing_leaks_at_exit(tmp_path):
    """nanobind tells on standard error what is still alive at the end."""
    code = INTERRUPTED.replace(
        "WORK", "run = tribode.simulate(machine, r=np.zeros(100)); y = run.y; table = run.events; del run"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0 and done.stderr == "", done.stderr


def test_system_results(tmp_path):
    system = tribode.System.from_lua("""
        local tb = require "tribode"
        return tb.system {
          states = { x = { start = 1, unit = "m" }, v = { unit = "m/s" } },
          inputs = { u = { unit = "m/s2" } },
          parameters = { k = { value = 4, unit = "1/s2" } },
          der = function(s) return { x = s.v, v = s.u - s.k * s.x } end,
          outputs = function(s) return { force = { s.u - s.k * s.x, unit = "m/s2" } } end,
        }""")
    assert [state["name"] for state in system.variables["states"]] == ["v", "x"]
    run = system.run(duration_s=3.0, relative_tolerance=1e-10, absolute_tolerance=1e-12)
    assert np.allclose(run["x"], np.cos(2 * run.t), atol=1e-7) and run.table.units["x"] == "m"
    later = system.run(end_time_s=6.0, resume=run.state, relative_tolerance=1e-10, absolute_tolerance=1e-12)
    assert later.t[0] == 3.0 and abs(later["x"][-1] - np.cos(12)) < 1e-7
    held = system.run(duration_s=1, inputs={"u": {"sample_time_s": 0.1, "values": np.full(11, 4.0)}}, start={"x": 1})
    assert np.allclose(held["x"], 1, atol=1e-9)
    linear = system.linearize(frequency_hz=[0.1, 1.0], input="u", output="force")
    assert np.array_equal(linear["A"], [[0, -4], [1, 0]]) and linear["B"].shape == (2, 1)
    assert sorted(linear["poles"].imag) == [-2, 2] and len(linear["response"]) == 2
    assert system.steady_state(inputs={"u": 8})["start"]["x"] == pytest.approx(2)


def test_diagnose_of_arrays(table):
    """A cogging force that the machine does not know of is found."""
    t = np.arange(6000) * table.Ts
    r = 0.02 * np.sin(2 * np.pi * 0.7 * t) + 0.005 * np.sin(2 * np.pi * 1.9 * t)
    truth = table.with_(
        noise_rms_m=2e-8,
        effects=[{"name": "force_ripple", "parameters": {"harmonics": [{"F": 3.0, "period_m": 0.008, "phase": 0.4}]}}],
    )
    measured = tribode.simulate(truth, r=r, seed=3)
    found = tribode.diagnose(table.with_(noise_rms_m=2e-8), {name: getattr(measured, name) for name in "truy"})
    assert found["verdict"] == "effect_found" and found["effects"][0]["name"] == "force_ripple"
    assert found["machine"].effects[0]["name"] == "force_ripple"
    kept = found["validation"][0]
    assert np.std(kept["y_after"] - kept["y_measured"]) < 0.2 * np.std(kept["y_before"] - kept["y_measured"])


def test_fra_of_arrays(table):
    """Stepped sines in closed loop: the response of the friction model-based analysis is near that of the plant."""
    frequencies = [25.0, 50.0, 100.0]
    t = np.arange(6000) * table.Ts
    records = []
    for f in frequencies:
        run = tribode.simulate(table, exc=15 * np.sin(2 * np.pi * f * t))
        records.append({"t": run.t, "u": run.u, "y": run.y, "exc": 15 * np.sin(2 * np.pi * f * t)})
    found = tribode.fra(table, records, methods=["fra1", "proposed"], delay_s=1.38e-3)
    assert set(found["analyses"]) == {"FRA-1", "Proposed"} and len(found["records"]) == 3
    proposed = found["analyses"]["Proposed"]["response"]
    assert np.allclose(proposed.frequency_hz, frequencies)
    truth = tribode.plant_response(table, frequencies).value
    error = {name: np.abs(found["analyses"][name]["response"].value / truth - 1).max() for name in found["analyses"]}
    assert error["Proposed"] < 0.1 < error["FRA-1"]


def test_identify_of_arrays(tmp_path):
    """Mass and viscous friction from a log, within four standard errors of the truth, and the files."""
    truth = tribode.Machine(
        {"rigid_gain_per_kg": 0.1, "friction": {"viscous": 20}, "encoder_resolution_m": 1e-7, "noise_rms_m": 5e-8}
    )
    t = np.arange(4000) * truth.Ts
    u = np.where(t < 0.02, 0.0, 30 * np.sin(2 * np.pi * 9 * t) + 20 * np.sin(2 * np.pi * 23 * t))
    y = tribode.simulate(truth, u, seed=1).y
    start = truth.with_(rigid_gain_per_kg=0.11, friction__viscous=10)
    found = tribode.identify(start, {"u": u, "y": y}, folder=tmp_path / "found")
    assert found["converged"] and [one["name"] for one in found["parameters"]] == [
        "rigid_gain_per_kg",
        "friction.viscous",
    ]
    for one, value in zip(found["parameters"], [0.1, 20]):
        assert abs(one["value"] - value) < 4 * one["standard_error"] < 0.02 * value
    assert found["machine"].rigid_gain_per_kg == found["parameters"][0]["value"]
    assert found["residuals"][0].shape == y.shape and found["residual_rms_m"][0] < 2e-7
    assert tribode.Machine(tmp_path / "found/machine.json") == found["machine"]
    assert {path.name for path in (tmp_path / "found").iterdir()} >= {"parameters.csv", "identify.json", "residual.png"}


def test_spectrum_and_frf():
    """A first-order lag under white noise: its response within the bounds, with the coherence that the noise leaves."""
    random = np.random.default_rng(1)
    x, y, pole = random.standard_normal(40000), np.zeros(40000), 0.8
    for k in range(1, x.size):
        y[k] = pole * y[k - 1] + (1 - pole) * x[k - 1]
    noisy = y + 0.05 * random.standard_normal(y.size)
    found = tribode.spectrum(noisy, x, sample_time_s=1e-3, window_samples=512)
    h1 = found["inputs"][0]["h1"]
    z = np.exp(2j * np.pi * found["frequency_hz"] * 1e-3)
    truth = (1 - pole) / (z - pole)
    error = np.abs(h1.value / truth - 1) / (found["inputs"][0]["std_phase_deg"] * np.pi / 180)
    assert np.mean(error[5:] < 2.5) > 0.9 and found["coherence"].min() > 0.1
    assert found["power"].sum() / 512e-3 == pytest.approx(np.var(noisy), rel=0.1)
    both = tribode.spectrum(noisy, [x, random.standard_normal(x.size)], sample_time_s=1e-3, window_samples=512)
    assert len(both["inputs"]) == 2 and both["inputs"][1]["coherence"].mean() < 0.05 and "h2" not in both["inputs"][0]
    response = tribode.frf(x, noisy, sample_time_s=1e-3, window_samples=512)
    k = np.argmin(np.abs(response["frequency_hz"] - 20))
    assert abs(response["value"][k] / ((1 - pole) / (np.exp(2j * np.pi * 20e-3) - pole)) - 1) < 0.1


def test_options_are_documented():
    """The docstrings have the engine's own tables."""
    assert "relative_tolerance (> 0; default" in tribode.simulate.__doc__
    assert "amplitude_N [N] (> 0; default 15)" in tribode.sweep.__doc__
    assert "max_steps" in tribode.System.run.__doc__
