#!/bin/bash
# measure.sh FOLDER OUT [--quick]: error against tolerance and time on the problems of tests/problems/ivp: CVODE by hand and,
# where $PYTHON has SciPy, SciPy and scikit-sundae, then Tribode, one after the other. FOLDER is that of the build.
set -euo pipefail
source=$(realpath "$(dirname "${BASH_SOURCE[0]}")/../..")
folder=$(realpath "$1")
out=$2
shift 2
mkdir -p "$out"
# One thread each.
export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
"$folder/bench_by_hand" "$@" >"$out/peers.csv"
python=${PYTHON:-python3}
if "$python" -c 'import scipy' 2>/dev/null; then
    "$python" "$source/benchmarks/conformance/peers.py" "$folder/libbench_right_sides.so" "$@" >>"$out/peers.csv"
else
    echo "left out: SciPy ($python has none; PYTHON=... names another)"
fi
"$folder/tribode" run "$source/tests/problems/work_precision.lua" "$@" -D peers="$(realpath "$out/peers.csv")" \
    -o "$out" --quiet
