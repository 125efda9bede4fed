"""The commands of every shipped agent as an earlier revision gave them: what a rebuilt house must give too.

``python -m tests.support.recorded`` records them anew, which only a change that is meant to change agents does.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rans.evaluation.fly.contestants import contestant
from rans.flight import Flight, fly
from rans.pretrained import pretrained_names
from rans.scenario import scenarios

FOLDER = Path(__file__).parents[1] / "data" / "commands"
SEED = 31
EPISODES = 64
"""Starts that neither training nor evaluation uses."""
FEW = 4
"""Episodes whose commands are kept of throttles and wheels, which take more room."""


def flown(name: str) -> Flight:
    """A shipped agent's flights from the recorded starts; a multi-task's episodes draw their tasks.

    All fly in a perfect world, also those that are made for another.
    """
    controller, craft, task, timing, _ = contestant(f"pretrained:{name}")
    judged = task.for_evaluation()
    return fly(craft, judged, controller, scenarios(judged, craft, SEED, EPISODES), timing)


def recorded(name: str) -> np.ndarray:
    """The commands (T, N, commands) that were recorded: zeros and ones, or numbers of the first `FEW` episodes."""
    with np.load(FOLDER / f"{name}.npz") as file:
        if "commands" in file:
            return file["commands"]
        return np.unpackbits(file["bits"], count=int(np.prod(file["shape"]))).reshape(file["shape"])


if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in pretrained_names():
        flight = flown(name)
        commands = flight.commands
        if flight.craft.is_continuous:
            few = commands[:, :FEW].astype(np.float32)
            np.savez_compressed(FOLDER / f"{name}.npz", commands=few)
            continue
        np.savez_compressed(
            FOLDER / f"{name}.npz",
            bits=np.packbits(commands.astype(bool)),
            shape=np.array(commands.shape),
        )
