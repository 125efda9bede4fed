"""Check of a trapping set of poses of an on/off agent in the plane, in intervals, apart from the prover.

The state is split into three parts, each of a position and its rate: along both diagonals of the goal's frame, that
have one set for both, and about the third axis. A certificate has cells of each. From a cell of one part, whatever
the other parts are in their sets, every pulse that the network may command moves the craft into cells of its set:
then their product is a trapping set. What one part does to another is bounded: thrust is off an axis by the heading
error, and a couple that turns the craft may take a thruster from a pulse along an axis.

Starts at rest that are farther away are flown as sets. At first the agent turns, and the position rests exactly.
While it comes into the set of headings, a pulse along an axis may be held back. Then the set of positions shrinks
into the trapping set.

Numbers are intervals in double precision and not balls, since a set has up to 10^5 cells, each with dozens of
commands, which arrays judge a thousand times as fast. They are widened by `_SLACK`, `_WIDER` and `_LOGIT`, far
above their rounding: numbers beyond `_MOST` in SI units, or `_STEEPEST` log-odds, are refused, and none is the
result of more than 200 operations, which err by 2e-14 of them at most. Floats are widened by `_SLACK` and `_WIDER`,
which cover all rounding: tests plant errors in tables, sizes and weights.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from rans_proof.agent_reader import AgentWeights, read_agent
from rans_proof.balls import Refused, need
from rans_proof.check_late import Late
from rans_proof.claims import (
    DIGEST,
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

FORMAT = 2
PROPERTY = "trapping set of poses of an agent that goes to a pose"
_LARGEST = 2**24
"""Bytes of a certificate."""
_MOST_CELLS = 2**23
"""Cells of a grid, and so bytes of memory of a set."""
_SIZE, _ERROR = number_in(0, 180), number_in(0, 0.2)
_WIDTH = Kind("number above 0, at most 180", lambda x: _SIZE.fits(x) and x > 0)
_RUNS = list_of(list_of(whole(1 - 2**20, 2**20 - 1), 3, 3), 1, _MOST_CELLS)
_ERRORS = (
    *("mass", "thrust", "position", "velocity", "heading", "spin"),
    *("opening", "shutting"),
)
_REACH = table_of({"sectors": whole(1, 10_000), "periods": whole(1, 10_000)})
_SCHEMA = {
    "format": one_of(FORMAT),
    "property": one_of(PROPERTY),
    "agent": table_of(dict.fromkeys(FILES, DIGEST)),
    "keep": table_of(dict.fromkeys(("position", "heading"), _SIZE)),
    "start": table_of(dict.fromkeys(("position", "heading", "speed", "spin"), _SIZE)),
    "uncertainty": table_of(dict.fromkeys(_ERRORS, _ERROR)),
    "grid": table_of(dict.fromkeys(("speed", "spin"), _WIDTH)),
    "cells": table_of(dict.fromkeys(("place", "heading"), _RUNS)),
    "reach": Kind(f"null, or {_REACH.words}", lambda x: x is None or _REACH.fits(x)),
}
"""What a certificate has, and nothing else."""
_SLACK = 1e-9
"""Widening of intervals, in SI units."""
_WIDER = 1e-7
"""Widening of images, in cells."""
_LOGIT = 1e-3
"""Log-odds, and inputs of units in log-odds, below which what happens is open, beside the rounding of sums."""
_UNIT = 2.0**-24
"""Unit roundoff of single precision, in which an agent flies."""
_MOST, _STEEPEST = 1e3, 1e9
"""Largest numbers that are computed with, in SI units and in log-odds; single precision has numbers to 3e38."""
_ROOM = 0.8
"""By how much positions on the way may be beyond the farthest start, m."""
_TURN_ROOM = 0.3
"""By how much headings on the way may be beyond the farthest start, rad; a set that comes farther is refused."""
_TURNS = 2000
"""Periods that a sector of headings may take to come into its set."""

Interval = tuple[Any, Any]


class Parts(NamedTuple):
    """Bounds of the state, each of absolute values: m, m/s, rad, rad/s."""

    place: float
    speed: float
    heading: float
    spin: float


class PoseCertificate(NamedTuple):
    """Content of a certificate that is accepted, or of which the form is right."""

    table: dict[str, Any]
    """The file's table."""
    settled: float | None
    """Time, s, after which every flight is in the trapping set; None: not known."""

    @property
    def theorem(self) -> str:
        """What it states, in words and units, without a full stop; `rans prove` and pages print it.

        Numbers are printed as the certificate has them, since a rounded one would be another theorem.
        """
        start = self.table["start"]
        keep = self.table["keep"]
        near = f"within {keep['position']!r} m and {keep['heading']!r} degrees of its goal for ever"
        begin = (
            f"from every place up to {start['position']!r} m away with a heading off by up to "
            f"{start['heading']!r} degrees"
        )
        if self.table["reach"] is None:
            fast = f"a speed up to {start['speed']!r} m/s and a spin up to {start['spin']!r} rad/s"
            return f"{begin}, {fast} it stays {near}; {self.errors}"
        after = "in the end " if self.settled is None else f"after {self.settled:.1f} s "
        return f"{begin}, at rest, it is {after}{near}; {self.errors}"

    @property
    def errors(self) -> str:
        """How far what flies may be from its design, in words and units.

        A key of "uncertainty" without words here would be an error that the theorem does not name.
        """
        off = {name: value for name, value in self.table["uncertainty"].items() if value}
        text = {
            "mass": "mass and inertia off by up to {} of them, by one factor",
            "thrust": "thrusts off by up to {} of them, by one factor for all",
            "position": "readings of the position off by up to {} m",
            "velocity": "readings of the velocity off by up to {} m/s",
            "heading": "readings of the heading off by up to {} rad",
            "spin": "readings of the spin off by up to {} rad/s",
            "opening": "each valve by itself, each time anew, up to {} s late to open",
            "shutting": "each valve by itself, each time anew, up to {} s late to shut",
        }
        return (
            ", ".join(text[name].format(repr(value)) for name, value in off.items())
            or "all as designed"
        )


