"""Records in formats that other Python packages read. Left out where these are not installed."""

import numpy as np
import pytest
import tribode


@pytest.fixture(scope="module")
def axis():
    return tribode.Machine(tribode.models / "linear_motor_table.lua")


@pytest.fixture(scope="module")
def run(axis):
    t = np.arange(1000) * axis.Ts
    return tribode.simulate(axis, r=1e-3 * np.sin(2 * np.pi * 2 * t))


def test_a_record_in_mdf4_comes_back(axis, run, tmp_path):
    asammdf = pytest.importorskip("asammdf")
    signals = [
        asammdf.Signal(run.r * 1e3, run.t, name="r", unit="mm"),
        asammdf.Signal(run.u, run.t, name="u", unit="N"),
        asammdf.Signal(run.y * 1e3, run.t, name="y", unit="mm"),
    ]
    with asammdf.MDF(version="4.10") as log:
        log.append(signals)
        log.save(tmp_path / "log.mf4")
    with asammdf.MDF(tmp_path / "log.mf4") as log:
        frame = log.to_dataframe(channels=["r", "u", "y"], raster=axis.Ts)
    np.testing.assert_allclose(frame.index.to_numpy(), run.t, atol=1e-12)
    np.testing.assert_allclose(frame["y"].to_numpy() * 1e-3, run.y, rtol=1e-15, atol=1e-18)
    again = tribode.simulate(axis, r=frame["r"].to_numpy() * 1e-3)
    np.testing.assert_allclose(again.y, run.y, atol=2e-7)  # one step of the encoder more: r is rounded twice


def test_a_sweep_in_parquet_comes_back(axis, tmp_path):
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    sweep = tribode.sweep(axis, np.linspace(10, 100, 3), amplitude_N=15.0)
    frame = pandas.DataFrame(dict(sweep.table))
    frame.to_parquet(tmp_path / "sweep.parquet")
    back = pandas.read_parquet(tmp_path / "sweep.parquet")
    assert list(back.columns) == list(frame.columns)
    for name in frame.columns:
        np.testing.assert_array_equal(back[name].to_numpy(), frame[name].to_numpy())
