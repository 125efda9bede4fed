"""
Your own spacecraft, with slow valves
=====================================

Describe a platform with six thrusters and slow valves, see whether an agent flies it, and export it for a robot.
"""

# %%
# Describe the spacecraft
# -----------------------
# A spacecraft is a TOML file or, as here, a value. Each thruster has a position (m), the direction of the force
# on the body, and a force (N). RANS derives torques, and warns if the thrusters cannot push and turn in every
# direction.
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt

import rans

craft = rans.Spacecraft.planar(
    "slider6",
    mass=6.0,
    inertia=0.15,
    thrusters=[
        ((-0.2, 0.12), (1, 0), 1.0),
        ((-0.2, -0.12), (1, 0), 1.0),
        ((0.2, 0.12), (-1, 0), 1.0),
        ((0.2, -0.12), (-1, 0), 1.0),
        ((0.0, -0.2), (0, 1), 1.0),
        ((0.0, 0.2), (0, -1), 1.0),
    ],
)
craft

# %%
# Describe what is uncertain
# --------------------------
# The valves open up to 60 ms after a command and need up to 30 ms to full force. The mass is known to 10 %, and
# the motion capture has 5 mm of noise. Every episode samples its own values; the agent does not observe them.
# Ranges begin at nominal: an agent that never flew without delay may fail there.
conditions = rans.Conditions(
    body=rans.BodyConditions(mass=(0.9, 1.1)),
    thrusters=rans.ThrusterConditions(latency=(0.0, 0.06), rise=(0.0, 0.03)),
    sensors=rans.SensorsConditions(position=rans.SensorConditions(noise=0.005)),
)
conditions

# %%
# Does it need a training?
# ------------------------
# The agent for any craft flies it from its file.
folder = Path(tempfile.mkdtemp())
file = folder / "slider6.toml"
rans.init_spacecraft("slider6", base=craft).write(file)
agent = rans.load_agent(f"any-craft-2d@{file}").under(conditions)
metrics = agent.evaluate(episodes=256)
for name in ("solved", "settling time", "impulse", "position error"):
    value = metrics[name]
    interval = f"{value.low:.3g} to {value.high:.3g}"
    print(f"{name:>14}: {value.value:.3g} {value.unit} ({interval})")

# %%
# Sixteen flights, from their starts to the goal at the origin:
flight = agent.fly(16)
figure, axes = plt.subplots(figsize=(5, 4), layout="constrained")
way = flight.states.p - flight.goals.p
axes.plot(way.x, way.y, linewidth=1)
axes.plot(0, 0, "k+", markersize=12)
axes.set(xlabel="x, m", ylabel="y, m", aspect="equal")
plt.show()

# %%
# Where it loses flights, ``rans.train("go-to-pose", craft, conditions="lab", quality="good")`` makes an agent
# with a memory, for late valves and uneven floors, in minutes on a GPU.
lab = agent.under("lab").evaluate(episodes=256)
print(f"in lab: {lab['solved'].value:.1f} % solved")

# %%
# Export
# ------
# The folder runs on a computer that has NumPy and nothing else. Its test vectors check that the exported agent
# gives the same commands.
robot = agent.export(folder / "robot", "numpy", episodes=64)
print(sorted(file.name for file in robot.iterdir()))
print(
    subprocess.run(
        [sys.executable, "agent.py"], cwd=robot, capture_output=True, text=True
    ).stdout
)

# %%
# The contract says what to connect: the columns of the observation and the order of the thrusters.
contract = json.loads((robot / "contract.json").read_text())
for column in contract["tasks"][0]["columns"]:
    print(f"{column['name']:>14} {column['unit']}")
print("control period:", contract["control_period"], "s")

# %%
# Next
# ----
# ``rans twin slider6.toml`` simulates the robot on your network and ``rans fly`` flies the agent on it, over
# ROS 2's DDS, Zenoh or PX4. Before a real flight read the checklist of *Fly an agent on a robot*.
