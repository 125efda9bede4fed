"""Search for trapping sets of poses of on/off agents in the plane: cells of position and heading.

The network that flies is asked what it commands at the corners of each cell, with every demand of the other parts
of the state. From the cells of the starts, images are added until none is new. What is found is a claim:
`rans_proof.check_pose` decides. It asks the network that flies and proves nothing: errors here cost cells, not
soundness.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from rans.extend import ConfigError, LoadedRun, Network, Spacecraft, write_text
from rans.policy.heads import OnOff
from rans_proof.verdicts import FILES

_PAD = 2e-4
"""Widening of a cell, m and m/s, rad and rad/s, at whose corners the network is asked."""
_DEMAND = 0.2
"""Position (m) that demands a pulse along an axis whatever its rate."""
_TURN = 0.14
"""Heading error, rad, from which turns come to an end in the same way as from farther."""
_ARRIVED = 0.05
"""Heading error, rad, below which a turn has come to an end."""
_COMING = 150
"""Periods in which positions a little beyond the limit come to be as those from farther away."""
_ROUNDS = 20
"""Guesses of how far the parts of the set reach."""
_GROWTH = 2000
"""Periods after which a set that still grows is given up."""


@dataclass(frozen=True)
class PoseErrors:
    """What need not be as designed; it is constant over a flight, except for the readings."""

    mass: float = 0.0
    """Mass and inertia are off by at most this part of them, by the same factor."""
    thrust: float = 0.0
    """All thrusts are off by at most this part of them, by the same factor."""
    position: float = 0.0
    """Readings of the position are off by at most this, m, at each decision anew."""
    velocity: float = 0.0
    """Readings of the velocity are off by at most this, m/s, at each decision anew."""
    heading: float = 0.0
    """Readings of the heading are off by at most this, rad, at each decision anew."""
    spin: float = 0.0
    """Readings of the spin are off by at most this, rad/s, at each decision anew."""
    opening: float = 0.0
    """Each thruster by itself, each time anew, opens later than commanded by at most this, s."""
    shutting: float = 0.0
    """Each thruster by itself, each time anew, shuts later than commanded by at most this, s."""


class PoseStart(NamedTuple):
    """Bounds of all starts."""

    position: float
    """Distance from the goal, m."""
    heading: float
    """Heading error, rad."""
    speed: float = 0.0
    """Speed, m/s."""
    spin: float = 0.0
    """Angular velocity, rad/s."""


class PoseTrap(NamedTuple):
    """Cells of a position along either diagonal of the goal's frame and its rate, and of a heading and its rate."""

    place: np.ndarray
    """Cells of a position, bool (rows of rate, columns of position); rest is in the middle."""
    heading: np.ndarray
    """Cells of the heading, bool (rows of spin, columns of heading); rest is in the middle."""
    speed: float
    """Width of a row of ``place``, m/s; a column is as wide as a row moves in a period."""
    spin: float
    """Width of a row of ``heading``, rad/s."""


