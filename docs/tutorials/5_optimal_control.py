"""
Compare with optimal control
============================

How far is an agent from what is physically possible? Optimal trajectories, certified bounds and tuned
controllers answer.
"""

# %%
# A minimum-time trajectory
# -------------------------
# The optimizer may open thrusters partly, which on/off valves cannot do: a real platform needs more time than
# this. Drake flies every trajectory as a check.
import matplotlib.pyplot as plt

import rans
from rans.evaluation.measure.metrics import samples

start = 3  # number of a start that agents are evaluated on
optimum = rans.optimal_trajectory("go-to-pose", objective="time", start=start)
print(optimum.status, f"{optimum.trajectory.cost:.2f} s")

figure, (path, commands) = plt.subplots(
    1, 2, figsize=(9, 3.6), layout="constrained"
)
path.plot(optimum.x[:, 0], optimum.x[:, 1], ".-")
path.plot(*optimum.x[0, :2], "o", color="tab:green", label="start")
path.plot(*optimum.x[-1, :2], "*", color="tab:red", markersize=12, label="goal")
path.set(xlabel="x, m", ylabel="y, m", aspect="equal")
path.legend()
commands.imshow(
    optimum.u.T,
    aspect="auto",
    cmap="Oranges",
    extent=(0, optimum.t[-1], 7.5, -0.5),
)
commands.set(
    xlabel="time, s", ylabel="thruster", title="opening of each thruster"
)
plt.show()

# %%
# A certified bound
# -----------------
# No on/off controller that changes its commands every 0.5 s arrives at rest sooner than the lower bound. An
# exhaustive search proves this. The upper bound comes with commands that reach it.
bound = rans.certify("go-to-pose", start=start, control_period=0.5, seconds=10)
print(
    f"arrival takes at least {bound.lower:.1f} s, and {bound.upper:.1f} s suffice"
)

# %%
# Agents and controllers from the same starts
# -------------------------------------------
# LQR, phase-plane switching and MPC need no training; LQR and switching are tuned.
comparison = rans.compare(
    "go-to-pose-2d-trade-off#0",
    "go-to-pose-2d-thrifty",
    beside=["lqr", "switching"],
    episodes=64,
    workers=1,
)
comparison

# %%
# Time against impulse
# --------------------
# Each point is one flight. Fast agents pay in impulse; a fuel-efficient agent takes longer. No single number
# ranks them.
figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
for name in (
    "go-to-pose-2d-trade-off#0",
    "go-to-pose-2d-thrifty",
    "lqr:go-to-pose-2d",
    "switching:go-to-pose-2d",
):
    measured = {
        one.name: one.numbers for one in samples(rans.load_agent(name).fly(64))
    }
    axes.scatter(
        measured["settling time"],
        measured["impulse"],
        s=12,
        label=name.partition(":")[0],
    )
axes.set(xlabel="settling time, s", ylabel="impulse in 25 s, N s")
axes.legend()
plt.show()

# %%
# Next
# ----
# ``rans compare RUN`` writes a page with these figures, the certified bounds of every start, and the worst
# flights. ``rans optimal go-to-pose --objective fuel --certify`` bounds the impulse. The page *Certified bounds*
# has the theory.
