"""Reference values for the problems of stiff.lua and smooth.lua, independent of the published ones.

Collocation at Radau points (s stages, order 2s - 1) in 80 digits. The step follows from the last Legendre coefficient of
the stages; each problem is solved with two numbers of stages and two tolerances, and what both agree in is printed beside
the published value. Newton's method uses one inverse per step. Needs python-flint and mpmath. Seconds to some minutes each.

    python references.py [NAME ...]
"""
import sys
from flint import arb, arb_mat, ctx
from mpmath import mp, mpf, polyroots

ctx.dps = 80
mp.dps = 70


def number(x):
    return arb(mp.nstr(x, 65)) if isinstance(x, mpf) else arb(x)


def middle(matrix):
    return arb_mat([[matrix[i, j].mid() for j in range(matrix.ncols())] for i in range(matrix.nrows())])


class Collocation:
    """Nodes c, integrals a_ij of the Lagrange polynomials, extrapolation, last Legendre coefficient."""

    def __init__(self, s):
        shifted = lambda n: [(-1) ** (n + k) * mp.binomial(n, k) * mp.binomial(n + k, k) for k in range(n, -1, -1)]
        a, b = shifted(s), [mpf(0)] + shifted(s - 1)
        c = sorted(r.real for r in polyroots([x - y for x, y in zip(a, b)], maxsteps=1000, extraprec=600))
        self.s, self.c = s, [number(x) for x in c]
        polys = []
        for j, cj in enumerate(c):
            poly = [mpf(1)]
            for k, ck in enumerate(c):
                if k != j:
                    poly = [((poly[i - 1] if i > 0 else 0) - ck * (poly[i] if i < len(poly) else 0)) / (cj - ck)
                            for i in range(len(poly) + 1)]
            polys.append(poly)
        self.a = [[number(sum(p * ci ** (n + 1) / (n + 1) for n, p in enumerate(poly))) for poly in polys] for ci in c]
        # The coefficient of x^(s-1), in units of that of the shifted Legendre polynomial.
        self.top = [number(poly[-1] / mp.binomial(2 * (s - 1), s - 1)) for poly in polys]


class Stiff:
    def __init__(self, f, jacobian, start, end, floor):
        self.f, self.jacobian, self.start, self.end, self.floor = f, jacobian, start, arb(end), floor


def solve(problem, s, tolerance, first=None):
    rule = Collocation(s)
    y = [arb(v) for v in problem.start]
    n, t, end = len(y), arb(0), problem.end
    h = arb(first) if first else end / 10 ** 6
    top = [abs(v) for v in y]
    steps = 0
    while True:
        last = bool(t + h >= end * (1 - arb(10) ** -40))
        if last:
            h = end - t
        rates = problem.f(t, y)
        J = problem.jacobian(t, y)
        M = arb_mat(n * s, n * s)
        for i in range(s):
            for j in range(s):
                w = h * rule.a[i][j]
                for p in range(n):
                    for q in range(n):
                        M[i * n + p, j * n + q] = (1 if i == j and p == q else 0) - (w * J[p][q]).mid()
        try:
            inverse = middle(M.inv())
        except ZeroDivisionError:
            h = h / 2
            continue
        weight = [max(float(abs(v)), fl) for v, fl in zip(y, problem.floor)]
        Z = [[arb(0)] * n for _ in range(s)]
        converged, before = False, None
        for sweep in range(60):
            F = [problem.f(t + rule.c[i] * h, [(a + b).mid() for a, b in zip(y, Z[i])]) for i in range(s)]
            R = arb_mat(n * s, 1)
            for i in range(s):
                for p in range(n):
                    R[i * n + p, 0] = (h * sum((rule.a[i][j] * F[j][p] for j in range(s)), arb(0)) - Z[i][p]).mid()
            D = inverse * R
            change = 0.0
            for i in range(s):
                for p in range(n):
                    d = D[i * n + p, 0].mid()
                    Z[i][p] = (Z[i][p] + d).mid()
                    change = max(change, abs(float(d)) / weight[p])
            if not change < 1e30:
                break
            if change < 1e-36:
                converged = True
                break
            if before is not None and sweep > 3 and change > 0.5 * before:
                break
            before = change
        if not converged:
            h = h / 2
            continue
        eta = 0.0
        for p in range(n):
            coefficient = sum((rule.top[i] * Z[i][p] for i in range(s)), arb(0))
            eta = max(eta, abs(float(coefficient)) / max(weight[p], float(abs(y[p] + Z[-1][p]))))
        factor = min(4.0, max(0.2, 0.8 * (tolerance / max(eta, 1e-60)) ** (1 / (s - 1))))
        if eta > 4 * tolerance:
            h = (h * arb(factor)).mid()
            continue
        y = [(a + b).mid() for a, b in zip(y, Z[-1])]
        t = (t + h).mid()
        steps += 1
        if last:
            return y, steps
        h = (h * arb(factor)).mid()


