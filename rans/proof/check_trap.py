"""Check of a trapping set in ball arithmetic; it shares no code with the prover.

It reads the files of the agent itself: weights, thrusters, and control period. A certificate is accepted if it is
of these files, its cells contain the starts, and every command that a cell may have moves the whole cell into cells
of the certificate, without passing the limits of speed and spin on the way. Numbers are intervals of FLINT
(`rans.proof.balls`), except whole numbers of cells.
"""

from __future__ import annotations

import functools
import hashlib
import itertools
import json
import tomllib
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from flint import acb, arb, arb_mat, ctx

from rans.proof.balls import (
    Refused,
    absolute_row_sums,
    column,
    matrix,
    network_enclosure,
    side_by_side,
    with_sizes,
)

FILES = ("agent.safetensors", "config.json", "spacecraft.toml")
_BITS = 64
_LOGIT = arb("0.001")
"""Log-odds below which a command is undecided."""
_TOLERANCE = arb(2) ** -40
"""Of integrals; what is left is in their balls."""
_CLIP = 10.0
"""Normalised columns are clipped here; cells that reach it are refused."""


def check_trap(
    certificate: bytes, files: Mapping[str, bytes], only: Sequence[int] | None = None
) -> None:
    """Check a certificate of a trapping set.

    Args:
        certificate: content of its file.
        files: contents of the agent's files, by name.
        only: numbers of the cells whose images are checked; None: all.

    Raises:
        Refused: it proves nothing, or is of another agent.
    """
    ctx.prec = _BITS
    table = json.loads(certificate)
    # What config.json says is read anew, so that its form may change.
    for name in ("agent.safetensors", "spacecraft.toml"):
        if table["agent"][name] != hashlib.sha256(files[name]).hexdigest():
            raise Refused(f"it is of another agent: the SHA-256 of {name} differs.")
    loop = _Loop(table, files)
    cells = [tuple(map(int, cell)) for cell in table["cells"]]
    if [list(cell) for cell in cells] != table["cells"]:
        raise Refused("its cells are not of whole numbers.")
    inside = loop.union(cells)
    loop.check_start(table["start"], inside)
    for number in range(len(cells)) if only is None else only:
        for commands in loop.commands(cells[number]):
            reason = loop.leaves(cells[number], commands, inside)
            if reason:
                raise Refused(f"cell {number} {cells[number]} {reason}.")


