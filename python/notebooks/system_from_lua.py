# %% [markdown]
# # A system of equations
# Any system of differential equations with events, written in Lua and run from Python: a bouncing ball, and a mass on a belt that
# sticks and slips. Ready systems are in `tribode.models / "systems"`.

# %%
import matplotlib.pyplot as plt
import numpy as np

import tribode

system = tribode.System.from_lua("""
local tb = require "tribode"
return tb.system {
  name = "ball",
  parameters = { g = { value = 9.81, unit = "m/s2" }, e = 0.8 },
  states = { h = { start = 1, unit = "m" }, v = { start = 0, unit = "m/s" } },
  der = function(s) return { h = s.v, v = -s.g } end,
  when = {
    { name = "impact", crossing = function(s) return s.h end, set = function(s) return { h = 0, v = -s.e * s.v } end },
  },
}
""")
run = system.run(duration_s=3.0, output_events=True)
print(run, f"{len(run.events)} impacts, the first at {run.events['t'][0]:.6f} s")

figure, axes = plt.subplots(figsize=(8, 3.5), layout="constrained")
axes.plot(run.t, run["h"])
axes.plot(run.events["t"], np.zeros(len(run.events)), "r.", label="impacts")
axes.set(xlabel="Time [s]", ylabel=f"Height [{run.table.units['h']}]")
axes.legend()
figure.savefig("system_ball.png")
assert abs(run.events["t"][0] - np.sqrt(2 / 9.81)) < 1e-12

# %% [markdown]
# The same system with other parameters, in threads.

# %%
from concurrent.futures import ThreadPoolExecutor

restitution = np.linspace(0.6, 0.95, 8)
with ThreadPoolExecutor() as pool:
    runs = list(pool.map(lambda e: system.run(duration_s=1.5, parameters={"e": e}), restitution))

figure, axes = plt.subplots(figsize=(8, 3.5), layout="constrained")
for e, one in zip(restitution, runs):
    axes.plot(one.t, one["h"], color=plt.cm.viridis(e), label=f"{e:.2f}")
axes.set(xlabel="Time [s]", ylabel="Height [m]")
axes.legend(title="Restitution", loc="center left", bbox_to_anchor=(1, 0.5))
figure.savefig("system_restitution.png")

# %% [markdown]
# A file: stick-slip of a mass on a belt.

# %%
stick_slip = tribode.System.from_lua(tribode.models / "systems/stick_slip.lua")
run = stick_slip.run(duration_s=20)
figure, axes = plt.subplots(figsize=(8, 3.5), layout="constrained")
names = [state["name"] for state in stick_slip.variables["states"]]
for name in names:
    axes.plot(run.t, run[name], label=f"{name} [{run.table.units[name]}]")
axes.set(xlabel="Time [s]")
axes.legend(loc="center left", bbox_to_anchor=(1, 0.5))
figure.savefig("system_stick_slip.png")
assert len(run.events) > 2