class _Grid:
    """Rows of a rate and columns of a position, both from -n to n; a column is what a row moves in a period.

    The widths are in units of rate (per s) and position; sets of cells are tables (rows, columns) of bool.
    """

    def __init__(
        self, width: float, period: float, fast: float, far: float, slip: float = 0.0
    ) -> None:
        self.period = period
        self.slip = slip
        """By how much valves that are late change a rate in a period besides."""
        self.width = width
        self.column = width * period
        self.rows, self.columns = math.ceil(fast / width), math.ceil(far / self.column)
        self.rate = np.arange(-self.rows, self.rows) * width
        self.place = np.arange(-self.columns, self.columns) * self.column

    def around(self, far: float, fast: float) -> np.ndarray:
        """Cells up to a position and a rate."""
        result = np.zeros((2 * self.rows, 2 * self.columns), dtype=bool)
        # A little beyond edges, where the checker rounds up.
        ends = (fast, self.width), (far, self.column)
        r, c = (max(1, math.ceil(x / w + 1e-6)) for x, w in ends)
        result[self.rows - r : self.rows + r, self.columns - c : self.columns + c] = True
        return result

    def extent(self, cells: np.ndarray) -> tuple[float, float]:
        """Largest position and rate."""
        rate = np.abs(self.rate[cells.any(axis=1)] + 0.5 * self.width).max() + 0.5 * self.width
        place = np.abs(self.place[cells.any(axis=0)] + 0.5 * self.column).max() + 0.5 * self.column
        return float(place), float(rate)

    def corners(self, place: float, rate: float) -> list[tuple[np.ndarray, np.ndarray]]:
        """Positions and rates of the corners of all cells, widened, each (rows, columns)."""
        return [
            tuple(np.meshgrid(self.place + x, self.rate + v))  # type: ignore[misc]
            for x in (-place - _PAD, self.column + place + _PAD)
            for v in (-rate - _PAD, self.width + rate + _PAD)
        ]

    def grown(self, cells: np.ndarray, pushes: list[tuple[np.ndarray, float, float]]) -> np.ndarray:
        """Cells and all that images of them touch, until none is new.

        Cells are (rows, columns) of rate and position.

        Args:
            cells: to begin with.
            pushes: where a command may be, and the smallest and largest derivative of the rate that it makes.

        Raises:
            ConfigError: images leave the grid.
        """
        whole = cells.copy()
        new = cells
        for _ in range(_GROWTH):
            new = self.image(new, pushes) & ~whole
            if not new.any():
                return whole
            whole |= new
        raise ConfigError("the search did not end.")

    def image(self, cells: np.ndarray, pushes: list[tuple[np.ndarray, float, float]]) -> np.ndarray:
        """Cells that images touch; see `grown`."""
        image = np.zeros_like(cells)
        for may, low, high in pushes:
            part = cells & may
            for row in np.flatnonzero(part.any(axis=1)):
                self._row(image, part[row], self.rate[row], low, high)
        return image

    def _row(
        self, image: np.ndarray, part: np.ndarray, rate: float, low: float, high: float
    ) -> None:
        """Add the image of the cells of one row (columns,) at a rate (per s) to ``image`` in place.

        `ConfigError` beyond the grid.
        """
        t = self.period
        slip = self.slip
        lower, upper = (slip / self.width + (1e-6 if x or slip else 0.0) for x in (low, high))
        number = round(rate / self.width)
        first = math.floor(number + t * low / self.width - lower) + self.rows
        last = math.ceil(number + 1 + t * high / self.width + upper) + self.rows
        begin, end = (0.5 * t * t * x for x in (low, high))
        shift = math.floor((rate * t + begin - slip * t) / self.column - 1e-6)
        reach = math.ceil(((rate + self.width) * t + end + slip * t) / self.column + 1e-6)
        used = np.flatnonzero(part)
        if (
            first < 0
            or last > 2 * self.rows
            or used[0] + shift < 0
            or used[-1] + reach >= part.size
        ):
            raise ConfigError("a flight may leave the limits.")
        count = np.concatenate(([0], np.cumsum(part)))
        column = np.arange(part.size)
        touched = (
            count[np.clip(column - shift + 1, 0, part.size)]
            - count[np.clip(column - reach, 0, part.size)]
        )
        image[first:last] |= touched > 0