class _Loop:
    """Closed loop of an agent and the cells of a certificate."""

    def __init__(self, table: dict[str, Any], files: Mapping[str, bytes]) -> None:
        config = json.loads(files["config.json"])
        craft = tomllib.loads(files["spacecraft.toml"].decode())
        settings = config["ppo"]
        usual = {"backbone": "dense", "zoom": 0.0, "symmetric": False, "activation": "tanh"}
        if config["task"] != "track-velocity" or craft["dimension"] != 2:
            raise Refused("its task is not track-velocity in the plane.")
        memory = settings.get("memory", {"kind": "none"})
        remembers = memory != "none" and memory.get("kind") != "none"
        if remembers or any(settings.get(key, value) != value for key, value in usual.items()):
            raise Refused("its policy is not a dense network of tanh on columns in the body frame.")
        if craft.get("thrust_sharing", "none") != "none" or set(craft) & {
            "wheel",
            "propellant",
            "slosh",
        }:
            raise Refused("its spacecraft has a shared supply, wheels, propellant or slosh.")
        self.period = arb(str(config["timing"]["control_period"]))
        self._integrals: dict[tuple[str, int], Any] = {}
        self._design(craft)
        self.layers = _network(files["agent.safetensors"], len(self.force))
        self.speed, self.spin = (arb(table["keep"][key]) for key in ("speed", "spin"))
        self.rings, self.sectors, self.side, self.fine = (
            int(table["grid"][key]) for key in ("rings", "sectors", "layers", "fine")
        )
        if min(self.rings, self.sectors, self.side, self.fine) < 1:
            raise Refused("its grid is empty.")
        off = {key: arb(value) for key, value in table["uncertainty"].items()}
        if any(not 0 <= x < 1 for x in off.values()):
            raise Refused("an uncertainty is not between 0 and 1.")
        self.low = (1 - off["thrust"]) / (1 + off["mass"])
        self.high = (1 + off["thrust"]) / (1 - off["mass"])
        self.factor = self.low.union(self.high)
        # A late command finds a state that has moved on since it was read: that is an error of the reading.
        late = off.get("delay", arb(0))
        if not late < self.period:
            raise Refused("its commands may be late by a period.")
        every = list(itertools.product((0, 1), repeat=len(self.force)))
        pull = max(float(_length(self._pull(u)).upper()) for u in every) * (1 + arb(2) ** -40)
        jump = max(abs(self._jump(u)) for u in every)
        fastest = self.side * self.step * self.high / self.fine
        drift = off["velocity"] + late * (self.high * pull + self.speed * fastest)
        turn = off["spin"] + late * self.high * jump * self.step / self.period
        self.reading = [drift, drift, turn]
        if not fastest <= self.spin:
            raise Refused("its cells go beyond the limit of the spin.")

    def _design(self, craft: dict[str, Any]) -> None:
        """Force over mass of each thruster, and its torque as a whole number of steps of spin."""
        thrusters = craft["thruster"]
        if any(craft.get("centre_of_mass", (0, 0))):
            raise Refused("the centre of mass is not in the middle of its frame.")
        self.force, self.directions, levers = [], [], []
        for thruster in thrusters:
            p, d = (
                [Fraction(float(x)) for x in thruster[key]] for key in ("position", "direction")
            )
            self.directions.append((Fraction(float(thruster["force"])), *d))
            norm = (_ball(d[0]) ** 2 + _ball(d[1]) ** 2).sqrt()
            size = arb(float(thruster["force"])) / norm
            self.force.append([_ball(x) * size / arb(float(craft["mass"])) for x in d])
            scale = Fraction(float(thruster["force"])) ** 2 / (d[0] ** 2 + d[1] ** 2)
            levers.append((p[0] * d[1] - p[1] * d[0], scale))
        # Squares of torques are rational, so that equal ones are equal without rounding.
        squares = {moment**2 * scale for moment, scale in levers if moment}
        if len(squares) != 1:
            raise Refused("its thrusters have different torques.")
        self.lever = [(moment > 0) - (moment < 0) for moment, _ in levers]
        torque = _ball(squares.pop()).sqrt()
        self.step = torque * self.period / arb(float(craft["inertia"]))

    def union(self, cells: Sequence[Any]) -> Any:
        inside = np.zeros((self.rings, self.sectors, 2 * self.side), dtype=bool)
        for cell in cells:
            a, b, c, d, e, f = cell
            good = 0 <= a < b <= self.rings and 0 <= c < d <= self.sectors
            # A sector of at most half a circle lies in the box that is used for it.
            if not (good and -self.side <= e < f <= self.side and 2 * (d - c) <= self.sectors):
                raise Refused(f"{cell} is no cell of its grid.")
            inside[a:b, c:d, e + self.side : f + self.side] = True
        return inside

    def check_start(self, start: Mapping[str, float], inside: Any) -> None:
        """Refuse cells that do not contain all states up to a speed and a spin."""
        rings = (arb(start["speed"]) / self.speed * self.rings).upper()
        layers = (arb(start["spin"]) / (self.step * self.low) * self.fine).upper()
        ring = next((k for k in range(self.rings + 1) if rings <= k), None)
        layer = next((k for k in range(self.side + 1) if layers <= k), None)
        if ring is None or layer is None:
            raise Refused("its starts are beyond its limits.")
        if not inside[:ring, :, self.side - layer : self.side + layer].all():
            raise Refused("its cells do not contain all starts.")

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
        """Every command that states of a cell may have, with errors of the readings."""
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

    def leaves(self, cell: Any, commands: Sequence[int], inside: Any) -> str:
        """Why the image of a cell under a command is not inside, or ""."""
        r0, r1, middle, half = self.sector(cell)
        spin = self.spins(cell)
        jump = self._jump(commands)
        turn = self.period * self.step * self.spins(cell, arb(jump) / 2) / arb.pi()
        force = self._pull(commands)
        size = _length(force)
        if _opposed(self.directions, commands):
            # A craft that coasts, whatever it spins: speed and direction in W stay.
            rings = cell[:2]
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
            fastest = self.step * (spin.abs_upper() + self.high * abs(jump))
            sag = self.high * size * fastest * self.period**2 / 8
            if not (_largest(most, r1) + sag <= self.speed):
                return "may pass the limit of the speed"
            rings = (_floor(least / self.speed * self.rings), _ceil(most / self.speed * self.rings))
            begin, end = self._directions(x, y, middle, turn)
        first = _floor(begin * self.sectors / 2)
        last = min(_ceil(end * self.sectors / 2), first + self.sectors)
        layers = [k + jump * self.fine + self.side for k in cell[4:]]
        if rings[0] < 0 or rings[1] > self.rings or layers[0] < 0 or layers[1] > 2 * self.side:
            return "may leave the grid"
        columns = [k % self.sectors for k in range(first, last)]
        if not inside[rings[0] : rings[1], columns, layers[0] : layers[1]].all():
            return "may leave the cells"
        return ""

    def _jump(self, commands: Sequence[int]) -> int:
        """Steps of spin that commands make."""
        return sum(k * u for k, u in zip(self.lever, commands, strict=True))

    def _pull(self, commands: Sequence[int]) -> list[Any]:
        """Force over mass of commands."""
        pairs = list(zip(self.force, commands, strict=True))
        return [sum((f[i] * u for f, u in pairs), arb(0)) for i in (0, 1)]

    def _impulse(self, force: Sequence[Any], spin: Any, jump: int) -> tuple[Any, Any, Any]:
        """Velocity change, in B of the beginning of a period, and a ball of how far it is off."""
        c, s = self._rotation(str(spin.mid().man_exp()), arb(spin.mid()), jump)
        # Other spins and torques turn the force by other angles, which are integrated over the period.
        spread = arb(spin.rad()) + abs(self.factor - 1).abs_upper() * abs(jump) / 2
        size = _length(force)
        x, y = c * force[0] - s * force[1], s * force[0] + c * force[1]
        off = self.high * size * spread * self.step * self.period**2 / 2
        off += abs(self.factor - 1).abs_upper() * _length((x, y))
        return x, y, arb(0, off.abs_upper())

    def _rotation(self, key: str, spin: Any, jump: int) -> tuple[Any, Any]:
        """Integrals of cosine and sine of the angle that the nominal craft has turned by."""
        if (key, jump) not in self._integrals:
            turn = self.step * self.period

            def integral(function: Callable[[Any], Any]) -> Any:
                whole = acb.integral(
                    lambda x, _: function(turn * x * (spin + jump * x / 2)),
                    0,
                    1,
                    abs_tol=_TOLERANCE,
                    rel_tol=_TOLERANCE,
                )
                return whole.real * self.period

            self._integrals[key, jump] = integral(lambda a: a.cos()), integral(lambda a: a.sin())
        return self._integrals[key, jump]

    def _directions(self, x: Any, y: Any, middle: Any, turn: Any) -> tuple[Any, Any]:
        """Directions of a box along a middle direction, less a turn, in parts of pi."""
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
    """Whether the open ones of thrusters (force, direction) push in pairs of opposite directions."""
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


