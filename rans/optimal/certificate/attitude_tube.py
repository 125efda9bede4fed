"""Bounds of transfers that end at rest, for thrusters of every kind and craft with reaction wheels.

A convex relaxation, as `rans.optimal.certificate.hull`, for any commands between 0 and 1 that may change at any
instant. Two things make it closer: the attitude at every instant lies in a tube, which the largest torque leaves
around the attitude of the start and of the goal, and one set of thrusters has to push and to turn. Reaction wheels
turn the craft without a price; the limit of their momentum is left out.

Multipliers are found by cutting planes (J. E. Kelley, "The cutting-plane method for solving convex programs", 1960)
and linear programs. Whatever multipliers a solver returns, the bound is computed from them anew and holds
(docs/certificate.md proves it), so that the tolerance of the solver does not matter. Whatever it changes must stay
a lower bound: tests hold it below linear programs and every trajectory found.
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
_MIXTURES = 0.0, 0.5, 0.9, 1.0
"""How much of the energy is taken from the squared angular momentum in measures of rotation in space."""
_MIDDLES = 0.3, 0.5, 0.7
"""Instants, over the time, until which torque speeds a rotation up, and slows it down afterwards: at edges of
intervals."""
_PRICES = 8
"""Number of parts of a flight with a price of their own for the angle from the middle of the tube."""
_PERIODS = 50
"""Largest number of periods that one bound excludes, 0.03 to 0.3 s of processor time each."""
_LARGEST = 30.0
"""Largest multiplier of an impulse; those of optimal flights are below 5."""


class _Corners(NamedTuple):
    """Extreme wrenches of the thrusters."""

    force: np.ndarray
    """(K, d) in B, N."""
    torque: np.ndarray
    """(K,) about z in the plane, N m; in space how fast it changes a `_Measure`."""
    thrust: np.ndarray
    """(K,) sum of the open thrusters' forces, N."""
    arm: float
    """Largest torque over thrust."""


class _Turning(NamedTuple):
    """What torque has to give in a transfer, and its E multipliers."""

    gain: np.ndarray
    """(E,) linear part of the bound."""
    spared: np.ndarray
    """(E,) price of the size of each multiplier: what the goal set leaves open."""
    basis: np.ndarray
    """(N, 2, E) by what the multipliers price torque at both ends of each interval."""
    lean: np.ndarray
    """(N, E) by what the multipliers price, in each interval, the angle from the middle of the tube."""
    signs: tuple[int, ...]
    """Sign that each multiplier must have; 0: either."""


class _Measure(NamedTuple):
    """A measure r of how fast a craft turns in space, of which torque is the only change.

    r is the root of the sum of c_i J_i w_i^2 over the principal axes, c = a + b J of two numbers a and b: a
    combination of energy and squared angular momentum, which gyroscopic torques leave alone. So r changes by at
    most k = |sqrt(c / J) torque| per second. In the metric of r, attitudes are a distance apart.
    """

    weights: tuple[float, float, float]
    """c_i >= 0 of the principal axes, from the least moment of inertia to the largest."""

    def distance(self, moments: np.ndarray, angle: float, axes: np.ndarray) -> float:
        """Least integral of r over time between two attitudes.

        Args:
            moments: (3,) principal moments of inertia, kg m^2.
            angle: angle between the attitudes, rad.
            axes: (3,) angle between both directions of each principal axis, rad.
        """
        stiff = np.array(self.weights) * moments
        i, j, _ = np.argsort(stiff)
        # r^2 is at least the least of these times w^2, and what the next has more times the speed of that axis.
        return math.sqrt(stiff[i] * angle**2 + (stiff[j] - stiff[i]) * float(axes[i]) ** 2)


