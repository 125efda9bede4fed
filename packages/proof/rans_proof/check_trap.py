"""Check of a trapping set in ball arithmetic; it shares no mathematics with the prover.

A certificate is accepted if it is of the agent's files, its cells contain the starts, and every command that a cell
may have moves the whole cell into cells of the certificate, without passing the limits of speed and spin on the
way. Numbers are intervals of FLINT (`rans_proof.balls`), except whole numbers of cells.

Weights, thrusters, mass and control period are read from the agent's files anew (`rans_proof.agent_reader` and
`rans_proof.craft_reader`). `rans_proof.flown` compares them with the agent as it flies; that is no part of the
check. Planted errors in cells, formulas and lookups must be found (`tests/test_check_trap.py`).
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from flint import acb, arb, arb_mat, ctx

from rans_proof.agent_reader import AgentWeights, read_agent
from rans_proof.balls import (
    absolute_row_sums,
    column,
    matrix,
    need,
    network_enclosure,
    side_by_side,
)
from rans_proof.claims import (
    ABOVE_ZERO,
    DIGEST,
    NUMBER,
    Kind,
    entries,
    json_of,
    list_of,
    number_in,
    one_of,
    table_of,
    whole,
)
from rans_proof.craft_reader import FILES, Craft, check_digests, read_craft, read_period

_BITS = 64
_LOGIT = arb("0.001")
"""Log-odds below which a command is undecided."""
_TOLERANCE = arb(2) ** -40
"""Of integrals; what is left is in their balls."""
_CLIP = 10.0
"""Normalised columns are clipped here (`rans_proof.agent_reader`); cells that reach it are refused."""
_MOST_CELLS = 2**28
"""Largest number of the smallest cells of a grid: one byte each in the memory of every process that checks."""
_LARGEST = 2**26
"""Bytes of a certificate."""
_ERROR = Kind("number from 0 to below 1", lambda x: NUMBER.fits(x) and 0 <= x < 1)
_COUNT = whole(1, _MOST_CELLS)
_SCHEMA = {
    "format": one_of(2),
    "property": one_of("trapping set of a velocity-tracking agent whose goal is at rest"),
    "agent": table_of(dict.fromkeys(FILES, DIGEST)),
    "keep": table_of({"speed": ABOVE_ZERO, "spin": ABOVE_ZERO}),
    "start": table_of({"speed": number_in(0, 1e9), "spin": number_in(0, 1e9)}),
    "uncertainty": table_of(dict.fromkeys(("mass", "thrust", "velocity", "spin", "delay"), _ERROR)),
    "grid": table_of(dict.fromkeys(("rings", "sectors", "layers", "fine"), _COUNT)),
    "cells": list_of(list_of(whole(-_MOST_CELLS, _MOST_CELLS), 6, 6), 1, _MOST_CELLS),
}
"""What a certificate has, and nothing else."""


def check_trap(
    certificate: bytes,
    files: Mapping[str, bytes],
    only: Sequence[int] | None = None,
) -> None:
    """Check a certificate of a trapping set.

    Args:
        certificate: content of its file.
        files: contents of the agent's files, by name.
        only: numbers of the cells whose images are checked; None: all.

    Raises:
        Refused: it proves nothing, or is of another agent.
    """
    table, loop = _read(certificate, files)
    cells = table["cells"]
    inside = loop.union(cells)
    loop.check_start(table["start"], inside)
    for k in range(len(cells)) if only is None else only:
        for commands in loop.commands(cells[k]):
            reason = loop.leaves(cells[k], commands, inside)
            need(not reason, f"cell {k} {cells[k]} {reason}.")


def formulas(
    certificate: bytes, files: Mapping[str, bytes]
) -> tuple[
    Callable[[np.ndarray], np.ndarray], Callable[[np.ndarray, np.ndarray], np.ndarray], float
]:
    """What a check takes the agent for, to be compared with its flight: see `rans_proof.flown.Formulas`.

    States are (N, 3): velocity in B, m/s, and spin, rad/s; commands (N, thrusters).

    Raises:
        Refused: as `check_trap`, before the first cell.
    """
    _, loop = _read(certificate, files)
    return loop.formulas()


def _read(certificate: bytes, files: Mapping[str, bytes]) -> tuple[dict[str, Any], _Loop]:
    """A certificate and the closed loop of the agent that it is of.

    It sets the precision of all balls of the process (`ctx.prec`).
    """
    ctx.prec = _BITS
    table = entries("it", json_of(certificate, _LARGEST), _SCHEMA)
    keep, start, grid = table["keep"], table["start"], table["grid"]
    need(all(start[key] <= keep[key] for key in keep), "its starts are beyond its limits.")
    size = 2 * grid["rings"] * grid["sectors"] * grid["layers"]
    need(size <= _MOST_CELLS, f"its grid has {size:,} cells.")
    check_digests(table["agent"], files)
    return table, _Loop(table, files)


class _Image(NamedTuple):
    """Cells that contain the image of a cell: first and last edge along each coordinate."""

    rings: tuple[int, int]
    sectors: tuple[int, int]
    """Numbers go on where the directions go round."""
    layers: tuple[int, int]
    fastest: Any
    """Upper bound of the speed on the way, m/s; None: it is constant."""


class _Loop:
    """Closed loop of an agent and the cells of a certificate, in balls, all read from the certificate's files.

    Speeds are in m/s and spins in rad/s, of the body frame; what cannot be read is `Refused`.
    """

    def __init__(self, table: Mapping[str, Any], files: Mapping[str, bytes]) -> None:
        # Errors are added to what is read, and factors of the thrust multiply each pull: both enclose all that
        # flies.
        self.period_text = str(read_period(files["config.json"], "track-velocity"))
        self.period = arb(self.period_text)
        self._integrals: dict[tuple[str, int], Any] = {}
        self._design(read_craft(files["spacecraft.toml"]))
        agent = read_agent(files["agent.safetensors"], "track-velocity", len(self.force))
        self.layers = _network(agent)
        self.speed, self.spin = (arb(table["keep"][key]) for key in ("speed", "spin"))
        self.rings, self.sectors, self.side, self.fine = (
            table["grid"][key] for key in ("rings", "sectors", "layers", "fine")
        )
        off = {key: arb(value) for key, value in table["uncertainty"].items()}
        self.low = (1 - off["thrust"]) / (1 + off["mass"])
        self.high = (1 + off["thrust"]) / (1 - off["mass"])
        self.factor = self.low.union(self.high)
        # A late command finds a state that has moved on since it was read: that is an error of the reading.
        late = off["delay"]
        need(late < self.period, "its commands may be late by a period.")
        every = list(itertools.product((0, 1), repeat=len(self.force)))
        pull = max(float(_length(self._pull(u)).upper()) for u in every) * (1 + arb(2) ** -40)
        jump = max(abs(self._jump(u)) for u in every)
        fastest = self.side * self.step * self.high / self.fine
        drift = off["velocity"] + late * (self.high * pull + self.speed * fastest)
        turn = off["spin"] + late * self.high * jump * self.step / self.period
        self.reading = [drift, drift, turn]
        need(fastest <= self.spin, "its cells go beyond the limit of the spin.")

    def _design(self, craft: Craft) -> None:
        """Set force over mass (balls) and lever of each thruster: its torque is a whole number of steps of spin.

        `image`, `_jump` and `_pull` read what it sets, in the order of the craft's thrusters.
        """
        self.directions = [(t.force, *t.direction) for t in craft.thrusters]
        self.force = []
        for thruster in craft.thrusters:
            x, y = (_ball(part) for part in thruster.direction)
            size = _ball(thruster.force) / (x**2 + y**2).sqrt() / arb(craft.mass)
            self.force.append([x * size, y * size])
        # Squares of torques are rational, so that equal ones are equal without rounding.
        squares = {t.squared_torque for t in craft.thrusters if t.moment}
        need(len(squares) == 1, "its thrusters have different torques.")
        self.lever = [t.lever for t in craft.thrusters]
        self.step = _ball(squares.pop()).sqrt() * self.period / arb(craft.inertia)

    def union(self, cells: Sequence[Any]) -> Any:
        """Table (rings, sectors, layers) of the grid's cells that these cells cover.

        `Refused` for a cell of no grid.
        """
        inside = np.zeros((self.rings, self.sectors, 2 * self.side), dtype=bool)
        for cell in cells:
            a, b, c, d, e, f = cell
            good = 0 <= a < b <= self.rings and 0 <= c < d <= self.sectors
            # A sector of at most half a circle lies in the box that is used for it.
            good &= -self.side <= e < f <= self.side and 2 * (d - c) <= self.sectors
            need(good, f"{cell} is no cell of its grid.")
            inside[a:b, c:d, e + self.side : f + self.side] = True
        return inside

    def check_start(self, start: Mapping[str, float], inside: Any) -> None:
        """Refuse cells that do not contain all states up to a speed and a spin."""
        rings = _ceil(arb(start["speed"]) / self.speed * self.rings)
        layers = _ceil(arb(start["spin"]) / (self.step * self.low) * self.fine)
        # Rest is a start: the ring and the layers that hold it always belong to the cover.
        ring, layer = max(rings, 1), max(layers, 1)
        is_on_grid = ring <= self.rings and layer <= self.side
        need(is_on_grid, "its starts are beyond its limits.")
        begin = inside[:ring, :, self.side - layer : self.side + layer]
        need(begin.all(), "its cells do not contain all starts.")

    def sector(self, cell: Any) -> tuple[Any, Any, Any, Any]:
        """Slowest, fastest, middle and half of the directions, which are parts of pi."""
        r0, r1 = (self.speed * k / self.rings for k in cell[:2])
        return r0, r1, arb(cell[3] + cell[2]) / self.sectors, arb(cell[3] - cell[2]) / self.sectors

    def spins(self, cell: Any, more: Any = 0) -> Any:
        """Ball of the spins of a cell and so many steps more, in steps of the nominal craft."""
        ends = [arb(k) / self.fine + more for k in cell[4:]]
        products = [x * factor for x in ends for factor in (self.low, self.high)]
        return functools.reduce(lambda hull, ball: hull.union(ball), products)

    def commands(self, cell: Any) -> list[tuple[int, ...]]:
        """Every command that states of a cell may have, with errors of the readings.

        A thruster whose log-odds may have either sign may be open or shut: a command that is missing would be a
        hole.
        """
        r0, r1, middle, half = self.sector(cell)
        c, s = middle.cos_pi(), middle.sin_pi()
        inner = r0 * half.cos_pi()
        ahead, across = (r1 - inner) / 2, r1 * half.sin_pi()
        spin = self.spins(cell) * self.step
        centre = column([(r1 + inner) / 2 * c, (r1 + inner) / 2 * s, arb(spin.mid())])
        spread = [[ahead * c, -across * s, 0], [ahead * s, across * c, 0], [0, 0, arb(spin.rad())]]
        errors = [[self.reading[i] if i == k else 0 for k in range(3)] for i in range(3)]
        both = side_by_side(arb_mat(spread), arb_mat(errors))
        self.layers[1](centre, both)
        gain, offset, off = network_enclosure(self.layers[0], centre, both)
        values = (gain * centre + offset).entries()
        reach = [a + b + _LOGIT for a, b in zip(absolute_row_sums(gain * both), off, strict=True)]
        choices = [
            (1,) if m > r else (0,) if m < -r else (0, 1)
            for m, r in zip(values, reach, strict=True)
        ]
        return list(itertools.product(*choices))

    def image(self, cell: Any, commands: Sequence[int]) -> _Image:
        """Cells that a cell is moved into by a command, and how fast states are on the way.

        Too many cells cost a proof, and one too few would be a hole in it; the sag bounds the speed between both
        ends.
        """
        r0, r1, middle, half = self.sector(cell)
        spin = self.spins(cell)
        jump = self._jump(commands)
        turn = self.period * self.step * self.spins(cell, arb(jump) / 2) / arb.pi()
        force = self._pull(commands)
        size = _length(force)
        fastest = None
        if _opposed(self.directions, commands):
            # A craft that coasts, whatever it spins: speed and direction in W stay.
            rings = cell[0], cell[1]
            begin, end = middle - half - turn, middle + half - turn
        else:
            *push, off = self._impulse(force, spin, jump)
            c, s = middle.cos_pi(), middle.sin_pi()
            ahead = c * push[0] + s * push[1] + off
            across = c * push[1] - s * push[0] + off
            x = (r0 * half.cos_pi() + ahead).union(r1 + ahead)
            y = (r1 * half.sin_pi()) * arb(0, 1) + across
            least = arb(_least(x) ** 2 + _least(y) ** 2).sqrt()
            most = _length((x, y))
            swiftest = self.step * (spin.abs_upper() + self.high * abs(jump))
            sag = self.high * size * swiftest * self.period**2 / 8
            fastest = _largest(most, r1) + sag
            rings = (_floor(least / self.speed * self.rings), _ceil(most / self.speed * self.rings))
            begin, end = self._directions(x, y, middle, turn)
        first = _floor(begin * self.sectors / 2)
        last = min(_ceil(end * self.sectors / 2), first + self.sectors)
        layers = cell[4] + jump * self.fine, cell[5] + jump * self.fine
        return _Image(rings, (first, last), layers, fastest)

    def leaves(self, cell: Any, commands: Sequence[int], inside: Any) -> str:
        """Why the image of a cell under a command is not inside, or ""."""
        rings, sectors, layers, fastest = self.image(cell, commands)
        if fastest is not None and not (fastest <= self.speed):
            return "may pass the limit of the speed"
        low, high = (k + self.side for k in layers)
        if rings[0] < 0 or rings[1] > self.rings or low < 0 or high > 2 * self.side:
            return "may leave the grid"
        columns = [k % self.sectors for k in range(*sectors)]
        if not inside[rings[0] : rings[1], columns, low:high].all():
            return "may leave the cells"
        return ""

    def formulas(self) -> tuple[Callable[..., np.ndarray], Callable[..., np.ndarray], float]:
        """Middles of the balls of network and motion as functions of (N, 3) states, and the period (s).

        `rans_proof.flown` compares them with a flight of the agent. No proof rests on them, which is why middles
        will do.
        """

        def log_odds(states: np.ndarray) -> np.ndarray:
            x = states
            for weight, bias, kind in self.layers[0]:
                x = x @ _middles(weight).T + _middles(bias)[:, 0]
                x = np.tanh(x) if kind else x
            return x

        def moved(states: np.ndarray, commands: np.ndarray) -> np.ndarray:
            """States (N, 3) a period after others under commands (N, thrusters), by the middles of the balls.

            In B, m/s and rad/s; mass and thrust as designed.
            """
            ends = []
            step = float(self.step)
            for (vx, vy, spin), command in zip(states, commands.astype(int).tolist(), strict=True):
                nominal = arb(spin) / self.step
                jump = self._jump(command)
                (fx, fy), (c, s) = self._pull(command), self._turning(arb(nominal.mid()), jump)
                ends.append(
                    (
                        vx + float(c * fx - s * fy),
                        vy + float(s * fx + c * fy),
                        spin + jump * step,
                    )
                )
            return np.array(ends)

        return log_odds, moved, float(self.period_text)

    def _jump(self, commands: Sequence[int]) -> int:
        """Steps of spin that commands make."""
        return sum(k * u for k, u in zip(self.lever, commands, strict=True))

    def _pull(self, commands: Sequence[int]) -> list[Any]:
        """Force over mass of commands."""
        pairs = list(zip(self.force, commands, strict=True))
        return [sum((f[i] * u for f, u in pairs), arb(0)) for i in (0, 1)]

    def _impulse(self, force: Sequence[Any], spin: Any, jump: int) -> tuple[Any, Any, Any]:
        """Velocity change, in B of the beginning of a period, and a ball of how far it is off.

        For thrust as designed; ``off`` also has the factor by which thrust and mass may be off.

        The ball may be too wide, never too narrow.
        """
        c, s = self._rotation(str(spin.mid().man_exp()), arb(spin.mid()), jump)
        # Other spins and torques turn the force by other angles, which are integrated over the period.
        spread = arb(spin.rad()) + abs(self.factor - 1).abs_upper() * abs(jump) / 2
        size = _length(force)
        x, y = c * force[0] - s * force[1], s * force[0] + c * force[1]
        off = self.high * size * spread * self.step * self.period**2 / 2
        off += abs(self.factor - 1).abs_upper() * _length((x, y))
        return x, y, arb(0, off.abs_upper())

    def _rotation(self, key: str, spin: Any, jump: int) -> tuple[Any, Any]:
        """`_turning` of a spin with this key, which many cells share."""
        if (key, jump) not in self._integrals:
            self._integrals[key, jump] = self._turning(spin, jump)
        return self._integrals[key, jump]

    def _turning(self, spin: Any, jump: int) -> tuple[Any, Any]:
        """Integrals of cosine and sine of the angle that the nominal craft has turned by.

        Only flights of `formulas` use it, no part of the proof, which bounds with `_impulse`.
        """
        turn = self.step * self.period

        def integral(function: Callable[[Any], Any]) -> Any:
            """Integral over a period of a function of the angle that is turned, as a ball."""
            whole = acb.integral(
                lambda x, _: function(turn * x * (spin + jump * x / 2)),
                0,
                1,
                abs_tol=_TOLERANCE,
                rel_tol=_TOLERANCE,
            )
            return whole.real * self.period

        return integral(lambda a: a.cos()), integral(lambda a: a.sin())

    def _directions(self, x: Any, y: Any, middle: Any, turn: Any) -> tuple[Any, Any]:
        """Directions (parts of pi) of the box x, y around a middle direction, less a turn.

        All of them if 0 is in it.

        The second is more than the first, and neither is brought into one turn: `image` makes a range of sectors of
        them.
        """
        if x.contains(0) and y.contains(0):
            return arb(0), arb(2)
        straight = arb.atan2(arb(y.mid()), arb(x.mid()))
        c, s = straight.cos(), straight.sin()
        corners = itertools.product((x.lower(), x.upper()), (y.lower(), y.upper()))
        angles = [arb.atan2(c * arb(b) - s * arb(a), c * arb(a) + s * arb(b)) for a, b in corners]
        whole = functools.reduce(lambda hull, ball: hull.union(ball), angles)
        whole = (whole + straight) / arb.pi() + middle - turn
        return arb(whole.lower()), arb(whole.upper())


def _opposed(thrusters: Sequence[Any], commands: Sequence[int]) -> bool:
    """Whether the open ones of thrusters (force, direction) push in pairs of opposite directions.

    Then they sum to no force, whatever their common factor is: the craft coasts exactly, without rounding.
    """
    rest = [thruster for thruster, u in zip(thrusters, commands, strict=True) if u]
    while rest:
        force, x, y = rest.pop()
        if (force, -x, -y) not in rest:
            return False
        rest.remove((force, -x, -y))
    return True


def _length(vector: Sequence[Any]) -> Any:
    """Upper bound of a length; a bound of a square below zero would have no root."""
    return sum((arb(x.abs_upper()) ** 2 for x in vector), arb(0)).sqrt()


def _ball(value: Fraction) -> Any:
    return arb(value.numerator) / arb(value.denominator)


def _least(x: Any) -> Any:
    return arb(0) if x.contains(0) else arb(x.abs_lower())


def _largest(a: Any, b: Any) -> Any:
    return a.union(b).upper()


def _floor(x: Any) -> int:
    return int(x.lower().floor().unique_fmpz())


def _ceil(x: Any) -> int:
    return int(x.upper().ceil().unique_fmpz())


def _middles(matrix: Any) -> np.ndarray:
    """Middles of the balls of a matrix."""
    return np.array([[float(x.mid()) for x in row] for row in matrix.tolist()])


def _network(agent: AgentWeights) -> tuple[Any, Any]:
    """Layers from velocity and spin to log-odds, and a check that no column is clipped.

    What the agent's preprocessing does to an observation is written here once more: normalised with 1e-6 on the
    variance, clipped at `_CLIP`, which ``check`` refuses. `rans_proof.flown` compares it with the agent.
    """
    need(agent.activation == "tanh", "its layers are not of tanh.")
    # Columns in B with the goal at rest: velocity, spin, task flag 2, velocity to gain, and two of zeros.
    weights = np.zeros((8, 3))
    weights[0, 0] = weights[1, 1] = weights[2, 2] = 1.0
    weights[4, 0] = weights[5, 1] = -1.0
    scale = [1 / (arb(float(x)) + arb("0.000001")).sqrt() for x in agent.variance]
    fixed = [arb(0)] * 3 + [arb(2)] + [arb(0)] * 4
    shift = column(
        [(f - arb(float(m))) * s for f, m, s in zip(fixed, agent.mean, scale, strict=True)]
    )
    columns = arb_mat(
        [[s * x for x in row] for s, row in zip(scale, weights.tolist(), strict=True)]
    )

    def check(centre: Any, spread: Any) -> None:
        values = (columns * centre + shift).entries()
        for value, reach in zip(values, absolute_row_sums(columns * spread), strict=True):
            need(abs(value) + reach < _CLIP, "a column is clipped.")

    layers = []
    for k, (weight, bias) in enumerate(agent.layers):
        weight, bias = matrix(weight), matrix(bias[:, None])
        if k == 0:
            weight, bias = weight * columns, weight * shift + bias
        layers.append((weight, bias, "Tanh"))
    # Log-odds of opening a thruster: its second output less its first one.
    weight, bias = agent.head
    layers.append(
        (
            matrix(weight[1::2]) - matrix(weight[::2]),
            matrix((bias[1::2])[:, None]) - matrix(bias[::2][:, None]),
            "",
        )
    )
    return layers, check
