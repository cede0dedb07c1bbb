"""The servo loop as a fixed-step loop compiled by Numba: classical Runge-Kutta, 27 states (position and velocity of the
rigid body and of two modes, thrust, the deflection of twenty elements). An element that passes its limit in a step is put
onto it and rests until the velocity reverses.

    python3 numba_rk4.py SCENARIOS.json

The file is the one that tribode_benchmarks writes. Prints scenario,method,us_per_sample,error_m,events; the times are the
process's, medians of five runs, compilation left out.
"""
import json
import math
import statistics
import sys
import time

try:
    import numba
    import numpy as np
except ImportError as error:
    sys.exit(f"numba_rk4.py: skipped, {error}")


@numba.njit
def derivative(s, slips, thrust_reference, gain, damping, stiffness, viscous, lag, k, d, out):
    v = s[1] + s[3] + s[5]
    friction = viscous * v
    for i in range(20):
        friction += k[i] * s[7 + i]
        if slips[i]:
            out[7 + i] = 0.0
        else:
            out[7 + i] = v
            friction += d[i] * v
    effective = (s[6] if lag > 0 else thrust_reference) - friction
    for j in range(3):
        out[2 * j] = s[2 * j + 1]
        out[2 * j + 1] = gain[j] * effective - damping[j] * s[2 * j + 1] - stiffness[j] * s[2 * j]
    out[6] = lag * (thrust_reference - s[6])


@numba.njit
def simulate(divisions, ts, excitation, loop, gain, damping, stiffness, viscous, lag, k, d, limit, position):
    kp, ki, kd, resolution = loop  # resolution 0: open loop
    s, moved = np.zeros(27), np.zeros(27)
    k1, k2, k3, k4 = np.zeros(27), np.zeros(27), np.zeros(27), np.zeros(27)
    slips = np.zeros(20, np.bool_)
    h = ts / divisions
    detected = last_error = integral = waiting = v_before = 0.0
    events = 0
    for sample in range(excitation.size):
        if resolution > 0:
            error = -detected
            detected = resolution * math.floor(position[sample] / resolution + 0.5)
            integral += ki * ts * error
            thrust = waiting
            waiting = kp * error + integral + kd * (error - last_error) / ts + excitation[sample]
            last_error = error
        else:
            thrust = excitation[sample]
        for _ in range(divisions):
            derivative(s, slips, thrust, gain, damping, stiffness, viscous, lag, k, d, k1)
            for i in range(27):
                moved[i] = s[i] + h / 2 * k1[i]
            derivative(moved, slips, thrust, gain, damping, stiffness, viscous, lag, k, d, k2)
            for i in range(27):
                moved[i] = s[i] + h / 2 * k2[i]
            derivative(moved, slips, thrust, gain, damping, stiffness, viscous, lag, k, d, k3)
            for i in range(27):
                moved[i] = s[i] + h * k3[i]
            derivative(moved, slips, thrust, gain, damping, stiffness, viscous, lag, k, d, k4)
            for i in range(27):
                s[i] += h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i])
            v = s[1] + s[3] + s[5]
            reversed_now = v * v_before < 0
            v_before = v
            for i in range(20):
                if slips[i]:
                    slips[i] = not reversed_now
                elif abs(s[7 + i]) > limit[i] and s[7 + i] * v > 0:
                    s[7 + i] = math.copysign(limit[i], s[7 + i])
                    slips[i] = True
                    events += 1
            events += reversed_now
        position[sample + 1] = s[0] + s[2] + s[4]
    return events


def arguments_of(scenario):
    omega = [0.0] + [2 * math.pi * freq_hz for _, freq_hz, _ in scenario["modes"]]
    zeta = [0.0] + [z for _, _, z in scenario["modes"]]
    gain = [scenario["rigid_gain"]] + [g for g, _, _ in scenario["modes"]]
    k, f, d = np.array(scenario["elements"]).T
    loop = scenario["loop"] or {"kp": 0, "ki": 0, "kd": 0, "encoder_resolution": 0}
    return (
        scenario["sample_time"],
        np.array(scenario["excitation"]),
        tuple(float(loop[key]) for key in ("kp", "ki", "kd", "encoder_resolution")),
        np.array(gain),
        np.array([2 * z * w for z, w in zip(zeta, omega)]),
        np.array([w * w for w in omega]),
        float(scenario["viscous"]),
        2 * math.pi * scenario["lag_hz"],
        k.copy(),
        d.copy(),
        f / k,
    )


def main():
    with open(sys.argv[1]) as file:
        scenarios = json.load(file)
    for scenario in scenarios:
        arguments = arguments_of(scenario)
        position = np.zeros(len(scenario["position"]))
        simulate(1, *arguments, position)  # compiles
        for divisions in (10, 100):
            seconds = []
            for _ in range(5):
                start = time.process_time()
                events = simulate(divisions, *arguments, position)
                seconds.append(time.process_time() - start)
            us = 1e6 * statistics.median(seconds) / (position.size - 1)
            error = np.abs(position - scenario["position"]).max()
            print(f"{scenario['name']},Numba RK4 {500 / divisions:g} us,{us},{error},{events}", flush=True)


main()
