"""Trapping sets of on/off agents in the plane that come to rest: cells that the closed loop maps into themselves.

The state is what the agent's commands depend on: the velocity in the body frame, in polar coordinates, and the
spin. Commands of an on/off agent are piecewise constant. Over a cell the log-odds of many thrusters keep their
sign; those that may change it may be open or shut, and every such command is followed. Its motion is exact: speed
and spin of a coasting craft are constant, and a pulse changes the spin by a whole number of steps, so that both
stay in their cells. The union of the cells is a trapping set if the image of every cell lies in it (Blanchini, "Set
invariance in control", 1999). What it writes is a claim; `rans_proof.check_trap` judges it without this code.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from rans.extend import ConfigError, Network, Spacecraft, write_text
from rans.model.spacecraft import check_rigid
from rans.policy.traced import parameters
from rans_proof.flown import check_architecture
from rans_proof.relaxation import TorchLayer, Zonotope, enclose
from rans_proof.trap_certificate import (
    FILES,
    FORMAT,
    PROPERTY,
    TrapCertificate,
    check_size,
    read_certificate,
)

LOGIT = 1.1e-3
"""Log-odds below which a command counts as undecided, for networks in single precision. The checker takes 1e-3."""
_SLACK = 1e-6
"""Widening of images, in cells; above rounding here and that of the checker's balls, whose radii have 30 bits."""
_BATCH = 2048
"""Cells whose images are computed together."""
_NODES = np.polynomial.legendre.leggauss(10)
"""Gauss-Legendre rule for the rotated thrust; its error is below 1e-15 where a period turns by less than 2 rad."""


class Grid(NamedTuple):
    """Numbers of cells along each coordinate."""

    rings: int
    """Rings of speed, from 0 to its limit."""
    sectors: int
    """Sectors of the direction of the velocity, all around."""
    fine: int
    """Layers of spin in the change that a pulse of one thruster makes."""

    def finer(self, factor: int) -> Grid:
        """Grid with so many times the cells along each coordinate."""
        return Grid(*(factor * count for count in self))


GRID = Grid(32, 72, 8)
"""Grid that usually suffices."""


@dataclass(frozen=True)
class Uncertainty:
    """What need not be as designed; it is constant over a flight, except for the readings."""

    mass: float = 0.0
    """Mass and inertia are off by at most this part of them, by the same factor."""
    thrust: float = 0.0
    """All thrusts are off by at most this part of them, by the same factor."""
    velocity: float = 0.0
    """Readings of each component of the velocity are off by at most this, m/s, at each decision anew."""
    spin: float = 0.0
    """Readings of the spin are off by at most this, rad/s, at each decision anew."""
    delay: float = 0.0
    """All thrusters open and shut later than commanded by one constant time of at most this, s."""

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not 0.0 <= value < 1.0:
                raise ConfigError(f"--off {name} must be from 0 to below 1, got {value:g}.")

    def push(self) -> tuple[float, float]:
        """Bounds of thrust over mass, as parts of the nominal one."""
        return (1 - self.thrust) / (1 + self.mass), (1 + self.thrust) / (1 - self.mass)


