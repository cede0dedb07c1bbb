"""Wrong calls end in an exception with a sentence, and never in a crash."""

import math
import threading

import numpy as np
import pytest

import tribode

SINE = 1e-3 * np.sin(0.1 * np.arange(50))


class Odd:
    """An object that is no plain data."""


class Liar:
    """Says it is an array, and is none."""

    def tolist(self):
        return self


def nested(depth):
    value = []
    for _ in range(depth):
        value = [value]
    return value


def itself():
    value = []
    value.append(value)
    return value


def broken_progress(what, done, of):
    raise LookupError("this progress function does not work")


def machine():
    return tribode.Machine(tribode.models / "linear_motor_table.lua")


def description(**changes):
    return {"Ts": 0.001, "rigid_gain_per_kg": 0.5, **changes}


def mass():
    return tribode.Machine(description())


def ball():
    return tribode.System.from_lua(tribode.models / "systems/bouncing_ball.lua")


def response():
    return tribode.plant_response(machine(), np.linspace(10.0, 200.0, 40))


# The call, the exception, and a part of its sentence.
WRONG = [
    # Machines
    (lambda: tribode.Machine(), TypeError, ""),
    (lambda: tribode.Machine(None), ValueError, "wants a description"),
    (lambda: tribode.Machine(3), ValueError, "wants a description"),
    (lambda: tribode.Machine([]), ValueError, "wants a description"),
    (lambda: tribode.Machine("no_such_file.lua"), ValueError, "no_such_file.lua"),
    (lambda: tribode.Machine("machine.txt"), ValueError, "a .lua or a .json file"),
    (lambda: tribode.Machine(""), ValueError, ""),
    (lambda: tribode.Machine("a\0b.lua"), ValueError, "zero byte"),
    (lambda: tribode.Machine("\ud800.lua"), ValueError, "UTF-8"),
    (lambda: tribode.Machine(b"machine.lua"), ValueError, "plain data"),
    (lambda: tribode.Machine({}), ValueError, "nothing could move"),
    (lambda: tribode.Machine({1: 2}), ValueError, "must be a str"),
    (lambda: tribode.Machine({"Ts": 0.001, "mass": 3}), ValueError, "mass"),
    (lambda: tribode.Machine(description(mass=3)), ValueError, "mass"),
    (lambda: tribode.Machine(description(Ts=0)), ValueError, "must be positive"),
    (lambda: tribode.Machine(description(Ts="fast")), ValueError, "Ts"),
    (lambda: tribode.Machine(description(Ts=math.nan)), ValueError, "Ts"),
    (lambda: tribode.Machine(description(Ts=math.inf)), ValueError, "Ts"),
    (lambda: tribode.Machine(description(Ts=10**30)), ValueError, "64 bits"),
    (lambda: tribode.Machine(description(friction=Odd())), ValueError, "plain data"),
    (lambda: tribode.Machine(description(friction=Liar())), ValueError, "levels"),
    (lambda: tribode.Machine(description(friction={"viscosity": 2})), ValueError, "viscous"),
    (lambda: tribode.Machine(description(modes=3)), ValueError, "modes"),
    (lambda: tribode.Machine(description(modes=[{"gain": 1}])), ValueError, "modes[1]"),
    (lambda: tribode.Machine(description(modes=nested(100))), ValueError, "levels"),
    (lambda: tribode.Machine(description(modes=itself())), ValueError, "levels"),
    (lambda: tribode.Machine(description(controller={"type": "pdi"})), ValueError, "pid"),
    (lambda: tribode.Machine(description(effects=[{"name": "no_such"}])), ValueError, "no_such"),
    (lambda: tribode.Machine(description(comment="\udfff")), ValueError, "UTF-8"),
    (lambda: tribode.Machine(description(), 3), TypeError, ""),
    (lambda: machine().mass, AttributeError, "mass"),
    (lambda: machine().fricton, AttributeError, "friction"),
    (lambda: setattr(machine(), "Ts", 1), AttributeError, ""),
    (lambda: machine().with_(mass=3), ValueError, "mass"),
    (lambda: machine().with_(3), ValueError, "dict"),
    (lambda: machine().with_({"friction.elements[99].K": 1}), ValueError, "entries"),
    (lambda: machine().with_({"friction..K": 1}), ValueError, "path"),
    (lambda: machine().with_({3: 1}), ValueError, "must be a str"),
    (lambda: machine().with_(Ts=-1), ValueError, "Ts"),
    (lambda: machine().with_(scale={"friction": 2}), ValueError, "number"),
    (lambda: machine().with_(scale=2), ValueError, "dict"),
    (lambda: machine().with_(Ts=None), ValueError, "Ts"),
    (lambda: machine().with_(scale={"Ts": "two"}), ValueError, "number"),
    # Simulation
    (lambda: tribode.simulate(), TypeError, ""),
    (lambda: tribode.simulate(machine()), ValueError, "no column u"),
    (lambda: tribode.simulate(None, SINE), ValueError, "wants a description"),
    (lambda: tribode.simulate(machine(), "u"), ValueError, "array of numbers"),
    (lambda: tribode.simulate(machine(), 3.0), ValueError, "dimensions"),
    (lambda: tribode.simulate(machine(), Odd()), ValueError, "array of numbers"),
    (lambda: tribode.simulate(machine(), []), ValueError, ""),
    (lambda: tribode.simulate(machine(), [1, "2"]), ValueError, "array of numbers"),
    (lambda: tribode.simulate(machine(), [1, None]), ValueError, "array of numbers"),
    (lambda: tribode.simulate(machine(), [1j, 2]), ValueError, "array of numbers"),
    (lambda: tribode.simulate(machine(), [[1, 2], [3]]), ValueError, ""),
    (lambda: tribode.simulate(machine(), np.zeros((3, 3))), ValueError, "2 dimensions"),
    (lambda: tribode.simulate(machine(), np.array(["a"])), ValueError, "array of numbers"),
    (lambda: tribode.simulate(machine(), [0, math.nan]), ValueError, "u[1] = nan"),
    (lambda: tribode.simulate(machine(), [0, 1, math.inf]), ValueError, "u[2] = inf"),
    (lambda: tribode.simulate(machine(), r=[0, -math.inf]), ValueError, "r[1]"),
    (lambda: tribode.simulate(machine(), r=SINE, exc=SINE[:3]), ValueError, "exc"),
    (lambda: tribode.simulate(mass(), r=SINE), ValueError, "controller"),
    (lambda: tribode.simulate(machine(), SINE, sovler="erk"), ValueError, "solver"),
    (lambda: tribode.simulate(machine(), SINE, solver="magic"), ValueError, "must be one of"),
    (lambda: tribode.simulate(machine(), SINE, solver=3), ValueError, "solver"),
    (lambda: tribode.simulate(machine(), SINE, relative_tolerance=0), ValueError, "relative_tolerance"),
    (lambda: tribode.simulate(machine(), SINE, relative_tolerance="fine"), ValueError, "relative_tolerance"),
    (lambda: tribode.simulate(machine(), SINE, relative_tolerance=Odd()), ValueError, "plain data"),
    (lambda: tribode.simulate(machine(), SINE, seed=-1), ValueError, "seed"),
    (lambda: tribode.simulate(machine(), SINE, seed=1.5), ValueError, "seed"),
    (lambda: tribode.simulate(machine(), SINE, seed=2**60), ValueError, "seed"),
    (lambda: tribode.simulate(machine(), SINE, seed=2**80), ValueError, "64 bits"),
    (lambda: tribode.simulate(machine(), SINE, friction_feedback=0.5), ValueError, ""),
    (lambda: tribode.simulate(machine(), SINE, progress=3), ValueError, "progress"),
    (lambda: tribode.simulate(machine(), SINE, progress=broken_progress), LookupError, "does not work"),
    (lambda: tribode.simulate(machine(), r=SINE, max_steps=1, solver="erk"), tribode.EndedEarly, ""),
    (lambda: tribode.simulate(mass().with_(initial="fitted"), SINE), ValueError, "fitted"),
    (lambda: tribode.Simulation(), TypeError, ""),
    # Frequency responses
    (lambda: tribode.sweep(machine()), TypeError, ""),
    (lambda: tribode.sweep(machine(), []), ValueError, "frequenc"),
    (lambda: tribode.sweep(machine(), [30, 20]), ValueError, ""),
    (lambda: tribode.sweep(machine(), [-1.0]), ValueError, "frequency_hz"),
    (lambda: tribode.sweep(machine(), ["20"]), ValueError, "frequency_hz"),
    (lambda: tribode.sweep(machine(), [5000.0]), ValueError, ""),
    (lambda: tribode.sweep(machine(), 20.0), ValueError, "frequency_hz"),
    (lambda: tribode.sweep(machine(), [20.0], amplitude=3), ValueError, "amplitude_N"),
    (lambda: tribode.sweep(machine(), [20.0], harmonics=0), ValueError, "harmonics"),
    (lambda: tribode.sweep(machine(), [20.0], workers=0), ValueError, "workers"),
    (lambda: tribode.sweep(machine(), [20.0], workers=-1), ValueError, "workers"),
    (lambda: tribode.sweep(machine(), [20.0], workers="two"), ValueError, "workers"),
    (lambda: tribode.sweep(machine(), [20.0], friction_model={"viscous": "a"}), ValueError, "viscous"),
    (lambda: tribode.sweep(machine(), [20.0], progress=broken_progress), LookupError, "does not work"),
    (lambda: tribode.sweep(mass(), [20.0]), ValueError, "controller"),
    (lambda: tribode.FrequencyResponse([1.0, 2.0]), TypeError, ""),
    (lambda: tribode.FrequencyResponse(np.array([1.0, 2.0]), np.array([1j])), ValueError, "as many"),
    (lambda: tribode.FrequencyResponse(np.array([2.0, 1.0]), np.array([1j, 1j])), ValueError, "ascend"),
    (lambda: tribode.FrequencyResponse(np.array([0.0]), np.array([1j])), ValueError, "positive"),
    (lambda: tribode.FrequencyResponse("a", "b"), TypeError, ""),
    (lambda: response().at(1000.0), ValueError, ""),
    (lambda: response().at("ten"), TypeError, ""),
    (lambda: response().remove_delay(math.nan), ValueError, "finite"),
    (lambda: tribode.FrequencyResponse(np.zeros(0), np.zeros(0, complex)).at(3.0), ValueError, "empty"),
    (lambda: tribode.fit_modal(3), ValueError, "FrequencyResponse"),
    (lambda: tribode.fit_modal(response(), modes=21), ValueError, "modes"),
    (lambda: tribode.fit_modal(response(), f_min_hz=500, f_max_hz=600), ValueError, ""),
    (lambda: tribode.fit_modal(response(), mode=1), ValueError, "modes"),
    (lambda: tribode.fit_modal(tribode.FrequencyResponse(np.array([30.0]), np.array([0j]))), ValueError, ""),
    (lambda: tribode.plant_response(machine(), [0.0]), ValueError, "positive"),
    (lambda: tribode.model_response({}, [1.0]), ValueError, "k0"),
    (lambda: tribode.model_response(3, [1.0]), ValueError, ""),
    # Records, diagnosis, batches
    (lambda: tribode.read_record("no_such.csv"), ValueError, "no_such.csv"),
    (lambda: tribode.read_record(3), ValueError, "path"),
    (lambda: tribode.read_record("/"), ValueError, ""),
    (lambda: tribode.read_record(__file__, columns={"t": 3}), ValueError, ""),
    (lambda: tribode.read_record(__file__, columns={"t": "zeit"}), ValueError, ""),
    (lambda: tribode.read_record(__file__, scale=3), ValueError, ""),
    (lambda: tribode.diagnose(machine(), []), ValueError, "empty"),
    (lambda: tribode.diagnose(machine(), 3), ValueError, "mapping"),
    (lambda: tribode.diagnose(machine(), {}), ValueError, ""),
    (lambda: tribode.diagnose(machine(), {"u": SINE}), ValueError, ""),
    (lambda: tribode.diagnose(machine(), {"u": SINE, "y": SINE[:3], "r": SINE}), ValueError, ""),
    (lambda: tribode.diagnose(machine(), {"u": SINE, "y": SINE, "r": SINE}), ValueError, ""),
    (lambda: tribode.diagnose(machine(), {"u": SINE, "y": "y", "r": SINE}), ValueError, "array of numbers"),
    (lambda: tribode.diagnose(machine(), "no_such.csv"), ValueError, "no_such.csv"),
    (lambda: tribode.diagnose(machine(), "no_such.csv", max_effects=0), ValueError, "max_effects"),
    (lambda: tribode.fra(machine(), []), ValueError, "empty"),
    (lambda: tribode.fra(machine(), {"u": SINE}), ValueError, ""),
    (lambda: tribode.fra(machine(), {"u": SINE, "y": SINE}, methods=["fra9"]), ValueError, "fra9"),
    (lambda: tribode.fra(machine(), {"u": SINE, "y": SINE}, method="fra1"), ValueError, "methods"),
    (lambda: tribode.identify(machine(), []), ValueError, "empty"),
    (lambda: tribode.identify(machine(), {"u": SINE}), ValueError, "y"),
    (lambda: tribode.identify(machine(), {"u": SINE, "y": SINE}, parameters=["mode"]), ValueError, "mode"),
    (lambda: tribode.identify(machine(), {"u": SINE, "y": SINE}, iteration=3), ValueError, "iterations"),
    (lambda: tribode.frf(SINE, SINE[:3], sample_time_s=1e-3), ValueError, "3 of output"),
    (lambda: tribode.frf(None, SINE, sample_time_s=1e-3), ValueError, "input is missing"),
    (lambda: tribode.frf(SINE, SINE, sample_time_s="1 ms"), ValueError, "sample_time_s"),
    (lambda: tribode.spectrum("y"), ValueError, "must be an array of numbers"),
    (lambda: tribode.spectrum(SINE, 3), ValueError, "inputs is a int"),
    (lambda: tribode.spectrum(SINE, [SINE, None]), ValueError, "inputs[1] is missing"),
    (lambda: tribode.spectrum(SINE, windows=3), ValueError, "window"),
    (lambda: tribode.read_batch("no_such_folder"), ValueError, ""),
    (lambda: tribode.read_batch(None), ValueError, "path"),
    # Systems
    (lambda: tribode.System.from_lua(3), ValueError, "text or a path"),
    (lambda: tribode.System.from_lua(""), ValueError, "must return a system"),
    (lambda: tribode.System.from_lua("return 3"), ValueError, "must return a system"),
    (lambda: tribode.System.from_lua("return {"), ValueError, "system"),
    (lambda: tribode.System.from_lua("error('no')"), ValueError, "no"),
    (lambda: tribode.System.from_lua("while true do end"), tribode.Error, "instructions"),
    (lambda: tribode.System.from_lua("return require 'no_such'"), ValueError, "no_such"),
    (lambda: tribode.System.from_lua("return io.open('/etc/passwd'):read()"), ValueError, ""),
    (lambda: tribode.System.from_lua("no_such.lua"), ValueError, "no_such.lua"),
    (lambda: ball().run(), ValueError, "duration_s"),
    (lambda: ball().run(duration_s=-1), ValueError, "duration_s"),
    (lambda: ball().run(duration_s=1, parameters={"gravity": 3}), ValueError, ""),
    (lambda: ball().run(duration_s=1, inputs={"u": 3}), ValueError, "u"),
    (lambda: ball().run(duration_s=1, inputs=3), ValueError, "inputs"),
    (lambda: ball().run(duration_s=1, start={"no": 1}), ValueError, "no"),
    (lambda: ball().run(duration_s=1, system=3), ValueError, "system"),
    (lambda: ball().run(duration_s=1, output_step=3), ValueError, "output_step_s"),
    (lambda: ball().run(duration_s=1, resume={"t": 3}), ValueError, "resume"),
    (lambda: ball().run(duration_s=1, progress="yes"), ValueError, "progress"),
    (lambda: ball().run(duration_s=1)["no_such"], KeyError, "no_such"),
    (lambda: ball().run(duration_s=1).no_such, AttributeError, "no_such"),
    (lambda: ball().linearize(at=3), ValueError, "at"),
    (lambda: ball().steady_state(free=["no"]), ValueError, ""),
]


