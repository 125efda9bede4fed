"""Transfers to a target whose coasts keep out of a zone around it, by sequential convex programming.

States are affine in the commands, and so are the coasts from them. A coast that keeps out of a ball is not a convex
set: in every round it keeps to the half space that faces the nearest point of the coast of the round before. Limits
of a mission are taken as in `rans_missions.convex.rendezvous`. Slack in every row makes each program solvable, at a
price at which the last rounds use none (Y. Mao et al., "Successive convexification of non-convex optimal control
problems", IEEE Conference on Decision and Control, 2016).
"""

from __future__ import annotations

import math

import numpy as np
from scipy import sparse

from rans.model.drift import ClohessyWiltshire
from rans_missions.convex.cone_program import ConeProgram
from rans_missions.convex.rendezvous import Meeting, cone_rows
from rans_missions.passive_safety import CoastZone, transition

_ROUNDS = 12
"""Largest number of programs."""
_CONVERGED = 0.01
"""Relative change of the impulse at which rounds end."""
_NEAR = 2.0
"""Coasts within so many radii of the zone have rows in the next program."""
_PRICES = 100.0, 3000.0, 100.0
"""Prices of a unit of slack of coasts, limits and positions, in impulses of one thruster over a period: a metre
counts as much as a few centimetres a second."""
_ROUNDING = 1e-5
"""Slack that counts as none, m or m/s."""
_STALLED = 0.9
"""Factor by which slack must fall in a round that goes on."""
_COAST, _LIMIT, _POSITION = range(3)
"""Kinds of slack."""
_BETWEEN = 2e-4
"""Margin of limits at the ends of periods, m or m/s, for the time between them."""
_ARRIVAL = 0.9
"""Part of the tolerances within which the transfer arrives."""
_SIDES = 4
"""Sides of the target on which transfers pass it, tried in turn."""
_BESIDE = 0.7
"""Distance from the target at which the first program begins the approach, in that of the zone."""
_ENTRY = 0.99
"""Distance at which the approach begins, in that of the zone."""


def passive_transfer(
    meeting: Meeting,
    start: np.ndarray,
    zone: CoastZone,
    clear: float,
    entry: int,
    periods: int,
) -> np.ndarray | None:
    """Commands (periods, thrusters) of a transfer whose coasts of an orbit keep out of a zone; None: none is found.

    Coasts count from all instants until the craft is within the zone's approach, at the end of a given period.
    Limits are kept at the end of every period. The first program leaves coasts out, and begins the approach beside
    the target, on one side after the other.

    Args:
        meeting: what is to be done, in a Clohessy-Wiltshire frame; it is met at the end of the last period.
        start: (6,) position, m, and velocity, m/s.
        zone: zone around the origin, with an approach.
        clear: distance, m, that coasts keep from the zone.
        entry: control periods until the approach.
        periods: control periods of the transfer.
    """
    # Directions across the way to the target.
    _, _, axes = np.linalg.svd(start[None, :3])
    for angle in np.linspace(0.0, 2.0 * math.pi, _SIDES, endpoint=False):
        side = math.cos(angle) * axes[1] + math.sin(angle) * axes[2]
        beside = _BESIDE * zone.approach * side
        commands = _passing(meeting, start, zone, zone.radius + clear, entry, periods, beside)
        if commands is not None:
            return commands
    return None


