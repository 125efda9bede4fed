"""Errors for which a trapping set is proved, refuted or open: a table and its picture.

`python -m campaigns.proof_conditions TABLE.json PICTURE.svg` computes the table unless the file exists, which takes
an hour of one core, and draws it. See docs/proof/proofs.md.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from rans_proof import trap as traps

from rans.evaluation.fly.agent import load_policy
from rans.pretrained import pretrained_folder
from rans.processes import Workers, nothing
from rans.show.figures.plotting import Figure, ListedColormap, rcParams

AGENT = "track-velocity-2d"
SPEED, SPIN = 0.2, 1.7
"""Limits of every flight, m/s and rad/s."""
START = (0.14, 0.15)
"""Speed and spin of the starts, m/s and rad/s."""
GRID = traps.GRID.finer(2)
MASS = (0.0, 0.005, 0.01, 0.015, 0.02, 0.03, 0.05, 0.1)
"""Parts by which mass and thrust are off."""
VELOCITY = (0.0, 0.0005, 0.001, 0.002, 0.003, 0.005, 0.01, 0.02, 0.03, 0.04)
"""Errors of readings of velocity, m/s; those of spin are 2.5 rad/s times as many m/s."""
DELAY = (0.0, 0.00025, 0.0005, 0.001, 0.0015, 0.002, 0.005, 0.02, 0.05, 0.1)
"""Delays of thrusters, s."""
VERDICTS = ("open", "proved", "refuted")


def column(_: None, kind: str, mass: float) -> tuple[str, float, list[str], list[float]]:
    """Verdicts for a mass error, by the other error, and seconds of each proof that was tried."""
    run = load_policy(pretrained_folder(AGENT))
    loop = traps.velocity_loop(run.network, run.craft, run.timing.control_period)
    values = VELOCITY if kind == "velocity" else DELAY
    sets = [
        traps.Uncertainty(mass, mass, x, 2.5 * x)
        if kind == "velocity"
        else traps.Uncertainty(mass, mass, delay=x)
        for x in values
    ]
    verdicts = ["open"] * len(values)
    # Larger errors include smaller ones: what is refuted stays so, and what is proved was so before.
    for k, off in enumerate(sets):
        if traps.broken_flight(loop, (SPEED, SPIN), START, off) is not None:
            verdicts[k:] = ["refuted"] * (len(values) - k)
            break
    low, high = -1, verdicts.count("open")
    seconds = []
    while high - low > 1:
        middle = (low + high) // 2
        begun = time.monotonic()
        found = traps.trapping_set(loop, SPEED, SPIN, sets[middle], GRID, start=START)
        seconds.append(time.monotonic() - begun)
        low, high = (middle, high) if len(found.cells) else (low, middle)
    verdicts[: low + 1] = ["proved"] * (low + 1)
    return kind, mass, verdicts, seconds


def compute() -> dict[str, Any]:
    """The table of all verdicts."""
    jobs = [(kind, mass) for mass in MASS for kind in ("velocity", "delay")]
    table: dict[str, Any] = {
        "agent": AGENT,
        "keep": {"speed": SPEED, "spin": SPIN},
        "start": {"speed": START[0], "spin": START[1]},
        "grid": GRID,
        "mass": MASS,
        "velocity": VELOCITY,
        "delay": DELAY,
        "verdicts": {"velocity": {}, "delay": {}},
    }
    seconds = 0.0
    for kind, mass, verdicts, times in Workers(nothing, (), None, "proved").ordered(column, jobs):
        table["verdicts"][kind][f"{mass:g}"] = verdicts
        seconds += sum(times)
    table["seconds of one core"] = round(seconds)
    return table


def draw(table: dict[str, Any], picture: Path) -> None:
    """Draw verdicts by errors of mass and thrust, and of readings or of time."""
    rcParams["svg.hashsalt"] = "rans"  # the same picture has the same bytes
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    axes = figure.subplots(1, 2, sharex=True)
    colors = ListedColormap(["#d9d9d9", "#2a7f62", "#b3432b"])
    labels = {"velocity": "readings of velocity off by, mm/s", "delay": "thrusters late by, ms"}
    for axis, (kind, label) in zip(axes, labels.items(), strict=True):
        columns = table["verdicts"][kind].values()
        values = np.array([[VERDICTS.index(x) for x in one] for one in columns]).T
        axis.pcolormesh(values, cmap=colors, vmin=0, vmax=2, edgecolors="white", linewidth=1.0)
        axis.set_yticks(np.arange(len(table[kind])) + 0.5, [f"{1000 * x:g}" for x in table[kind]])
        axis.set_xticks(
            np.arange(len(table["mass"])) + 0.5, [f"{100 * x:g}" for x in table["mass"]]
        )
        axis.set_xlabel("mass and thrust off by, %")
        axis.set_ylabel(label)
    figure.suptitle("Proved (green), refuted by a flight (red), open (gray)", fontsize=11)
    figure.savefig(picture, metadata={"Date": None})


if __name__ == "__main__":
    file = Path(sys.argv[1])
    if not file.exists():
        file.write_text(json.dumps(compute(), indent=1) + "\n")
    draw(json.loads(file.read_text()), Path(sys.argv[2]))
