"""The problems of tests/problems/ivp by SciPy (LSODA, BDF, Radau; RK45, DOP853 where nothing is stiff) and, where it is there, by
scikit-sundae, which is CVODE called from Python. All call the compiled right sides of right_sides.cpp. One line for each
run as by_hand.cpp writes it. Needs SciPy.

    python peers.py LIBRARY [--quick] [PROBLEM ...]
"""
import ctypes
import sys
import time
import warnings

import numpy as np
from scipy.integrate import solve_ivp
from scipy.sparse import diags

try:
    from sksundae.cvode import CVODE
except ImportError:
    CVODE = None

warnings.simplefilter("ignore")
library = ctypes.CDLL(sys.argv[1])
library.problem_name.restype = ctypes.c_char_p
for function in (library.problem_end, library.problem_jump):
    function.restype = ctypes.c_double
library.problem_rates.argtypes = [ctypes.c_int, ctypes.c_int, ctypes.c_double, ctypes.c_void_p, ctypes.c_void_p]
library.problem_rates.restype = None


class Problem:
    def __init__(self, k):
        self.k, self.name, self.n = k, library.problem_name(k).decode(), library.problem_size(k)
        self.end, self.jump = library.problem_end(k), library.problem_jump(k)
        self.band, self.stiff = library.problem_band(k), bool(library.problem_stiff(k))
        self.start, self.nominal = np.empty(self.n), np.empty(self.n)
        library.problem_start(k, self.start.ctypes.data_as(ctypes.c_void_p))
        library.problem_nominal(k, self.nominal.ctypes.data_as(ctypes.c_void_p))

    def pieces(self):
        return [(0, self.jump, 0), (self.jump, self.end, 1)] if self.jump > 0 else [(0, self.end, 0)]

    def rates(self, late):
        """f(t, y), and f(t, y, out) for what hands its own memory."""
        call, k = library.problem_rates, self.k

        def rates(t, y, out=None):
            f = np.empty(len(y)) if out is None else out
            y = np.ascontiguousarray(y)
            call(k, late, t, y.ctypes.data, f.ctypes.data)
            return f
        return rates


def by_scipy(method):
    def run(problem, tolerance):
        options = {}
        if problem.band and method == "LSODA":
            options = {"lband": problem.band, "uband": problem.band}
        elif problem.band and method in ("BDF", "Radau"):
            ones = np.ones(problem.n)
            options = {"jac_sparsity": diags([ones] * (2 * problem.band + 1), range(-problem.band, problem.band + 1),
                                             shape=(problem.n, problem.n), format="csc")}
        y, steps = problem.start, 0
        for begin, end, late in problem.pieces():
            result = solve_ivp(problem.rates(late), (begin, end), y, method=method, rtol=tolerance,
                               atol=tolerance * problem.nominal, **options)
            if not result.success:
                return None, 0
            y, steps = result.y[:, -1], steps + len(result.t) - 1
        return y, steps
    return run


def by_scikit_sundae(method):
    def run(problem, tolerance):
        y, steps = problem.start, 0
        options = {"linsolver": "dense"}
        if problem.band:
            options = {"linsolver": "band", "lband": problem.band, "uband": problem.band}
        if method == "Adams":
            options = {}
        for begin, end, late in problem.pieces():
            solver = CVODE(problem.rates(late), method=method, rtol=tolerance, atol=tolerance * problem.nominal,
                           max_num_steps=10 ** 7, **options)
            result = solver.solve(np.array([begin, end]), y)
            if not result.success:
                return None, 0
            y, steps = result.y[-1], steps + result.nsteps if hasattr(result, "nsteps") else 0
        return y, steps
    return run


def methods(problem):
    if problem.stiff:
        names = ["LSODA", "BDF", "Radau"]
    else:
        names = ["LSODA", "RK45", "DOP853"]
    list_of = [("SciPy " + name, by_scipy(name)) for name in names]
    if CVODE is not None:
        list_of.append(("scikit-sundae CVODE", by_scikit_sundae("BDF" if problem.stiff else "Adams")))
    return list_of


def main(arguments):
    quick = "--quick" in arguments
    names = [a for a in arguments if a != "--quick"]
    for problem in map(Problem, range(library.problem_count())):
        long = problem.n > 100 or problem.name == "RINGMOD"
        if (names and problem.name not in names) or (quick and not names and long):
            continue
        for method, run in methods(problem):
            # Written in Python: minutes at tight tolerances.
            slow = method in ("SciPy BDF", "SciPy Radau")
            if slow and problem.name == "RINGMOD":
                continue
            tolerances = [1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10]
            if quick or slow and long:
                tolerances = [1e-4, 1e-6]
            elif slow:
                tolerances = [1e-4, 1e-6, 1e-8]
            for tolerance in tolerances:
                least, total, y, steps = None, 0, None, 0
                # The least of five, or of as many as fit into half a second.
                for _ in range(1 if quick else 5):
                    begin = time.process_time()
                    try:
                        y, steps = run(problem, tolerance)
                    except Exception as reason:
                        print(f"{problem.name} by {method}: {reason}", file=sys.stderr)
                        y = None
                    seconds = time.process_time() - begin
                    least = seconds if least is None else min(least, seconds)
                    total += seconds
                    if total > 0.5 or y is None:
                        break
                values = "failed" if y is None else " ".join(f"{v:.17g}" for v in y)
                print(f"{problem.name},{method},{tolerance:g},{least:.9g},{steps},{values}", flush=True)


main(sys.argv[2:])
