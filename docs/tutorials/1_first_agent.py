"""
First agent
===========

Train an agent that flies a floating platform to a pose, measure it, and plot its flights.
"""

# %%
# Train
# -----
# The task *go-to-pose* asks for a position and a heading: within 5 cm and 5 degrees for the last fifth of 25 s.
# The spacecraft is the floating platform of the RANS paper, 5.32 kg with eight on/off thrusters of 1 N.
# Training stops as soon as 99.5 % of the test episodes are solved, which takes seconds.
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import rans

folder = Path(tempfile.mkdtemp()) / "first"
agent = rans.train("go-to-pose", output=folder)
agent

# %%
# Measure
# -------
# Evaluation flies episodes whose starts no training has seen. Every value has a 95 % interval.
metrics = agent.evaluate(episodes=256)
for name in (
    "solved",
    "settling time",
    "impulse",
    "position error",
    "attitude error",
):
    value = metrics[name]
    interval = f"{value.low:.3g} to {value.high:.3g}"
    print(f"{name:>14}: {value.value:.3g} {value.unit} ({interval})")

# %%
# Fly
# ---
# A flight holds states, commands and errors over time. Here are sixteen episodes: the position error of each,
# and the thrusters of the first one.
flight = agent.fly(16)
figure, (errors, valves) = plt.subplots(
    2, 1, figsize=(8, 6), layout="constrained"
)
errors.semilogy(
    flight.times, 100 * np.asarray(flight.errors()["position"]), linewidth=1
)
errors.axhline(5, color="black", linestyle="--", label="tolerance, 5 cm")
errors.set(xlabel="time, s", ylabel="position error, cm")
errors.legend()
valves.imshow(
    np.asarray(flight.commands)[:, 0].T,
    aspect="auto",
    cmap="Oranges",
    extent=(0, 25, 7.5, -0.5),
)
valves.set(
    xlabel="time, s",
    ylabel="thruster",
    title="open thrusters of the first episode",
)
plt.show()

# %%
# Act
# ---
# An agent is a function from observations to commands. In a Gymnasium loop:
import gymnasium

env = gymnasium.make("rans/GoToPose2D-v0")
observation, _ = env.reset(seed=0)
total = 0.0
for _ in range(125):
    observation, reward, terminated, truncated, _ = env.step(
        agent.act(observation)
    )
    total += float(reward)
    if terminated or truncated:
        break
print(f"return {total:.1f}")

# %%
# Next
# ----
# This agent is quick to train and fires more than it needs. ``rans train go-to-pose --quality good`` trains for
# minutes and uses less impulse. ``agent.view()`` replays flights in three dimensions, ``agent.compare("lqr")``
# flies an LQR from the same starts, and ``agent.export(folder, "onnx")`` writes it for a robot.