def _network(content: bytes, thrusters: int) -> tuple[Any, Any]:
    """Layers from velocity and spin to log-odds, and a check that no column is clipped."""
    size = int.from_bytes(content[:8], "little")
    header = json.loads(content[8 : 8 + size])

    def tensor(name: str) -> np.ndarray:
        entry = header[f"weights/{name}"]
        if entry["dtype"] != "F32":
            raise Refused(f"{name} is not in single precision.")
        begin, end = entry["data_offsets"]
        data = content[8 + size :][begin:end]
        return np.frombuffer(data, "<f4").reshape(entry["shape"]).astype(float)

    mean, variance = tensor("features_extractor.mean"), tensor("features_extractor.variance")
    # Columns in B with the goal at rest: velocity, spin, task flag 2, velocity to gain, and two of zeros.
    weights = np.zeros((8, 3))
    weights[0, 0] = weights[1, 1] = weights[2, 2] = 1.0
    weights[4, 0] = weights[5, 1] = -1.0
    scale = [1 / (arb(float(x)) + arb("0.000001")).sqrt() for x in variance]
    fixed = [arb(0)] * 3 + [arb(2)] + [arb(0)] * 4
    shift = column([(f - arb(float(m))) * s for f, m, s in zip(fixed, mean, scale, strict=True)])
    columns = arb_mat(
        [[s * x for x in row] for s, row in zip(scale, weights.tolist(), strict=True)]
    )

    def check(centre: Any, spread: Any) -> None:
        values = (columns * centre + shift).entries()
        for value, reach in zip(values, absolute_row_sums(columns * spread), strict=True):
            if not abs(value) + reach < _CLIP:
                raise Refused("a column is clipped.")

    layers = []
    numbers = sorted({int(n.split(".")[-2]) for n in header if ".trunk." in n})
    for k, number in enumerate(numbers):
        weight = matrix(tensor(f"features_extractor.trunk.{number}.weight"))
        bias = matrix(tensor(f"features_extractor.trunk.{number}.bias")[:, None])
        if k == 0:
            weight, bias = weight * columns, weight * shift + bias
        layers.append((weight, bias, "Tanh"))
    # Log-odds of opening a thruster: its second output less its first one.
    weight, bias = tensor("action_net.weight"), tensor("action_net.bias")
    if len(bias) != 2 * thrusters:
        raise Refused("its commands are not on/off.")
    layers.append(
        (
            matrix(weight[1::2]) - matrix(weight[::2]),
            matrix((bias[1::2])[:, None]) - matrix(bias[::2][:, None]),
            "",
        )
    )
    return with_sizes(layers), check