def pose_trap(
    run: LoadedRun,
    keep: tuple[float, float],
    start: PoseStart,
    off: PoseErrors = PoseErrors(),
    speed: float = 0.004,
    spin: float = 0.004,
) -> PoseTrap:
    """Find a trapping set that contains starts, or the states around rest if they are far away.

    Args:
        run: run of an agent that goes to a pose in the plane.
        keep: limits of the distance (m) and of the heading error (rad).
        start: starts; those beyond the limits are left out.
        off: what need not be as designed.
        speed: width of cells, m/s.
        spin: width of cells, rad/s.

    Raises:
        ConfigError: none is found.
    """
    asked = _Asked(run)
    period = run.timing.control_period
    low = (1 - off.thrust) / (1 + off.mass)
    high = (1 + off.thrust) / (1 - off.mass)
    is_near = start.position < keep[0] and start.heading < keep[1]
    near = start if is_near else PoseStart(0.0, 0.0)
    # The heading by itself: what the axes demand may take thrusters from a turn.
    far = max(1.2 * keep[1], 2.0 * _TURN)
    late = high * (off.opening + off.shutting)
    turning_slip = asked.thrusters * asked.twist * late
    turning = _Grid(spin, period, 4.0 * asked.twist * period, far, turning_slip)
    pushes = []
    for level, may in asked.turns(turning, off).items():
        ends = [level * asked.twist * x for x in (low, high)]
        pushes.append((may, min(ends), max(ends)))
    begin = turning.around(near.heading, near.spin)
    if not is_near:
        # What turns come to be, all of which end as those from nearby.
        arriving = turning.around(min(start.heading, _TURN), 0.0)
        while turning.extent(arriving)[0] > _ARRIVED:
            arriving = turning.image(arriving, pushes)
        begin |= arriving
    heading = turning.grown(begin, pushes)
    angle, rate = turning.extent(heading)
    # The position, for a guess of how far it reaches, which grows until it is one.
    turned = angle + rate * (period + 2.0 * off.shutting)
    turned += 2.0 * high * asked.twist * (period + late) ** 2
    turned += 2.0 * turning_slip * (period + off.shutting)
    slip = 0.5 * asked.thrusters * asked.pull * late * (1.0 + math.sin(turned))
    moving = _Grid(speed, period, 10.0 * asked.pull * period, 3.0 * keep[0], slip)
    across = 2.0 * asked.pull * high * math.sin(turned)
    guess = (0.5 * keep[0], 2.0 * asked.pull * period)
    for _ in range(_ROUNDS):
        pushes = []
        for level, may in asked.pulses(moving, guess, angle, off).items():
            ends = [
                level * asked.pull * x * c for x in (low, high) for c in (1.0, math.cos(turned))
            ]
            pushes.append((may, min(ends) - across, max(ends) + across))
        begin = moving.around(near.position, near.speed)
        if not is_near:
            coming = moving.around(min(start.position, 1.2 * keep[0]), 0.0)
            for _ in range(_COMING):
                coming = moving.image(coming, pushes)
            begin |= coming
        place = moving.grown(begin, pushes)
        reached = moving.extent(place)
        if reached[0] <= guess[0] and reached[1] <= guess[1]:
            return PoseTrap(place, heading, speed, spin)
        guess = max(guess[0], reached[0]), max(guess[1], reached[1])
    raise ConfigError("no bound of the position was found.")


class _Asked:
    """A network, and what it commands, by asking it at points: a guess that only the check turns into a proof."""

    def __init__(self, run: LoadedRun) -> None:
        self._network: Network = run.network
        craft: Spacecraft = run.craft
        along = np.array([t.direction for t in craft.thrusters])[:, :2]
        place = np.array([t.position for t in craft.thrusters])[:, :2]
        force = np.array([t.force for t in craft.thrusters])
        torque = force * (place[:, 0] * along[:, 1] - place[:, 1] * along[:, 0])
        self._axes = np.array([[1.0, -1.0], [1.0, 1.0]]) / math.sqrt(2.0)
        pushes = force[:, None] * along @ self._axes.T
        self.thrusters = len(force)
        self.pull = float(np.abs(pushes).max() / craft.mass)
        self.twist = float(np.abs(torque).max() / np.asarray(craft.inertia).ravel()[-1])
        self._along = np.round(pushes / np.abs(pushes).max()).astype(int)
        self._lever = np.sign(np.round(torque, 9)).astype(int)
        _check_sums(self._network)

    @torch.no_grad()
    def _open(
        self, place: np.ndarray, velocity: np.ndarray, sine: np.ndarray, spin: np.ndarray
    ) -> np.ndarray:
        """Commands (N, thrusters), of positions and velocities (N, 2) along the axes.

        They only suggest sets of cells: `rans_proof.check_pose` proves them with bounds of the network.
        """
        count = len(sine)
        cosine = np.sqrt(1.0 - sine * sine)
        # An observation with the body frame in place of the world's.
        columns = np.column_stack(
            (
                np.ones(count),
                np.zeros(count),
                velocity @ self._axes,
                spin,
                np.ones(count),
                -place @ self._axes,
                cosine,
                sine,
            )
        )
        policy = self._network.evaluate(torch.tensor(columns, dtype=torch.float32)).policy
        assert isinstance(policy, OnOff)
        return policy.logit.numpy() > 0.0

    def turns(self, grid: _Grid, off: PoseErrors) -> dict[int, np.ndarray]:
        """Where (rows, columns) so many thrusters may turn the craft, by asking the network at corners of cells.

        Corners are no proof: a command that only occurs within a cell is found by the check, which then refuses.
        """
        found = []
        # A reading lacks what valves let through late, by up to four thrusters.
        heading = off.heading + 2.0 * self.twist * 1.3 * off.shutting**2
        rate = off.spin + 4.0 * self.twist * 1.3 * off.shutting
        for angle, spin in grid.corners(heading, rate):
            for demand in (0.0, _DEMAND, -_DEMAND):
                place = np.full((angle.size, 2), demand)
                still = np.zeros_like(place)
                opened = self._open(place, still, -np.sin(angle.ravel()), spin.ravel())
                found.append((opened @ self._lever).reshape(angle.shape))
        return _filled(found)

    def pulses(
        self, grid: _Grid, guess: tuple[float, float], angle: float, off: PoseErrors
    ) -> dict[int, np.ndarray]:
        """Where so many thrusters may push along either axis, with the other axis up to a guess.

        Tables are (rows, columns) by the number of thrusters.

        Corners are no proof: see `turns`.
        """
        found = []
        turn = math.sqrt(2.0) * off.heading
        place = off.position + (math.sin(angle) + turn) * guess[0]
        rate = off.velocity + (math.sin(angle) + turn) * guess[1]
        rate += 4.0 * self.pull * off.shutting
        for x, v in grid.corners(place, rate):
            for sine in (0.0, 0.06, -0.06):
                for axis in (0, 1):
                    position, velocity = (np.zeros((x.size, 2)) for _ in range(2))
                    position[:, axis], velocity[:, axis] = x.ravel(), v.ravel()
                    opened = self._open(position, velocity, np.full(x.size, sine), np.zeros(x.size))
                    found.append((opened @ self._along[:, axis]).reshape(x.shape))
        return _filled(found)