def d(text):
    """A decimal constant as written."""
    return arb(text)


def robertson():
    k1, k2, k3 = d("0.04"), arb(10) ** 4, 3 * arb(10) ** 7
    # The third is 1 - y1 - y2.
    f = lambda t, y: (lambda r1, r3: [r1, -r1 - r3])(-k1 * y[0] + k2 * y[1] * (1 - y[0] - y[1]), k3 * y[1] ** 2)
    def jac(t, y):
        a, b = -k1 - k2 * y[1], k2 * (1 - y[0] - 2 * y[1])
        return [[a, b], [-a, -b - 2 * k3 * y[1]]]
    return Stiff(f, jac, [1, 0], "1e11", [1e-12, 1e-18])


def hires():
    c = [d(v) for v in "1.71 0.43 8.32 0.0007 8.75 10.03 0.035 1.12 1.745 0.69 1.81".split()]
    def f(t, y):
        bind = 280 * y[5] * y[7]
        return [-c[0] * y[0] + c[1] * y[1] + c[2] * y[2] + c[3], c[0] * y[0] - c[4] * y[1],
                -c[5] * y[2] + c[1] * y[3] + c[6] * y[4], c[2] * y[1] + c[0] * y[2] - c[7] * y[3],
                -c[8] * y[4] + c[1] * (y[5] + y[6]),
                -bind + c[9] * y[3] + c[0] * y[4] - c[1] * y[5] + c[9] * y[6], bind - c[10] * y[6],
                -bind + c[10] * y[6]]
    def jac(t, y):
        z = arb(0)
        u, v = 280 * y[7], 280 * y[5]
        return [[-c[0], c[1], c[2], z, z, z, z, z], [c[0], -c[4], z, z, z, z, z, z],
                [z, z, -c[5], c[1], c[6], z, z, z], [z, c[2], c[0], -c[7], z, z, z, z],
                [z, z, z, z, -c[8], c[1], c[1], z], [z, z, z, c[9], c[0], -c[1] - u, c[9], -v],
                [z, z, z, z, z, u, -c[10], v], [z, z, z, z, z, -u, c[10], -v]]
    return Stiff(f, jac, [1, 0, 0, 0, 0, 0, 0, "0.0057"], "321.8122", [1e-4] * 8)


def oregonator():
    a, q, w = d("77.27"), d("8.375e-6"), d("0.161")
    f = lambda t, y: [a * (y[1] + y[0] * (1 - q * y[0] - y[1])), (y[2] - (1 + y[0]) * y[1]) / a, w * (y[0] - y[2])]
    jac = lambda t, y: [[a * (1 - 2 * q * y[0] - y[1]), a * (1 - y[0]), arb(0)], [-y[1] / a, -(1 + y[0]) / a, 1 / a],
                        [w, arb(0), -w]]
    return Stiff(f, jac, [1, 2, 3], 360, [1, 1, 1])


def van_der_pol(mu):
    m = arb(mu) ** 2
    f = lambda t, y: [y[1], ((1 - y[0] ** 2) * y[1] - y[0]) * m]
    jac = lambda t, y: [[arb(0), arb(1)], [(-2 * y[0] * y[1] - 1) * m, (1 - y[0] ** 2) * m]]
    return Stiff(f, jac, [2, 0], 2, [1e-2, 1e-2])


def e5():
    A, B, C, M = d("7.89e-10"), d("1.1e7"), d("1.13e3"), d("1e6")
    def f(t, y):
        r1, r2, r3, r4 = A * y[0], B * y[0] * y[2], M * C * y[1] * y[2], C * y[3]
        return [-r1 - r2, r1 - r3, r1 - r3 - r2 + r4, r2 - r4]
    def jac(t, y):
        u, v, p, q, z = B * y[2], B * y[0], M * C * y[2], M * C * y[1], arb(0)
        return [[-A - u, z, -v, z], [A, -p, -q, z], [A - u, -p, -q - v, C], [u, z, v, -C]]
    return Stiff(f, jac, ["1.76e-3", 0, 0, 0], "1e13", [1e-10, 1e-22, 1e-22, 1e-24])



