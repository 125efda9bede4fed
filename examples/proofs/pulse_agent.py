"""Write a small on/off agent that goes to a pose and stays there, as a run folder for `rans prove`.

    python examples/proofs/pulse_agent.py pulse-agent
    rans prove pulse-agent --property position=0.05,heading=5 --from position=0.015,heading=1.5
    rans evaluate pulse-agent

The craft is the floating platform with a control period of 0.1 s: at 0.2 s one pulse of a couple turns it by 0.06
rad before the next decision, and no dead-banded law keeps 5 degrees. The network is such a law, so that nothing is
trained: along each axis (the diagonals of the body frame, as the thrusters push) and about the third one it
pulses where the clipped error less a time times the rate is beyond a dead band. A couple of thrusters makes each
pulse. Thrust along the axes begins when the heading is near its goal. The layers have 14 and 6 units of ReLU.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import numpy as np
import torch

from rans.extend import write_text
from rans.fast.agent_files.agent import actor_bytes
from rans.policy.architecture import Architecture
from rans.tasks.derived import layout
from rans.tasks.go_to_pose import GoToPose

PERIOD = 0.1  # s
PLACE = (0.08, 0.8, 0.02)  # m, s, m: farthest error that counts, time of the rate, dead band
HEADING = (0.08, 0.25, 0.03)  # of the sine of the heading error, s, of that sine
GATE = 0.07  # sine of the heading error up to which the craft moves along its axes
STEEP = 1000.0  # log-odds per m
STEEP_HEADING = 500.0  # log-odds per unit of the sine
SHUT = 1e5  # log-odds per unit of the sine beyond the gate
LEAST = 0.1  # log-odds by which a dead band is wider
AXES = np.array([[1.0, -1.0], [1.0, 1.0]]) * math.sqrt(0.5)  # rows: axes in the body frame
OPENED = [(0, 5), (1, 4), (2, 7), (3, 6), (1, 5), (0, 4)]
"""Thrusters of the pulses along +, - of the first axis, of the second one, and about +, -."""


def network() -> dict[str, np.ndarray]:
    """Weights, by their names in an agent's file.

    Columns are velocity (2), spin, the task's flag, way to the goal (2), cosine and sine of the heading error.
    """
    first, shift = np.zeros((14, 8)), np.zeros(14)
    second, bias = np.zeros((6, 14)), np.zeros(6)
    errors = [np.zeros(8) for _ in range(3)]
    rates = [np.zeros(8) for _ in range(3)]
    for axis in (0, 1):
        errors[axis][4:6] = AXES[axis]
        rates[axis][:2] = AXES[axis]
    errors[2][7] = 1.0
    rates[2][2] = 1.0
    for number, (error, rate) in enumerate(zip(errors, rates, strict=True)):
        largest, time, band = HEADING if number == 2 else PLACE
        steep = STEEP_HEADING if number == 2 else STEEP
        unit = 4 * number
        # The clipped error is relu(e + largest) - relu(e - largest) - largest, and the rate has two units.
        first[unit : unit + 4] = error, error, rate, -rate
        shift[unit : unit + 2] = largest, -largest
        towards = steep * np.array([1.0, -1.0, -time, time])
        second[2 * number, unit : unit + 4] = towards
        second[2 * number + 1, unit : unit + 4] = -towards
        bias[2 * number] = steep * (-largest - band)
        bias[2 * number + 1] = steep * (largest - band)
    first[12:] = errors[2], -errors[2]
    shift[12:] = -GATE
    second[:4, 12:] = -SHUT
    head = np.zeros((16, 6))
    for number, pair in enumerate(OPENED):
        for thruster in pair:
            head[2 * thruster + 1, number] = 1.0
    least = np.zeros(16)
    least[1::2] = -LEAST
    return {
        "features_extractor.trunk.0.weight": first,
        "features_extractor.trunk.0.bias": shift,
        "features_extractor.trunk.2.weight": second,
        "features_extractor.trunk.2.bias": bias,
        "action_net.weight": head,
        "action_net.bias": least,
        "features_extractor.mean": np.zeros(8),
        "features_extractor.variance": np.full(8, 1.0 - 1e-6),
        "features_extractor.count": np.ones(()),
    }


def write_agent(folder: Path) -> None:
    """Write the run folder."""
    folder.mkdir(parents=True, exist_ok=True)
    architecture = Architecture(layout(GoToPose(), 2), 8, (14, 6), activation="relu")
    weights = {name: torch.tensor(x, dtype=torch.float32) for name, x in network().items()}
    (folder / "agent.safetensors").write_bytes(actor_bytes(architecture, weights, 1))
    config = {
        "task": "go-to-pose",
        "spacecraft": "floating-platform",
        "ppo": {"layers": [14, 6]},
        "timing": {"control_period": PERIOD, "episode_steps": 900},
    }
    write_text(folder / "config.json", json.dumps(config, indent=2) + "\n")
    craft = Path(__file__).parents[2] / "rans/data/spacecraft/floating-platform.toml"
    write_text(folder / "spacecraft.toml", craft.read_text("utf-8"))


if __name__ == "__main__":
    write_agent(Path(sys.argv[1]))
