"""Bounds of transfers that end at rest, for thrusters of every kind and craft with reaction wheels.

A convex relaxation, as `rans.optimal.certificate.hull`, for any commands between 0 and 1 that may change at any
instant. Two things make it closer: the attitude at every instant lies in a tube, which the largest torque leaves
around the attitude of the start and of the goal, and in the plane one set of thrusters has to push and to turn.
Reaction wheels turn the craft without a price; the limit of their momentum is left out.

Multipliers are found by cutting planes (J. E. Kelley, "The cutting-plane method for solving convex programs", 1960)
and linear programs. Whatever multipliers a solver returns, the bound is computed from them anew and holds
(docs/certificate.md proves it), so that the tolerance of the solver does not matter.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from rans.errors import ConfigError
from rans.model.dynamics import State
from rans.model.fields import leaves
from rans.model.spacecraft import Spacecraft
from rans.optimal.certificate.goal_set import (
    GoalSet,
    check_certifiable,
    check_finite,
    check_period,
    rounded_up,
)
from rans.optimal.trajectory.allocation import inertia
from rans.optimal.trajectory.guess import rotation_vector

_INTERVALS = 40
"""Parts of a flight in which a tube is as wide as at its wider end; twice as many raise bounds by about 0.5 %."""
_MOST_THRUSTERS = 16
"""Largest number of thrusters, whose sets are enumerated."""
_MANY = 1000
"""Number of wrenches in space beyond which those inside the convex hull of all are left out."""
_ROUNDS = 40
"""Largest number of rounds of cutting planes."""
_CLOSE = 1e-3
"""Relative distance between bound and linear program at which rounds end, and accuracy of a least time."""
_ROUNDING = 1e-8
"""Relative part of a bound that is subtracted for rounding: wrenches count as one where they agree to 1e-9."""
_LONGEST = 1e6
"""Time, s, beyond which nothing is excluded: a craft that needs longer has nearly no thrust in some direction."""
_PERIODS = 50
"""Largest number of periods that one bound excludes, 0.03 to 0.3 s of processor time each."""
_LARGEST = 30.0
"""Largest multiplier of an impulse; those of optimal flights are below 5."""


class _Corners(NamedTuple):
    """Extreme wrenches of the thrusters."""

    force: np.ndarray
    """(K, d) in B, N."""
    torque: np.ndarray
    """(K,) about z in the plane, N m; zero in space."""
    thrust: np.ndarray
    """(K,) sum of the open thrusters' forces, N."""


