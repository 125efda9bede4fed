"""Least propellant of a powered descent, by lossless convexification.

A lander is a point mass whose engines push along one axis of the craft, between a least and a largest thrust, and
cannot be shut. The thrust's direction may change at once, within a cone about the vertical. The set of thrusts is
a shell, which is not convex; with a slack sigma for the size of the acceleration it becomes the solid cone
|u| <= sigma, and the optimum of that larger problem lies on the shell: the relaxation is lossless. Sources:
B. Acikmese and S. R. Ploen, "Convex programming approach to powered descent guidance for Mars landing", Journal of
Guidance, Control, and Dynamics 30(5), 2007; B. Acikmese, J. M. Carson and L. Blackmore, "Lossless convexification
of nonconvex control bound and pointing constraints of the soft landing optimal control problem", IEEE
Transactions on Control Systems Technology 21(6), 2013.

The mass enters through z = ln m, so that the dynamics are linear. Bounds of the thrust are then bounds rho exp(-z)
of sigma. The lower one is convex, and replaced by a tangent. The upper one is not: a tangent lies below it and
gives a trajectory that can be flown, a chord lies above it and gives a bound that nothing can beat.

Engines that are throttled one by one turn the thrust in the craft, and so beyond the craft's tilt limit. Their
thrusts, and the tilts of the craft, are relaxed to a convex set of thrust and flow, which gives a bound too.

Units inside the solver: 1 km, 10 s, and the craft's full mass. Variables of programs are scaled (`_LENGTH`,
`_SPEED`, `_ACCELERATION`); side "bound" must stay below every landing, as tests ask.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from scipy import sparse

from rans.extend import ConfigError, Spacecraft, Throttle
from rans_missions.convex.cone_program import ConeProgram, Rows, SolverFailed
from rans_missions.tasks.land import Land

_LENGTH = 1000.0
"""m."""
_TIME = 10.0
"""s."""
_SPEED = _LENGTH / _TIME
_ACCELERATION = _LENGTH / _TIME**2
_ROUNDS = 6
"""Linearisations of the upper bound at most; two or three suffice."""
_MOST_APART = 12
"""Engines that are throttled one by one: their choices of least and largest throttles are 2 to this power."""
_SETTLED = 1e-5
"""Change of ln m between linearisations that no longer matters: 0.02 kg of two tonnes."""

Side = Literal["flyable", "bound"]


@dataclass(frozen=True)
class Lander:
    """Craft of a landing problem: a thrust along one axis, and the propellant that it takes.

    >>> from rans_missions.convex.landing import Lander
    >>> lander = Lander.of(rans.load_spacecraft("mars-lander-steered"))
    >>> round(lander.least_thrust), round(lander.largest_thrust)
    (4972, 13258)
    """

    mass: float
    """With a full tank, kg."""
    propellant: float
    """In a full tank, kg."""
    least_thrust: float
    """Of all engines together along the axis, N."""
    largest_thrust: float
    """The same, N."""
    exhaust_speed: float
    """Thrust along the axis over mass flow, m/s: canted engines waste a part of theirs."""
    corners: tuple[tuple[float, float, float], ...] = ()
    """Thrusts of every choice of least and largest throttles, for engines that are throttled one by one.

    Each has the mass flow times `exhaust_speed`, the force along z of B, and the force across it, N. The bounds of
    thrust above are then those of the first number. Empty: all engines are throttled alike."""

    @classmethod
    def of(cls, craft: Spacecraft, dead: Sequence[int] = (), apart: bool = False) -> Lander:
        """Lander of a craft in space whose engines push along z of B when all are throttled alike.

        Args:
            craft: with all of its engines.
            dead: numbers of engines that give no thrust; then the axis is that of the others' thrust.
            apart: whether the engines that are left are throttled one by one. Their torques are not limited, as
                if wheels held against them. `landing` has lower bounds of such a craft alone.

        Raises:
            ConfigError: it has no propellant or a tank at a place, its thrusters are not throttled, they do not
                push along z together, there is no such engine, or more than 12 are throttled one by one.
        """
        tank = craft.propellant
        if craft.dimension != 3 or tank is None or not isinstance(craft.actuators, Throttle):
            raise ConfigError(
                f"spacecraft {craft.name!r} is no lander: it needs throttled engines and propellant, in space "
                '(dimension = 3, [actuators] kind = "throttle", [propellant]).'
            )
        if tank.position is not None:
            raise ConfigError(
                f"the least propellant of a landing is that of a centre of mass that stays in the craft, and "
                f"the tank of {craft.name!r} has a position: take it out of [propellant]."
            )
        # All engines together must push along z of B, so that thrust follows attitude.
        forces = craft.wrenches[:, :3]
        along = forces.sum(axis=0)
        if np.linalg.norm(along[:2]) > 1e-6 * along[2]:
            raise ConfigError(
                f"the engines of {craft.name!r} push along {along.round(3).tolist()} N together, and a lander's "
                "along z of B."
            )
        count = len(forces)
        if not all(0 <= k < count for k in dead) or len({*dead}) == count:
            raise ConfigError(
                f"dead engines are some, not all, of the numbers 0 to {count - 1}, got {[*dead]}."
            )
        # Mass flow at full thrust is the sum over engines of force by exhaust speed.
        live = np.delete(forces, [*dead], axis=0)
        sizes = np.linalg.norm(live, axis=1)
        full = float(np.linalg.norm(live.sum(axis=0)))
        flow = float(sizes.sum()) / tank.exhaust_speed
        lander = cls(
            craft.mass,
            tank.mass,
            craft.actuators.least * full,
            craft.actuators.most * full,
            full / flow,
        )
        if not apart:
            return lander
        if len(live) > _MOST_APART:
            raise ConfigError(
                f"at most {_MOST_APART} engines can be throttled one by one, and {craft.name!r} has {len(live)}."
            )
        # Corners of what engines throttled one by one can give: propellant, push along z, push
        # across it.
        limits = craft.actuators.least, craft.actuators.most
        throttles = np.array([*itertools.product(limits, repeat=len(live))])
        used = throttles @ sizes * (lander.exhaust_speed / tank.exhaust_speed)
        force = throttles @ live
        across = np.linalg.norm(force[:, :2], axis=1)
        rows = np.stack([used, force[:, 2], across], axis=1)
        return replace(lander, corners=tuple(map(tuple, rows.tolist())))


@dataclass(frozen=True)
class Descent:
    """Conditions of a landing: gravity, limits and its end.

    The landing site is the origin, z points up.
    """

    gravity: float = 3.7114
    """m/s^2."""
    glide_slope: float = math.radians(4.0)
    """Least elevation above the ground seen from the site, rad."""
    margin: float = 1.0
    """Radius of the disc on the ground from whose rim the glide slope rises, m."""
    tilt: float = math.radians(40.0)
    """Largest angle between thrust and vertical, rad."""
    position_tolerance: float = 0.0
    """Distance from the site in which it may end, m; 0: at the site."""
    velocity_tolerance: float = 0.0
    """Speed with which it may end, m/s; 0: at rest."""
    turning: float | None = None
    """Largest angular acceleration across its thrust of a full craft that starts upright and at rest, rad/s^2.

    Thrust is then tilted by no more than half of it times the squared time. None: it turns at once."""

    @classmethod
    def of(cls, task: Land, exact: bool = False, craft: Spacecraft | None = None) -> Descent:
        """What a task asks for.

        Args:
            task: whose settings count.
            exact: whether to end at the site at rest instead of within the tolerances.
            craft: whose `turning` counts; None: thrust turns at once.
        """
        return cls(
            gravity=task.gravity,
            glide_slope=task.glide_slope,
            margin=task.position_tolerance,
            tilt=task.tilt_limit,
            position_tolerance=0.0 if exact else task.position_tolerance,
            velocity_tolerance=0.0 if exact else task.velocity_tolerance,
            turning=None if craft is None else largest_turning(craft),
        )


def largest_turning(craft: Spacecraft) -> float | None:
    """Largest angular acceleration across z of B that reaction wheels give a full craft, rad/s^2.

    In B, a craft's angular velocity is what its wheels have given to it, whatever way it turned: momentum is
    kept. Thrust along z of B is therefore tilted by no more than half of this number times the squared time after
    a start at rest. None where something else turns the craft too, of which this is not true.
    """
    turns = craft.wrenches[:, 3:]
    if craft.acting_effectors or np.abs(turns).max() > 1e-9 or not craft.wheels:
        return None
    torques = np.array([np.multiply(wheel.axis, wheel.max_torque) for wheel in craft.wheels])
    across = np.linalg.solve(np.array(craft.inertia), torques.T)[:2]
    corners = itertools.product((-1.0, 1.0), repeat=len(torques))
    return max(float(np.linalg.norm(across @ corner)) for corner in corners)


@dataclass(frozen=True)
class Landing:
    """An optimum of a fixed flight time, with accelerations that are held for equal periods."""

    period: float
    """For which an acceleration is held, s."""
    p: np.ndarray
    """(N + 1, 3) positions, m."""
    v: np.ndarray
    """(N + 1, 3) velocities, m/s."""
    mass: np.ndarray
    """(N + 1,) kg."""
    acceleration: np.ndarray
    """(N, 3) of the thrust alone, m/s^2."""
    slack: np.ndarray
    """(N,) sigma, m/s^2: the size of the acceleration where the relaxation is lossless."""
    propellant: float
    """Used, kg."""
    dual: float
    """Propellant that the dual solution proves to be needed, kg: what is above it is the duality gap."""

    @property
    def time(self) -> float:
        """Flight time, s."""
        return self.period * len(self.acceleration)


def landing(
    lander: Lander,
    descent: Descent,
    start: tuple[np.ndarray, np.ndarray],
    time: float,
    period: float = 0.5,
    side: Side = "flyable",
) -> Landing | None:
    """Landing in a given time (s) with the least propellant.

    None: of a bound, it is proved that there is none, by a certificate that is checked (`ConeProgram`). Of a plan
    that is to be flown, there is none near the masses of a craft that thrusts moderately.

    Args:
        lander: what lands.
        descent: what is asked for.
        start: position, m, and velocity, m/s.
        time: of flight, s; whole periods of it count.
        period: for which an acceleration is held, s.
        side: "flyable" keeps the true bounds of the thrust, and is flown; "bound" relaxes the upper one so that
            no landing in this time with accelerations held for such periods needs less.

    Raises:
        ConfigError: a plan is to be flown, and engines are throttled one by one.
        SolverFailed: Clarabel ends neither with a solution nor with a proof that there is none.
    """
    if lander.corners and side == "flyable":
        raise ConfigError(
            'for engines that are throttled one by one there is a lower bound alone: side = "bound".'
        )
    count = round(time / period)
    if count < 1:
        return None
    problem = _Problem(lander, descent, start, count, period)
    result = problem.solved(problem.heaviest if side == "bound" else problem.middle, side)
    if result is None:
        return None
    # The masses of the flight found are those of the next program.
    for _ in range(1 if side == "bound" else _ROUNDS):
        try:
            again = problem.solved(np.log(result.mass), side)
        except SolverFailed:
            break
        if again is None:
            # A bound has lines that no landing breaks, and this is a proof; a plan has the one before.
            return None if side == "bound" else result
        change = np.abs(np.log(again.mass / result.mass)).max()
        result = again
        if change < _SETTLED:
            break
    return result


def best_landing(
    lander: Lander,
    descent: Descent,
    start: tuple[np.ndarray, np.ndarray],
    period: float = 0.5,
    side: Side = "flyable",
    times: tuple[float, float] = (2.0, 120.0),
) -> Landing | None:
    """Landing with the least propellant of all flight times that are whole periods; None: see `landing`.

    The propellant need not have one minimum over the flight time, and no time is left out. The time with the least
    bound is taken: first by the rocket equation (`least_propellant`), then by one program, until a solution is not
    above the bounds of all other times.

    As a bound (side = "bound") it is one for accelerations that are held for this period. One for a longer hold is
    none for a shorter, which can do more: for the mission, take its own control period.

    Args:
        lander: what lands.
        descent: what is asked for.
        start: position, m, and velocity, m/s.
        period: for which an acceleration is held, s.
        side: as for `landing`.
        times: shortest and longest flight that counts, s.

    Raises:
        ConfigError: see `landing`.
        SolverFailed: see `landing`.
    """
    first = max(1, math.ceil(times[0] / period - 1e-9))
    last = int(times[1] / period + 1e-9)

    # Flight times that are still open, in periods: their bound, and how sharp it is.
    waiting = [
        (least_propellant(lander, descent, start, count * period), 0, count)
        for count in range(first, last + 1)
    ]
    heapq.heapify(waiting)
    solutions: dict[int, Landing] = {}
    while waiting:
        least, level, count = heapq.heappop(waiting)
        if level == 2:
            return solutions[count]
        if not math.isfinite(least):
            break
        if level == 0:
            problem = _Problem(lander, descent, start, count, period)
            try:
                found = problem.solved(problem.heaviest, "bound")
            except SolverFailed:
                # The next level asks again.
                heapq.heappush(waiting, (least, 1, count))
                continue
        else:
            found = landing(lander, descent, start, count * period, period, side)
        if found is not None:
            solutions[count] = found
            heapq.heappush(waiting, (max(least, found.propellant), level + 1, count))
    return None


def least_propellant(
    lander: Lander, descent: Descent, start: tuple[np.ndarray, np.ndarray], time: float
) -> float:
    """Lower bound of all landings in a time (s), kg, by the rocket equation; infinite: there is none.

    Thrust has to change the velocity by that at the start, and by what gravity gives meanwhile. It flows at its
    least all the time.
    """
    change = np.array([0.0, 0.0, descent.gravity * time]) - start[1]
    needed = max(0.0, float(np.linalg.norm(change)) - descent.velocity_tolerance)
    # Engines throttled one by one may waste less than all together.
    used, along, across = np.array(lander.corners or ((1.0, 1.0, 0.0),)).T
    lit = used > 0.0
    exhaust = lander.exhaust_speed * float((np.hypot(along, across)[lit] / used[lit]).max())
    most = min(lander.propellant, lander.largest_thrust / lander.exhaust_speed * time)
    least = max(
        lander.mass * -math.expm1(-needed / exhaust),
        lander.least_thrust / lander.exhaust_speed * time,
    )
    return least if least <= most else math.inf


class _Problem:
    """The second-order cone program of one flight time, in the solver's units.

    Variables, by knots k = 0 to N: p_k (3), v_k (3), z_k = ln(m_k / m_full), then by periods u_k (3), sigma_k.
    With engines that are throttled one by one, sigma_k is the mass flow times the exhaust speed over the mass, and
    one more variable a period is not below the size of u_k.
    """

    def __init__(
        self,
        lander: Lander,
        descent: Descent,
        start: tuple[np.ndarray, np.ndarray],
        count: int,
        period: float,
    ) -> None:
        self._lander = lander
        self._descent = descent
        self._start = start
        self._count = count
        self._period = period
        self._width = 5 if lander.corners else 4
        # Numbers of the variables of each knot, and of each period.
        knots = 7 * (count + 1)
        numbers = np.arange(knots + self._width * count)
        self._knots = numbers[:knots].reshape(-1, 7)
        self._controls = numbers[knots:].reshape(-1, self._width)
        self._size = len(numbers)
        # ln m of craft that burn as much, and as little, as they can.
        times = period * np.arange(count + 1)
        dry = lander.mass - lander.propellant
        flows = np.array([lander.largest_thrust, lander.least_thrust]) / lander.exhaust_speed
        masses = np.maximum(lander.mass - flows[:, None] * times, dry)
        self._lightest, self.heaviest = np.log(masses)
        self.middle = 0.5 * (self._lightest + self.heaviest)
        # Largest tilt of thrust in each period, rad: what a craft can have turned by at its end, with the inertia
        # of the lightest that it can be.
        self._tilts = np.full(count, descent.tilt)
        if descent.turning is not None:
            turned = 0.5 * descent.turning * lander.mass / masses[0, 1:] * times[1:] ** 2
            self._tilts = np.minimum(self._tilts, turned)

    def solved(self, log_mass: np.ndarray, side: Side) -> Landing | None:
        """Optimum with the bounds of thrust linearised about masses (N + 1,), ln kg; None: proved infeasible.

        In SI units.
        """
        answer = self._program(log_mass, side).solve(
            f"a landing in {self._count * self._period:g} s"
        )
        if answer is None:
            return None
        x = np.array(answer.x)
        knots = x[self._knots]
        controls = x[self._controls] * _ACCELERATION
        full = self._lander.mass
        mass = full * np.exp(knots[:, 6])
        return Landing(
            self._period,
            knots[:, :3] * _LENGTH,
            knots[:, 3:6] * _SPEED,
            mass,
            controls[:, :3],
            controls[:, 3],
            float(mass[0] - mass[-1]),
            full - full * math.exp(-float(answer.obj_val_dual)),
        )

    def _sum(self, *terms: tuple[float | np.ndarray, np.ndarray]) -> Any:
        """Rows that add up variables, by their numbers, with coefficients: a row for each number of a term."""
        count = terms[0][1].size
        values = [np.broadcast_to(value, count) for value, _ in terms]
        columns = [numbers.ravel() for _, numbers in terms]
        row = np.tile(np.arange(count), len(terms))
        entries = np.concatenate(values), (row, np.concatenate(columns))
        return sparse.csr_matrix(entries, shape=(count, self._size))

    def _program(self, log_mass: np.ndarray, side: Side) -> ConeProgram:
        """Least propellant about masses whose logarithms (N + 1,) are given.

        On side "bound" every row must hold for all landings that can be flown, on the other side for none that
        cannot.
        """
        lander, descent, n, add = self._lander, self._descent, self._count, self._sum
        p, v, z = self._knots[:, :3], self._knots[:, 3:6], self._knots[:, 6]
        u, sigma, size = self._controls[:, :3], self._controls[:, 3], self._controls[:, -1]
        rows = Rows(self._size)
        # Motion by an acceleration that is held for a period, from the start to the end.
        h = self._period / _TIME
        fallen = h * np.tile([0.0, 0.0, descent.gravity / _ACCELERATION], n)
        rate = _ACCELERATION * _TIME / lander.exhaust_speed
        rows.keep_zero(add((1.0, v[1:]), (-1.0, v[:-1]), (-h, u)), fallen)
        moved = (-1.0, p[:-1]), (-h, v[:-1]), (-0.5 * h**2, u)
        rows.keep_zero(add((1.0, p[1:]), *moved), 0.5 * h * fallen)
        rows.keep_zero(add((1.0, z[1:]), (-1.0, z[:-1]), (h * rate, sigma)), np.zeros(n))
        begin = np.concatenate([self._start[0] / _LENGTH, self._start[1] / _SPEED, [0.0]])
        rows.keep_zero(add((1.0, self._knots[0])), -begin)
        for last, tolerance in (
            (p[-1], descent.position_tolerance / _LENGTH),
            (v[-1], descent.velocity_tolerance / _SPEED),
        ):
            if tolerance == 0.0:
                rows.keep_zero(add((1.0, last)), np.zeros(3))
            else:
                radius = np.array([tolerance])
                rows.keep_in_cones(add((0.0, z[:1])), radius, add((1.0, last)), np.zeros(3))
        # The acceleration is no larger than its size; the craft is above the glide slope after the start.
        rows.keep_in_cones(add((1.0, size)), np.zeros(n), add((1.0, u)), np.zeros(3 * n))
        height = add((1.0 / math.tan(descent.glide_slope), p[1:, 2]))
        rim = np.full(n, descent.margin / _LENGTH)
        rows.keep_in_cones(height, rim, add((1.0, p[1:, :2])), np.zeros(2 * n))
        # No more propellant than there is.
        emptying = math.log(1.0 - lander.propellant / lander.mass)
        rows.keep_above_zero(add((1.0, z[-1:])), np.array([-emptying]))

        # In some periods, variables with a sign are at most slope sigma + force (N) over the mass.
        every = np.arange(n)
        limits = [
            (-1.0, sigma, every, 0.0, -lander.least_thrust),
            (1.0, sigma, every, 0.0, lander.largest_thrust),
        ]
        # Thrust is tilted by a bounded angle: with engines throttled together its vertical part is not below sigma
        # times the cosine; else lines bound its size and its vertical part by the flow.
        if lander.corners:
            # The flow is not negative, even where the tangent is.
            rows.keep_above_zero(add((1.0, sigma)), np.zeros(n))
            for tilt in np.unique(self._tilts):
                which = np.flatnonzero(self._tilts == tilt)
                sizes, heights = thrusts(lander.corners, float(tilt))
                limits += [(1.0, size, which, *line) for line in sizes]
                limits += [(-1.0, u[:, 2], which, *line) for line in heights]
        else:
            upright = add((1.0, u[:, 2]), (-np.cos(self._tilts), sigma))
            rows.keep_above_zero(upright, np.zeros(n))
        under, over = self._inverse_masses(log_mass, side)
        for sign, numbers, which, slope, force in limits:
            line = over if force > 0.0 else under
            constant, steep = line[:, which] * force / _ACCELERATION
            terms = (slope, sigma[which]), (0.5 * steep, z[which]), (0.5 * steep, z[which + 1])
            rows.keep_above_zero(add((-sign, numbers[which]), *terms), constant)

        # Sizes that no variable exceeds: the largest acceleration all the way, in any direction. Where a variable
        # may be larger a proof may be wrong.
        inverse = np.abs([a + b * end for a, b in (under, over) for end in (emptying, 0.0)]).max()
        flow = lander.largest_thrust / _ACCELERATION * inverse
        push = max(
            abs(slope) * flow + abs(force) / _ACCELERATION * inverse
            for _, _, _, slope, force in limits
        )
        time = n * h
        speed = float(np.linalg.norm(begin[3:6])) + time * (push + descent.gravity / _ACCELERATION)
        place = float(np.linalg.norm(begin[:3])) + 2.0 * time * speed
        farthest = np.zeros(self._size)
        farthest[self._knots] = [*[place] * 3, *[speed] * 3, -emptying]
        farthest[self._controls] = [push, push, push, flow, push][: self._width]
        cost = np.zeros(self._size)
        cost[z[-1]] = -1.0
        return rows.program(cost, -farthest, farthest)

    def _inverse_masses(self, log_mass: np.ndarray, side: Side) -> tuple[np.ndarray, np.ndarray]:
        """Two lines for 1 / m in each period, (2, N): constant and slope, 1/kg, over the mean of z at its ends.

        The first is a tangent, which is nowhere above 1 / m. The second is the same tangent if the plan is to be
        flown, and a chord, which is above 1 / m, if it is to be a bound. Thrust that is held for a period acts on
        the mass in its middle, ln of which is the mean of both ends.
        """
        full = math.log(self._lander.mass)
        middle, light, heavy = (
            0.5 * (one[1:] + one[:-1]) for one in (log_mass, self._lightest, self.heaviest)
        )
        inverse = np.exp(-middle)
        tangent = np.stack([inverse * (1.0 + middle - full), -inverse])
        if side == "flyable":
            return tangent, tangent
        # The chord between the masses that can be reached. Both are the dry mass in flights that are too long.
        above = np.exp(-light)
        slope = (np.exp(-heavy) - above) / np.maximum(heavy - light, 1e-9)
        return tangent, np.stack([above + slope * (full - light), slope])


Lines = tuple[tuple[float, float], ...]
"""Slopes, and intercepts, N, over the flow times the exhaust speed, N."""


@lru_cache(maxsize=1024)
def thrusts(corners: tuple[tuple[float, float, float], ...], tilt: float) -> tuple[Lines, Lines]:
    """Lines above the size of thrust, and above its negative height, of engines that are throttled one by one.

    Every thrust is a mixture of those of `Lander.corners`. Size, force across the axis and the negative height are
    convex in the thrust, and flow is linear in it, so that lines above the corners are above all thrusts.

    Args:
        corners: see `Lander`.
        tilt: largest tilt of the craft's axis, rad. The thrust is lowest where the force across points down from
            the axis that is tilted by so much.
    """
    used, along, across = np.array(corners).T
    low = math.sin(tilt) * across - math.cos(tilt) * along
    return _lines_above(used, np.hypot(along, across)), _lines_above(used, low)


def _lines_above(x: np.ndarray, y: np.ndarray) -> Lines:
    """Lines (slope, offset) of the least concave function that is nowhere below points (x, y), (n,) each.

    They limit thrust in programs of bounds, so that none of the points may lie above a line.
    """
    highest: dict[float, float] = {}
    for a, b in zip(x.round(6).tolist(), y.tolist(), strict=True):
        highest[a] = max(b, highest.get(a, -math.inf))
    hull: list[tuple[float, float]] = []
    for point in sorted(highest.items()):
        while len(hull) > 1 and _slope(hull[-2], hull[-1]) <= _slope(hull[-2], point):
            hull.pop()
        hull.append(point)
    slopes = [_slope(*ends) for ends in itertools.pairwise(hull)]
    return tuple((slope, b - slope * a) for slope, (a, b) in zip(slopes, hull[:-1], strict=True))


def _slope(first: tuple[float, float], second: tuple[float, float]) -> float:
    return (second[1] - first[1]) / (second[0] - first[0])