def pollution():
    k = [d(v) for v in """.35 26.6 1.23e4 8.6e-4 8.2e-4 1.5e4 1.3e-4 2.4e4 1.65e4 9e3 .022 1.2e4 1.88 1.63e4 4.8e6 3.5e-4
        .0175 1e8 4.44e11 1.24e3 2.1 5.78 .0474 1.78e3 3.12""".split()]
    # Species that each reaction's rate is a product of; how it changes the species [Verwer 1994].
    inputs = [[1], [2, 4], [5, 2], [7], [7], [7, 6], [9], [9, 6], [11, 2], [11, 1], [13], [10, 2], [14], [1, 6], [3], [4],
              [4], [16], [16], [17, 6], [19], [19], [1, 4], [19, 1], [20]]
    terms = {1: "-1 -10 -14 -23 -24 2 3 9 11 12 22 25", 2: "-2 -3 -9 -12 1 21", 3: "-15 1 17 19 22",
             4: "-2 -16 -17 -23 15", 5: "-3 4 4 6 7 13 20", 6: "-6 -8 -14 -20 3 18 18", 7: "-4 -5 -6 13", 8: "4 5 6 7",
             9: "-7 -8", 10: "-12 7 9", 11: "-9 -10 8 11", 12: "9", 13: "-11 10", 14: "-13 12", 15: "14",
             16: "-18 -19 16", 17: "-20", 18: "20", 19: "-21 -22 -24 23 25", 20: "-25 24"}
    terms = {i: [int(v) for v in line.split()] for i, line in terms.items()}
    def f(t, y):
        r = []
        for kj, species in zip(k, inputs):
            for i in species:
                kj = kj * y[i - 1]
            r.append(kj)
        return [sum((r[j - 1] if j > 0 else -r[-j - 1] for j in terms[i]), arb(0)) for i in range(1, 21)]
    def jac(t, y):
        J = [[arb(0)] * 20 for _ in range(20)]
        for i in range(1, 21):
            for j in terms[i]:
                species, kj = inputs[abs(j) - 1], k[abs(j) - 1] * (1 if j > 0 else -1)
                if len(species) == 1:
                    J[i - 1][species[0] - 1] += kj
                else:
                    a, b = species
                    J[i - 1][a - 1] += kj * y[b - 1]
                    J[i - 1][b - 1] += kj * y[a - 1]
        return J
    start = "0 .2 0 .04 0 0 .1 .3 .01 0 0 0 0 0 0 0 .007 0 0 0".split()
    return Stiff(f, jac, start, 60, [1e-6] * 20)


def arenstorf():
    mu = d("0.012277471")
    rest = 1 - mu
    def f(t, y):
        e2, m2 = (y[0] + mu) ** 2 + y[1] ** 2, (y[0] - rest) ** 2 + y[1] ** 2
        e, m = rest / (e2 * e2.sqrt()), mu / (m2 * m2.sqrt())
        return [y[2], y[3], y[0] + 2 * y[3] - e * (y[0] + mu) - m * (y[0] - rest),
                y[1] - 2 * y[2] - e * y[1] - m * y[1]]
    return Stiff(f, None, ["0.994", 0, 0, "-2.00158510637908252240537862224"], "17.0652165601579625588917206249", [1] * 4)


def pleiades():
    start = "3 3 -1 -3 2 -2 2 3 -3 2 0 0 -4 4 0 0 0 0 0 1.75 -1.5 0 0 0 -1.25 1 0 0".split()
    def f(t, y):
        a = [arb(0)] * 14
        for i in range(7):
            for j in range(7):
                if i != j:
                    dx, dy = y[j] - y[i], y[7 + j] - y[7 + i]
                    r2 = dx * dx + dy * dy
                    w = (j + 1) / (r2 * r2.sqrt())
                    a[i] += w * dx
                    a[7 + i] += w * dy
        return list(y[14:]) + a
    return Stiff(f, None, start, 3, [1] * 28)


def brusselator(cells=20):
    spread = d("0.02") * (cells + 1) ** 2
    def f(t, y):
        rates = []
        for i in range(cells):
            u, v = y[2 * i], y[2 * i + 1]
            ends = [(y[2 * i - 2] + y[2 * i + 2]) if 0 < i < cells - 1 else (y[2] if i == 0 else y[2 * i - 2]) + 1,
                    (y[2 * i - 1] + y[2 * i + 3]) if 0 < i < cells - 1 else (y[3] if i == 0 else y[2 * i - 1]) + 3]
            turn = u * u * v
            rates += [1 + turn - 4 * u + spread * (ends[0] - 2 * u), 3 * u - turn + spread * (ends[1] - 2 * v)]
        return rates
    start = []
    for i in range(cells):
        start += [1 + (2 * arb.pi() * (i + 1) / (cells + 1)).sin(), 3]
    return Stiff(f, None, start, 10, [1] * 2 * cells)