def read_pose_certificate(content: bytes) -> PoseCertificate:
    """Content of a certificate's file, whose schema is closed.

    Raises:
        Refused: it is none.
    """
    table = entries("it", json_of(content, _LARGEST), _SCHEMA)
    is_slow = table["start"]["speed"] == table["start"]["spin"] == 0.0
    need(table["reach"] is None or is_slow, "starts that are far must be at rest")
    off = table["uncertainty"]
    is_prompt = off["opening"] == off["shutting"] == 0.0
    need(table["reach"] is None or is_prompt, "a way from far has no delays of valves")
    return PoseCertificate(table, None)


def check_pose(certificate: bytes, files: Mapping[str, bytes]) -> PoseCertificate:
    """Check a certificate of a trapping set of poses, and return what it states.

    Args:
        certificate: content of its file.
        files: contents of the agent's files, by name.

    Raises:
        Refused: it proves nothing, or is of another agent.
    """
    table = read_pose_certificate(certificate).table
    check_digests(table["agent"], files)
    loop = Loop(table, files)
    start = table["start"]
    keep = table["keep"]
    place, heading = (loop.cells(table["cells"][name], name) for name in ("place", "heading"))
    bounds = loop.bounds(place, heading)
    loop.check_closed(place, heading, bounds)
    within = loop.between_decisions(bounds)
    need(
        math.sqrt(2.0) * within.place + _SLACK <= keep["position"],
        "its cells are beyond the limit of the position",
    )
    need(
        within.heading + _SLACK <= math.radians(keep["heading"]),
        "its cells are beyond the limit of the heading",
    )
    # From where it starts: inside the set at once, or by the turn and the way that are checked.
    begin = Parts(start["position"], start["speed"], math.radians(start["heading"]), start["spin"])
    if table["reach"] is None:
        for cells, far, fast in (
            (place, begin.place, begin.speed),
            (heading, begin.heading, begin.spin),
        ):
            box = cells.box(far, fast)
            need(not (box.inside & ~cells.inside).any(), "its cells do not contain all starts")
        return PoseCertificate(table, 0.0)
    need(
        begin.place <= 5.0 and begin.heading < math.pi,
        "starts are at most 5 m away, and less than 180 degrees off",
    )
    periods = loop.reach(begin, table["reach"], place, heading, bounds)
    return PoseCertificate(table, periods * loop.period)