def test_there_are_a_hundred_different_ones():
    codes = {(call.__code__.co_code, call.__code__.co_consts, call.__code__.co_names) for call, _, _ in WRONG}
    assert len(codes) == len(WRONG) >= 100


@pytest.mark.parametrize("number", range(len(WRONG)))
def test_wrong_call(number):
    call, kind, part = WRONG[number]
    with pytest.raises(kind) as problem:
        call()
    text = str(problem.value)
    assert text and part in text
    # The engine's own errors are one sentence for the user, nothing of the machinery behind it.
    if isinstance(problem.value, tribode.Error):
        assert "std::" not in text and "json.exception" not in text


def test_wrong_calls_from_threads():
    """The same calls, at the same time in four threads."""
    failures = []

    def work(first):
        for call, kind, _ in WRONG[first::4]:
            try:
                call()
                failures.append("no exception")
            except kind:
                pass
            except BaseException as other:  # noqa: BLE001
                failures.append(other)

    threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures


def test_errors_are_those_of_python():
    assert issubclass(tribode.InputError, ValueError) and issubclass(tribode.InputError, tribode.Error)
    assert issubclass(tribode.EndedEarly, tribode.Error) and not issubclass(tribode.EndedEarly, ValueError)


def test_a_run_that_ends_early_keeps_what_it_reached():
    with pytest.raises(tribode.EndedEarly) as problem:
        tribode.simulate(machine(), r=np.r_[np.zeros(100), np.full(100, 1e-3)], solver="erk", max_steps=3)
    result = problem.value.result
    assert 0 < len(result.t) < 200 and not result.ok and result.message == str(problem.value)
