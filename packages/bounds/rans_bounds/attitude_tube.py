"""Bounds of transfers for thrusters of every kind and craft with reaction wheels.

A convex relaxation, as `rans_bounds.hull`, for any commands between 0 and 1 that may change at any
instant. Two things make it closer: the attitude at every instant lies in a tube, which the largest torque leaves
around the attitude of the start and of the goal, and one set of thrusters has to push and to turn. Reaction wheels
turn the craft without a price; the limit of their momentum is left out.
"""

from __future__ import annotations

import contextlib
import math
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from rans.extend import (
    ConfigError,
    Spacecraft,
    State,
    check_certifiable,
    check_period,
    inertia,
    leaves,
    rotation_vector,
    rounded_up,
)
from rans_bounds.goal_set import GoalSet
from rans_bounds.problem import check_finite
from rans_bounds.transfer import Corners, Transfer, Turning

_INTERVALS = 40
"""Parts of a flight in which a tube is as wide as at its wider end; twice as many raise bounds by about 0.5 %."""
_MOST_THRUSTERS = 16
"""Largest number of thrusters, whose sets are enumerated."""
_MANY = 1000
"""Number of wrenches in space beyond which those inside the convex hull of all are left out."""
_MIXTURES = 0.0, 0.5, 0.9, 1.0
"""How much of the energy is taken from the squared angular momentum in measures of rotation in space."""
_MIDDLES = 0.3, 0.5, 0.7
"""Instants, over the time, until which torque speeds a rotation up, and slows it down afterwards: at edges of
intervals."""
_PRICES = 8
"""Number of parts of a flight with a price of their own for the angle from the middle of the tube."""
_PERIODS = 50
"""Largest number of periods that one bound excludes, 0.03 to 0.3 s of processor time each."""


class _Measure(NamedTuple):
    """A measure r of how fast a craft turns in space, of which torque is the only change.

    r is the root of the sum of c_i J_i w_i^2 over the principal axes, c = a + b J of two numbers a and b: a
    combination of energy and squared angular momentum, which gyroscopic torques leave alone. So r changes by at
    most k = |sqrt(c / J) torque| per second. In the metric of r, attitudes are a distance apart.
    """

    weights: tuple[float, ...]
    """c_i >= 0 of the principal axes, from the least moment of inertia to the largest."""
    largest: float
    """The largest k of thrusters and wheels."""
    arm: float
    """The largest k over thrust; infinite with wheels."""

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
        craft: thrusters of any kind, with or without wheels, without propellant.
        start: of floats.
        goal: of floats.
        period: time between the instants at which a craft can count as arrived, s.
        tolerances: of position, velocity, heading and spin.
        after: another lower bound, s, such as `rans_bounds.hull.least_time`: sooner instants are
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
        craft: see `least_arrival`.
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


@cache
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


def _torques(craft: Spacecraft, weights: tuple[float, ...] | None) -> tuple[np.ndarray, float]:
    """Torque (K,) of all sets, and the largest of the wheels, N m; in space how fast they change a measure."""
    wrench, _ = _sets(craft)
    wheels = np.array(craft.wheel_map).reshape(-1, wrench.shape[1] - craft.dimension)
    if weights is None:
        return wrench[:, 2], float(np.abs(wheels).sum())
    moments, principal = np.linalg.eigh(inertia(craft))
    rate = principal.T * np.sqrt(np.array(weights) / moments)[:, None]
    torques = np.linalg.norm(wrench[:, 3:] @ rate.T, axis=1)
    return torques, float(np.linalg.norm(wheels @ rate.T, axis=1).sum())


@cache
def _corners(craft: Spacecraft, weights: tuple[float, ...] | None) -> Corners:
    """Extreme wrenches and the largest torque of the wheels; in space torques are those of a measure.

    Points within the hull may be dropped, since the bound is linear in them; a corner may not.
    """
    size = craft.dimension
    wrench, thrust = _sets(craft)
    torque, wheels = _torques(craft, weights)
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
    return Corners(points[:, :size], points[:, size], points[:, size + 1], wheels)


def _transfer(
    craft: Spacecraft,
    start: State,
    goal: State,
    time: float,
    tolerances: GoalSet,
    sign: int,
    by_impulse: bool = False,
) -> Transfer | None:
    """The transfer of one way to turn; None: the torque does not suffice for it.

    The bound of a craft in space that is closer by impulse may be another than the one that is closer by time.

    A flight is bounded by the least over all ways (`_signs`).
    """
    edges = np.linspace(0.0, time, _INTERVALS + 1)
    first, last, before, after = (
        np.array(x.columns(), float) for x in (start.p, goal.p, start.v, goal.v)
    )
    turned = (
        _turned_in_plane(craft, start, goal, edges, tolerances, sign)
        if craft.dimension == 2
        else _turned_in_space(craft, start, goal, edges, tolerances, by_impulse)
    )
    if turned is None:
        return None
    weights, turning, centre, width = turned
    return Transfer(
        _corners(craft, weights),
        craft.mass,
        time,
        last - first - before * time,
        after - before,
        (
            tolerances.velocity + _rounding(before, after),
            tolerances.position + _rounding(first, last, before * time),
        ),
        turning,
        centre,
        width * (1.0 + 1e-12) + 1e-12,
    )


