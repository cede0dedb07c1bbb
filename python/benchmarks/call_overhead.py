"""What a call of tribode.simulate from Python costs besides the run itself.

Paired in each call: its wall time less the time of the run inside the engine, which is what the program and C++ need for
the same run. The call includes the look at the input and the release of the result before it.
"""

import statistics
import time

import numpy as np

import tribode

machine = tribode.Machine(tribode.models / "linear_motor_table.lua")
print("samples     run us    call us   besides the run us: median   90 %")
for samples in (10, 200, 2000, 20000, 100000):
    r = 1e-3 * np.sin(2 * np.pi * 2 * np.arange(samples) * machine.Ts)
    calls, besides = [], []
    for _ in range(max(50, min(1000, 2000000 // samples))):
        start = time.perf_counter()
        run = tribode.simulate(machine, r=r)
        calls.append(1e6 * (time.perf_counter() - start))
        besides.append(calls[-1] - 1e6 * run.seconds)
    call, beside = statistics.median(calls), statistics.median(besides)
    high = sorted(besides)[int(0.9 * len(besides))]
    print(f"{samples:7} {call - beside:10.1f} {call:10.1f} {beside:28.1f} {high:6.1f}")
