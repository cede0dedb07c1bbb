"""Tribode: simulation, frequency-response analysis and diagnosis of servo systems with friction.

All quantities are in SI units (m, N, s, kg, Hz) unless a name says otherwise. The options of each function are those
of the function of the same name in Lua; help(tribode.sweep) lists them. What is wrong is raised as InputError, a
ValueError, with one sentence that says what was found and what is allowed. Ctrl-C ends any run; other threads of
Python go on while the engine works.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from . import _tribode
from ._tribode import EndedEarly, Error, FrequencyResponse, InputError, Machine, OutputError, Simulation, Sweep, Table
from ._tribode import __version__

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from typing import Any, Union

    from numpy.typing import ArrayLike, NDArray
    from typing_extensions import Unpack

    from ._options import DiagnoseOptions, FitModalOptions, FraOptions, IdentifyOptions, RunOptions, SimulateOptions
    from ._options import SpectrumOptions, SweepOptions
    from ._options import Diagnosis, FraAnalysis, Identified, LinearSystem, MeasuredResponses, MergedBatch, Spectrum
    from ._options import SteadyState

    FilePath = Union[str, os.PathLike[str]]
    MachineLike = Union[Machine, FilePath, Mapping[str, Any]]
    RecordLike = Union[FilePath, Mapping[str, ArrayLike], Table]
    Progress = Union[bool, None, Callable[[str, int, int], object]]

__all__ = [
    "EndedEarly",
    "Error",
    "FrequencyResponse",
    "InputError",
    "Machine",
    "OutputError",
    "Simulation",
    "Sweep",
    "System",
    "SystemRun",
    "Table",
    "diagnose",
    "fit_modal",
    "fra",
    "frf",
    "identify",
    "model_response",
    "models",
    "plant_parameters",
    "plant_response",
    "read_batch",
    "read_record",
    "simulate",
    "spectrum",
    "sweep",
]

for _type in (FrequencyResponse, Machine, Simulation, Sweep, Table):
    _type.__module__ = "tribode"

models = Path(__file__).parent / "models"
"""The folder of the ready machines and systems:
tribode.Machine(tribode.models / "linear_motor_table.lua")"""


def _signal(value, function, name):
    """One number a sample as an array of doubles, or None."""
    if value is None:
        return None
    array = np.asarray(value)
    if array.dtype.kind not in "biuf":
        raise InputError(f"{function}: {name} is {_described(value, array)}, must be an array of numbers")
    if array.ndim != 1:
        raise InputError(f"{function}: {name} has {array.ndim} dimensions, must have one")
    return np.ascontiguousarray(array, dtype=np.float64)


def _needed_signal(value, function, name):
    signal = _signal(value, function, name)
    if signal is None:
        raise InputError(f"{function}: {name} is missing, must be an array of numbers")
    return signal


def _described(value, array):
    if isinstance(value, np.ndarray):
        return f"an array of {array.dtype}"
    return f"a {type(value).__name__}"


def _machine(value: MachineLike) -> Machine:
    return value if isinstance(value, Machine) else Machine(value)


def _workers(value, function):
    if value is None:
        return os.cpu_count() or 1
    if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or not 1 <= value <= 1024:
        raise InputError(f"{function}: workers = {value!r}, must be a whole number from 1 to 1024")
    return int(value)


class _Bars:
    """Progress as tqdm shows it: one bar for each kind of work."""

    def __init__(self, tqdm):
        self._tqdm, self._bar, self._what = tqdm, None, None

    def __call__(self, what, done, of):
        if self._bar is None or what != self._what or done < self._bar.n:
            self.close()
            self._bar, self._what = self._tqdm(total=of, desc=what), what
        self._bar.update(done - self._bar.n)

    def close(self):
        if self._bar is not None:
            self._bar.close()
            self._bar = None


class _Lines:
    """The same where there is no tqdm: a line every tenth of the way."""

    def __init__(self):
        self._last = None

    def __call__(self, what, done, of):
        tenth = (what, 10 * done // of if of else 10)
        if tenth != self._last:
            self._last = tenth
            print(f"{what}: {done} of {of}", flush=True)

    def close(self):
        pass


class _Progress:
    """What `progress` stands for, while a call lasts: nothing, a bar, or the function that was given."""

    def __init__(self, wanted, function):
        self._bars = None
        self.call = None
        if callable(wanted):
            self.call = wanted
        elif wanted is True:
            try:
                from tqdm.auto import tqdm  # type: ignore[import-untyped]

                self._bars = _Bars(tqdm)
            except ImportError:
                self._bars = _Lines()
            self.call = self._bars
        elif wanted is not False and wanted is not None:
            raise InputError(
                f"{function}: progress = {wanted!r}, must be True, False or a function of (what, done, of)"
            )

    def __enter__(self):
        return self.call

    def __exit__(self, *_):
        if self._bars is not None:
            self._bars.close()


def _ended_early(message, result):
    error = EndedEarly(message)
    error.result = result
    return error


def simulate(
    machine: MachineLike,
    u: ArrayLike | None = None,
    *,
    r: ArrayLike | None = None,
    exc: ArrayLike | None = None,
    y: ArrayLike | None = None,
    progress: Progress = False,
    **options: Unpack[SimulateOptions],
) -> Simulation:
    """Simulates a machine under an input: u in open loop, or r and exc in closed loop.

    machine: a Machine, or what makes one. u [N], r [m], exc [N]: arrays with one entry a sample, the first at t = 0.
    u is held between the samples, or as the machine's field `input` says. y [m]: the measured position, for a machine
    whose initial state is "fitted". progress: True for a bar (tqdm), or a function of (what, done, of).

    Raises EndedEarly where the run could not go on; its `result` is the run so far.

    >>> import numpy as np, tribode
    >>> machine = tribode.Machine(tribode.models / "linear_motor_table.lua")
    >>> t = np.arange(2000) * machine.Ts
    >>> run = tribode.simulate(machine, r=1e-3 * np.sin(2 * np.pi * 2 * t))
    >>> run.x.shape, len(run.events)
    ((2000,), 167)
    """
    name = "tribode.simulate"

    def signal(value, key):
        return _signal(value, name, key)

    with _Progress(progress, name) as call:
        result = _tribode.simulate(
            _machine(machine), signal(u, "u"), signal(r, "r"), signal(exc, "exc"), signal(y, "y"), options, call
        )
    if not result.ok:
        raise _ended_early(result.message, result)
    return result


def sweep(
    machine: MachineLike,
    frequency_hz: ArrayLike,
    *,
    workers: int | None = None,
    checkpoint: FilePath | None = None,
    progress: Progress = False,
    **options: Unpack[SweepOptions],
) -> Sweep:
    """Measures the frequency response of a machine in closed loop by a sine sweep, and analyzes it in three ways.

    frequency_hz: ascending. workers: threads, by default one per processor; the result does not depend on it.
    checkpoint: a file that keeps what is done when the sweep is interrupted, from which the same call goes on.
    """
    name = "tribode.sweep"
    given = {**options, "frequency_hz": frequency_hz}
    with _Progress(progress, name) as call:
        return _tribode.sweep(
            _machine(machine), given, _workers(workers, name), "" if checkpoint is None else os.fspath(checkpoint), call
        )


def fit_modal(response: FrequencyResponse, **options: Unpack[FitModalOptions]) -> dict[str, Any]:
    """Fits a rigid body and vibration modes to a FrequencyResponse.

    Returns a dict: k0, k1, f1_hz, zeta1, k2, ... in SI units,
    standard_errors with the same keys, residual_rms, converged, message.
    """
    if not isinstance(response, FrequencyResponse):
        raise InputError(f"tribode.fit_modal: response is a {type(response).__name__}, must be a FrequencyResponse")
    return _tribode.fit_modal(response, options)


def plant_parameters(machine: MachineLike) -> dict[str, Any]:
    """The modal parameters of a machine without friction, with the keys of fit_modal."""
    return _tribode.plant_parameters(_machine(machine))


def plant_response(machine: MachineLike, frequency_hz: ArrayLike) -> FrequencyResponse:
    """The frequency response of a machine without friction, from thrust to position: what an analysis should find."""
    return _tribode.plant_response(_machine(machine), _signal(frequency_hz, "tribode.plant_response", "frequency_hz"))


def model_response(model: Mapping[str, Any], frequency_hz: ArrayLike) -> FrequencyResponse:
    """The frequency response of modal parameters, as fit_modal returns them."""
    return _tribode.model_response(model, _signal(frequency_hz, "tribode.model_response", "frequency_hz"))


def read_record(
    path: FilePath, *, columns: Mapping[str, str] | None = None, scale: Mapping[str, float] | None = None
) -> Table:
    """Reads a record: CSV, MAT (v5, v7.3) or HDF5, also packed by gzip.

    columns={"t": "t_s"} gives columns other names, scale={"u": 35.15} brings them to SI units.
    """
    return _tribode.read_record(_path(path, "tribode.read_record", "path"), columns, scale)


def _record(value, machine, function, key):
    """A measured record: a path, or arrays by name, with t where there is none."""
    if isinstance(value, (str, os.PathLike)):
        return value
    if not hasattr(value, "keys"):
        raise InputError(
            f"{function}: {key} is a {type(value).__name__}, must be a path or a mapping from names to arrays"
        )
    columns = {str(name): _signal(value[name], function, f"{key}.{name}") for name in value.keys()}
    if "t" not in columns and columns:
        columns["t"] = np.arange(len(next(iter(columns.values())))) * machine.sample_time
    return columns


def _records(data, machine, function):
    given = data if isinstance(data, (list, tuple)) else [data]
    return [_record(value, machine, function, f"data[{i}]") for i, value in enumerate(given)]


def fra(
    machine: MachineLike,
    data: RecordLike | Sequence[RecordLike],
    *,
    columns: Mapping[str, str] | None = None,
    scale: Mapping[str, float] | None = None,
    folder: FilePath | None = None,
    progress: Progress = False,
    **options: Unpack[FraOptions],
) -> MeasuredResponses:
    """Measures frequency responses from records, as `tribode fra` does (docs/measured-frequency-response.md).

    data: the path of a record, a mapping from names to arrays (t, u, y and, in closed loop, r or exc), or a list of
    them. folder: where report, plots and files go; by default nothing is written.

    Returns a dict: analyses, by their names a dict of arrays (frequency_hz, value, std_gain_db, std_phase_deg,
    coherence, ...) and the FrequencyResponse; fits, the contents of fit.json; records and notes, sentences; delay_s.
    """
    name = "tribode.fra"
    machine = _machine(machine)
    records = _records(data, machine, name)
    with _Progress(progress, name) as call:
        return _tribode.fra(
            machine, records, columns, scale, options, "" if folder is None else os.fspath(folder), call
        )


def identify(
    machine: MachineLike,
    data: RecordLike | Sequence[RecordLike],
    *,
    columns: Mapping[str, str] | None = None,
    scale: Mapping[str, float] | None = None,
    folder: FilePath | None = None,
    workers: int | None = None,
    progress: Progress = False,
    **options: Unpack[IdentifyOptions],
) -> Identified:
    """Estimates friction, modes, mass and delay of a machine at once from its records, by the simulated position
    (docs/measured-frequency-response.md). The machine has the start values.

    data: the path of a record, a mapping from names to arrays (t, y and u, or in closed loop r or exc), or a list of
    them. folder: where the machine, its parameters and a plot go; by default nothing is written.

    Returns a dict: machine, the Machine found; parameters, a list of dicts name, unit, start, value, standard_error
    (infinite where the records do not determine it); covariance; residuals, an array for each record;
    residual_rms_m, excess, objective, iterations, converged, notes.
    """
    name = "tribode.identify"
    machine = _machine(machine)
    records = _records(data, machine, name)
    with _Progress(progress, name) as call:
        return _tribode.identify(
            machine,
            records,
            columns,
            scale,
            options,
            "" if folder is None else os.fspath(folder),
            _workers(workers, name),
            call,
        )


def frf(
    input: ArrayLike,
    output: ArrayLike,
    *,
    sample_time_s: float,
    excitation: ArrayLike | None = None,
    window_samples: int = 0,
) -> FraAnalysis:
    """Estimates the response between any two signals by averaged cross spectra; in a closed loop with the excitation
    as reference. window_samples = 0: an eighth of the signals, at most 8192.

    Returns a dict of arrays as those of tribode.fra: frequency_hz, value, std_gain_db, std_phase_deg, coherence, ...
    """
    name = "tribode.frf"
    return _tribode.frf(
        _needed_signal(input, name, "input"),
        _needed_signal(output, name, "output"),
        _signal(excitation, name, "excitation"),
        {"sample_time_s": sample_time_s, "window_samples": window_samples},
    )


def spectrum(
    output: ArrayLike, inputs: ArrayLike | Sequence[ArrayLike] = (), **options: Unpack[SpectrumOptions]
) -> Spectrum:
    """Estimates the power spectrum of a signal and its relation to others by Welch's method
    (docs/measured-frequency-response.md).

    inputs: the signal that the output answers, or a list of several.

    Returns a dict of arrays: frequency_hz, power (one-sided density), and windows, averages, bandwidth_hz, power_low,
    power_high; with inputs coherence, coherence_threshold, noise_power, and inputs, of each power, cross_power,
    coherence, h1, std_gain_db, std_phase_deg, and of one input h2 and hv.
    """
    name = "tribode.spectrum"
    if isinstance(inputs, str) or not hasattr(inputs, "__len__"):
        raise InputError(f"{name}: inputs is {_described(inputs, None)}, must be an array of numbers or a list of arrays")
    signals = [inputs] if len(inputs) > 0 and isinstance(inputs[0], (int, float, np.number)) else inputs
    return _tribode.spectrum(
        _needed_signal(output, name, "output"),
        [_needed_signal(x, name, f"inputs[{i}]") for i, x in enumerate(signals)],
        options,
    )


def diagnose(
    machine: MachineLike,
    data: RecordLike | Sequence[RecordLike],
    *,
    validate: RecordLike | None = None,
    columns: Mapping[str, str] | None = None,
    scale: Mapping[str, float] | None = None,
    folder: FilePath | None = None,
    workers: int | None = None,
    progress: Progress = False,
    **options: Unpack[DiagnoseOptions],
) -> Diagnosis:
    """Finds which effect a machine lacks that its measured records show.

    data, validate: the path of a record, or a mapping from names to arrays (t, u, y and, in closed loop, r); data may
    be a list of them. Without validate, the last third of the first record is kept for validation. folder: where
    report, plots and files go (needs gnuplot); by default nothing is written.

    Returns the contents of diagnosis.json (docs/diagnosis.md) and: machine, the Machine with the effects; records and
    validation, for each record a dict of arrays t, u_measured, y_measured, u_before, y_before, u_after, y_after, and
    first, the first sample that counts.
    """
    name = "tribode.diagnose"
    machine = _machine(machine)

    records = _records(data, machine, name)
    kept = None if validate is None else _record(validate, machine, name, "validate")
    with _Progress(progress, name) as call:
        return _tribode.diagnose(
            machine,
            records,
            kept,
            columns,
            scale,
            options,
            "" if folder is None else os.fspath(folder),
            _workers(workers, name),
            call,
        )


def read_batch(path: FilePath) -> MergedBatch:
    """Reads all points of a complete batch (docs/batch.md): name, count, seed, index, seeds, units, parameters,
    results, failures. Numbers are arrays with one entry a point, NaN where it failed."""
    return _tribode.read_batch(_path(path, "tribode.read_batch", "path"))


def _path(value, function, name):
    if isinstance(value, (str, os.PathLike)):
        return os.fspath(value)
    raise InputError(f"{function}: {name} is a {type(value).__name__}, must be a path")


class SystemRun:
    """A run of a system of equations: run.t, run["name"] and, for a vector, run["name"] with a column for each
    element.

    table: all columns, with their units. events: an array with the fields t [s] and name. final: the values at the
    end. state: where the run may be continued (resume=run.state). message, t_end, solver, statistics; ended_by and
    stiff_from_s where there is one.
    """

    table: Table
    ok: bool
    message: str
    t_end: float
    solver: str
    events: NDArray[Any]
    final: dict[str, float | str]
    state: dict[str, Any]
    statistics: dict[str, float]

    def __init__(self, table, info):
        self.table = table
        self.info = info

    @property
    def t(self) -> NDArray[np.float64]:
        """Times of the rows [s]"""
        return self.table["t"]

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        if name not in self.table and f"{name}[1]" in self.table:
            count = 1
            while f"{name}[{count + 1}]" in self.table:
                count += 1
            return np.column_stack([self.table[f"{name}[{i + 1}]"] for i in range(count)])
        return self.table[name]

    def keys(self) -> list[str]:
        return self.table.keys()

    def __getattr__(self, name: str) -> Any:
        info = self.__dict__.get("info", {})
        if name in info:
            return info[name]
        raise AttributeError(f"a run of a system has no {name!r}, it has t, table, {', '.join(info)}")

    def __repr__(self):
        return f"<tribode.SystemRun: {len(self.t)} rows of {', '.join(self.table.keys())}>"


class System:
    """A hybrid system of equations written in Lua (docs/systems.md). Made by System.from_lua.

    Several threads may run one system at a time.
    """

    def __init__(self, engine):
        self._engine = engine
        # The first reading of the program, which also says what is wrong with it.
        variables = engine.call("system_variables", {}, False)
        self.variables = {kind: list(entries) for kind, entries in variables.items()}

    @staticmethod
    def from_lua(source: FilePath, *, read: FilePath | Sequence[FilePath] = (), compile: bool = False) -> System:
        """The system of a Lua program that ends with `return tb.system {...}`: its text, or the path of a .lua file.

        The program runs in a sandbox. It can require what is in its own folder, and read the folders in `read`.
        compile: the equations go through the system's C compiler, which is faster in long runs.
        """
        name = "tribode.System.from_lua"
        if not isinstance(source, (str, os.PathLike)):
            raise InputError(f"{name}: source is a {type(source).__name__}, must be a text or a path")
        if isinstance(read, (str, os.PathLike)):
            read = [read]
        folders = [str(models.parent)] + [os.fspath(folder) for folder in read]
        is_file = not isinstance(source, str) or (source.endswith(".lua") and "\n" not in source)
        return System(
            _tribode.LuaSystem(None if is_file else source, source if is_file else None, folders, bool(compile))
        )

    def run(self, *, progress: Progress = False, **options: Unpack[RunOptions]) -> SystemRun:
        """Runs the system: tb.run_system with these options.

        duration_s or end_time_s; inputs={"u": 3, "w": {"sample_time_s": 1e-3, "values": array}}; parameters and start
        as dicts; start_time_s; resume. Raises EndedEarly where the run could not go on; its `result` is the run so
        far.
        """
        with _Progress(progress, "tribode.System.run") as call:
            table, info = self._engine.run(options, call)
        result = SystemRun(table, info)
        if not info["ok"]:
            raise _ended_early(info["message"], result)
        return result

    def linearize(self, **options: Any) -> LinearSystem:
        """tb.linearize: A, B, C, D as arrays, poles as complex numbers, and with frequency_hz the response and
        margins."""
        result = self._engine.call("linearize", options, True)
        for matrix in "ABCD":
            rows = result[matrix]
            result[matrix] = (
                np.array([np.atleast_1d(row) for row in rows], dtype=float) if len(rows) else np.zeros((0, 0))
            )
        result["poles"] = np.array([complex(pole["real"], pole["imag"]) for pole in result["poles"]])
        response = result.get("response")
        if response is not None:
            result["response"] = FrequencyResponse(
                response["frequency_hz"].astype(float), response["real"] + 1j * response["imag"]
            )
        return result

    def steady_state(self, **options: Any) -> SteadyState:
        """tb.steady_state: where all derivatives are zero."""
        return self._engine.call("steady_state", options, False)

    def __repr__(self):
        states = ", ".join(state["name"] for state in self.variables.get("states", []))
        return f"<tribode.System {self._engine.name}: states {states}>"


def _document_options():
    """The tables of options, as the engine has them, into the docstrings."""
    for name, rows in _tribode.options().items():
        function = System.run if name == "run" else globals()[name]
        indent = "        " if name == "run" else "    "
        lines = [f"{indent}Options:"]
        for row in rows:
            unit = f" [{row['unit']}]" if row["unit"] else ""
            meaning = f": {row['meaning']}" if row["meaning"] else ""
            lines.append(f"{indent}  {row['path']}{unit} ({row['values']}; default {row['default']}){meaning}")
        function.__doc__ = function.__doc__.rstrip() + "\n\n" + "\n".join(lines) + "\n" + indent


_document_options()
