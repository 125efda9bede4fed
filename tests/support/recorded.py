"""The commands of every shipped agent as an earlier revision gave them: what a rebuilt house must give too.

``python -m tests.support.recorded`` records them anew, which only a change that is meant to change agents does;
with names after it those agents alone.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from rans.base.pretrained import pretrained_names
from rans.episode.flight import Flight, fly
from rans.episode.scenario import scenarios
from rans.evaluation.fly.contestants import contestant

FOLDER = Path(__file__).parents[1] / "data" / "commands"
SEED = 31
EPISODES = 32
"""Starts that neither training nor evaluation uses."""
FEW = 16
"""Of them, flights whose duty cycles are recorded, which take 32 times as much room as bits."""

VALUES = {"any-craft-2d": "#0.4", "any-craft-3d": "#0.4"}
"""What follows the name of an agent whose value flights would choose: its commands are those of one value."""
CUT = {"inspect-3d": 150}
"""Periods after which flights are cut off, whose every period costs 40 ms; others fly to their end."""


def flown(name: str, periods: int | None = None) -> Flight:
    """A shipped agent's flights from the recorded starts, in all their periods or in the first ones.

    A multi-task's episodes draw their tasks. All fly in a perfect world, also those that are made for another.
    """
    loaded = contestant(f"pretrained:{name}{VALUES.get(name, '')}")
    craft = loaded.craft
    timing = loaded.timing
    timing = replace(timing, episode_steps=periods or CUT.get(name, timing.episode_steps))
    judged = loaded.task.for_evaluation()
    return fly(craft, judged, loaded.controller, scenarios(judged, craft, SEED, EPISODES), timing)


def recorded(name: str) -> np.ndarray:
    """The commands (T, N, thrusters) that were recorded: zeros and ones, or duty cycles of fewer episodes."""
    with np.load(FOLDER / f"{name}.npz") as file:
        if "duty" in file:
            return file["duty"].astype(float)
        count = int(np.prod(file["shape"]))
        return np.unpackbits(file["bits"], count=count).reshape(file["shape"])[:, :EPISODES]


def record(name: str) -> None:
    """Write the commands of a shipped agent as it is now."""
    commands = flown(name).commands
    file = FOLDER / f"{name}.npz"
    if np.isin(commands, (0.0, 1.0)).all():
        bits = np.packbits(commands.astype(bool))
        np.savez_compressed(file, bits=bits, shape=np.array(commands.shape))
    else:
        np.savez_compressed(file, duty=commands[:, :FEW].astype(np.float32))


if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in sys.argv[1:] or pretrained_names():
        record(name)