def _rounding(*terms: np.ndarray | float) -> float:
    """More than the sum of these terms may be wrong by: a flight without thrust ends where it does to rounding."""
    return 1e-12 * float(sum(np.abs(term).sum() for term in terms))


_Turned = tuple[tuple[float, ...] | None, Turning, np.ndarray, np.ndarray]
"""Weights of a measure, what torques have to give, and middle (N, d, d) and half width (N,) of the tube."""


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
    torques, wheels = _torques(craft, None)
    fastest = (float(np.abs(torques).max()) + wheels) / moment
    spins = float(start.spin()[0]), float(goal.spin()[0])
    angle = float(rotation_vector(start.attitude.to(goal.attitude))[0])
    first = float(leaves(start.attitude)[0])
    if sign:  # whoever turns this far passes every heading
        middle = np.full(len(edges) - 1, first)
        width = np.full(len(edges) - 1, math.pi)
    else:
        left = time - edges
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
        middle = 0.5 * (low + high)
        width = np.minimum(0.5 * np.maximum(high - low, 0.0), math.pi)
    # Multipliers of the spin and of the heading over the time.
    turn = angle + sign * 2.0 * math.pi - spins[0] * time
    share = 1.0 - edges / time
    pairs = np.stack([share[:-1], share[1:]], axis=1)
    turning = Turning(
        moment * np.array([spins[1] - spins[0], turn / time]),
        moment * np.array([tolerances.spin, tolerances.heading / time])
        + moment * _rounding(first, angle, spins[0], spins[1]) * np.array([1.0, 1.0 / time + 1.0]),
        np.stack([np.ones_like(pairs), pairs], axis=2),
        np.zeros((len(pairs), 2)),
        (0, sign),
    )
    cos, sin = np.cos(middle), np.sin(middle)
    centre = np.moveaxis(np.array([[cos, -sin], [sin, cos]]), 2, 0)
    return None, turning, centre, width


@cache
def _measures(craft: Spacecraft) -> tuple[_Measure, ...]:
    """Measures of rotation in space.

    The momentum of wheels turns with the craft and may change its angular momentum, but not its energy.
    """
    moments = np.linalg.eigvalsh(inertia(craft))
    mixed = [moments - x * moments[0] for x in _MIXTURES]
    mixed += [x * moments[2] - moments for x in (1.0, 1.5)]
    result = []
    for candidate in [moments[2] * np.ones(3), *([] if craft.wheels else mixed)]:
        # Of equal moments nothing but rounding may be left.
        weights = np.where(candidate < 1e-9 * moments[2], 0.0, candidate)
        if not weights.any():
            continue
        weights = tuple((weights / weights.max()).tolist())
        torques, wheels = _torques(craft, weights)
        arm = float((torques / np.maximum(_sets(craft)[1], 1e-300)).max())
        largest = float(torques.max()) + wheels
        result.append(_Measure(weights, largest, math.inf if craft.wheels else arm))
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
    first, last = (
        Rotation.from_quat(
            [float(value) for value in leaves(x.attitude)], scalar_first=True
        ).as_matrix()
        for x in (start, goal)
    )
    angle = float(np.linalg.norm(rotation_vector(start.attitude.to(goal.attitude))))
    cosines = np.sum((first @ principal) * (last @ principal), axis=0)
    axes = np.maximum(np.arccos(np.clip(cosines, -1.0, 1.0)) - tolerances.heading - 1e-7, 0.0)
    spins = [principal.T @ np.array(x.spin(), float) for x in (start, goal)]

    # Of each measure the speeds at both ends, and the distance that it has to make.
    ahead = np.full(len(edges), np.inf)
    back = np.full(len(edges), np.inf)
    choices = []
    for measure in _measures(craft):
        largest = measure.largest
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
        strength = max(measure.arm if by_impulse else largest, 1e-300)
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
    turning = Turning(
        np.concatenate([gain, -free]),
        np.append(np.full(len(middles), _rounding(distance / time, *speeds)), np.zeros(len(free))),
        np.concatenate([np.abs(pairs[..., None] - middles), basis], axis=2),
        np.concatenate([np.zeros((len(lean), len(middles))), lean], axis=1),
        (1,) * (len(middles) + len(free)),
    )
    centre = np.where(narrow[:, None, None], first, last)
    width = np.minimum(np.where(narrow, ahead[1:], back[:-1]), math.pi)
    return measure.weights, turning, centre, width


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