@dataclass(frozen=True)
class _Transfer:
    """A transfer of one craft in a given time, with a heading to turn by at least or exactly."""

    corners: _Corners
    wheels: float
    """Largest torque of all wheels together, as those of the corners."""
    mass: float
    time: float
    """s"""
    way: np.ndarray
    """(d,) displacement that thrust has to give, m."""
    change: np.ndarray
    """(d,) change of velocity, m/s."""
    tolerances: GoalSet
    turning: _Turning
    """What torque has to give."""
    centre: np.ndarray
    """(N, d, d) attitude in the middle of the tube in each interval."""
    width: np.ndarray
    """(N,) largest angle from there, rad."""

    @property
    def count(self) -> int:
        """Number of multipliers: of velocity and position, and those of the rotation."""
        return 2 * len(self.way) + len(self.turning.gain)

    def gain(self) -> np.ndarray:
        """(count,) linear part of the bound: of multipliers of velocity, of position over the time, and so on."""
        parts = [self.mass * self.change, self.mass * self.way / self.time, self.turning.gain]
        return np.concatenate(parts)

    def radii(self) -> np.ndarray:
        """Price of the size of each multiplier, vectors being one: what the goal set leaves open."""
        near = self.tolerances
        sizes = [self.mass * near.velocity, self.mass * near.position / self.time]
        return np.concatenate([sizes, self.turning.spared])

    def sizes(self, x: np.ndarray) -> np.ndarray:
        """Sizes of the multipliers, vectors being one."""
        d = len(self.way)
        return np.array([np.linalg.norm(x[:d]), np.linalg.norm(x[d : 2 * d]), *np.abs(x[2 * d :])])

    def ends(self) -> np.ndarray:
        """(N, 2) share of the time that is left at both ends of each interval."""
        left = np.linspace(1.0, 0.0, len(self.width) + 1)
        return np.stack([left[:-1], left[1:]], axis=1)

    def best(self, x: np.ndarray, price: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Largest (N, 2) of what thrust is worth less its price at both ends of the intervals, and where it is.

        Returns:
            The values, N; slopes (N, 2, d + 2) by force, torque and price of the angle; and prices (N, 2).
        """
        d = len(self.way)
        left = self.ends()[..., None]
        pull = x[:d] + left * x[d : 2 * d]
        turning = self.turning.basis @ x[2 * d :]
        size = np.linalg.norm(pull, axis=-1)
        ahead = pull / np.where(size > 0.0, size, 1.0)[..., None]
        # In the frame of the middle of the tube: angles between the pull and the force of every set.
        force = np.linalg.norm(self.corners.force, axis=1)
        unit = self.corners.force / np.where(force > 0.0, force, 1.0)[:, None]
        inside = np.einsum("nji,nej->nei", self.centre, ahead)
        angle = np.arccos(np.clip(inside @ unit.T, -1.0, 1.0))
        # The attitude turns a force towards the pull: not, as far as the tube lets it, or as far as its price says.
        pulled = size[..., None] * force
        turned = np.minimum(angle, self.width[:, None, None])
        lean = np.maximum(self.turning.lean @ x[2 * d :], 0.0)[:, None, None]
        worth = pulled * np.cos(angle - turned)
        if lean.any():
            with np.errstate(divide="ignore", invalid="ignore"):
                rest = np.arcsin(np.where(pulled > lean, lean / pulled, 1.0))
            worth -= lean * turned
            for less in (np.clip(angle - rest, 0.0, turned), 0.0 * turned):
                value = pulled * np.cos(angle - less) - lean * less
                turned = np.where(value > worth, less, turned)
                worth = np.maximum(value, worth)
        off = angle - turned
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
        leant = np.take_along_axis(turned, which[..., None], -1)
        slopes = np.concatenate([forces, torque[..., None], leant], axis=-1)
        return values, slopes, price * self.corners.thrust[which]

    def value(self, x: np.ndarray, values: np.ndarray) -> float:
        """Bound of multipliers, from the worth of thrust at both ends of every interval."""
        used = float(values.sum()) * 0.5 * self.time / len(self.width)
        linear = float(self.gain() @ x)
        spared = float(self.radii() @ self.sizes(x))
        return linear - spared - used - _ROUNDING * (abs(linear) + spared + used)

    def bound(self, price: float) -> float:
        """The best bound that cutting planes find; 0 if there is none.

        Multipliers are in the order of `gain`: d of the velocity, d of the position, and those of the rotation.

        Args:
            price: of thrust. 1: the bound is that of the impulse, N s. 0: thrust costs nothing, and a result above
                0 proves, whatever its size, that nothing arrives in the time; the first such result is returned.
        """
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
        # A torque counts as the force at the largest arm, which is 1e-6 m at least: a craft may have no torque.
        unit[2 * d :] = 1.0 / max(self.corners.arm, 1e-6)
        most = (_LARGEST if price else 1.0) * unit
        low = np.concatenate([-most, np.zeros(kinds + 2 * cells)])
        for k, sign in enumerate(self.turning.signs, 2 * d):
            if sign > 0:
                low[k] = 0.0
            elif sign < 0:
                most[k] = 0.0
        high = np.concatenate([most, np.full(kinds + 2 * cells, np.inf)])
        cost = -np.concatenate(
            [self.gain(), -self.radii(), np.full(2 * cells, -0.5 * self.time / cells)]
        )
        rows: list[sparse.csr_matrix] = []
        rights: list[np.ndarray] = []
        x = np.zeros(count)
        # First along the way: the pull is x[:d] + left x[d : 2 d], which goes from ahead to -ahead. At a size of 1
        # thrust is worth its price. Without a price every size gives the same sign: 0.3 keeps twice of it below 1,
        # the largest multiplier.
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
            basis = self.turning.basis.reshape(2 * cells, -1)
            cut[:, 2 * d : count] = slopes[..., d].reshape(-1, 1) * basis
            leans = np.repeat(self.turning.lean, 2, axis=0)
            cut[:, 2 * d : count] -= slopes[..., d + 1].reshape(-1, 1) * leans
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
    ways = [
        _transfer(craft, start, goal, horizon, tolerances, sign, by_impulse=True)
        for sign in _signs(craft)
    ]
    return min((math.inf if one is None else one.bound(1.0) for one in ways), default=math.inf)


def _excluded(
    craft: Spacecraft, start: State, goal: State, time: float, tolerances: GoalSet
) -> bool:
    """Whether it is proved that no flight of this length (s) ends in the set, whichever way the craft turns."""
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


def _sets(craft: Spacecraft) -> tuple[np.ndarray, np.ndarray]:
    """Wrenches (K, 3 or 6) of all sets of thrusters, with shared thrust of single ones, and their thrust (K,).

    Bounds need every set that may be open, at the thrust that it costs: one that is missing would be a cheaper
    flight.
    """
    count = craft.thruster_count
    forces = np.array([thruster.force for thruster in craft.thrusters])
    if craft.thrust_sharing == "split":
        sets = np.vstack([np.zeros(count), np.eye(count)])
    else:
        sets = ((np.arange(2**count)[:, None] >> np.arange(count)) & 1).astype(float)
    return sets @ craft.wrenches, sets @ forces


@cache
def _corners(craft: Spacecraft, measure: _Measure | None) -> tuple[_Corners, float]:
    """Extreme wrenches, and the largest torque of the wheels, N m; in space torques are those of a measure.

    Points within the hull may be dropped, since the bound is linear in them; a corner may not.
    """
    size = craft.dimension
    wrench, thrust = _sets(craft)
    if measure is None:
        torque = wrench[:, size]
        wheels = float(np.abs(np.array(craft.wheel_map)).sum())
    else:
        moments, principal = np.linalg.eigh(inertia(craft))
        rate = principal.T * np.sqrt(np.array(measure.weights) / moments)[:, None]
        torque = np.linalg.norm(wrench[:, size:] @ rate.T, axis=1)
        axes = np.array(craft.wheel_map).reshape(-1, size)
        wheels = float(np.linalg.norm(axes @ rate.T, axis=1).sum())
    points = np.column_stack([wrench[:, :size], torque, thrust])
    # Sets with the same wrench are one, the cheapest of them.
    order = np.argsort(points[:, -1], kind="stable")
    scale = np.abs(points).max(axis=0) + 1e-300
    _, first = np.unique(np.round(points[order, :-1] / scale[:-1], 9), axis=0, return_index=True)
    points = points[order[first]]
    if len(points) > _MANY and size == 3:  # what is worth most is at a corner of the convex hull
        from scipy.spatial import ConvexHull, QhullError

        # Flat hulls, as of thrusters that all push along a plane, have no corners: all points are kept.
        with contextlib.suppress(QhullError):
            points = points[ConvexHull(points / scale).vertices]
    force, torque, thrust = points[:, :size], points[:, size], points[:, size + 1]
    arm = float((np.abs(torque) / np.maximum(thrust, 1e-300)).max())
    return _Corners(force, torque, thrust, arm), wheels


def _transfer(
    craft: Spacecraft,
    start: State,
    goal: State,
    time: float,
    tolerances: GoalSet,
    sign: int,
    by_impulse: bool = False,
) -> _Transfer | None:
    """The transfer of one way to turn; None: the torque does not suffice for it.

    The bound of a craft in space that is closer by impulse may be another than the one that is closer by time.

    A flight is bounded by the least over all ways (`_signs`).
    """
    edges = np.linspace(0.0, time, _INTERVALS + 1)
    displacement, before, after = (
        np.array(x.columns(), float) for x in (goal.p - start.p, start.v, goal.v)
    )
    turned = (
        _turned_in_plane(craft, start, goal, edges, tolerances, sign)
        if craft.dimension == 2
        else _turned_in_space(craft, start, goal, edges, tolerances, by_impulse)
    )
    if turned is None:
        return None
    measure, turning, centre, width = turned
    return _Transfer(
        *_corners(craft, measure),
        craft.mass,
        time,
        displacement - before * time,
        after - before,
        tolerances,
        turning,
        centre,
        width * (1.0 + 1e-12) + 1e-12,
    )


_Turned = tuple[_Measure | None, _Turning, np.ndarray, np.ndarray]
"""Measure of torques, what they have to give, and middle (N, d, d) and half width (N,) of the tube."""


def _turned_in_plane(
    craft: Spacecraft,
    start: State,
    goal: State,
    edges: np.ndarray,
    tolerances: GoalSet,
    sign: int,
) -> _Turned | None:
    """Rotation in the plane at times (s), by the shorter way or a whole turn or more further in sense ``sign``.

    Tubes may be too wide, never too narrow, and None only where no flight is as quick: bounds rely on both.
    """
    moment = float(inertia(craft)[0, 0])
    time = float(edges[-1])
    corners, wheels = _corners(craft, None)
    fastest = (float(np.abs(corners.torque).max()) + wheels) / moment
    spins = float(start.spin()[0]), float(goal.spin()[0])
    angle = float(rotation_vector(start.attitude.to(goal.attitude))[0])
    tube = _plane_tube(start, goal, angle, spins, fastest, edges, tolerances, sign)
    if tube is None:
        return None
    # Multipliers of the spin and of the heading over the time.
    turn = angle + sign * 2.0 * math.pi - spins[0] * time
    left = 1.0 - edges / time
    pairs = np.stack([left[:-1], left[1:]], axis=1)
    turning = _Turning(
        moment * np.array([spins[1] - spins[0], turn / time]),
        moment * np.array([tolerances.spin, tolerances.heading / time]),
        np.stack([np.ones_like(pairs), pairs], axis=2),
        np.zeros((len(pairs), 2)),
        (0, sign),
    )
    middle, width = tube
    cos = np.cos(middle)
    sin = np.sin(middle)
    return (
        None,
        turning,
        np.stack([np.stack([cos, -sin], 1), np.stack([sin, cos], 1)], axis=1),
        width,
    )


@cache
def _measures(craft: Spacecraft) -> tuple[tuple[_Measure, float, float], ...]:
    """Measures of rotation in space, each with the largest k, and the largest over thrust; infinite with wheels.

    The momentum of wheels turns with the craft and may change its angular momentum, but not its energy.
    """
    moments, principal = np.linalg.eigh(inertia(craft))
    mixed = [moments - x * moments[0] for x in _MIXTURES]
    mixed += [x * moments[2] - moments for x in (1.0, 1.5)]
    candidates = [moments[2] * np.ones(3), *([] if craft.wheels else mixed)]
    wrench, thrust = _sets(craft)
    wheels = np.array(craft.wheel_map).reshape(-1, 3)
    result = []
    for weights in candidates:
        # Of equal moments nothing but rounding may be left.
        weights = np.where(weights < 1e-9 * moments[2], 0.0, weights)
        if not weights.any():
            continue
        weights = weights / weights.max()
        rate = principal.T * np.sqrt(weights / moments)[:, None]
        torques = np.linalg.norm(wrench[:, 3:] @ rate.T, axis=1)
        arm = math.inf if craft.wheels else float((torques / np.maximum(thrust, 1e-300)).max())
        largest = float(torques.max() + np.linalg.norm(wheels @ rate.T, axis=1).sum())
        first, second, third = (float(x) for x in weights)
        result.append((_Measure((first, second, third)), largest, arm))
    return tuple(result)


def _turned_in_space(
    craft: Spacecraft,
    start: State,
    goal: State,
    edges: np.ndarray,
    tolerances: GoalSet,
    by_impulse: bool,
) -> _Turned | None:
    """Attitude over time in space, as tubes at the edges (K,) of intervals (s); None if that is too short.

    Tubes may be too wide, never too narrow, and None only where no flight is as quick: bounds rely on both.
    """
    moments, principal = np.linalg.eigh(inertia(craft))
    time = float(edges[-1])
    left = time - edges
    first, last = (_matrix(x) for x in (start, goal))
    angle = float(np.linalg.norm(rotation_vector(start.attitude.to(goal.attitude))))
    cosines = np.sum((first @ principal) * (last @ principal), axis=0)
    axes = np.maximum(np.arccos(np.clip(cosines, -1.0, 1.0)) - tolerances.heading - 1e-7, 0.0)
    spins = [principal.T @ np.array(x.spin(), float) for x in (start, goal)]

    # Of each measure the speeds at both ends, and the distance that it has to make.
    ahead = np.full(len(edges), np.inf)
    back = np.full(len(edges), np.inf)
    choices = []
    for measure, largest, arm in _measures(craft):
        stiff = np.array(measure.weights) * moments
        speeds = [math.sqrt(float(stiff @ w**2)) for w in spins]
        speeds[1] += math.sqrt(float(stiff.max())) * tolerances.spin
        distance = measure.distance(moments, max(angle - tolerances.heading, 0.0), axes)
        # The most of it by each instant, and from there on.
        before = speeds[0] * edges + 0.5 * largest * edges**2
        rest = speeds[1] * left + 0.5 * largest * left**2
        if float((before + rest).min()) < distance * (1.0 - 1e-9):
            return None
        if least := math.sqrt(float(stiff.min())):
            ahead = np.minimum(ahead, before / least)
            back = np.minimum(back, rest / least)
        strength = max(arm if by_impulse else largest, 1e-300)
        choices.append((distance / strength, measure, distance, speeds))

    # The measure whose distance is farthest for the torque.
    _, measure, distance, speeds = max(choices, key=lambda choice: choice[0])
    middles = np.array(_MIDDLES)
    pairs = np.stack([edges[:-1], edges[1:]], axis=1) / time
    gain = distance / time - speeds[0] * middles - speeds[1] * (1.0 - middles)
    back += tolerances.heading
    narrow = ahead[1:] < back[:-1]
    least = math.sqrt(float((np.array(measure.weights) * moments).min()))
    basis, lean, free = _leaning(edges, narrow, speeds, least, tolerances.heading)
    turning = _Turning(
        np.concatenate([gain, -free]),
        np.zeros(len(middles) + len(free)),
        np.concatenate([np.abs(pairs[..., None] - middles), basis], axis=2),
        np.concatenate([np.zeros((len(lean), len(middles))), lean], axis=1),
        (1,) * (len(middles) + len(free)),
    )
    centre = np.where(narrow[:, None, None], first, last)
    width = np.minimum(np.where(narrow, ahead[1:], back[:-1]), math.pi)
    return measure, turning, centre, width


def _leaning(
    edges: np.ndarray, ahead: np.ndarray, speeds: list[float], least: float, heading: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Prices of the angle from the attitude of the start, and near the end from that of the goal.

    At an instant t, least times the angle from the start is at most speed t + integral of (t - s) k(s) from 0 to t,
    and likewise for the goal from the end on. A price of the angle therefore is one of the torque before.

    Args:
        edges: (N + 1,) ends of the intervals, s.
        ahead: (N,) whether the middle of the tube is the attitude of the start.
        speeds: measure of the spin at the start, and at most at the goal.
        least: root of the least of the measure's weights times moments; 0: angles have no price.
        heading: tolerance of the attitude, rad.

    Returns:
        Prices (N, 2, G) of the torque at both ends of the intervals and (N, G) of the angle in them, by each
        multiplier, and (G,) what comes without torque.
    """
    count = len(edges) - 1
    time = float(edges[-1])
    if least == 0.0:
        return np.zeros((count, 2, 0)), np.zeros((count, 0)), np.zeros(0)
    basis = []
    lean = []
    free = []
    for part in np.array_split(np.arange(count), _PRICES):
        for cells, sense in ((part[ahead[part]], 1), (part[~ahead[part]], -1)):
            if not len(cells):
                continue
            # Cells of one side are neighbours. In time from that side's end on:
            first, last = edges[cells[0]], edges[cells[-1] + 1]
            begin, end = (first, last) if sense > 0 else (time - last, time - first)
            instants = edges if sense > 0 else time - edges
            weight = 0.5 * (
                np.maximum(end - instants, 0.0) ** 2 - np.maximum(begin - instants, 0.0) ** 2
            )
            half = 0.5 * (end**2 - begin**2)
            speed, offset = (speeds[0], 0.0) if sense > 0 else (speeds[1], heading)
            # Scaled so that the largest price of torque is 1, as that of the other multipliers.
            scale = max(float(weight.max()), 1e-300) / least
            weight = weight / (least * scale)
            basis.append(np.stack([weight[:-1], weight[1:]], axis=1))
            lean.append(np.isin(np.arange(count), cells) / scale)
            free.append((speed * half / least + offset * (end - begin)) / scale)
    return np.stack(basis, axis=2), np.stack(lean, axis=1), np.array(free)


def _matrix(state: State) -> np.ndarray:
    """(3, 3) rotation matrix R_WB of a state of numbers.

    Of a state of numbers with a unit quaternion, w first; from B to W.
    """
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
    """Middle (N,) and half width (N,) of the headings of each interval, rad; None: there are none in one.

    No heading that a flight can have in an interval may lie outside of it.
    """
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
