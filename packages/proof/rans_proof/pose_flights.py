"""Flights of an agent from a trapping set of poses, in an engine of RANS, none of which may leave it."""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rans.extend import (
    ConfigError,
    GoToPose,
    Heading,
    LoadedRun,
    PlanarState,
    RansError,
    Scenario,
    Vec2,
    fly,
    load_policy,
)
from rans_proof.verdicts import FILES

_FLIGHTS = 500
"""Flights with which a certificate is compared with the agent as it flies."""
_PERIODS = 30
"""Periods of each, in which most come to several pulses."""


def read_run(files: Mapping[str, bytes]) -> LoadedRun:
    """The run of an agent's files, as flights load it.

    Raises:
        ConfigError: a file is damaged, or they are not of one agent.
    """
    with tempfile.TemporaryDirectory() as folder:
        for name in FILES:
            (Path(folder) / name).write_bytes(files[name])
        try:
            return load_policy(Path(folder))
        except ConfigError as error:  # the user has never heard of that folder
            raise ConfigError(str(error).replace(f"{folder}/", "")) from error


def check_pose_as_flown(certificate: bytes, files: Mapping[str, bytes]) -> None:
    """Compare what the checker takes an agent for with flights from random states of the cells.

    Raises:
        Refused: a flight leaves the cells, a file is damaged, or the agent flies another task.
    """
    from rans_proof.balls import Refused

    try:
        run = read_run(files)
        if type(run.task) is not GoToPose or run.craft.dimension != 2:
            raise Refused("it flies another task")
        left, _, _ = leaving(run, json.loads(certificate), _FLIGHTS, _PERIODS, 0)
    except RansError as error:
        raise Refused(str(error)) from error
    if left:
        raise Refused(
            f"{left} of {_FLIGHTS} flights of the agent leave its cells; the usual cause: a file says two things"
        )


def leaving(
    run: LoadedRun,
    table: Mapping[str, Any],
    flights: int,
    periods: int,
    seed: int,
) -> tuple[int, float, float]:
    """Flights that leave the cells, and the largest distance (m) and heading error (rad) of all at their decisions.

    All is as designed.

    Args:
        run: the agent, as flights load it.
        table: a certificate.
        flights: number of random states of random cells.
        periods: control periods of each flight.
        seed: of the states.
    """
    random = np.random.default_rng(seed)
    period = run.timing.control_period
    parts = {
        name: _Lookup(table["cells"][name], width, period)
        for name, width in (("place", table["grid"]["speed"]), ("heading", table["grid"]["spin"]))
    }
    (x, vx), (y, vy) = (parts["place"].drawn(random, flights) for _ in range(2))
    angle, spin = parts["heading"].drawn(random, flights)
    # Positions of cells are along the diagonals (1, -1) and (1, 1) of the goal's frame.
    half = math.sqrt(0.5)
    zero = np.zeros(flights)
    start = PlanarState(
        Vec2(half * (x + y), half * (y - x)),
        Heading(angle),
        Vec2(half * (vx + vy), half * (vy - vx)),
        spin,
    )
    goal = PlanarState(Vec2(zero, zero), Heading(zero), Vec2(zero, zero), zero)
    timing = replace(run.timing, episode_steps=periods)
    states = fly(run.craft, run.task, run.controller, Scenario(start, goal), timing).states
    p = states.p
    v = states.v
    heading = (np.asarray(states.attitude.angle) + math.pi) % (2.0 * math.pi) - math.pi
    inside = parts["heading"].holds(heading, np.asarray(states.w))
    for sign in (-1.0, 1.0):
        inside &= parts["place"].holds(half * (p.x + sign * p.y), half * (v.x + sign * v.y))
    return (
        int((~inside.all(axis=0)).sum()),
        float(np.hypot(p.x, p.y).max()),
        float(np.abs(heading).max()),
    )


class _Lookup:
    """Cells of one part of a state."""

    def __init__(self, runs: list[list[int]], width: float, period: float) -> None:
        table = np.array(runs)
        self._half = int(np.abs(table).max()) + 2
        self._width = width
        self._column = width * period
        self._inside = np.zeros((2 * self._half, 2 * self._half), dtype=bool)
        for row, first, last in runs:
            self._inside[row + self._half, first + self._half : last + self._half] = True

    def drawn(self, random: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Random positions and rates."""
        cells = np.argwhere(self._inside)
        chosen = (
            cells[random.integers(0, len(cells), count)] - self._half + random.random((count, 2))
        )
        return chosen[:, 1] * self._column, chosen[:, 0] * self._width

    def holds(self, position: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """Whether states (...) are in cells; on an edge, in a cell of either side.

        Edges get 1e-6 of a cell, since states of an engine are rounded.
        """
        result = np.zeros(position.shape, dtype=bool)
        limit = 2 * self._half - 1
        for a in (-1e-6, 1e-6):
            for b in (-1e-6, 1e-6):
                row = np.floor(rate / self._width + a).astype(int) + self._half
                column = np.floor(position / self._column + b).astype(int) + self._half
                near = (row >= 0) & (row <= limit) & (column >= 0) & (column <= limit)
                result |= near & self._inside[np.clip(row, 0, limit), np.clip(column, 0, limit)]
        return result
