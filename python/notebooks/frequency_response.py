# %% [markdown]
# # Measure a frequency response
# A sine sweep in closed loop, analyzed in three ways, and the modal parameters that each gives. Friction bends the response from thrust
# to position (FRA-1); the friction model-based analysis (Proposed) corrects that.

# %%
import matplotlib.pyplot as plt
import numpy as np

import tribode

machine = tribode.Machine(tribode.models / "linear_motor_table.lua")
frequency = np.geomspace(10, 200, 200)
sweep = tribode.sweep(machine, frequency, amplitude_N=15.0, progress=True)
truth = tribode.plant_response(machine, frequency)
sweep

# %%
figure, (gain, phase) = plt.subplots(2, 1, figsize=(8, 6), sharex=True, layout="constrained")
for name, response in sweep.responses.items():
    gain.semilogx(response.frequency_hz, response.gain_db, label=name)
    phase.semilogx(response.frequency_hz, response.phase_deg)
gain.semilogx(truth.frequency_hz, truth.gain_db, "k--", label="plant without friction")
phase.semilogx(truth.frequency_hz, truth.phase_deg, "k--")
gain.set(ylabel="Gain [dB]")
gain.legend()
phase.set(xlabel="Frequency [Hz]", ylabel="Phase [deg]")
figure.savefig("frequency_response.png")

# %% [markdown]
# The modal fit: rigid gain and first mode beside the truth.

# %%
known = tribode.plant_parameters(machine)
print(f"{'':10} {'k0 [1/kg]':>10} {'f1 [Hz]':>9} {'zeta1':>8}")
print(f"{'truth':10} {known['k0']:10.5f} {known['f1_hz']:9.3f} {known['zeta1']:8.4f}")
for name, response in sweep.responses.items():
    fit = tribode.fit_modal(response)
    print(f"{name:10} {fit['k0']:10.5f} {fit['f1_hz']:9.3f} {fit['zeta1']:8.4f}")

# %%
proposed = sweep.responses["Proposed"]
errors = {
    name: np.abs(np.log(np.abs(response.value / truth.value))).mean() for name, response in sweep.responses.items()
}
assert errors["Proposed"] < errors["FRA-1"], errors
errors