def ring_modulator(end="1e-4"):
    c, cs, cp, r, rp, lh, ls1, ls2, ls3, g1, g2, g3, ri, rc, gamma, delta = [d(v) for v in """1.6e-8 2e-12 1e-8 25000 50
        4.45 .002 5e-4 5e-4 36.3 17.3 17.3 50 600 40.67286402e-9 17.7493332""".split()]
    signs = [(2, -4, -6, -1), (-3, 5, -6, -1), (3, 4, 6, 1), (-2, -5, 6, 1)]  # of the voltages at the diodes, and the carrier
    def drops(t, y):
        high = 2 * (20000 * arb.pi() * t).sin()
        return [sum((y[abs(k)] * (1 if k > 0 else -1) for k in row[:3]), arb(0)) + row[3] * high for row in signs]
    flows = {2: (-1, 0, 0, 1), 3: (0, 1, -1, 0), 4: (1, 0, -1, 0), 5: (0, -1, 0, 1), 6: (1, 1, -1, -1)}
    size = {2: cs, 3: cs, 4: cs, 5: cs, 6: cp}
    J0 = [[arb(0)] * 15 for _ in range(15)]
    for i, row in {0: {7: 1 / c, 9: -1 / c / 2, 10: 1 / c / 2, 13: 1 / c, 0: -1 / r / c},
                   1: {8: 1 / c, 11: -1 / c / 2, 12: 1 / c / 2, 14: 1 / c, 1: -1 / r / c},
                   2: {9: 1 / cs}, 3: {10: -1 / cs}, 4: {11: 1 / cs}, 5: {12: -1 / cs}, 6: {6: -1 / rp / cp},
                   7: {0: -1 / lh}, 8: {1: -1 / lh}, 9: {0: 1 / ls2 / 2, 2: -1 / ls2, 9: -g2 / ls2},
                   10: {0: -1 / ls3 / 2, 3: 1 / ls3, 10: -g3 / ls3}, 11: {1: 1 / ls2 / 2, 4: -1 / ls2, 11: -g2 / ls2},
                   12: {1: -1 / ls3 / 2, 5: 1 / ls3, 12: -g3 / ls3}, 13: {0: -1 / ls1, 13: -(ri + g1) / ls1},
                   14: {1: -1 / ls1, 14: -(rc + g1) / ls1}}.items():
        for j, value in row.items():
            J0[i][j] = value
    linear = [[(j, v) for j, v in enumerate(row) if v != 0] for row in J0]
    def f(t, y):
        q = [gamma * ((delta * u).exp() - 1) for u in drops(t, y)]
        rates = [sum((v * y[j] for j, v in row), arb(0)) for row in linear]
        rates[13] += (2000 * arb.pi() * t).sin() / 2 / ls1
        for i, w in flows.items():
            rates[i] += sum((a * b for a, b in zip(w, q)), arb(0)) / size[i]
        return rates
    def jac(t, y):
        J = [list(row) for row in J0]
        for k, u in enumerate(drops(t, y)):
            slope = gamma * delta * (delta * u).exp()
            for i, w in flows.items():
                for m in signs[k][:3]:
                    J[i][abs(m)] += w[k] * slope * (1 if m > 0 else -1) / size[i]
        return J
    return Stiff(f, jac, [0] * 15, end, [1e-2] * 7 + [1e-5] * 8)


def extrapolate(problem, tolerance, columns=16):
    """Gragg's midpoint rule, extrapolated in h^2, for problems that are not stiff."""
    y, t, H, steps = [arb(v) for v in problem.start], arb(0), problem.end / 4096, 0
    while True:
        last = bool(t + H >= problem.end * (1 - arb(10) ** -40))
        if last:
            H = problem.end - t
        rows = []
        for k in range(columns):
            n = 2 * (k + 1)
            h = H / n
            before, now = y, [(a + h * b).mid() for a, b in zip(y, problem.f(t, y))]
            for i in range(1, n):
                slope = problem.f(t + i * h, now)
                before, now = now, [(a + 2 * h * b).mid() for a, b in zip(before, slope)]
            row = [now]
            for j in range(1, k + 1):
                factor = 1 / ((arb(k + 1) / (k + 1 - j)) ** 2 - 1)
                row.append([(a + (a - b) * factor).mid() for a, b in zip(row[-1], rows[-1][j - 1])])
            rows.append(row)
        off = max(abs(float(a - b)) for a, b in zip(rows[-1][-1], rows[-1][-2]))
        factor = min(4.0, max(0.2, 0.8 * (tolerance / max(off, 1e-60)) ** (1 / (2 * columns - 1))))
        if off > tolerance:
            H = (H * arb(factor)).mid()
            continue
        y, t, steps = rows[-1][-1], (t + H).mid(), steps + 1
        if last:
            return y, steps
        H = (H * arb(factor)).mid()


