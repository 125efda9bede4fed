"""What whoever flies an agent elsewhere must know, as JSON: columns, thrusters, timing, pairs to check."""

from __future__ import annotations

import hashlib
import math
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import torch

from rans.effectors.commands import of_outputs
from rans.episode import Setup
from rans.evaluation.fly.agent import Agent
from rans.evaluation.fly.episodes import fly_episodes
from rans.fast.learn.config import TrainConfig, to_table
from rans.files import git_revision, package_version
from rans.model.spacecraft import Spacecraft
from rans.policy.network import Network
from rans.tasks.derived import example

FLIGHTS = 64
STEPS = 125
GOLDEN = 4
"""Flights from which the columns' ranges are taken, their most steps, and those kept as golden pairs."""
FLIGHT_SEED = 2026
"""Of their starts, which are those of training; no training or judgement uses this seed."""
DUTY_TOLERANCE = 1e-4
"""How far golden duties may be off: rounding of float32 in another order of sums is a hundredth of it."""
_FRAMES = {
    "W": "at rest (or, on an orbit, the Hill frame: x outwards, y along the track, z across); right-handed",
    "B": "fixed to the spacecraft: origin at its centre of mass, axes of spacecraft.toml; right-handed",
}


class Recorder:
    """A controller that keeps every observation that it is shown."""

    def __init__(self, controller: Agent) -> None:
        self.name = controller.name
        self._controller = controller
        self._seen = list[np.ndarray]()

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._controller.reset(count)
        self._seen.clear()

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`."""
        self._seen.append(observation)
        return self._controller.act(state, goal, observation)

    @property
    def seen(self) -> np.ndarray:
        """The last flights' observations (T, N, width)."""
        return np.stack(self._seen)


def observed(
    network: Network, setup: Setup, seed: int = FLIGHT_SEED, count: int = FLIGHTS
) -> np.ndarray:
    """What the network observes when it flies from the starts of training: (T, N, width) float32."""
    recorder = Recorder(Agent(network, "agent", setup.craft))
    timing = setup.timing
    short = replace(timing, episode_steps=min(timing.episode_steps, STEPS), substeps=None)
    fly_episodes(recorder, setup._replace(timing=short), seed, count)
    return recorder.seen


def contract(
    name: str,
    config: TrainConfig,
    craft: Spacecraft,
    spacecraft_text: str,
    memory: int,
    seen: np.ndarray,
) -> dict[str, Any]:
    """The contract of an agent with so much memory that observed (T, N, width) on flights."""
    shown = example(config.settings, craft.dimension)
    lows = _short(seen.min(axis=(0, 1)))
    highs = _short(seen.max(axis=(0, 1)))
    columns = [
        {
            "column": at,
            "name": row.name,
            "unit": row.unit,
            "frame": row.frame,
            "bound": bound if math.isfinite(bound) else None,
            "valid": [low, high],
        }
        for at, (row, bound, low, high) in enumerate(
            zip(shown.table(), shown.bounds(), lows, highs, strict=True)
        )
    ]
    return {
        "format": 1,
        "agent": name,
        "task": config.task,
        "settings": to_table(config)["settings"],
        "spacecraft": {
            "name": craft.name,
            "file": "spacecraft.toml",
            "sha256": hashlib.sha256(spacecraft_text.encode()).hexdigest(),
        },
        "control_period": config.timing.control_period,
        "frames": _FRAMES,
        "observation": columns,
        "command": {
            "actuators": craft.actuators.kind,
            "values": craft.actuators.allowed,
            "thrusters": [_thruster(craft, at) for at in range(len(craft.thrusters))],
            "wheels": [asdict(wheel) for wheel in craft.wheels],
            "ranges": [one._asdict() for one in craft.commands],
        },
        "memory": memory,
        "valid": f"least and largest of {seen.shape[1]} flights of {seen.shape[0]} periods from the starts "
        "of training: the agent was not tried beyond",
        "units": {"control_period": "s", "position": "m", "force": "N"},
        "revision": git_revision(),
        "rans": package_version("rans"),
    }


def _thruster(craft: Spacecraft, at: int) -> dict[str, Any]:
    """One entry of a command; the place is about the centre of mass."""
    thruster = craft.thrusters[at]
    place = np.subtract(thruster.position, craft.centre_of_mass).tolist()
    return {
        "index": at,
        "position": place,
        "direction": list(thruster.direction),
        "force": thruster.force,
    }


@torch.no_grad()
def golden(network: Network, seen: np.ndarray, craft: Spacecraft | None = None) -> dict[str, Any]:
    """Pairs of observations and commands, episode after episode; ``begins`` where the memory is zero.

    Of on/off thrusters those flights are taken in which no choice is close, so that rounding turns none.
    """
    exact = Network(network.architecture, {name: x.double() for name, x in network.tensors.items()})
    memory = exact.blank(seen.shape[1])
    commands = []
    margins = []
    for rows in torch.from_numpy(seen):
        output, columns = exact.shown(rows, memory)
        commands.append(output.policy.mode())
        margins.append(output.policy.margin())
        memory = exact.remember(columns, memory, commands[-1], output)
    clearest = torch.stack(margins).amin(dim=(0, 2)).argsort(descending=True)[:GOLDEN]
    kept, pairs = (
        x[:, clearest.numpy()].swapaxes(0, 1) for x in (seen, torch.stack(commands).numpy())
    )
    begins = [step == 0 for _ in clearest for step in range(len(seen))]
    return {
        "begins": begins,
        "tolerance": DUTY_TOLERANCE if network.architecture.continuous else 0.0,
        "observation": [_short(row) for row in kept.reshape(len(begins), -1)],
        "command": [_short(row) for row in _in_ranges(pairs.reshape(len(begins), -1), craft)],
    }


def _in_ranges(outputs: np.ndarray, craft: Spacecraft | None) -> np.ndarray:
    """Commands (rows, commands) of a policy's outputs from 0 to 1."""
    if craft is None:
        return outputs
    return np.stack(of_outputs(craft, tuple(outputs.T)), axis=1)


def _short(row: np.ndarray) -> list[float]:
    """Numbers of single precision, with no more digits than tell them apart."""
    return [float(str(x)) for x in row.astype(np.float32)]
