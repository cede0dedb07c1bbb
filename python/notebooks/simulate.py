# %% [markdown]
# # Simulate a servo axis with friction
# A ready machine, its friction while it moves, and what a worse encoder does. Quantities are in SI units.

# %%
import matplotlib.pyplot as plt
import numpy as np

import tribode

machine = tribode.Machine(tribode.models / "linear_motor_table.lua")
machine

# %% [markdown]
# The controller of the machine follows a reference: a sine of 1 mm at 2 Hz.

# %%
t = np.arange(2000) * machine.Ts
reference = 1e-3 * np.sin(2 * np.pi * 2 * t)
run = tribode.simulate(machine, r=reference)
print(
    f"{len(run.t)} samples, {len(run.events)} stick-slip transitions, solver {run.solver}, {1e3 * run.seconds:.1f} ms"
)

figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.5), layout="constrained")
left.plot(run.t, 1e3 * reference, "k--", label="reference")
left.plot(run.t, 1e3 * run.x, label="position")
left.set(xlabel="Time [s]", ylabel="Position [mm]")
left.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
right.plot(1e3 * run.x, run.f)
right.set(xlabel="Position [mm]", ylabel="Friction [N]", title="Rolling friction: a loop with memory")
figure.savefig("simulate_friction.png")

# %% [markdown]
# `with_` makes another machine. A coarser encoder makes the thrust rough:

# %%
figure, axes = plt.subplots(figsize=(7, 3.5), layout="constrained")
for resolution in (1e-5, 1e-6, 1e-7):
    coarse = tribode.simulate(machine.with_(encoder_resolution_m=resolution), r=reference)
    axes.plot(t[:400], coarse.u[:400], label=f"{1e6 * resolution:g} µm")
axes.set(xlabel="Time [s]", ylabel="Thrust [N]")
axes.legend(title="Resolution", loc="center left", bbox_to_anchor=(1, 0.5))
figure.savefig("simulate_encoders.png")

# %% [markdown]
# Runs are independent: threads use all processors, because the engine works without Python's lock.

# %%
from concurrent.futures import ThreadPoolExecutor

scales = np.linspace(0.5, 1.5, 21)


def peak_error(scale):
    other = machine.with_(scale={"friction.elements[*].F": scale})
    return np.abs(reference - tribode.simulate(other, r=reference).x).max()


with ThreadPoolExecutor() as pool:
    errors = np.array(list(pool.map(peak_error, scales)))

figure, axes = plt.subplots(figsize=(7, 3.5), layout="constrained")
axes.plot(scales, 1e6 * errors, "o-")
axes.set(xlabel="Friction, relative to the described one", ylabel="Largest tracking error [µm]")
figure.savefig("simulate_friction_scale.png")
assert errors[-1] > errors[0]
