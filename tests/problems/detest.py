"""Reference values of DETEST at t = 20 [Hull 1972], classes A5, B, C and E, for tests/scripts/detest.lua.

Gragg's midpoint rule, extrapolated in h^2 to order 28, in decimal numbers of 40 digits. Each problem is solved
with two numbers of steps; what both agree in is printed, 20 digits at least. Some minutes.
"""
import sys
from decimal import Decimal as D, getcontext

getcontext().prec = 40
COLUMNS = 14


def midpoint(f, t, y, H, n):
    h = H / n
    before, now = y, [a + h * b for a, b in zip(y, f(t, y))]
    for i in range(1, n):
        slope = f(t + i * h, now)
        before, now = now, [a + 2 * h * b for a, b in zip(before, slope)]
    return now


def step(f, t, y, H):
    rows = []
    for k in range(COLUMNS):
        row = [midpoint(f, t, y, H, 2 * (k + 1))]
        for j in range(1, k + 1):
            factor = 1 / ((D(k + 1) / D(k + 1 - j)) ** 2 - 1)
            row.append([a + (a - b) * factor for a, b in zip(row[-1], rows[-1][j - 1])])
        rows.append(row)
    return rows[-1][-1]


def solve(f, y, steps, end=D(20)):
    t, H = D(0), end / steps
    y = [D(v) for v in y]
    for k in range(steps):
        y = step(f, k * H, y, H)
    return y


def sin(x):
    """Reduced by halving, then by the series."""
    half = x / 2 ** 20
    s, c, term, n = D(0), D(0), D(1), 0
    while abs(term) > D(10) ** -60:
        if n % 2 == 0:
            c += term if n % 4 == 0 else -term
        else:
            s += term if n % 4 == 1 else -term
        n += 1
        term = term * half / n
    # cosines lose digits when they are doubled, 1 - cos does not
    v = 2 * sum_of_versine(half)
    for _ in range(20):
        s, v = 2 * s * (1 - v), 2 * v * (2 - v)
    return s


def sum_of_versine(x):
    """(1 - cos x) / 2."""
    total, term, n = D(0), x * x / 2, 2
    while abs(term) > D(10) ** -70:
        total += term
        term = -term * x * x / ((n + 1) * (n + 2))
        n += 2
    return total / 2


def torus(t, y):
    r = (y[0] * y[0] + y[1] * y[1]).sqrt()
    return [-y[1] - y[0] * y[2] / r, y[0] - y[1] * y[2] / r, y[0] / r]


def chain(t, y):
    return [-y[0]] + [y[i - 1] - y[i] for i in range(1, 9)] + [y[8]]


def slowing_chain(t, y):
    return [-y[0]] + [i * y[i - 1] - (i + 1) * y[i] for i in range(1, 9)] + [9 * y[8]]


def heat(t, y):
    n = len(y)
    return [(y[i - 1] if i > 0 else 0) - 2 * y[i] + (y[i + 1] if i + 1 < n else 0) for i in range(n)]


K2 = D("2.95912208286")
M = [D(m) for m in ("1.00000597682", ".000954786104043", ".000285583733151", ".0000437273164546", ".0000517759138449",
                    ".00000277777777778")]
PLACES = """3.42947415189 3.35386959711 1.35494901715 6.64145542550 5.97156957878 2.18231499728 11.2630437207 14.6952576794
6.27960525067 -30.1552268759 1.65699966404 1.43785752721 -21.1238353380 28.4465098142 15.3882659679"""
SPEEDS = """-.557160570446 .505696783289 .230578543901 -.415570776342 .365682722812 .169143213293 -.325325669158
.189706021964 .0877265322780 -.0240476254170 -.287659532608 -.117219543175 -.176860753121 -.216393453025
-.0148647893090"""


def planets(t, y):
    x = [y[3 * j:3 * j + 3] for j in range(5)]
    cube = lambda v: (lambda s: s * s.sqrt())(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    r3 = [cube(v) for v in x]
    forces = []
    for j in range(5):
        force = [-(M[0] + M[j + 1]) * x[j][i] / r3[j] for i in range(3)]
        for k in range(5):
            if k == j:
                continue
            d = [x[k][i] - x[j][i] for i in range(3)]
            d3 = cube(d)
            force = [force[i] + M[k + 1] * (d[i] / d3 - x[k][i] / r3[k]) for i in range(3)]
        forces += [K2 * a for a in force]
    return y[15:] + forces


def bessel(t, y):
    s = t + 1
    return [y[1], -(y[1] / s + (1 - D("0.25") / (s * s)) * y[0])]


PROBLEMS = {
    "A5": (lambda t, y: [(y[0] - t) / (y[0] + t)], [4], 40),
    "B1": (lambda t, y: [2 * (y[0] - y[0] * y[1]), -(y[1] - y[0] * y[1])], [1, 3], 240),
    "B2": (lambda t, y: [-y[0] + y[1], y[0] - 2 * y[1] + y[2], y[1] - y[2]], [2, 0, 1], 40),
    "B3": (lambda t, y: [-y[0], y[0] - y[1] * y[1], y[1] * y[1]], [1, 0, 0], 80),
    "B4": (torus, [3, 0, 0], 100),
    "B5": (lambda t, y: [y[1] * y[2], -y[0] * y[2], D("-0.51") * y[0] * y[1]], [0, 1, 1], 80),
    "C1": (chain, [1] + 9 * [0], 40),
    "C2": (slowing_chain, [1] + 9 * [0], 120),
    "C3": (heat, [1] + 9 * [0], 60),
    "C4": (heat, [1] + 50 * [0], 60),
    "C5": (planets, (PLACES + " " + SPEEDS).split(), 20),
    "E1": (bessel, ["0.6713967071418030", "0.09540051444747446"], 160),
    "E2": (lambda t, y: [y[1], (1 - y[0] * y[0]) * y[1] - y[0]], [2, 0], 240),
    "E3": (lambda t, y: [y[1], y[0] ** 3 / 6 - y[0] + 2 * sin(D("2.78535") * t)], [0, 0], 100),
    "E4": (lambda t, y: [y[1], D("0.032") - D("0.4") * y[1] * y[1]], [30, 0], 60),
    "E5": (lambda t, y: [y[1], (1 + y[1] * y[1]).sqrt() / (25 - t)], [0, 0], 80),
}

for name in sys.argv[1:] or PROBLEMS:
    f, y, steps = PROBLEMS[name]
    coarse, fine = solve(f, y, steps), solve(f, y, steps * 5 // 4)
    off = max(abs(a - b) for a, b in zip(coarse, fine))
    print(f"{name} (two runs differ by {off:.1e}):", flush=True)
    for value in fine:
        print(f"  {value:.20f}" if abs(value) > D("1e-3") else f"  {value:.20e}")