def _check_sums(network: Network) -> None:
    """Refuse (`ConfigError`) a network whose partial sums may be too large for single precision."""
    tensors = network.tensors
    largest = torch.full((8,), network.architecture.clip, dtype=torch.float64)
    for layer in ("features_extractor.trunk.0", "features_extractor.trunk.2", "action_net"):
        weight, bias = (tensors[f"{layer}.{name}"].double().abs() for name in ("weight", "bias"))
        largest = weight @ largest + bias
        # Half of the largest number leaves more than rounding adds.
        if not bool((largest < 0.5 * torch.finfo(torch.float32).max).all()):
            raise ConfigError("its network's sums may be too large for single precision.")


def _filled(found: list[np.ndarray]) -> dict[int, np.ndarray]:
    """Cells of each level, among them all between the lowest and the highest that were found at a cell."""
    low = np.min(found, axis=0)
    high = np.max(found, axis=0)
    return {
        level: (low <= level) & (level <= high)
        for level in range(int(low.min()), int(high.max()) + 1)
    }


def write_pose_trap(
    trap: PoseTrap,
    keep: tuple[float, float],
    start: PoseStart,
    off: PoseErrors,
    agent: Mapping[str, bytes],
    period: float,
    file: Path,
) -> None:
    """Write a certificate.

    Args:
        trap: the set.
        keep: limits of the distance (m) and of the heading error (degrees).
        start: starts, with their heading in degrees.
        off: what need not be as designed.
        agent: contents of the agent's files, by name.
        period: control period, s.
        file: to be written.

    Raises:
        ConfigError: the file cannot be written.
    """
    is_near = start.position < keep[0] and start.heading < keep[1]
    # Ten seconds to brake and come to rest, and a twentieth of a metre in a second.
    periods = math.ceil((15.0 + start.position / 0.05) / period)
    table = {
        "format": 2,
        "property": "trapping set of poses of an agent that goes to a pose",
        "agent": {name: hashlib.sha256(agent[name]).hexdigest() for name in FILES},
        "keep": {"position": keep[0], "heading": keep[1]},
        "start": start._asdict(),
        "uncertainty": asdict(off),
        "grid": {"speed": trap.speed, "spin": trap.spin},
        "cells": {"place": _runs(trap.place), "heading": _runs(trap.heading)},
        "reach": None
        if is_near
        else {"sectors": max(1, math.ceil(start.heading / 5.0)), "periods": periods},
    }
    write_text(file, json.dumps(table) + "\n")


def _runs(cells: np.ndarray) -> list[list[int]]:
    """Runs of cells (rows, columns) that are set: row, first column, one after the last, from the middle.

    The certificate's form of a set, which `rans_proof.check_pose.Loop.cells` reads.
    """
    half = [n // 2 for n in cells.shape]
    result = []
    for row in np.flatnonzero(cells.any(axis=1)):
        edges = np.flatnonzero(np.diff(np.concatenate(([0], cells[row].astype(int), [0]))))
        result += [
            [int(row) - half[0], int(a) - half[1], int(b) - half[1]]
            for a, b in zip(edges[::2], edges[1::2], strict=True)
        ]
    return result
