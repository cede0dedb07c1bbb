import os
import pathlib
import shutil
import subprocess

import numpy as np
import pytest

import tribode

PROJECT = pathlib.Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def program():
    """The program `tribode` of the same sources, to compare with: TRIBODE_PROGRAM or build/release/tribode."""
    path = pathlib.Path(os.environ.get("TRIBODE_PROGRAM", PROJECT / "build/release/tribode"))
    if not path.exists():
        pytest.fail(f"{path}: the program is missing; build it (./dev build) or set TRIBODE_PROGRAM")

    def run(*arguments, **options):
        return subprocess.run(
            [path, *map(str, arguments)], check=True, capture_output=True, text=True, cwd=PROJECT, **options
        )

    return run


@pytest.fixture(scope="session")
def table():
    return tribode.Machine(tribode.models / "linear_motor_table.lua")


@pytest.fixture(scope="session")
def reference(table):
    """A sine of 1 mm at 2 Hz, for 1 s."""
    return 1e-3 * np.sin(2 * np.pi * 2 * np.arange(2000) * table.Ts)


@pytest.fixture(scope="session")
def open_axis():
    """A bare mass with friction, in open loop."""
    return tribode.Machine(
        {
            "Ts": 0.001,
            "rigid_gain_per_kg": 0.5,
            "friction": {"coulomb": 1.0, "viscous": 2.0, "elements": [{"K": 1e4, "F": 2.0, "D": 0.0}]},
        }
    )
