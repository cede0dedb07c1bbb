"""What a call of tribode.simulate from Python costs besides the run: paired in each call, wall time less that in the engine."""

import statistics
import time

import numpy as np

import tribode

machine = tribode.Machine(tribode.models / "linear_motor_table.lua")
print("machine              samples  engine us  call us  overhead us (median)  overhead us (90 %)")
for samples in (10, 200, 2000, 20000):
    r = 1e-3 * np.sin(2 * np.pi * 2 * np.arange(samples) * machine.Ts)
    calls, overheads = [], []
    for _ in range(max(100, 200000 // samples // 10)):
        start = time.perf_counter()
        run = tribode.simulate(machine, r=r)
        wall = time.perf_counter() - start
        calls.append(wall)
        overheads.append(wall - run.seconds)
    call, overhead = statistics.median(calls), statistics.median(overheads)
    high = sorted(overheads)[int(0.9 * len(overheads))]
    print(
        f"linear_motor_table   {samples:7} {1e6 * (call - overhead):10.1f} {1e6 * call:8.1f} {1e6 * overhead:21.1f} {1e6 * high:19.1f}"
    )