def brusselator_grid(cells, tolerance=1e-16, columns=8):
    """The same rule on arrays of 64-bit mantissas, for many cells; the tolerance is that of the last column."""
    import numpy as np
    real = np.longdouble
    spread, x = real("0.02") * (cells + 1) ** 2, np.arange(1, cells + 1).astype(real) / (cells + 1)
    u0, v0 = 1 + np.sin(8 * np.arctan(real(1)) * x), np.full(cells, real(3))
    def f(y):
        u, v = y
        rates = np.empty_like(y)
        for k, (w, end) in enumerate(((u, 1), (v, 3))):
            rates[k] = -2 * w
            rates[k, 1:] += w[:-1]
            rates[k, :-1] += w[1:]
            rates[k, 0] += end
            rates[k, -1] += end
        rates *= spread
        turn = u * u * v
        rates[0] += 1 + turn - 4 * u
        rates[1] += 3 * u - turn
        return rates
    y, t, end, H, steps = np.array([u0, v0]), real(0), real(10), real(1e-6), 0
    while t < end:
        H = min(H, end - t)
        rows, slope = [], f(y)
        for k in range(columns):
            n = 2 * (k + 1)
            h = H / n
            before, now = y, y + h * slope
            for _ in range(1, n):
                before, now = now, before + 2 * h * f(now)
            row = [now]
            for j in range(1, k + 1):
                row.append(row[-1] + (row[-1] - rows[-1][j - 1]) / ((real(k + 1) / (k + 1 - j)) ** 2 - 1))
            rows.append(row)
        off = float(np.max(np.abs(rows[-1][-1] - rows[-1][-2])))
        if not off < 1e30:
            H = H / 4
            continue
        factor = min(2.0, max(0.2, 0.8 * (tolerance / max(off, 1e-40)) ** (1 / (2 * columns - 1))))
        if off <= tolerance:
            y, t, steps = rows[-1][-1], t + H, steps + 1
        H = H * real(factor)
    return y.T.reshape(-1), steps


PROBLEMS = {
    "ROBER": (robertson, None), "HIRES": (hires, None), "OREGO": (oregonator, None),
    "VDPOL1e3": (lambda: van_der_pol(10 ** 3), None), "VDPOL1e4": (lambda: van_der_pol(10 ** 4), None),
    "VDPOL1e5": (lambda: van_der_pol(10 ** 5), None), "VDPOL1e6": (lambda: van_der_pol(10 ** 6), None),
    "E5": (e5, "1e-5"), "POLLU": (pollution, None), "ARENSTORF": (arenstorf, None), "PLEIADES": (pleiades, None),
    "BRUSSELATOR40": (brusselator, None), "RINGMOD": (ring_modulator, "1e-9"),
}

for name in sys.argv[1:] or PROBLEMS:
    if name in ("BRUSSELATOR400", "BRUSSELATOR2000"):
        # Every twentieth cell is enough.
        cells = int(name[11:]) // 2
        (coarse, few), (fine, many) = brusselator_grid(cells, 1e-14), brusselator_grid(cells, 1e-16)
        print(f"{name}: {few} and {many} steps", flush=True)
        for i in range(0, 2 * cells, 2 * cells // 10):
            for j in (i, i + 1):
                print(f"  [{j + 1}] = {fine[j]:.19g}  (differs by {abs(coarse[j] - fine[j]):.0e})", flush=True)
        continue
    make, first = PROBLEMS[name]
    problem = make()
    if problem.jacobian is None:
        (coarse, few), (fine, many) = extrapolate(problem, 1e-26), extrapolate(problem, 1e-30)
    else:
        (coarse, few), (fine, many) = solve(problem, 9, 1e-15, first), solve(problem, 11, 1e-18, first)
    print(f"{name}: {few} and {many} steps", flush=True)
    for a, b in zip(coarse, fine):
        off = abs(float(a - b)) / max(abs(float(b)), 1e-300)
        print(f"  {b.str(22, radius=False)}  (differs by {off:.0e})", flush=True)