class Cells:
    """Set of cells of a position and its rate: a table of rows of the rate and columns of the position.

    ``inside`` (rows, columns) is changed in place by callers; `moved` must never lose a cell that a state may
    reach.
    """

    def __init__(self, width: tuple[float, float], half: tuple[int, int]) -> None:
        need(4 * half[0] * half[1] <= _MOST_CELLS, "it has too many cells")
        self.width = width
        """Height of a row, in units of the rate, and width of a column, in units of the position."""
        self.half = half
        """Rows and columns of either sign."""
        self.inside = np.zeros((2 * half[0], 2 * half[1]), dtype=bool)
        rate, position = (np.arange(-n, n) * w for n, w in zip(half, width, strict=True))
        self.rate = rate, rate + width[0]
        self.position = position, position + width[1]

    def like(self) -> Cells:
        """Set without cells on the same grid."""
        return Cells(self.width, self.half)

    def largest(self) -> tuple[float, float]:
        """Largest absolute position (m or rad) and rate (per s) of its states, at the edges of its cells.

        Upper bounds: they become `Parts`, by which the other sets are judged.
        """
        rows, columns = (np.flatnonzero(self.inside.any(axis=axis)) for axis in (1, 0))
        need(len(rows) > 0, "a set has no cells")
        result = []
        for number, half, width in (
            (columns, self.half[1], self.width[1]),
            (rows, self.half[0], self.width[0]),
        ):
            result.append(width * max(half - int(number[0]), int(number[-1]) + 1 - half))
        return result[0], result[1]

    def box(self, far: float, fast: float) -> Cells:
        """All cells with a position up to ``far`` and a rate up to ``fast``, at least those around rest."""
        result = self.like()
        rows, columns = (
            max(1, math.ceil(x / w + _SLACK)) for x, w in zip((fast, far), self.width, strict=True)
        )
        need(rows <= self.half[0] and columns <= self.half[1], "starts are beyond the cells")
        middle = [slice(n - k, n + k) for n, k in zip(self.half, (rows, columns), strict=True)]
        result.inside[middle[0], middle[1]] = True
        return result

    def moved(
        self,
        levels: Mapping[int, np.ndarray],
        push: Mapping[int, Interval],
        period: float,
        slip: float = 0.0,
    ) -> Cells:
        """Cells that contain the images of all its cells.

        Args:
            levels: cells in which a command may be, by commands.
            push: bounds of the rate's derivative over a period, by commands.
            period: control period, s.
            slip: by how much the rate may change besides, and the position by that times the period.
        """
        rows, columns = np.nonzero(self.inside)
        more = slip / self.width[0]
        boxes = []
        for level, may in levels.items():
            chosen = may[rows, columns]
            row = rows[chosen] - self.half[0]
            column = columns[chosen] - self.half[1]
            # In cells, of which a column is as wide as a row moves in a period: a rate of r to r + 1 moves by a,
            # a position of c to c + 1 by its rate and a / 2. Without a push nothing is widened.
            low, high = (period * x / self.width[0] for x in push[level])
            below, above = (more + (_WIDER if x or slip else 0.0) for x in (low, high))
            for first, last, part, n in (
                (row, row + 1, 1.0, self.half[0]),
                (column + row, column + row + 2, 0.5, self.half[1]),
            ):
                begin = np.floor(first + part * low - below).astype(int) + n
                end = np.ceil(last + part * high + above).astype(int) + n
                need((begin >= 0).all() and (end <= 2 * n).all(), "a cell leaves the grid")
                boxes += [begin, end]
        r0, r1, c0, c1 = (np.concatenate(boxes[k::4]) for k in range(4))
        # Cells in boxes, from sums of what begins and ends at their corners.
        top = r0.min()
        left = c0.min()
        corner = np.zeros((r1.max() - top + 1, c1.max() - left + 1), dtype=np.int64)
        for r, c, sign in ((r0, c0, 1), (r1, c1, 1), (r0, c1, -1), (r1, c0, -1)):
            np.add.at(corner, (r - top, c - left), sign)
        image = (corner.cumsum(0).cumsum(1) > 0)[:-1, :-1]
        result = self.like()
        result.inside[top : top + len(image), left : left + image.shape[1]] = image
        return result


