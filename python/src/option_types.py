"""Writes the types of the options of tribode's functions for type checkers, from the engine's own tables, and those of the
dicts that they return, which python/tests/test_types.py compares with results.

Run by CMake: option_types.py FOLDER_OF_THE_MODULE OUTPUT
"""

import re
import sys

sys.path.insert(0, sys.argv[1])

import _tribode  # noqa: E402


def type_of(values):
    if values.startswith("whole"):
        return "int"
    if values == "true or false":
        return "bool"
    if values.startswith("list of numbers"):
        return "ArrayLike"
    if values.startswith("list"):
        return "Sequence[Any]"
    if values.startswith("table"):
        return "Mapping[str, Any]"
    if values.startswith("text"):
        return "str"
    names = re.findall(r'`"([^"]*)"`', values)
    if names:
        return "Literal[" + ", ".join(f'"{name}"' for name in names) + "]"
    return "float"


# Options with a place of their own in the signature.
NAMED = {"sweep": {"frequency_hz"}}
# What a function takes besides its struct of options.
FURTHER = {
    "run": [
        ("parameters", "Mapping[str, Any]"),
        ("inputs", "Mapping[str, Any]"),
        ("start", 'Mapping[str, Any] | Literal["steady"]'),
        ("resume", "Mapping[str, Any]"),
    ],
}

NUMBERS, VALUES = "NDArray[np.float64]", "NDArray[np.complex128]"
# A "?" behind the name: it may be missing.
RESULTS = {
    "LinearSystem": [
        *((matrix, NUMBERS) for matrix in "ABCD"),
        ("poles", VALUES),
        ("stable", "bool"),
        ("sample_time_s?", "float"),
        ("response?", "FrequencyResponse"),
        ("margins?", "dict[str, float]"),
        *((names, "list[str]") for names in ("states", "inputs", "outputs")),
        ("left_out", "dict[str, Any]"),
        ("rate_left", "float"),
        ("jump_left", "float"),
    ],
    "SteadyState": [
        ("start", "dict[str, Any]"),
        ("inputs", "dict[str, float]"),
        ("parameters", "dict[str, float]"),
        ("residual", "float"),
        ("iterations", "int"),
        ("conditions", "dict[str, Any]"),
    ],
    "MergedBatch": [
        ("name", "str"),
        ("count", "int"),
        ("seed", "int"),
        ("index", "NDArray[np.int64]"),
        ("seeds", "NDArray[Any]"),
        ("units", "dict[str, str]"),
        ("parameters", "dict[str, NDArray[Any]]"),
        ("results", "dict[str, Any]"),
        ("failures", "list[dict[str, Any]]"),
    ],
    "FraAnalysis": [
        ("response", "FrequencyResponse"),
        ("value", VALUES),
        *(
            (name, NUMBERS)
            for name in "frequency_hz std_gain_db std_phase_deg coherence odd_distortion even_distortion settled".split()
        ),
    ],
    "MeasuredResponses": [
        ("analyses", "dict[str, FraAnalysis]"),
        ("fits", "dict[str, Any]"),
        ("records", "list[str]"),
        ("notes", "list[str]"),
        ("delay_s", "float"),
    ],
    "Identified": [
        ("machine", "Machine"),
        ("parameters", "list[dict[str, Any]]"),
        ("covariance", "list[list[float]]"),
        ("residuals", "list[NDArray[np.float64]]"),
        ("residual_rms_m", "list[float]"),
        ("excess", "float"),
        ("objective", "float"),
        ("iterations", "int"),
        ("simulations", "int"),
        ("converged", "bool"),
        ("notes", "list[str]"),
    ],
    "InputSpectra": [
        ("power", NUMBERS),
        ("cross_power", VALUES),
        ("coherence", NUMBERS),
        ("h1", "FrequencyResponse"),
        ("h2?", "FrequencyResponse"),
        ("hv?", "FrequencyResponse"),
        ("std_gain_db", NUMBERS),
        ("std_phase_deg", NUMBERS),
    ],
    "Spectrum": [
        ("frequency_hz", NUMBERS),
        ("power", NUMBERS),
        ("windows", "int"),
        ("averages", "float"),
        ("bandwidth_hz", "float"),
        ("power_low", "float"),
        ("power_high", "float"),
        ("inputs", "list[InputSpectra]"),
        ("coherence?", NUMBERS),
        ("coherence_threshold?", "float"),
        ("noise_power?", NUMBERS),
    ],
    "Diagnosis": [
        *((name, "str") for name in ("verdict", "where", "gap_unit", "version")),
        *((name, "float") for name in ("explained", "seconds")),
        ("effects", "list[dict[str, Any]]"),
        ("gap", "dict[str, dict[str, float]]"),
        ("nearest", "Any"),
        ("fields_off?", "list[dict[str, Any]]"),
        ("next_experiment", "str | None"),
        ("hypotheses", "list[dict[str, Any]]"),
        ("out_of_time", "bool"),
        ("data", "list[str]"),
        ("machine", "Machine"),
        ("records", "list[dict[str, Any]]"),
        ("validation", "list[dict[str, Any]]"),
    ],
}

lines = [
    "# Made by python/src/option_types.py from the engine's tables of options.",
    "from collections.abc import Mapping, Sequence",
    "from typing import Any, Literal, TypedDict",
    "",
    "import numpy as np",
    "from numpy.typing import ArrayLike, NDArray",
    "from typing_extensions import NotRequired",
    "",
    "from ._tribode import FrequencyResponse, Machine",
    "",
]
tables = _tribode.options()
for function in ("simulate", "sweep", "fit_modal", "fra", "identify", "spectrum", "diagnose", "run"):
    title = "".join(part.title() for part in function.split("_"))
    lines.append(f"class {title}Options(TypedDict, total=False):")
    fields = list(FURTHER.get(function, []))
    fields += [
        (row["path"], type_of(row["values"]))
        for row in tables.get(function, [])
        if not re.search(r"[.\[]", row["path"]) and row["path"] not in NAMED.get(function, ())
    ]
    lines += [f"    {name}: {kind}" for name, kind in fields] + [""]
for title, fields in RESULTS.items():
    lines.append(f"class {title}(TypedDict):")
    lines += [
        f"    {name[:-1]}: NotRequired[{kind}]" if name.endswith("?") else f"    {name}: {kind}" for name, kind in fields
    ] + [""]
with open(sys.argv[2], "w") as file:
    file.write("\n".join(lines))
