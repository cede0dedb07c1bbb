"""Reference values of Robertson's problem at t = 0.4, 4 ... 4e10, and its roots, for tests/scripts/system_problems.lua.

Collocation at the Radau points of twelve stages (order 23) in 40 digits, steps that grow with the time. Solved with two
growths; what both agree in is printed. Needs mpmath; a few minutes.
"""
from mpmath import mp, mpf, matrix, lu_solve, polyroots, taylor, legendre, quad, nstr

mp.dps = 40
STAGES = 12
K1, K2, K3 = mpf("0.04"), mpf(10) ** 4, 3 * mpf(10) ** 7


def radau_nodes(s):
    """Roots of P_s(2c - 1) - P_{s-1}(2c - 1): the right one is 1."""
    shifted = lambda n: [(-1) ** (n + k) * mp.binomial(n, k) * mp.binomial(n + k, k) for k in range(n, -1, -1)]
    a, b = shifted(s), [mpf(0)] + shifted(s - 1)
    return sorted(r.real for r in polyroots([x - y for x, y in zip(a, b)], maxsteps=500, extraprec=400))


def integrals(nodes):
    """a_ij, the integral of the j-th Lagrange polynomial up to c_i."""
    rows = [[mpf(0)] * len(nodes) for _ in nodes]
    for j, cj in enumerate(nodes):
        poly = [mpf(1)]
        for k, ck in enumerate(nodes):
            if k != j:
                poly = [((poly[i - 1] if i > 0 else 0) - ck * (poly[i] if i < len(poly) else 0)) / (cj - ck)
                        for i in range(len(poly) + 1)]
        for i, ci in enumerate(nodes):
            rows[i][j] = sum(p * ci ** (n + 1) / (n + 1) for n, p in enumerate(poly))
    return rows


NODES = radau_nodes(STAGES)
A = integrals(NODES)


def rate(y):
    y3 = 1 - y[0] - y[1]
    r1 = -K1 * y[0] + K2 * y[1] * y3
    return [r1, -r1 - K3 * y[1] ** 2]


def jacobian(y):
    y3 = 1 - y[0] - y[1]
    a, b = -K1 - K2 * y[1], K2 * (y3 - y[1])
    return [[a, b], [-a, -b - 2 * K3 * y[1]]]


def step(y, h):
    """The stages from Newton's method; the last one is the end of the step."""
    s = STAGES
    stages = [list(y) for _ in range(s)]
    for _ in range(60):
        rates = [rate(v) for v in stages]
        slopes = [jacobian(v) for v in stages]
        residual, J = matrix(2 * s, 1), matrix(2 * s, 2 * s)
        for i in range(s):
            for c in range(2):
                residual[2 * i + c] = stages[i][c] - y[c] - h * sum(A[i][j] * rates[j][c] for j in range(s))
                for j in range(s):
                    for d in range(2):
                        J[2 * i + c, 2 * j + d] = (1 if i == j and c == d else 0) - h * A[i][j] * slopes[j][c][d]
        change = lu_solve(J, residual)
        for i in range(s):
            for c in range(2):
                stages[i][c] -= change[2 * i + c]
        if max(abs(change[i]) / (abs(stages[i // 2][i % 2]) + mpf(10) ** -30) for i in range(2 * s)) < mpf(10) ** -30:
            return stages[-1]
    raise RuntimeError("Newton's method does not settle")


def root(t, y, h, g, wanted):
    """The time in the step at which g is as wanted, by the secant method."""
    low, high = mpf(0), h
    f_low, f_high = g(y) - wanted, g(step(y, h)) - wanted
    while abs(high - low) > abs(t + h) * mpf(10) ** -28:
        middle = high - f_high * (high - low) / (f_high - f_low)
        low, f_low = high, f_high
        high, f_high = middle, g(step(y, middle)) - wanted
        if f_high == 0:
            break
    return t + high


def solve(growth):
    y, t, h = [mpf(1), mpf(0)], mpf(0), mpf(10) ** -5
    values = []
    for decade in range(12):
        end = mpf("0.4") * mpf(10) ** decade
        while t < end:
            h = min(h, end - t)
            after = step(y, h)
            for g, wanted in ((lambda v: 1 - v[0] - v[1], mpf("0.01")), (lambda v: v[0], mpf("0.0001"))):
                if (g(y) - wanted) * (g(after) - wanted) < 0:
                    values.append(root(t, y, h, g, wanted))
            y, t = after, t + h
            h = max(h, t * growth)
        values += [y[0], y[1], 1 - y[0] - y[1]]
    return values


coarse, fine = solve(mpf("0.5")), solve(mpf("0.3"))
for a, b in zip(coarse, fine):
    print(nstr(b, 20), "differs by", nstr(abs(a - b) / b, 2))