@dataclass(frozen=True)
class Loop:
    """Closed loop of an on/off agent that is to come to rest."""

    layers: list[TorchLayer]
    """Network from velocity in B (m/s) and spin (rad/s) to log-odds of each thruster."""
    force: np.ndarray
    """(thrusters, 2) force over mass of each thruster in B, m/s^2."""
    lever: np.ndarray
    """(thrusters,) steps of spin that a pulse makes: -1, 0 or 1."""
    step: float
    """Change of spin by a thruster that is open for a period, rad/s."""
    period: float
    """Control period, s."""

    def log_odds(self, velocity: np.ndarray, spin: np.ndarray) -> np.ndarray:
        """Log-odds (N, thrusters) of states (N, 2) and (N,)."""
        x = torch.tensor(np.column_stack((velocity, spin)))
        for weight, bias, activation, _ in self.layers:
            x = x @ weight.T + bias
            x = torch.tanh(x) if activation else x
        return x.numpy()

    def strongest(self) -> tuple[float, float]:
        """Largest acceleration (m/s^2) and rate of the spin (rad/s^2) of any command."""
        count = len(self.force)
        commands = (np.arange(2**count)[:, None] >> np.arange(count)) & 1
        pull = np.linalg.norm(commands @ self.force, axis=1).max()
        return float(pull), float(np.abs(commands @ self.lever).max() * self.step / self.period)

    def impulse(self, spin: np.ndarray, commands: np.ndarray) -> np.ndarray:
        """Velocity change (N, 2), in B of the beginning of a period, by commands (N, thrusters).

        Force and lever are as designed; Gauss's rule of ten nodes.
        """
        force = commands @ self.force
        rate = commands @ self.lever * self.step / self.period
        total = np.zeros_like(force)
        for node, weight in zip(*_NODES, strict=True):
            time = 0.5 * (node + 1.0) * self.period
            angle = spin * time + 0.5 * rate * time * time
            c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
            turned = np.concatenate(
                (c * force[:, :1] - s * force[:, 1:], s * force[:, :1] + c * force[:, 1:]), axis=1
            )
            total += 0.5 * self.period * weight * turned
        return total

    def fly(
        self, velocity: np.ndarray, spin: np.ndarray, commands: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Velocity in B (N, 2), m/s, and spin (N,), rad/s, a period later, by commands (N, thrusters).

        The search flies samples by it. What it finds is proved by the checker's own equations, not by these.
        """
        change = commands @ self.lever * self.step
        v = velocity + self.impulse(spin, commands)
        turn = (spin + 0.5 * change) * self.period
        c, s = np.cos(turn), np.sin(turn)
        return np.column_stack(
            (c * v[:, 0] + s * v[:, 1], c * v[:, 1] - s * v[:, 0])
        ), spin + change


@dataclass(frozen=True)
class Trap:
    """Cells of speed, direction in B and spin that every flight from them stays in.

    A cell is a box of whole numbers: rings of speed, sectors of direction, and layers of spin.
    """

    speed: float
    """Largest speed, m/s, at all times."""
    rings: int
    """Rings of speed from 0 to the largest one."""
    sectors: int
    """Sectors of direction, the first one begins at the x axis of B."""
    layers: int
    """Layers of spin of either sign; the number of a layer is from -layers to layers - 1."""
    fine: int
    """Layers that a pulse of one thruster changes the spin by."""
    cells: np.ndarray
    """(N, 6) whole numbers: begin and end of rings, of sectors, and of layers."""
    uncertainty: Uncertainty
    rest: int = 0
    """Cells of the smallest size that were left out."""

    def inside(self) -> np.ndarray:
        """Which cells of the smallest size belong to it: (rings, sectors, 2 layers)."""
        result = np.zeros((self.rings, self.sectors, 2 * self.layers), dtype=bool)
        for a, b, c, d, e, f in self.cells:
            result[a:b, c:d, e + self.layers : f + self.layers] = True
        return result

    def contains(self, loop: Loop, speed: float, spin: float) -> bool:
        """Whether it contains all states up to a speed (m/s) and a spin (rad/s)."""
        return self.has_all(loop, speed, spin, self.inside())

    def has_all(self, loop: Loop, speed: float, spin: float, inside: np.ndarray) -> bool:
        """Whether cells of the smallest size contain all states up to a speed (m/s) and a spin (rad/s).

        `inside` is (rings, sectors, layers).
        """
        low, _ = self.uncertainty.push()
        ring = max(1, int(np.ceil(speed / self.speed * self.rings + 1e-9)))
        layer = max(1, int(np.ceil(spin / (loop.step * low) * self.fine + 1e-9)))
        if ring > self.rings or layer > self.layers:
            return False
        middle = slice(self.layers - layer, self.layers + layer)
        return bool(inside[:ring, :, middle].all())


def velocity_loop(network: Network, craft: Spacecraft, period: float) -> Loop:
    """Closed loop of an agent of `rans.TrackVelocity` in the plane whose goal is at rest.

    Raises:
        ConfigError: policy or spacecraft is of a kind that no proof is known for.
    """
    architecture = network.architecture
    check_architecture(architecture)
    if craft.dimension != 2:
        raise ConfigError("trapping sets are proved for track-velocity in the plane.")
    lever = np.array([thruster.position for thruster in craft.thrusters]) - np.array(
        craft.centre_of_mass
    )
    lever = lever[:, :2]
    along = np.array([thruster.direction for thruster in craft.thrusters])[:, :2]
    force = np.array([thruster.force for thruster in craft.thrusters])
    torque = force * (lever[:, 0] * along[:, 1] - lever[:, 1] * along[:, 0])
    size = np.abs(torque).max()
    check_rigid(craft, "trapping sets")
    if craft.thrust_sharing != "none" or craft.wheels or craft.propellant is not None:
        raise ConfigError(
            "trapping sets are proved without a shared supply, wheels and propellant."
        )
    if not size > 0.0 or not np.allclose(np.abs(torque) / size, 1.0, atol=1e-12):
        raise ConfigError("trapping sets are proved for thrusters whose torques are equal in size.")
    # Columns in B with the goal at rest: velocity, spin, task flag 2, velocity to gain, and two of zeros.
    # The network's layers over velocity and spin alone: a goal at rest fixes the other columns.
    tables = {name: x.astype(float) for name, x in parameters(network).items()}
    column = np.zeros((8, 3))
    column[[0, 1, 2], [0, 1, 2]] = 1.0
    column[[4, 5], [0, 1]] = -1.0
    scale = 1.0 / np.sqrt(tables["variance"] + 1e-6)
    shift = (np.array([0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0]) - tables["mean"]) * scale
    layers = []
    for number in range(len(architecture.layers)):
        weight, bias = (tables[f"trunk.{2 * number}.{name}"] for name in ("weight", "bias"))
        if number == 0:
            weight, bias = weight * scale @ column, weight @ shift + bias
        layers.append(TorchLayer(torch.tensor(weight), torch.tensor(bias), "tanh"))
    head = [torch.tensor(tables[f"head.{name}"]) for name in ("weight", "bias")]
    layers.append(TorchLayer(head[0], head[1], ""))
    return Loop(
        layers,
        force[:, None] * along / craft.mass,
        np.sign(np.round(torque / size)),
        float(size * period / np.asarray(craft.inertia).ravel()[0]),
        period,
    )


def broken_flight(
    loop: Loop,
    keep: tuple[float, float],
    start: tuple[float, float],
    off: Uncertainty = Uncertainty(),
    flights: int = 2000,
) -> tuple[np.ndarray, float, float] | None:
    """Start, highest speed (m/s) and spin (rad/s) of a simulated flight that passes these limits, or None.

    Starts are uniform up to a speed and a spin, parameters and readings extreme; flights last 60 periods.

    For a hint before the search only: what it returns is flown once more before it is claimed.
    """
    random = np.random.default_rng(0)
    angle = random.uniform(0.0, 2.0 * np.pi, flights)
    speed = start[0] * np.sqrt(random.random(flights))
    velocity = speed[:, None] * np.column_stack((np.cos(angle), np.sin(angle)))
    rate = random.uniform(-start[1], start[1], flights)
    begin = np.column_stack((velocity, rate))
    factor = random.choice(off.push(), flights)
    highest, fastest = speed.copy(), np.abs(rate)
    # The commands of the last decision act until the new ones do.
    late = off.delay / loop.period
    parts = [
        replace(loop, period=loop.period * x, step=loop.step * x) for x in (late, 1.0 - late) if x
    ]
    commands = np.zeros((flights, len(loop.force)))
    for _ in range(60):
        read = velocity + off.velocity * random.choice([-1.0, 1.0], velocity.shape)
        read_spin = rate + off.spin * random.choice([-1.0, 1.0], flights)
        new = (loop.log_odds(read, read_spin) > 0) * factor[:, None]
        for part, acting in zip(parts, (commands, new)[-len(parts) :], strict=True):
            velocity, rate = part.fly(velocity, rate, acting)
            highest = np.maximum(highest, np.linalg.norm(velocity, axis=1))
            fastest = np.maximum(fastest, np.abs(rate))
        commands = new
    beyond = np.maximum(highest / keep[0], fastest / keep[1])
    worst = int(beyond.argmax())
    if beyond[worst] <= 1.0:
        return None
    return begin[worst], float(highest[worst]), float(fastest[worst])


def write_trap(
    trap: Trap, spin: float, start: tuple[float, float], agent: Mapping[str, bytes], file: Path
) -> TrapCertificate:
    """Write the certificate of a trapping set, and return what it states.

    Args:
        trap: the set.
        spin: limit of the spin, rad/s.
        start: speed (m/s) and spin (rad/s) up to which every start is in it.
        agent: contents of the agent's files, by name (`rans_proof.trap_certificate.FILES`).
        file: to be written.

    Raises:
        ConfigError: the file cannot be written.
    """
    table = {
        "format": FORMAT,
        "property": PROPERTY,
        "agent": {name: hashlib.sha256(agent[name]).hexdigest() for name in FILES},
        "keep": {"speed": trap.speed, "spin": spin},
        "start": {"speed": start[0], "spin": start[1]},
        "grid": {name: getattr(trap, name) for name in ("rings", "sectors", "layers", "fine")},
        "uncertainty": asdict(trap.uncertainty),
        "cells": trap.cells.tolist(),
    }
    text = json.dumps(table) + "\n"
    write_text(file, text)
    return read_certificate(text.encode(), file)


def largest_start(trap: Trap, loop: Loop, spin: float) -> float:
    """Largest speed (m/s) up to which all states with at most this spin (rad/s) are in a trapping set; 0: none."""
    # A little below the edges, which are then in no further ring.
    edges = np.arange(trap.rings, 0, -1) / trap.rings * trap.speed * (1.0 - 1e-6)
    return next((float(x) for x in edges if trap.contains(loop, x, spin)), 0.0)


def trapping_set(
    loop: Loop,
    speed: float,
    spin: float,
    uncertainty: Uncertainty = Uncertainty(),
    grid: Grid = GRID,
    report: Callable[[int, int], object] = lambda done, left: None,
    start: tuple[float, float] | None = None,
) -> Trap:
    """Largest set of cells below a speed (m/s) and a spin (rad/s) that is mapped into itself.

    It begins with all cells, splits those that are not known to be mapped into the set, and leaves out those of the
    smallest size, until nothing changes.

    Args:
        loop: closed loop.
        speed: limit of the speed at all times, m/s.
        spin: limit of the spin at all times, rad/s.
        uncertainty: what need not be as designed.
        grid: numbers of the smallest cells.
        report: called with the numbers of cells that are known, and that are left.
        start: if it is set, the search ends without a cell once a state up to this speed (m/s) and this spin
            (rad/s) is left out.

    Raises:
        ConfigError: commands may be late by a period or more.
    """
    if uncertainty.delay >= loop.period:
        raise ConfigError(
            f"a delay must be below the control period of {loop.period:g} s, got {uncertainty.delay:g}."
        )
    # Layers of spin on either side of zero.
    rings, sectors, fine = grid
    _, high = uncertainty.push()
    layers = int(spin / (loop.step * high) * fine)
    check_size(2 * rings * sectors * layers)
    trap = Trap(speed, rings, sectors, layers, fine, np.zeros((0, 6), int), uncertainty)
    maps = _Maps(loop, trap)
    inside = np.ones((rings, sectors, 2 * layers), dtype=bool)
    # Each cell has several images, whose owner is its number.
    cells = _blocks(rings, sectors, layers)
    owner, images = maps.images(cells)
    while True:
        outside = _outside(inside, images)
        failed = np.zeros(len(cells), dtype=bool)
        failed[owner[outside]] = True
        report(int((~failed).sum()), int(failed.sum()))
        if not failed.any():
            break
        # The smallest cells leave the set, the others are split.
        small = failed & ((cells[:, 1::2] - cells[:, ::2]).max(axis=1) == 1)
        for a, _, c, _, e, _ in cells[small]:
            inside[a, c, e + layers] = False
        if start is not None and not trap.has_all(loop, *start, inside):
            cells = np.zeros((0, 6), int)
            break
        halves = maps.halves(cells[failed & ~small])
        # Cells that are known keep their images; the others' are computed anew.
        number = np.cumsum(~failed) - 1
        stay = ~failed[owner]
        new_owner, new_images = maps.images(halves)
        count = int((~failed).sum())
        cells = np.concatenate((cells[~failed], halves))
        owner = np.concatenate((number[owner[stay]], count + new_owner))
        images = np.concatenate((images[stay], new_images))
    return replace(trap, cells=cells, rest=int((~inside).sum()))


def _blocks(rings: int, sectors: int, layers: int) -> np.ndarray:
    """Cells (N, 6) to begin with, 4 by 8 by 4 of the smallest ones."""
    edges = [
        np.append(np.arange(low, high, width), high)
        for low, high, width in ((0, rings, 4), (0, sectors, 8), (-layers, layers, 4))
    ]
    begin = np.stack(np.meshgrid(*(edge[:-1] for edge in edges), indexing="ij"), axis=-1).reshape(
        -1, 3
    )
    end = np.stack(np.meshgrid(*(edge[1:] for edge in edges), indexing="ij"), axis=-1).reshape(
        -1, 3
    )
    return np.stack((begin, end), axis=2).reshape(-1, 6)


def _outside(inside: np.ndarray, images: np.ndarray) -> np.ndarray:
    """Whether images (N, 6) leave a set; those with a negative first number have left all cells.

    Sectors go round: the table has them twice, so that a box over the last one is counted like any other.
    """
    rings, sectors, layers = inside.shape
    a, b, c, d, e, f = images.T
    lost = (a < 0) | (b > rings) | (e < 0) | (f > layers)
    # Numbers of cells outside within boxes, from sums over all boxes at the origin; directions go round twice.
    total = np.zeros((rings + 1, 2 * sectors + 1, layers + 1), dtype=np.int64)
    out = ~np.concatenate((inside, inside), axis=1)
    total[1:, 1:, 1:] = out.cumsum(0).cumsum(1).cumsum(2)
    a, b, c, d, e, f = np.where(lost, 0, images.T)
    count = (total[b, d, f] - total[a, d, f] - total[b, c, f] + total[a, c, f]) - (
        total[b, d, e] - total[a, d, e] - total[b, c, e] + total[a, c, e]
    )
    return lost | (count > 0)


class _Maps:
    """Images of cells under one control period of the closed loop, with the errors that the trap allows.

    Late commands count as an error of the reading, so that velocity (m/s) and spin (rad/s) are read with a slack;
    images must hold every state that may be reached.
    """

    def __init__(self, loop: Loop, trap: Trap) -> None:
        self._loop = loop
        self._trap = trap
        first = loop.layers[0].weight
        self._worth = torch.linalg.vector_norm(first, dim=0).numpy()
        # A late command finds a state that has moved on since it was read: that is an error of the reading.
        off = trap.uncertainty
        _, high = off.push()
        pull, twist = loop.strongest()
        fastest = trap.layers / trap.fine * loop.step * high
        self._velocity = off.velocity + off.delay * (high * pull + trap.speed * fastest)
        self._spin = off.spin + off.delay * high * twist

    def halves(self, cells: np.ndarray) -> np.ndarray:
        """Both halves of cells (N, 6), along what matters most to the first layer and can be split.

        Split cells share an edge. Which axis is split costs time only.
        """
        width = cells[:, 1::2] - cells[:, ::2]
        dr, dphi, dw = self._sizes()
        size = np.stack(
            (
                width[:, 0] * dr * self._worth[:2].max(),
                width[:, 1] * dphi * cells[:, 1] * dr * self._worth[:2].max(),
                width[:, 2] * dw * self._worth[2],
            ),
            axis=1,
        )
        axis = np.where(width > 1, size, -1.0).argmax(axis=1)
        rows = np.arange(len(cells))
        middle = cells[rows, 2 * axis] + width[rows, axis] // 2
        below, above = cells.copy(), cells.copy()
        below[rows, 2 * axis + 1] = middle
        above[rows, 2 * axis] = middle
        return np.concatenate((below, above))

    def _sizes(self) -> tuple[float, float, float]:
        """Width of a ring (m/s), a sector (rad), and a layer of spin (rad/s)."""
        trap = self._trap
        return (
            trap.speed / trap.rings,
            2.0 * np.pi / trap.sectors,
            self._loop.step / trap.fine,
        )

    def images(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Images (M, 6) of cells (N, 6) under every command that they may have, and whose they are (M,)."""
        owners, results = [np.zeros(0, int)], [np.zeros((0, 6), int)]
        for begin in range(0, len(cells), _BATCH):
            part = cells[begin : begin + _BATCH]
            number, commands = self._commands(part)
            owners.append(begin + number)
            results.append(self._moved(part[number], commands))
        return np.concatenate(owners), np.concatenate(results)

    @torch.no_grad()
    def _commands(self, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Every command (M, thrusters) that cells may have, and whose it is (M,).

        The number of every cell occurs at least once.
        """
        loop, trap = self._loop, self._trap
        dr, dphi, _ = self._sizes()
        low, high = trap.uncertainty.push()
        r0, r1 = cells[:, 0] * dr, cells[:, 1] * dr
        half = 0.5 * dphi * (cells[:, 3] - cells[:, 2])
        middle = 0.5 * dphi * (cells[:, 3] + cells[:, 2])
        # A sector of a ring lies in a box along its middle direction.
        inner = r0 * np.cos(half)
        ahead = np.stack((np.cos(middle), np.sin(middle)), axis=1)
        across = np.stack((-np.sin(middle), np.cos(middle)), axis=1)
        ends = np.stack(
            [cells[:, k] / trap.fine * loop.step * x for k in (4, 5) for x in (low, high)]
        )
        centre = np.column_stack(
            (0.5 * (inner + r1)[:, None] * ahead, 0.5 * (ends.min(0) + ends.max(0)))
        )
        generators = np.zeros((len(cells), 3, 3))
        generators[:, :2, 0] = (0.5 * (r1 - inner))[:, None] * ahead
        generators[:, :2, 1] = (r1 * np.sin(half))[:, None] * across
        generators[:, 2, 2] = 0.5 * (ends.max(0) - ends.min(0))
        box = np.full((len(cells), 3), 1e-14)
        box[:, :2] += self._velocity
        box[:, 2] += self._spin
        # Cells become zonotopes, whose log-odds are enclosed.
        states = Zonotope(*(torch.tensor(x) for x in (centre, generators, box)))
        planes = enclose(loop.layers, states)
        value = ((planes.gain @ states.centre[:, :, None])[:, :, 0] + planes.offset).numpy()
        reach = (planes.gain @ states.generators).abs().sum(dim=2)
        reach = reach + (planes.gain.abs() @ states.box[:, :, None])[:, :, 0] + planes.error
        reach = reach.numpy() + LOGIT
        number = np.arange(len(cells))
        commands = value > reach
        either = np.abs(value) <= reach
        for thruster in range(value.shape[1]):
            both = either[number, thruster]
            open_too = commands[both].copy()
            open_too[:, thruster] = True
            number = np.concatenate((number, number[both]))
            commands = np.concatenate((commands, open_too))
        return number, commands.astype(float)

    def _moved(self, cells: np.ndarray, commands: np.ndarray) -> np.ndarray:
        """Images (N, 6) of cells (N, 6) under commands (N, thrusters); -1 where the speed is above its limit.

        Cells that a flight enters at all must be in the box, rounding included; whole boxes are tested by
        `_outside`.
        """
        loop, trap = self._loop, self._trap
        dr, dphi, _ = self._sizes()
        low, high = trap.uncertainty.push()
        steps = commands @ loop.lever
        # Velocity change in the middle, and how far others are from it.
        spin_middle = 0.5 * (cells[:, 4] + cells[:, 5]) / trap.fine
        spin_half = 0.5 * (cells[:, 5] - cells[:, 4]) / trap.fine
        impulse = loop.impulse(spin_middle * loop.step, commands)
        strength = np.linalg.norm(commands @ loop.force, axis=1)
        off_turn = high * spin_half + max(high - 1.0, 1.0 - low) * (
            np.abs(spin_middle) + 0.5 * np.abs(steps)
        )
        off = high * strength * loop.period**2 / 2.0 * loop.step * off_turn
        off += max(high - 1.0, 1.0 - low) * np.linalg.norm(impulse, axis=1)
        # The box of a sector, along its middle direction, moved by it.
        r0, r1 = cells[:, 0] * dr, cells[:, 1] * dr
        half = 0.5 * dphi * (cells[:, 3] - cells[:, 2])
        middle = 0.5 * dphi * (cells[:, 3] + cells[:, 2])
        c, s = np.cos(middle), np.sin(middle)
        ahead = c * impulse[:, 0] + s * impulse[:, 1]
        across = c * impulse[:, 1] - s * impulse[:, 0]
        x = np.stack((r0 * np.cos(half) + ahead - off, r1 + ahead + off))
        y = np.stack((-r1 * np.sin(half) + across - off, r1 * np.sin(half) + across + off))
        nearest = [np.where(z[0] * z[1] <= 0.0, 0.0, np.abs(z).min(axis=0)) for z in (x, y)]
        lowest = np.hypot(*nearest)
        highest = np.hypot(np.abs(x).max(axis=0), np.abs(y).max(axis=0))
        straight = np.arctan2(y.mean(axis=0), x.mean(axis=0))
        corners = np.stack([np.arctan2(b, a) - straight for a in x for b in y])
        corners = (corners + np.pi) % (2.0 * np.pi) - np.pi
        # Between decisions the velocity is off the straight line by at most |v''| T^2 / 8.
        fastest = loop.step * high * (np.abs(spin_middle) + spin_half + np.abs(steps))
        sag = high * strength * fastest * loop.period**2 / 8.0
        # A craft that coasts keeps its speed and its direction in W.
        coasts = strength < 1e-12
        turn = np.stack(
            [
                loop.period * loop.step * x * (k / trap.fine + 0.5 * steps)
                for k in (cells[:, 4], cells[:, 5])
                for x in (low, high)
            ]
        )
        begin = np.where(coasts, middle - half, middle + straight + corners.min(axis=0)) - turn.max(
            0
        )
        end = np.where(coasts, middle + half, middle + straight + corners.max(axis=0)) - turn.min(0)
        # Cells that the image touches.
        first = np.floor(begin / dphi - _SLACK).astype(int)
        last = np.ceil(end / dphi + _SLACK).astype(int)
        round_about = ((lowest == 0.0) & ~coasts) | (last - first >= trap.sectors)
        first, last = np.where(round_about, 0, first), np.where(round_about, trap.sectors, last)
        shift = first // trap.sectors * trap.sectors
        rings = [
            np.where(coasts, cells[:, 0], np.floor(lowest / dr - _SLACK)).astype(int),
            np.where(coasts, cells[:, 1], np.ceil(highest / dr + _SLACK)).astype(int),
        ]
        rings[0] = np.maximum(rings[0], 0)
        too_fast = ~coasts & (np.maximum(highest, r1) + sag > trap.speed * (1.0 - 1e-12))
        jump = np.round(steps).astype(int) * trap.fine + trap.layers
        result = np.stack(
            (*rings, first - shift, last - shift, cells[:, 4] + jump, cells[:, 5] + jump), axis=1
        )
        result[too_fast, 0] = -1
        return result
