"""Records in formats that other packages read and write (docs/how-to/use-from-python.md)."""

import numpy as np
import pytest

import tribode


@pytest.fixture
def log(table):
    """A log of the table under a multisine, as a drive might leave it."""
    excitation = np.random.default_rng(1).choice([-20.0, 20.0], 4000)
    run = tribode.simulate(table, exc=excitation)
    return {"t": run.t, "exc": excitation, "u": run.u, "y": run.y}


def test_parquet(table, log, tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    run = tribode.simulate(table, r=1e-3 * np.sin(0.01 * np.arange(500)))
    columns = {name: getattr(run, name) for name in "truyxvf"}
    parquet.write_table(pyarrow.table(columns), tmp_path / "run.parquet")
    read = parquet.read_table(tmp_path / "run.parquet")
    for name, values in columns.items():
        assert read[name].to_numpy().tobytes() == values.tobytes()

    parquet.write_table(pyarrow.table(log), tmp_path / "log.parquet")
    measured = parquet.read_table(tmp_path / "log.parquet").to_pydict()
    found = tribode.fra(table, measured, methods=["fra1"])
    expected = tribode.fra(table, log, methods=["fra1"])
    value = found["analyses"]["FRA-1"]["value"]
    assert np.array_equal(value, expected["analyses"]["FRA-1"]["value"], equal_nan=True) and len(value) > 10


def test_a_table_as_parquet(table, tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    sweep = tribode.sweep(table, [20.0, 40.0], settle_time_limit_s=0.6)
    parquet.write_table(pyarrow.table(dict(sweep.table)), tmp_path / "sweep.parquet")
    assert parquet.read_table(tmp_path / "sweep.parquet")["frequency_hz"].to_pylist() == [20.0, 40.0]


def test_mdf4(table, log, tmp_path):
    asammdf = pytest.importorskip("asammdf")
    # The logger: mm and mA, each signal with a name of its own, and one at a rate of its own.
    with asammdf.MDF(version="4.10") as file:
        slow = np.arange(0, log["t"][-1], 0.1)
        file.append([
            asammdf.Signal(log["y"] * 1e3, log["t"], name="Axis.Position", unit="mm"),
            asammdf.Signal(log["u"], log["t"], name="Axis.Force", unit="N"),
            asammdf.Signal(log["exc"], log["t"], name="Axis.Excitation", unit="N"),
        ])
        file.append([asammdf.Signal(20 + slow, slow, name="Winding.Temperature", unit="degC")])
        file.save(tmp_path / "log.mf4")

    names = {"u": "Axis.Force", "y": "Axis.Position", "exc": "Axis.Excitation"}
    with asammdf.MDF(tmp_path / "log.mf4") as file:
        signals = {name: file.get(channel) for name, channel in names.items()}
    record = {name: signal.samples.astype(float) for name, signal in signals.items()}
    record["t"] = signals["y"].timestamps
    record["y"] = record["y"] * 1e-3  # mm
    found = tribode.fra(table, record, methods=["fra1"])["analyses"]["FRA-1"]["value"]
    expected = tribode.fra(table, log, methods=["fra1"])["analyses"]["FRA-1"]["value"]
    assert len(found) > 10 and np.allclose(found, expected, rtol=1e-6, equal_nan=True)