def _passing(
    meeting: Meeting,
    start: np.ndarray,
    zone: CoastZone,
    radius: float,
    entry: int,
    periods: int,
    beside: np.ndarray,
) -> np.ndarray | None:
    """(periods, m) commands whose coasts keep a radius (m), with the first approach at a point (3,), m.

    None: none found. See `passive_transfer`.
    """
    assert isinstance(meeting.drift, ClohessyWiltshire)
    n, period = meeting.drift.mean_motion, meeting.timing.control_period
    # States (periods + 1, 6) are free + effect @ commands.
    checks = meeting.timing.checks * np.arange(periods + 1)
    free = meeting.free(start, checks)
    effect = np.stack([meeting.effect(int(check), periods) for check in checks])
    # On the line to the target, which sets the first tangents of the limits.
    states = np.linspace(1.0, 0.0, periods + 1)[:, None] * start
    # Instants of coasts, close enough that the craft passes half the zone's radius between two of them.
    speed = float(np.linalg.norm(start[:3])) / (entry * period)
    orbit = 2.0 * math.pi / n
    count = math.ceil((orbit + period) / min(0.5 * zone.radius / speed, orbit / 100.0))
    coast = np.stack([transition(n, t)[:3] for t in np.linspace(0.0, orbit + period, count + 1)])
    price = np.tile(meeting.price, periods)
    commands: np.ndarray | None = None
    impulse = least_slack = math.inf
    for round_ in range(_ROUNDS):
        rows = _Rows(len(price))
        # Coasts from the end of a period, and at the same instants from its beginning: in between are those from
        # within the period.
        later = coast @ transition(n, period)
        ends = (
            np.einsum("jab,kb->jka", later, states[:entry]),
            np.einsum("jab,kb->jka", coast, states[1 : entry + 1]),
        )
        near = _nearest(*ends)
        distance = np.linalg.norm(near, axis=2)
        instant, which = np.nonzero((distance < radius + _NEAR * zone.radius) & (round_ > 0))
        unit = near[instant, which] / np.maximum(distance[instant, which], 1e-9)[:, None]
        for shift, response in ((0, later), (1, coast)):
            direction = np.einsum("ia,iab->ib", unit, response[instant])
            rows.above(
                np.einsum("ib,ibc->ic", direction, effect[which + shift]),
                np.einsum("ib,ib->i", direction, free[which + shift]) - radius,
            )
        for k in range(1, periods + 1):
            for limit in meeting.limits:
                cone = cone_rows(limit, states[k])
                rows.cone(
                    cone.row @ effect[k],
                    float(cone.row @ free[k]) + cone.constant - _BETWEEN,
                    cone.matrix @ effect[k],
                    cone.matrix @ free[k] + cone.vector,
                    _LIMIT,
                )
        begin, within = (0.0, _ENTRY) if round_ else (beside, _ENTRY - _BESIDE)
        rows.ball(effect[entry, :3], free[entry, :3] - begin, within * zone.approach)
        away = free[-1] - np.concatenate([meeting.point, np.zeros(3)])
        rows.ball(effect[-1, :3], away[:3], _ARRIVAL * meeting.position_tolerance)
        rows.ball(effect[-1, 3:], away[3:], _ARRIVAL * meeting.velocity_tolerance, _LIMIT)
        answer = rows.program(price).solve("a transfer with safe coasts")
        if answer is None:
            return None
        solved, slacks = np.split(np.array(answer.x), [len(price)])
        solved = np.clip(solved, 0.0, 1.0)
        spent, slack = float(price @ solved), float(np.array(_PRICES) @ slacks)
        states = free + effect @ solved
        if round_ and slacks.max() < _ROUNDING:
            commands = solved
            if abs(spent - impulse) < _CONVERGED * impulse:
                break
            impulse = spent
        elif round_ > 1 and slack > _STALLED * least_slack:
            break
        least_slack = slack if round_ else math.inf
    return None if commands is None else commands.reshape(periods, -1)


def _nearest(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The point (J, K, 3) nearest to the origin of each segment between two points (J, K, 3)."""
    along = second - first
    square = np.maximum(np.sum(along * along, axis=2), 1e-30)
    part = np.clip(-np.sum(first * along, axis=2) / square, 0.0, 1.0)
    return first + part[..., None] * along


class _Rows:
    """A program of commands in [0, 1] and one slack for all rows of a kind."""

    def __init__(self, count: int) -> None:
        self._count = count
        unit = np.eye(count + len(_PRICES))
        self._matrix = [-unit, unit[:count]]
        self._right = [np.zeros(len(unit)), np.ones(count)]
        self._cones: list[np.ndarray] = []
        self._constants: list[np.ndarray] = []

    def above(self, matrix: np.ndarray, constant: np.ndarray) -> None:
        """Matrix u + constant + slack of coasts >= 0."""
        slack = np.zeros((len(matrix), len(_PRICES)))
        slack[:, _COAST] = -1.0
        self._matrix.append(np.hstack([-matrix, slack]))
        self._right.append(constant)

    def cone(
        self, row: np.ndarray, constant: float, matrix: np.ndarray, vector: np.ndarray, kind: int
    ) -> None:
        """|matrix u + vector| <= row u + constant + slack of a kind."""
        slack = np.zeros((len(vector) + 1, len(_PRICES)))
        slack[0, kind] = -1.0
        self._cones.append(np.hstack([-np.vstack([row, matrix]), slack]))
        self._constants.append(np.concatenate([[constant], vector]))

    def ball(
        self, matrix: np.ndarray, vector: np.ndarray, radius: float, kind: int = _POSITION
    ) -> None:
        """|matrix u + vector| <= radius + slack of a kind."""
        self.cone(np.zeros(self._count), radius, matrix, vector, kind)

    def program(self, price: np.ndarray) -> ConeProgram:
        """The program of commands that cost ``price`` (n,) each, with slack at `_PRICES`.

        Commands come first, then the slacks in the order of `_PRICES`; `matrix` has a column for each.
        """
        slack = np.ones(len(_PRICES))
        return ConeProgram(
            np.concatenate([price, price.max() * np.array(_PRICES)]),
            sparse.csc_matrix(np.vstack([*self._matrix, *self._cones])),
            np.concatenate([*self._right, *self._constants]),
            0,
            sum(map(len, self._right)),
            tuple(map(len, self._constants)),
            np.zeros(self._count + len(slack)),
            np.concatenate([np.ones(self._count), 1e6 * slack]),
        )