class Loop:
    """Closed loop of an agent, its craft and the errors of a certificate, all read from the certificate's files.

    Bounds are enclosures with all rounding, in SI units and the goal's frame; what cannot be read is `Refused`.
    """

    def __init__(self, table: Mapping[str, Any], files: Mapping[str, bytes]) -> None:
        self.period = read_period(files["config.json"])
        self._design(read_craft(files["spacecraft.toml"]))
        agent = read_agent(files["agent.safetensors"], len(self.along))
        self.network = Network(agent)
        self.off = table["uncertainty"]
        low = (1.0 - self.off["thrust"]) / (1.0 + self.off["mass"]) - _SLACK
        high = (1.0 + self.off["thrust"]) / (1.0 - self.off["mass"]) + _SLACK
        self.factor = low, high
        most = self.most_pull, self.most_twist
        self.late = Late(self.off, self.along, self.pull * high, self.twist * high, most)
        need(
            max(self.late.opening, self.late.shutting) < self.period,
            "its valves may be late by a period",
        )
        self.off = self.late.readings(self.off)
        self.grid = table["grid"]

    def _design(self, craft: Craft) -> None:
        """Acceleration along a diagonal and rate of the spin by one thruster, and the part of each.

        Sets what all checks read; `Refused` for craft of another kind.
        """
        thrusters = craft.thrusters
        is_diagonal = all(abs(t.direction[0]) == abs(t.direction[1]) for t in thrusters)
        need(is_diagonal, "a thruster does not push along a diagonal")
        forces = {t.force for t in thrusters}
        torques = {t.squared_torque for t in thrusters}
        is_one = len(forces) == len(torques) == 1 and 0 not in torques
        need(is_one, "its thrusters are not all of one force and torque")
        # Diagonals are (1, -1) and (1, 1).
        self.along = [
            ((x - y > 0) - (x - y < 0), (x + y > 0) - (x + y < 0))
            for x, y in (t.direction for t in thrusters)
        ]
        self.lever = [t.lever for t in thrusters]
        self.pull = float(forces.pop()) / craft.mass
        self.twist = math.sqrt(torques.pop()) / craft.inertia
        self.most_pull = max(
            sum(max(s * a[k], 0) for a in self.along) for s in (1, -1) for k in (0, 1)
        )
        self.most_twist = max(sum(max(s * k, 0) for k in self.lever) for s in (1, -1))
        strongest = max(self.pull * self.most_pull, self.twist * self.most_twist)
        need(strongest <= _MOST, "its thrusters are too strong for double precision")

    def cells(self, runs: Sequence[Sequence[int]], part: str) -> Cells:
        """Cells of a certificate, on a grid that holds them and their images."""
        rows, columns = (
            max(max(-min(run[k] for run in runs), max(run[k] for run in runs) + 1) for k in ks)
            for ks in ((0,), (1, 2))
        )
        result = self._grid(part, rows, columns)
        need(all(run[1] < run[2] for run in runs), "a row of cells is empty")
        for row, first, last in runs:
            result.inside[row + result.half[0], first + result.half[1] : last + result.half[1]] = (
                True
            )
        return result

    def _grid(self, part: str, rows: int, columns: int) -> Cells:
        """A grid with these rows and columns of either sign, and one more; what would leave it is refused."""
        width = self.grid["speed" if part == "place" else "spin"]
        return Cells((width, width * self.period), (rows + 1, columns + 1))

    def bounds(self, place: Cells, heading: Cells) -> Parts:
        """Bounds of all states of a product of sets."""
        bounds = Parts(*place.largest(), *heading.largest())
        need(max(bounds) <= _MOST, "its cells are too far or too fast for double precision")
        return bounds

    def between_decisions(self, bounds: Parts) -> Parts:
        """Bounds at all instants of flights whose decisions are within bounds.

        Between them a position is off the straight line by at most its largest acceleration times period^2 / 8.
        """
        sag = self.period**2 / 8.0 * self.factor[1]
        # Thrust along both diagonals, turned by any angle, is at most sqrt(2) of that along one.
        pull = math.sqrt(2.0) * self.most_pull * self.pull
        twist = self.most_twist * self.twist
        unread = self.late.unread
        return bounds._replace(
            place=bounds.place + sag * pull + unread["position"],
            heading=bounds.heading + sag * twist + unread["heading"],
        )

    def check_closed(self, place: Cells, heading: Cells, bounds: Parts) -> None:
        """Refuse (`Refused`) a product of sets that an image leaves, of headings first and then of positions.

        Both sets must be within ``bounds``: a heading's image is computed for all positions within them, and vice
        versa.
        """
        slips = self.late.spin_slip, self.late.slip(self._turned(bounds))
        levels = self.heading_levels(heading, bounds)
        turned = heading.moved(levels, self._twists(), self.period, slips[0])
        need(not (turned.inside & ~heading.inside).any(), "a heading may leave its cells")
        levels = self.place_levels(place, bounds)
        moved = place.moved(levels, self._pulls(bounds), self.period, slips[1])
        need(not (moved.inside & ~place.inside).any(), "a position may leave its cells")

    def _twists(self) -> dict[int, Interval]:
        """Bounds of the rate of the spin, by thrusters that turn the craft."""
        return {
            k: _times(k * self.twist, self.factor)
            for k in range(-self.most_twist, self.most_twist + 1)
        }

    def _turned(self, bounds: Parts) -> float:
        """Largest angle between the craft and the goal's frame while thrusters are open."""
        return min(
            bounds.heading
            + bounds.spin * self.period
            + self.twist * self.most_twist * self.factor[1] * self.period**2 / 2
            + self.late.turned(bounds.spin, self.period),
            math.pi,
        )

    def _pulls(self, bounds: Parts) -> dict[int, Interval]:
        """Bounds of the acceleration along a diagonal of the goal's frame, by thrusters along the craft's.

        Too wide an interval costs cells and too narrow one would prove what is false; so it is for all bounds here.
        """
        turned = self._turned(bounds)
        least = math.cos(turned)
        across = self.most_pull * (math.sin(turned) if turned < math.pi / 2 else 1.0)
        result = {}
        for k in range(-self.most_pull, self.most_pull + 1):
            ends = k, k * least
            forward = min(ends) - across, max(ends) + across
            products = [f * self.pull * x for f in self.factor for x in forward]
            result[k] = min(products) - _SLACK, max(products) + _SLACK
        return result

    def place_levels(
        self, cells: Cells, bounds: Parts, is_quiet: bool = False
    ) -> dict[int, np.ndarray]:
        """Cells of a position in which so many thrusters may push along it; of either diagonal.

        Args:
            cells: grid of a position and its rate.
            bounds: of all parts.
            is_quiet: whether a pulse may be held back in all of them.
        """
        # Beyond the bounds are no states: every number is allowed there, which can only refuse more.
        rows, across = (
            slice(max(n - 1 - math.ceil(x / w), 0), n + 1 + math.ceil(x / w))
            for n, w, x in zip(cells.half, cells.width, (bounds.speed, bounds.place), strict=True)
        )
        position = cells.position[0][across], cells.position[1][across]
        rate = cells.rate[0][rows], cells.rate[1][rows]
        result: dict[int, np.ndarray] = {}
        for k in range(-self.most_pull, self.most_pull + 1):
            result[k] = np.ones(cells.inside.shape, dtype=bool)
            result[k][rows, across] = False
        place, speed = self._readings(bounds)
        for axis in (0, 1):
            columns = self._columns(bounds)
            columns[4 + axis] = _spread(self._seen(position, bounds.place, bounds.heading), place)
            columns[axis] = _spread(self._seen(rate, bounds.speed, bounds.heading), speed)
            # Way to the goal is what a position lacks.
            columns[4 + axis] = -columns[4 + axis][1], -columns[4 + axis][0]
            weights = [a[axis] for a in self.along]
            for level, may in self.network.levels(columns, 4 + axis, axis, weights).items():
                result[level][rows, across] |= may
        if is_quiet:
            result[0][:] = True
        return result

    def heading_levels(
        self, cells: Cells, bounds: Parts, weights: Sequence[int] | None = None
    ) -> dict[int, np.ndarray]:
        """Cells of a heading in which so many thrusters may turn the craft, or have a sum of other weights.

        A level that is left out makes the check unsound, one too many only refuses more.
        """
        columns = self._columns(bounds)
        sine = _sine(*cells.position)
        off = self.off["heading"] + _SLACK
        columns[7] = np.maximum(-sine[1] - off, -1.0), np.minimum(-sine[0] + off, 1.0)
        columns[2] = _spread(cells.rate, self.off["spin"])
        return self.network.levels(columns, 7, 2, self.lever if weights is None else weights)

    def _columns(self, bounds: Parts) -> list[Interval]:
        """Bounds of what the network is given, with its vectors along the craft's diagonals."""
        place, speed = self._readings(bounds)
        place = math.sqrt(2.0) * bounds.place + place
        speed = math.sqrt(2.0) * bounds.speed + speed
        turned = min(bounds.heading + self.off["heading"], math.pi)
        sine = math.sin(turned) if turned < math.pi / 2 else 1.0
        sizes = [speed, speed, bounds.spin + self.off["spin"], 1.0, place, place, 1.0, sine]
        columns: list[Interval] = [(-x - _SLACK, x + _SLACK) for x in sizes]
        columns[3] = (1.0, 1.0)
        return columns

    def _readings(self, bounds: Parts) -> tuple[float, float]:
        """Errors of a component of position and velocity in the body frame, with those of the heading."""
        turn = math.sqrt(2.0) * self.off["heading"]
        return self.off["position"] + turn * bounds.place, self.off[
            "velocity"
        ] + turn * bounds.speed

    @staticmethod
    def _seen(along: Interval, across: float, heading: float) -> Interval:
        """A component along a diagonal of the craft, by that of the goal's frame and the size of the other one.

        Interval and size must hold for every heading up to ``heading``, rad.
        """
        turned = min(heading, math.pi)
        c = math.cos(turned)
        s = math.sin(turned) if turned < math.pi / 2 else 1.0
        low = (
            np.minimum(along[0], c * along[0])
            if c >= 0
            else -np.maximum(abs(along[0]), abs(along[1]))
        )
        high = (
            np.maximum(along[1], c * along[1])
            if c >= 0
            else np.maximum(abs(along[0]), abs(along[1]))
        )
        return low - s * across - _SLACK, high + s * across + _SLACK

    def reach(
        self, begin: Parts, plan: Mapping[str, int], place: Cells, heading: Cells, bounds: Parts
    ) -> int:
        """Periods after which all flights from starts at rest are in the trapping set.

        Sets on the way are as large as need be, and none is refined: a period in which a bound is passed is
        refused.
        """
        # Positions: a grid for all of the way, in cells of the trapping set.
        columns = math.ceil((begin.place + _ROOM) / place.width[1])
        way = self._grid("place", 8 * place.half[0], columns)
        far = Parts(way.half[1] * way.width[1], way.half[0] * way.width[0], math.pi, 0.0)
        # On the way too, headings stay in their cells.
        turned = heading.moved(
            self.heading_levels(heading, far._replace(heading=bounds.heading, spin=bounds.spin)),
            self._twists(),
            self.period,
        )
        need(
            not (turned.inside & ~heading.inside).any(), "a heading may leave its cells on the way"
        )
        first, loose, wide = self._turn(begin, plan["sectors"], heading, far)
        current = way.box(begin.place, 0.0)
        # While headings come into their set, any pulse may be held back.
        for _ in range(loose):
            now = Parts(*current.largest(), *wide)
            current = current.moved(
                self.place_levels(current, now, is_quiet=True), self._pulls(now), self.period
            )
        # Then positions come into theirs; bounds are kept for ten periods, in which they may only shrink.
        inside = way.like()
        inside.inside[_middle(way, place)] = place.inside
        kept = Parts(*current.largest(), bounds.heading, bounds.spin)
        levels = self.place_levels(current, kept)
        pulls = self._pulls(kept)
        for number in range(plan["periods"]):
            if not (current.inside & ~inside.inside).any():
                return first + loose + number
            now = Parts(*current.largest(), bounds.heading, bounds.spin)
            if number % 10 == 0 or now.place > kept.place or now.speed > kept.speed:
                kept = now
                levels = self.place_levels(current, kept)
                pulls = self._pulls(kept)
            current = current.moved(levels, pulls, self.period)
        raise Refused(f"positions are not in their cells after {plan['periods']} periods")

    def _turn(
        self, begin: Parts, sectors: int, heading: Cells, far: Parts
    ) -> tuple[int, int, tuple[float, float]]:
        """Periods of the longest turn in which the position rests; those to its end; heading and spin then.

        Over headings from -begin.heading to begin.heading (rad) in so many ``sectors``, until they are in
        ``heading``, the trapping cells; positions are anywhere within ``far``. `Refused` if the turn does not end.
        """
        columns = math.ceil(min(begin.heading + _TURN_ROOM, math.pi) / heading.width[1])
        columns = max(columns, heading.half[1])
        whole = self._grid("heading", heading.half[0] + heading.half[0] // 2, columns)
        far = far._replace(spin=whole.half[0] * whole.width[0])
        levels = self.heading_levels(whole, far)
        # Cells of headings in which no position on the way is pulsed.
        quiet = np.ones(whole.inside.shape, dtype=bool)
        for axis in (0, 1):
            for level, may in self.heading_levels(
                whole, far, [a[axis] for a in self.along]
            ).items():
                if level:
                    quiet &= ~may
        settled = whole.like()
        settled.inside[_middle(whole, heading)] = heading.inside
        twists = self._twists()
        edges = (
            np.linspace(-begin.heading, begin.heading, sectors + 1) / whole.width[1] + whole.half[1]
        )
        latest = 0
        loose = 0
        widest = [0.0, 0.0]
        # Sector after sector of the first heading, until its cells are settled.
        for low, high in itertools.pairwise(edges):
            current = whole.like()
            row = whole.half[0]
            current.inside[row - 1 : row + 1, math.floor(low - 1e-7) : math.ceil(high + 1e-7)] = (
                True
            )
            first = None
            for number in range(_TURNS):
                if not (current.inside & ~settled.inside).any():
                    break
                if first is None and (current.inside & ~quiet).any():
                    first = number
                if first is not None:
                    moving = current.like()
                    moving.inside = current.inside & ~quiet
                    if moving.inside.any():
                        widest = [max(a, b) for a, b in zip(widest, moving.largest(), strict=True)]
                current = current.moved(levels, twists, self.period)
            else:
                raise Refused(f"headings are not in their cells after {_TURNS} periods")
            first = number if first is None else first
            latest = max(latest, first)
            loose = max(loose, number - first)
        ends = heading.largest()
        return latest, loose, (max(widest[0], ends[0]), max(widest[1], ends[1]))


class Network:
    """Log-odds of an agent whose first layer has units of one column each, in intervals.

    Columns 0, 1 and 4, 5 are position and velocity along both diagonals; other networks are `Refused`.
    """

    def __init__(self, agent: AgentWeights) -> None:
        need(
            agent.activation == "relu" and len(agent.layers) == 2,
            "its network has not two layers of ReLU",
        )
        need(not agent.mean.any(), "its columns are not centred at 0")
        self._scale = scale = 1.0 / np.sqrt(agent.variance + 1e-6)
        need(scale[0] == scale[1] and scale[4] == scale[5], "its columns have scales of their own")
        (first, shift), (self._second, self._bias) = agent.layers
        # Vectors along the diagonals (1, -1) and (1, 1), whose weights are zero without rounding or not.
        weight = first.copy()
        for k in (0, 4):
            weight[:, k], weight[:, k + 1] = (
                first[:, k] - first[:, k + 1],
                first[:, k] + first[:, k + 1],
            )
        weight[:, [0, 1, 4, 5]] *= math.sqrt(0.5)
        weight *= scale
        shift = shift + weight[:, 3]
        used = (weight != 0.0) & (np.arange(8) != 3)
        need(
            (used.sum(axis=1) == 1).all() and not used[:, 6].any(),
            "a unit takes more than one column",
        )
        self._units = [
            (int(np.flatnonzero(row)[0]), float(w[row][0]), float(b))
            for row, w, b in zip(used, weight, shift, strict=True)
        ]
        head, bias = agent.head
        self._head = head[1::2] - head[::2]
        self._least = bias[1::2] - bias[::2]
        # Sums of sizes, which no partial sum of a layer exceeds in any order, in single precision as it flies:
        # columns are below 9.9 after their scales, and scores of shut and of open are summed apart.
        steepest = np.full(8, 9.9)
        for rows, shifts in (*agent.layers, agent.head):
            steepest = np.abs(rows) @ steepest + np.abs(shifts)
            need(steepest.max() <= _STEEPEST, "its log-odds are too steep for single precision")
        # Roundings of a term: its scale, as many sums as columns and units, two biases and two products.
        self._rounding = (8 + 8 + len(self._units)) * _UNIT
        self._pairs = [(i, j) for i in range(len(self._bias)) for j in range(i)]
        # Bias and weights of each unit, and of the sums of two, with the sizes of their terms.
        table = np.column_stack((self._bias, self._second))
        terms = np.abs(table)
        self._single = table, terms
        sums, sizes = (np.array([x[i] + x[j] for i, j in self._pairs]) for x in (table, terms))
        self._sums = sums, sizes

    def _range(
        self, rows: np.ndarray, terms: np.ndarray, column: int, interval: Interval
    ) -> Interval:
        """Bounds of what units of a column add to rows: a piecewise linear function, extreme at ends and bends.

        With the rounding of single precision, which is largest where terms are. That of this program is made up for
        by the last line.
        """
        units = [(k, slope, b) for k, (c, slope, b) in enumerate(self._units) if c == column]
        low, high = (np.asarray(x, float) for x in interval)

        def value(x: np.ndarray, sign: float) -> np.ndarray:
            total = np.zeros((len(rows), *x.shape))
            for k, slope, b in units:
                total = total + np.multiply.outer(rows[:, k], np.maximum(slope * x + b, 0.0))
                size = np.abs(slope * x) + abs(b)
                total = total + sign * self._rounding * np.multiply.outer(terms[:, k], size)
            return total

        bounds = []
        for sign, extreme in ((-1.0, np.min), (1.0, np.max)):
            ends = [value(low, sign), value(high, sign)]
            for bend in (0.0, *(-b / slope for _, slope, b in units)):
                inside = value(np.full(low.shape, bend), sign)
                ends.append(np.where((low < bend) & (bend < high), inside, ends[0]))
            bounds.append(extreme(ends, axis=0))
        size = np.abs(rows).sum() * max(1.0, float(np.abs(low).max()), float(np.abs(high).max()))
        return bounds[0] - 1e-13 * size, bounds[1] + 1e-13 * size

    def levels(
        self, columns: Sequence[Interval], across: int, down: int, weights: Sequence[int]
    ) -> dict[int, np.ndarray]:
        """Where the open thrusters may have a sum of weights: tables (rows, columns), by sums.

        Args:
            columns: bounds of what the network is given; those of columns ``across`` and ``down`` are arrays.
            across: column that changes along a table's rows.
            down: column that changes along a table's columns.
            weights: of each thruster, whole numbers.
        """
        for ends, scale in zip(columns, self._scale, strict=True):
            need(all(np.abs(scale * x).max() < 9.9 for x in ends), "a column may be clipped")
        base, ends = self._inputs(*self._single, columns, across, down)
        # Columns of a table between which no unit differs, but for how far below zero it is, are one.
        dead = base[1] + ends[1].max(axis=1, keepdims=True) < -_LOGIT
        base = np.where(dead, -1e9, base)
        base, number = np.unique(base, axis=2, return_inverse=True)
        low, high = (x[:, None, :] + y[:, :, None] for x, y in zip(base, ends, strict=True))
        # Both units of some pairs are never live together.
        sums: Any = sum(x[1].max(axis=1) for x in self._inputs(*self._sums, columns, across, down))
        apart = {pair for pair, x in zip(self._pairs, sums, strict=True) if x < -2.0 * _LOGIT}
        result: dict[int, np.ndarray] = {}
        shape = low.shape[1:]
        for live in itertools.product((False, True), repeat=len(low)):
            if any(live[i] and live[j] for i, j in apart):
                continue
            may = np.ones(shape, dtype=bool)
            for k, is_live in enumerate(live):
                may &= high[k] > -_LOGIT if is_live else low[k] < _LOGIT
            if may.any():
                self._add(result, may, live, low, high, weights)
        return {level: may[:, number.ravel()] for level, may in result.items()}

    def _inputs(
        self,
        table: np.ndarray,
        terms: np.ndarray,
        columns: Sequence[Interval],
        across: int,
        down: int,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of linear functions of the first layer: the sum of (2, units, columns) and (2, units, rows).

        The functions are a table of a bias and weights, and the sizes of the terms that these are sums of.
        The axis ``across`` is that of a cell's columns (position), ``down`` that of its rows (rate); other columns
        are the same for all cells.
        """
        off = self._rounding * terms[:, 0]
        along = np.stack((table[:, 0] - off, table[:, 0] + off))[:, :, None]
        upright = np.zeros((2, len(table), 1))
        for column in range(8):
            if column in (3, 6):
                continue
            ends = np.stack(self._range(table[:, 1:], terms[:, 1:], column, columns[column]))
            if column == down:
                upright = upright + ends
            else:
                along = along + (ends if column == across else ends[:, :, None])
        return along, upright

    def _add(
        self,
        result: dict[int, np.ndarray],
        may: np.ndarray,
        live: Sequence[bool],
        low: np.ndarray,
        high: np.ndarray,
        weights: Sequence[int],
    ) -> None:
        """Add sums of weights where these units are live and all others are zero.

        Changes tables in `result` (cells) in place.
        """
        on = [k for k, is_live in enumerate(live) if is_live]
        # Thrusters of the same log-odds are open together.
        groups: dict[tuple[float, ...], int] = {}
        for thruster, weight in enumerate(weights):
            key = (*self._head[thruster, on], self._least[thruster])
            groups[key] = groups.get(key, 0) + weight
        keys = [key for key, weight in groups.items() if weight]
        opens = []
        shuts = []
        for key in keys:
            least = np.full(may.shape, key[-1])
            most = least.copy()
            off = np.abs(least)
            for k, w in zip(on, key[:-1], strict=True):
                ends = w * np.maximum(low[k] - _LOGIT, 0.0), w * np.maximum(high[k] + _LOGIT, 0.0)
                least = least + np.minimum(*ends)
                most = most + np.maximum(*ends)
                off = off + np.abs(ends[1])
            least = least - self._rounding * off
            most = most + self._rounding * off
            opens.append(may & (most > -_LOGIT))
            shuts.append(may & (least < _LOGIT))
        # Log-odds that are never below others' are open whenever these are: units are never negative.
        above = [
            (i, j)
            for i, a in enumerate(keys)
            for j, b in enumerate(keys)
            if i != j and all(x >= y for x, y in zip(a, b, strict=True))
        ]
        for chosen in itertools.product((False, True), repeat=len(keys)):
            if any(chosen[j] and not chosen[i] for i, j in above):
                continue
            here = may
            for is_open, opened, shut in zip(chosen, opens, shuts, strict=True):
                here = here & (opened if is_open else shut)
            if here.any():
                total = sum(
                    groups[key] for key, is_open in zip(keys, chosen, strict=True) if is_open
                )
                result[total] = result[total] | here if total in result else here


def _sine(low: np.ndarray, high: np.ndarray) -> Interval:
    """Bounds of the sine between angles of at most one and a half turns."""
    ends = np.sin(low), np.sin(high)
    least = np.minimum(*ends)
    most = np.maximum(*ends)
    for turn in (-1, 0, 1):
        top = (0.5 + 2.0 * turn) * math.pi
        most = np.where((low <= top + _SLACK) & (top - _SLACK <= high), 1.0, most)
        least = np.where(
            (low <= top - math.pi + _SLACK) & (top - math.pi - _SLACK <= high), -1.0, least
        )
    return least, most


def _middle(outer: Cells, inner: Cells) -> tuple[slice, slice]:
    """Where a table of cells lies in a larger one of the same cells, as slices of rows and columns.

    Both tables have rest in their middle.
    """
    need(
        outer.width == inner.width
        and all(a >= b for a, b in zip(outer.half, inner.half, strict=True)),
        "grids",
    )
    rows, columns = (slice(a - b, a + b) for a, b in zip(outer.half, inner.half, strict=True))
    return rows, columns


def _spread(interval: Interval, off: float) -> Interval:
    return interval[0] - off - _SLACK, interval[1] + off + _SLACK


def _times(value: float, factor: tuple[float, float]) -> Interval:
    ends = value * factor[0], value * factor[1]
    if value == 0.0:
        return ends
    return min(ends) - _SLACK, max(ends) + _SLACK
