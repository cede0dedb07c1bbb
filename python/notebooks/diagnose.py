# %% [markdown]
# # Diagnose a model that disagrees with a measured record
# The record here is simulated: a machine with cogging (a force ripple of 3 N along the position) that its description does not have. With
# your own records, pass the path of a CSV, MAT or HDF5 file instead of the arrays.

# %%
import matplotlib.pyplot as plt
import numpy as np

import tribode

described = tribode.Machine(tribode.models / "linear_motor_table.lua").with_(noise_rms_m=2e-8)
ripple = {"name": "force_ripple", "parameters": {"harmonics": [{"F": 3.0, "period_m": 0.008, "phase": 0.4}]}}
real = described.with_(effects=[ripple])

t = np.arange(6000) * described.Ts
reference = 0.02 * np.sin(2 * np.pi * 0.7 * t) + 0.005 * np.sin(2 * np.pi * 1.9 * t)
measured = tribode.simulate(real, r=reference, seed=3)
record = {"t": measured.t, "r": measured.r, "u": measured.u, "y": measured.y}

# %%
found = tribode.diagnose(described, record, progress=True)
print(found["verdict"])
for effect in found["effects"]:
    print(f"{effect['name']}, probability {effect['probability']:.3f}: {effect['parameters']}")
print(found["where"])

# %% [markdown]
# The last third of the record was not used in the fit. There, measured minus simulated position:

# %%
kept = found["validation"][0]
figure, axes = plt.subplots(figsize=(8, 3.5), layout="constrained")
validated = slice(kept["first"], None)
for label, simulated in (("as described", kept["y_before"]), ("with " + found["effects"][0]["name"], kept["y_after"])):
    axes.plot(kept["t"][validated], 1e6 * (kept["y_measured"] - simulated)[validated], label=label)
axes.set(xlabel="Time [s]", ylabel="Measured minus simulated [µm]")
axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
figure.savefig("diagnose.png")
assert found["verdict"] == "effect_found" and found["effects"][0]["name"] == "force_ripple"

# %% [markdown]
# `found["machine"]` is the machine with the effect, ready for the next simulation.

# %%
found["machine"].effects