@dataclass(frozen=True)
class _Transfer:
    """A transfer of one craft in a given time, with a heading to turn by at least or exactly."""

    corners: _Corners
    wheels: float
    """Largest torque of all wheels together about z, N m; 0 in space, where torques have no multiplier."""
    mass: float
    moment: float
    """Moment of inertia about z, kg m^2."""
    time: float
    """s"""
    way: np.ndarray
    """(d,) displacement that thrust has to give, m."""
    change: np.ndarray
    """(d,) change of velocity, m/s."""
    turn: float
    """Angle that torque has to give in the plane, rad, without sign conditions exactly (within the tolerance)."""
    spin_change: float
    """Change of the spin in the plane, rad/s."""
    tolerances: GoalSet
    sign: int
    """0: the angle is the turn; 1 or -1: it is the turn or more in this sense, and the tube is all attitudes."""
    centre: np.ndarray
    """(N, d, d) attitude in the middle of the tube in each interval."""
    width: np.ndarray
    """(N,) largest angle from there, rad."""
    turns: bool
    """Whether the torque has a multiplier: in the plane."""

    @property
    def count(self) -> int:
        """Number of multipliers: of velocity and position, and in the plane of spin and heading."""
        return 2 * len(self.way) + 2 * self.turns

    def gain(self) -> np.ndarray:
        """(count,) linear part of the bound: of multipliers of velocity, of position over the time, and so on."""
        parts = [self.mass * self.change, self.mass * self.way / self.time]
        if self.turns:
            angles = np.array([self.spin_change, self.turn / self.time])
            parts.append(self.moment * angles)
        return np.concatenate(parts)

    def radii(self) -> np.ndarray:
        """Price of the size of each of the 2 or 4 multipliers: what the goal set leaves open."""
        near = self.tolerances
        sizes = [self.mass * near.velocity, self.mass * near.position / self.time]
        if self.turns:
            sizes += [self.moment * near.spin, self.moment * near.heading / self.time]
        return np.array(sizes)

    def sizes(self, x: np.ndarray) -> np.ndarray:
        """Sizes of the 2 or 4 multipliers."""
        d = len(self.way)
        return np.array([np.linalg.norm(x[:d]), np.linalg.norm(x[d : 2 * d]), *np.abs(x[2 * d :])])

    def ends(self) -> np.ndarray:
        """(N, 2) share of the time that is left at both ends of each interval."""
        left = np.linspace(1.0, 0.0, len(self.width) + 1)
        return np.stack([left[:-1], left[1:]], axis=1)

    def best(self, x: np.ndarray, price: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Largest (N, 2) of what thrust is worth less its price at both ends of the intervals, and where it is.

        Returns:
            The values, N; slopes (N, 2, d + 1) by the multipliers of force and torque; and prices (N, 2).
        """
        d = len(self.way)
        left = self.ends()[..., None]
        pull = x[:d] + left * x[d : 2 * d]
        turning = x[2 * d] + left[..., 0] * x[2 * d + 1] if self.turns else 0.0 * left[..., 0]
        size = np.linalg.norm(pull, axis=-1)
        ahead = pull / np.where(size > 0.0, size, 1.0)[..., None]
        # In the frame of the middle of the tube: angles between the pull and the force of every set.
        force = np.linalg.norm(self.corners.force, axis=1)
        unit = self.corners.force / np.where(force > 0.0, force, 1.0)[:, None]
        inside = np.einsum("nji,nej->nei", self.centre, ahead)
        angle = np.arccos(np.clip(inside @ unit.T, -1.0, 1.0))
        off = np.maximum(angle - self.width[:, None, None], 0.0)
        worth = size[..., None] * force * np.cos(off)
        worth += turning[..., None] * self.corners.torque - price * self.corners.thrust
        which = worth.argmax(axis=-1)
        wheel = np.sign(turning) * self.wheels
        values = np.take_along_axis(worth, which[..., None], -1)[..., 0] + turning * wheel
        # The slope by the pull is the best force in W: turned by the tube towards the pull.
        off = np.take_along_axis(off, which[..., None], -1)
        axis = np.einsum("nij,nej->nei", self.centre, unit[which])
        aside = axis - np.sum(axis * ahead, axis=-1, keepdims=True) * ahead
        length = np.linalg.norm(aside, axis=-1, keepdims=True)
        aside = aside / np.where(length > 0.0, length, 1.0)
        forces = force[which][..., None] * (np.cos(off) * ahead + np.sin(off) * aside)
        torque = self.corners.torque[which] + wheel
        slopes = np.concatenate([forces, torque[..., None]], axis=-1)
        return values, slopes, price * self.corners.thrust[which]

    def value(self, x: np.ndarray, values: np.ndarray) -> float:
        """Bound of multipliers, from the worth of thrust at both ends of every interval."""
        used = float(values.sum()) * 0.5 * self.time / len(self.width)
        linear = float(self.gain() @ x)
        spared = float(self.radii() @ self.sizes(x))
        return linear - spared - used - _ROUNDING * (abs(linear) + spared + used)

    def bound(self, price: float) -> float:
        """The best bound: of the impulse, N s, for a price of 1; for 0 above zero if nobody arrives in the time."""
        from scipy import sparse
        from scipy.optimize import linprog

        d = len(self.way)
        count = self.count
        cells = len(self.width)
        left = self.ends().ravel()
        kinds = len(self.radii())
        # Columns: multipliers, sizes of them, worth at both ends of the intervals.
        total = count + kinds + 2 * cells
        unit = np.ones(count)
        if self.turns:  # a torque counts as the force at the largest arm
            thrust = np.maximum(self.corners.thrust, 1e-300)
            unit[2 * d :] = 1.0 / max(float((np.abs(self.corners.torque) / thrust).max()), 1e-6)
        most = (_LARGEST if price else 1.0) * unit
        low = np.concatenate([-most, np.zeros(kinds + 2 * cells)])
        if self.sign and self.turns:
            if self.sign > 0:
                low[count - 1] = 0.0
            else:
                most[count - 1] = 0.0
        high = np.concatenate([most, np.full(kinds + 2 * cells, np.inf)])
        cost = -np.concatenate(
            [self.gain(), -self.radii(), np.full(2 * cells, -0.5 * self.time / cells)]
        )
        rows: list[sparse.csr_matrix] = []
        rights: list[np.ndarray] = []
        x = np.zeros(count)
        # First along the way: ahead, then back.
        response = self.way if self.way.any() else self.change
        if response.any():
            ahead = response / np.linalg.norm(response) * (1.0 if price else 0.3)
            x[:d] = -ahead
            x[d : 2 * d] = 2.0 * ahead
        best = 0.0
        for _ in range(_ROUNDS):
            values, slopes, prices = self.best(x, price)
            best = max(best, self.value(x, values))
            if not price and best > 0.0:
                return best
            # One cut for each end of each interval, and one for each size.
            cut = np.zeros((2 * cells, total))
            force = slopes[..., :d].reshape(-1, d)
            cut[:, :d] = force
            cut[:, d : 2 * d] = left[:, None] * force
            if self.turns:
                torque = slopes[..., d].ravel()
                cut[:, 2 * d] = torque
                cut[:, 2 * d + 1] = left * torque
            cut[np.arange(2 * cells), count + kinds + np.arange(2 * cells)] = -1.0
            ball = np.zeros((2 * kinds, total))
            for k in range(kinds):
                part = slice(k * d, (k + 1) * d) if k < 2 else slice(2 * d + k - 2, 2 * d + k - 1)
                size = np.linalg.norm(x[part])
                ball[2 * k, part] = x[part] / size if size > 0.0 else 0.0
                ball[2 * k + 1, part] = -ball[2 * k, part]
                ball[2 * k : 2 * k + 2, count + k] = -1.0
            rows.append(sparse.csr_matrix(np.vstack([cut, ball])))
            rights.append(np.concatenate([prices.ravel(), np.zeros(2 * kinds)]))
            answer = linprog(
                cost,
                sparse.vstack(rows),
                np.concatenate(rights),
                bounds=np.stack([low, high], axis=1),
                method="highs",
            )
            if answer.x is None:  # pragma: no cover - the zero multipliers fulfil every cut
                break
            x = answer.x[:count]
            ceiling = -float(answer.fun)
            if ceiling <= best * (1.0 + _CLOSE) + 1e-12 * float(np.abs(cost).sum()):
                break
        return best


def least_time(craft: Spacecraft, start: State, goal: State, tolerances: GoalSet) -> float:
    """Time before which no craft is at rest within the tolerances of the goal's pose, s.

    Who rests there may stay, so that what is excluded by a time is excluded by every earlier one.

    Args:
        craft: thrusters of any kind, with or without wheels, without propellant.
        start: of floats.
        goal: of floats, at rest.
        tolerances: of position and heading; velocity and spin must be zero.

    Raises:
        ConfigError: no bound covers this craft, the goal moves, or the set allows motion.
    """
    _check(craft, start, goal)
    if tolerances.velocity or tolerances.spin or any(leaves(goal.v)) or any(goal.spin()):
        raise ConfigError(
            "this bound of time is for ends at rest: the goal and the tolerances of velocity and spin must be zero."
        )
    # A time at which nothing is excluded; then bisection.
    low = 0.0
    high = 1.0
    while _excluded(craft, start, goal, high, tolerances):
        low = high
        high *= 2.0
        if high > _LONGEST:
            return low
    while high - low > _CLOSE * high:
        middle = 0.5 * (low + high)
        if _excluded(craft, start, goal, middle, tolerances):
            low = middle
        else:
            high = middle
    return low


def least_arrival(
    craft: Spacecraft,
    start: State,
    goal: State,
    period: float,
    tolerances: GoalSet,
    after: float,
) -> float:
    """The first whole number of periods for which no proof excludes that a craft is in the goal set, s.

    The set may allow motion: who moves in it leaves it again, so that every period is excluded by itself.

    Args:
        craft: see `least_time`.
        start: of floats.
        goal: of floats.
        period: time between the instants at which a craft can count as arrived, s.
        tolerances: of position, velocity, heading and spin.
        after: another lower bound, s, such as `rans.optimal.certificate.hull.least_time`: sooner instants are
            not tried. 0 or less is returned as it is.

    Raises:
        ConfigError: no bound covers this craft, or the period is not positive.
    """
    _check(craft, start, goal)
    check_period(period)
    if after <= 0.0:
        return after
    first = round(rounded_up(after, period) / period)
    for count in range(first, first + _PERIODS):
        if not _excluded(craft, start, goal, count * period, tolerances):
            return count * period
    return (first + _PERIODS) * period


def least_impulse(
    craft: Spacecraft, start: State, goal: State, horizon: float, tolerances: GoalSet
) -> float:
    """Impulse without which nothing is within the tolerances of the goal at the horizon, N s.

    It is infinite if the torque cannot turn the craft so far in this time.

    Args:
        craft: see `least_time`.
        start: of floats.
        goal: of floats.
        horizon: s.
        tolerances: of position, velocity, heading and spin.

    Raises:
        ConfigError: no bound covers this craft, or the horizon is not positive.
    """
    _check(craft, start, goal)
    if not (math.isfinite(horizon) and horizon > 0):
        raise ConfigError(f"a bound of impulse needs a finite horizon > 0 s, got {horizon}.")
    ways = [_transfer(craft, start, goal, horizon, tolerances, sign) for sign in _signs(craft)]
    return min((math.inf if one is None else one.bound(1.0) for one in ways), default=math.inf)


def _excluded(
    craft: Spacecraft, start: State, goal: State, time: float, tolerances: GoalSet
) -> bool:
    """Whether no flight of this length ends in the set, whichever way the craft turns."""
    for sign in _signs(craft):
        one = _transfer(craft, start, goal, time, tolerances, sign)
        if one is not None and one.bound(0.0) <= 0.0:
            return False
    return True


def _signs(craft: Spacecraft) -> tuple[int, ...]:
    """Ways to turn: the shorter one, or at least the longer one in either sense. In space there is one."""
    return (0, 1, -1) if craft.dimension == 2 else (0,)


def check_covered(craft: Spacecraft) -> None:
    """Refuse a craft that these bounds do not cover.

    Raises:
        ConfigError: it has other effectors than thrusters and wheels, propellant, or more than 16 thrusters.
    """
    check_certifiable(craft, wheels=True)
    if craft.thruster_count > _MOST_THRUSTERS:
        raise ConfigError(
            f"spacecraft {craft.name!r}: bounds enumerate the sets of at most {_MOST_THRUSTERS} thrusters, "
            f"got {craft.thruster_count}."
        )


def _check(craft: Spacecraft, start: State, goal: State) -> None:
    check_finite(start, goal)
    check_covered(craft)


@cache
def _corners(craft: Spacecraft) -> tuple[_Corners, float]:
    """Extreme wrenches, and the largest torque about any axis, N m, with wheels."""
    size = craft.dimension
    count = craft.thruster_count
    forces = np.array([thruster.force for thruster in craft.thrusters])
    if craft.thrust_sharing == "split":
        sets = np.vstack([np.zeros(count), np.eye(count)])
    else:
        sets = ((np.arange(2**count)[:, None] >> np.arange(count)) & 1).astype(float)
    wrench = sets @ craft.wrenches
    wheels = float(np.linalg.norm(np.array(craft.wheel_map).reshape(-1, 1), axis=1).sum())
    largest = float(np.linalg.norm(wrench[:, size:], axis=1).max()) + wheels
    torque = wrench[:, size] if size == 2 else np.zeros(len(sets))
    points = np.column_stack([wrench[:, :size], torque, sets @ forces])
    # Sets with the same wrench are one, the cheapest of them.
    order = np.argsort(points[:, -1], kind="stable")
    scale = np.abs(points).max(axis=0) + 1e-300
    _, first = np.unique(np.round(points[order, :-1] / scale[:-1], 9), axis=0, return_index=True)
    points = points[order[first]]
    if len(points) > _MANY and size == 3:  # what is worth most is at a corner of the convex hull
        from scipy.spatial import ConvexHull, QhullError

        used = points[:, [0, 1, 2, 4]]
        scale = np.maximum(np.abs(used).max(axis=0), 1e-300)
        # Flat hulls, as of thrusters that all push along a plane, have no corners: all points are kept.
        with contextlib.suppress(QhullError):
            points = points[ConvexHull(used / scale).vertices]
    return _Corners(points[:, :size], points[:, size], points[:, size + 1]), largest


def _transfer(
    craft: Spacecraft, start: State, goal: State, time: float, tolerances: GoalSet, sign: int
) -> _Transfer | None:
    """The transfer of one way to turn; None: the torque does not suffice for it."""
    corners, largest = _corners(craft)
    tensor = inertia(craft)
    least = float(np.linalg.eigvalsh(tensor)[0])
    edges = np.linspace(0.0, time, _INTERVALS + 1)
    left = time - edges
    displacement, before, after = (
        np.array(x.columns(), float) for x in (goal.p - start.p, start.v, goal.v)
    )
    way = displacement - before * time
    if craft.dimension == 2:
        spins = float(start.spin()[0]), float(goal.spin()[0])
        angle = float(rotation_vector(start.attitude.to(goal.attitude))[0])
        # The shorter way is within half a turn; the longer ones are a whole turn further in either sense.
        turn = angle + sign * 2.0 * math.pi - spins[0] * time
        tube = _plane_tube(start, goal, angle, spins, largest / least, edges, tolerances, sign)
        if tube is None:
            return None
        middle, width = tube
        cos = np.cos(middle)
        sin = np.sin(middle)
        centre = np.stack([np.stack([cos, -sin], 1), np.stack([sin, cos], 1)], axis=1)
        wheels = float(np.abs(np.array(craft.wheel_map)).sum())
    else:
        # The root of w . I w changes by at most the torque over that of the least moment, whatever wheels store.
        roots = [
            math.sqrt(float(w @ tensor @ w)) for w in (np.array(x.spin()) for x in (start, goal))
        ]
        slack = math.sqrt(float(np.linalg.eigvalsh(tensor)[-1])) * tolerances.spin
        speeds = roots[0] / math.sqrt(least), (roots[1] + slack) / math.sqrt(least)
        angle = float(np.linalg.norm(rotation_vector(start.attitude.to(goal.attitude))))
        ahead = speeds[0] * edges + 0.5 * largest / least * edges**2
        back = speeds[1] * left + 0.5 * largest / least * left**2 + tolerances.heading
        if float((ahead + back).min()) < angle * (1.0 - 1e-12):
            return None
        narrow = ahead[1:] < back[:-1]
        first, last = (_matrix(x) for x in (start, goal))
        centre = np.where(narrow[:, None, None], first, last)
        width = np.where(narrow, ahead[1:], back[:-1])
        turn = wheels = 0.0
        spins = 0.0, 0.0
    return _Transfer(
        corners,
        wheels,
        craft.mass,
        float(tensor[0, 0]),
        time,
        way,
        after - before,
        turn,
        spins[1] - spins[0],
        tolerances,
        sign,
        centre,
        width * (1.0 + 1e-12) + 1e-12,
        craft.dimension == 2,
    )


def _matrix(state: State) -> np.ndarray:
    """(3, 3) rotation matrix R_WB."""
    w, x, y, z = (float(value) for value in leaves(state.attitude))
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _plane_tube(
    start: State,
    goal: State,
    angle: float,
    spins: tuple[float, float],
    fastest: float,
    edges: np.ndarray,
    tolerances: GoalSet,
    sign: int,
) -> tuple[np.ndarray, np.ndarray] | None:
    """Middle (N,) and half width (N,) of the headings of each interval, rad; None: there are none in one."""
    first = float(leaves(start.attitude)[0])
    time = edges[-1]
    left = time - edges
    if sign:  # whoever turns this far passes every heading
        return np.full(len(edges) - 1, first), np.full(len(edges) - 1, math.pi)
    grown = 0.5 * fastest * edges**2
    coming = 0.5 * fastest * left**2 + tolerances.spin * left + tolerances.heading
    drift = first + spins[0] * edges
    ending = first + angle - spins[1] * left
    # In an interval the tube is as wide as at its wider end, on either side.
    low = np.maximum(
        np.minimum(drift[:-1], drift[1:]) - grown[1:],
        np.minimum(ending[:-1], ending[1:]) - coming[:-1],
    )
    high = np.minimum(
        np.maximum(drift[:-1], drift[1:]) + grown[1:],
        np.maximum(ending[:-1], ending[1:]) + coming[:-1],
    )
    if bool((high < low - 1e-12).any()):
        return None
    return 0.5 * (low + high), np.minimum(0.5 * np.maximum(high - low, 0.0), math.pi)
