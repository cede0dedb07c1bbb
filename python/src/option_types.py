"""Writes the types of the options of tribode's functions for type checkers, from the engine's own tables.

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

lines = [
    "# Made by python/src/option_types.py from the engine's tables of options.",
    "from collections.abc import Mapping, Sequence",
    "from typing import Any, Literal, TypedDict",
    "",
    "from numpy.typing import ArrayLike",
    "",
]
tables = _tribode.options()
for function in ("simulate", "sweep", "fit_modal", "fra", "diagnose", "run"):
    title = "".join(part.title() for part in function.split("_"))
    lines.append(f"class {title}Options(TypedDict, total=False):")
    fields = list(FURTHER.get(function, []))
    fields += [
        (row["path"], type_of(row["values"]))
        for row in tables.get(function, [])
        if not re.search(r"[.\[]", row["path"]) and row["path"] not in NAMED.get(function, ())
    ]
    lines += [f"    {name}: {kind}" for name, kind in fields] + [""]
with open(sys.argv[2], "w") as file:
    file.write("\n".join(lines))
