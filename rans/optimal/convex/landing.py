"""Least propellant of a powered descent, by lossless convexification.

A lander is a point mass whose engines push along one axis of the craft, between a least and a largest thrust, and
cannot be shut. The thrust's direction may change at once, within a cone about the vertical. The set of thrusts is
a shell, which is not convex; with a slack sigma for the size of the acceleration it becomes the solid cone
|u| <= sigma, and the optimum of that larger problem lies on the shell: the relaxation is lossless. Sources:
B. Acikmese and S. R. Ploen, "Convex programming approach to powered descent guidance for Mars landing", Journal of
Guidance, Control, and Dynamics 30(5), 2007; B. Acikmese, J. M. Carson and L. Blackmore, "Lossless convexification
of nonconvex control bound and pointing constraints of the soft landing optimal control problem", IEEE
Transactions on Control Systems Technology 21(6), 2013.

The mass enters through z = ln m, so that the dynamics are linear. Bounds of the thrust are then bounds
rho exp(-z) of sigma. The lower one is convex, and replaced by a tangent. The upper one is not: a tangent lies below
it and gives a trajectory that can be flown, a chord lies above it and gives a bound that nothing can beat.

Engines that are throttled one by one turn the thrust in the craft, and so beyond the craft's tilt limit. Their
thrusts, and the tilts of the craft, are relaxed to a convex set of thrust and flow, which gives a bound too.

Units inside the solver: 1 km, 10 s, and the craft's full mass.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from scipy import sparse

from rans.errors import ConfigError, require
from rans.model.actuators import Throttle
from rans.model.spacecraft import Spacecraft
from rans.tasks.land import Land

_LENGTH = 1000.0
"""m."""
_TIME = 10.0
"""s."""
_SPEED = _LENGTH / _TIME
_ACCELERATION = _LENGTH / _TIME**2
_ROUNDS = 6
"""Linearisations of the upper bound at most; two or three suffice."""
_COARSE = 2.0
"""Hold with which the flight time is searched, s."""
_MOST_APART = 12
"""Engines that are throttled one by one: their choices of least and largest throttles are 2 to this power."""
_SETTLED = 1e-5
"""Change of ln m between linearisations that no longer matters: 0.02 kg of two tonnes."""

Side = Literal["flyable", "bound"]


@dataclass(frozen=True)
class Lander:
    """What the problem knows of a craft: a thrust along one axis, and the propellant that it takes.

    >>> from rans.optimal.convex.landing import Lander
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
        """Of a craft in space whose engines push along z of B when all are throttled alike.

        Args:
            craft: with all of its engines.
            dead: numbers of engines that give no thrust; then the axis is that of the others' thrust.
            apart: whether the engines that are left are throttled one by one. Their torques are not limited, as
                if wheels held against them. `landing` has lower bounds of such a craft alone.

        Raises:
            ConfigError: it has no propellant, its thrusters are not throttled, they do not push along z
                together, there is no such engine, or more than 12 are throttled one by one.
        """
        tank = craft.propellant
        if craft.dimension != 3 or tank is None or not isinstance(craft.actuators, Throttle):
            raise ConfigError(
                f"spacecraft {craft.name!r} is no lander: it needs throttled engines and propellant, in space "
                '(dimension = 3, [actuators] kind = "throttle", [propellant]).'
            )
        along = full_thrust(craft)
        if np.linalg.norm(along[:2]) > 1e-6 * along[2]:
            raise ConfigError(
                f"the engines of {craft.name!r} push along {along.round(3).tolist()} N together, and a lander's "
                "along z of B."
            )
        full = float(np.linalg.norm(full_thrust(craft, dead)))
        live = [t for k, t in enumerate(craft.thrusters) if k not in dead]
        flow = sum(t.force for t in live) / tank.exhaust_speed
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
        limits = craft.actuators.least, craft.actuators.most
        throttles = np.array([*itertools.product(limits, repeat=len(live))])
        used = throttles @ [t.force for t in live] * (lander.exhaust_speed / tank.exhaust_speed)
        force = throttles @ np.array([np.multiply(t.direction, t.force) for t in live])
        across = np.linalg.norm(force[:, :2], axis=1)
        rows = np.stack([used, force[:, 2], across], axis=1)
        return replace(lander, corners=tuple(map(tuple, rows.tolist())))


def full_thrust(craft: Spacecraft, dead: Sequence[int] = ()) -> np.ndarray:
    """(3,) force in B of all engines at full thrust but the dead ones, N.

    Raises:
        ConfigError: there is no engine of a number, or none is left.
    """
    count = len(craft.thrusters)
    if not all(0 <= k < count for k in dead) or len({*dead}) == count:
        raise ConfigError(
            f"dead engines are some, not all, of the numbers 0 to {count - 1}, got {[*dead]}."
        )
    live = [t for k, t in enumerate(craft.thrusters) if k not in dead]
    return np.array([np.multiply(t.direction, t.force) for t in live]).sum(axis=0)


def thrust_offset(craft: Spacecraft, dead: Sequence[int]) -> float:
    """Angle between z of B and the thrust of all engines but the dead ones, throttled alike, rad.

    Raises:
        ConfigError: see `full_thrust`.
    """
    force = full_thrust(craft, dead)
    return math.acos(min(1.0, float(force[2] / np.linalg.norm(force))))


@dataclass(frozen=True)
class Descent:
    """What a landing asks for: gravity, limits and where it ends.

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
    speed: float | None = None
    """Largest speed, m/s; None: any."""
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
    turns = np.array(craft.wrench_map)[:, 3:]
    if craft.further_effectors or np.abs(turns).max() > 1e-9 or not craft.wheels:
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
    primal_residual: float
    """Of the solver's equations and cones, in its units."""
    dual_residual: float
    """The same of the dual problem."""

    @property
    def time(self) -> float:
        """Flight time, s."""
        return self.period * len(self.acceleration)

    @property
    def looseness(self) -> float:
        """How far sigma exceeds the acceleration at most, as a share of it: 0 where the relaxation is lossless."""
        size = np.linalg.norm(self.acceleration, axis=1)
        return float(np.max(self.slack / size - 1.0))


def landing(
    lander: Lander,
    descent: Descent,
    start: tuple[np.ndarray, np.ndarray],
    time: float,
    period: float = 0.5,
    side: Side = "flyable",
    propellant: float | None = None,
) -> Landing | None:
    """Landing in a given time (s) with the least propellant; None: there is none.

    Args:
        lander: what lands.
        descent: what is asked for.
        start: position, m, and velocity, m/s.
        time: of flight, s; whole periods of it count.
        period: for which an acceleration is held, s.
        side: "flyable" keeps the true bounds of the thrust, and is flown; "bound" relaxes the upper one so that
            no landing in this time with accelerations held for such periods needs less.
        propellant: left at the start, kg; None: a full tank.

    Raises:
        ConfigError: a plan is to be flown, and engines are throttled one by one.
    """
    if lander.corners and side == "flyable":
        raise ConfigError(
            'for engines that are throttled one by one there is a lower bound alone: side = "bound".'
        )
    count = round(time / period)
    if count < 1:
        return None
    problem = _Problem(lander, descent, start, count, period, propellant)
    result = problem.solved(problem.heaviest if side == "bound" else problem.middle, side)
    if side == "bound" or result is None:
        # The lower thrust bound's tangent is below it wherever it touches: one more makes it tight.
        return result and (problem.solved(np.log(result.mass), side) or result)
    for _ in range(_ROUNDS):
        again = problem.solved(np.log(result.mass), side)
        if again is None:
            break
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
    times: tuple[float, float] = (20.0, 120.0),
    propellant: float | None = None,
) -> Landing | None:
    """Landing with the least propellant of all flight times; None: there is none.

    The time is found with long holds first, then with those of the period.

    Args:
        lander: what lands.
        descent: what is asked for.
        start: position, m, and velocity, m/s.
        period: for which an acceleration is held, s.
        side: as for `landing`.
        times: shortest and longest flight that is tried, s.
        propellant: left at the start, kg; None: a full tank.

    Raises:
        ConfigError: see `landing`.
    """
    coarse = period * max(1, round(_COARSE / period))
    guess = _least(lander, descent, start, coarse, "bound", times, propellant)
    if guess is None:
        return None
    # Shorter holds lose less, so that the best time may be a coarse period away; walk downhill from there.
    near = (guess.time - coarse, guess.time + coarse)
    return _least(lander, descent, start, period, side, near, propellant, guess.time)


def _least(
    lander: Lander,
    descent: Descent,
    start: tuple[np.ndarray, np.ndarray],
    period: float,
    side: Side,
    times: tuple[float, float],
    propellant: float | None,
    guess: float | None = None,
) -> Landing | None:
    """Landing with the least propellant between two times (s), of which the propellant has one minimum.

    Without a guess of the time nine times are tried first, because short and long flights are infeasible; where all
    nine are, 33.
    """
    known: dict[int, Landing | None] = {}

    def used(count: int) -> float:
        if count not in known:
            time = count * period
            known[count] = landing(lander, descent, start, time, period, side, propellant)
        result = known[count]
        return math.inf if result is None else result.propellant

    low = max(1, round(times[0] / period))
    high = max(low, round(times[1] / period))
    if guess is None:
        best, step = low, 0
        for parts in (8, 32):
            best = min({round(low + (high - low) * k / parts) for k in range(parts + 1)}, key=used)
            step = max(1, (high - low) // (2 * parts))
            if not math.isinf(used(best)):
                break
    else:
        best = round(guess / period)
        step = 1
        if math.isinf(used(best)):
            best = min(range(low, high + 1), key=used)
    if math.isinf(used(best)) and guess is None:
        return None
    while step:
        beside = [count for count in (best - step, best + step) if low <= count <= high]
        better = min((best, *beside), key=used)
        if better == best:
            step //= 2
        best = better
    return known[best]


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
        propellant: float | None,
    ) -> None:
        self.lander = lander
        self.descent = descent
        self.count = count
        self.period = period
        self.start = start
        self.spent = 0.0 if propellant is None else lander.propellant - propellant
        self.knots = 7 * (count + 1)
        self.width = 5 if lander.corners else 4
        self.size = self.knots + self.width * count
        dry = lander.mass - lander.propellant
        elapsed = period * np.arange(count + 1)
        full = lander.mass - self.spent
        lightest = full - lander.largest_thrust / lander.exhaust_speed * elapsed
        # ln m of craft that burn as much, and as little, as they can.
        self.lightest = np.log(np.maximum(lightest, dry))
        heaviest = full - lander.least_thrust / lander.exhaust_speed * elapsed
        self.heaviest = np.log(np.maximum(heaviest, dry))
        self.middle = 0.5 * (self.lightest + self.heaviest)
        self.equations = self._dynamics()
        self.fixed = self._fixed_cones()

    def solved(self, log_mass: np.ndarray, side: Side) -> Landing | None:
        """Optimum with the bounds of thrust linearised about masses (N + 1,), ln kg; None: infeasible."""
        # Clarabel has no stubs for what its compiled module holds.
        clarabel: Any = require("clarabel")

        linear = self._linear(log_mass, side)
        blocks = [self.equations, linear, *self.fixed]
        matrix = sparse.vstack([block for block, _, _ in blocks], format="csc")
        right = np.concatenate([values for _, values, _ in blocks])
        cones = [
            clarabel.ZeroConeT(self.equations[0].shape[0]),
            clarabel.NonnegativeConeT(linear[0].shape[0]),
            *(
                clarabel.SecondOrderConeT(width)
                for block, _, width in self.fixed
                for _ in range(block.shape[0] // width)
            ),
        ]
        cost = np.zeros(self.size)
        cost[self._z(self.count)] = -1.0
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_threads = 1
        nothing = sparse.csc_matrix((self.size, self.size))
        answer = clarabel.DefaultSolver(nothing, cost, matrix, right, cones, settings).solve()
        if str(answer.status) not in ("Solved", "AlmostSolved"):
            return None
        return self._read(answer)

    def _read(self, answer: Any) -> Landing:
        """The solver's answer in SI units."""
        x = np.array(answer.x)
        knots = x[: self.knots].reshape(-1, 7)
        controls = x[self.knots :].reshape(-1, self.width) * _ACCELERATION
        mass = self.lander.mass * np.exp(knots[:, 6])
        needed = self.lander.mass * math.exp(-float(answer.obj_val_dual))
        return Landing(
            self.period,
            knots[:, :3] * _LENGTH,
            knots[:, 3:6] * _SPEED,
            mass,
            controls[:, :3],
            controls[:, 3],
            float(mass[0] - mass[-1]),
            float(mass[0] - needed),
            float(answer.r_prim),
            float(answer.r_dual),
        )

    def _z(self, knot: int) -> int:
        return 7 * knot + 6

    def _sigma(self, period: int) -> int:
        return self.knots + self.width * period + 3

    def _dynamics(self) -> tuple[Any, np.ndarray, int]:
        """Equations of motion, the start and, where it is exact, the end."""
        n = self.count
        step = self.period / _TIME
        g = np.array([0.0, 0.0, -self.descent.gravity / _ACCELERATION])
        rate = _ACCELERATION * _TIME / self.lander.exhaust_speed
        one = sparse.eye(3)
        # x_{k+1} - A x_k - B (u_k, sigma_k) = constant.
        carry = np.eye(7)
        carry[:3, 3:6] = step * np.eye(3)
        push = np.zeros((7, self.width))
        push[:3, :3] = 0.5 * step**2 * np.eye(3)
        push[3:6, :3] = step * np.eye(3)
        push[6, 3] = -rate * step
        here = sparse.hstack([sparse.eye(n), sparse.csc_matrix((n, 1))])
        there = sparse.hstack([sparse.csc_matrix((n, 1)), sparse.eye(n)])
        states = sparse.kron(there, sparse.eye(7)) - sparse.kron(here, carry)
        motion = sparse.hstack([states, -sparse.kron(sparse.eye(n), push)])
        falling = np.concatenate([0.5 * step**2 * g, step * g, [0.0]])
        p, v = self.start
        full = math.log((self.lander.mass - self.spent) / self.lander.mass)
        begin = sparse.eye(7, self.size)
        rows = [motion, begin]
        values = [np.tile(falling, n), np.concatenate([p / _LENGTH, v / _SPEED, [full]])]
        for tolerance, offset in (
            (self.descent.position_tolerance, 0),
            (self.descent.velocity_tolerance, 3),
        ):
            if tolerance == 0.0:
                rows.append(_selected(one, 7 * n + offset, self.size))
                values.append(np.zeros(3))
        return sparse.vstack(rows, format="csc"), np.concatenate(values), 1

    def _linear(self, log_mass: np.ndarray, side: Side) -> tuple[Any, np.ndarray, int]:
        """Bounds of sigma, the thrust's cone about the vertical, and the propellant, as rows with A x <= b."""
        n = self.count
        least = self.lander.least_thrust / _ACCELERATION
        most = self.lander.largest_thrust / _ACCELERATION
        rows: list[tuple[int, int, float]] = []
        right: list[float] = []

        def add(bound: float, *entries: tuple[int, float]) -> None:
            rows.extend((len(right), column, value) for column, value in entries)
            right.append(bound)

        tilts = self._tilts()
        for k, (under, over) in enumerate(self._inverse_masses(log_mass, side)):
            sigma = self._sigma(k)

            def bounded(
                force: float,
                inverse: tuple[float, float],
                *entries: tuple[int, float],
                k: int = k,
            ) -> None:
                """The entries and a force over the mass sum to at most 0."""
                constant, slope = inverse
                middle = [(self._z(knot), 0.5 * slope * force) for knot in (k, k + 1)]
                add(-constant * force, *entries, *middle)

            bounded(least, under, (sigma, -1.0))
            bounded(-most, over, (sigma, 1.0))
            vertical = sigma - 1
            if not self.lander.corners:
                add(0.0, (sigma, math.cos(tilts[k])), (vertical, -1.0))
                continue
            sizes, heights = thrusts(self.lander.corners, float(tilts[k]))
            for variable, sign, lines in ((sigma + 1, 1.0, sizes), (vertical, -1.0, heights)):
                for slope, force in lines:
                    bounded(
                        -force / _ACCELERATION,
                        over if force > 0.0 else under,
                        (variable, sign),
                        (sigma, -slope),
                    )
        dry = math.log((self.lander.mass - self.lander.propellant) / self.lander.mass)
        add(-dry, (self._z(n), -1.0))
        row, column, value = zip(*rows, strict=True)
        matrix = sparse.csc_matrix((value, (row, column)), shape=(len(right), self.size))
        return matrix, np.array(right), 1

    def _inverse_masses(
        self, log_mass: np.ndarray, side: Side
    ) -> Iterator[tuple[tuple[float, float], tuple[float, float]]]:
        """Two lines (constant, slope) over z for 1 / m in each period.

        The first is a tangent, which is nowhere above 1 / m. The second is the same tangent if the plan is to be
        flown, and a chord, which is above 1 / m, if it is to be a bound.
        """
        full = math.log(self.lander.mass)
        # Thrust that is held for a period acts on the mass in its middle, ln of which is the mean of both ends.
        about = 0.5 * (log_mass[:-1] + log_mass[1:])
        lightest = 0.5 * (self.lightest[:-1] + self.lightest[1:])
        heaviest = 0.5 * (self.heaviest[:-1] + self.heaviest[1:])
        for middle, light, heavy in zip(about, lightest, heaviest, strict=True):
            inverse = math.exp(-middle)
            tangent = inverse * (1.0 + middle - full), -inverse
            if side == "flyable":
                yield tangent, tangent
                continue
            # The chord between the masses that can be reached. Both are the dry mass in flights that are too long.
            above = math.exp(-light)
            slope = (math.exp(-heavy) - above) / max(heavy - light, 1e-9)
            yield tangent, (above + slope * (full - light), slope)

    def _tilts(self) -> np.ndarray:
        """(N,) largest tilt of thrust in each period, rad: what a craft can have turned by at its end.

        By then a craft's inertia is that of the lightest that it can be.
        """
        limit = np.full(self.count, self.descent.tilt)
        if self.descent.turning is None:
            return limit
        full = math.log(self.lander.mass)
        growth = np.exp(full - self.lightest[1:])
        times = self.period * np.arange(1, self.count + 1)
        return np.minimum(limit, 0.5 * self.descent.turning * growth * times**2)

    def _fixed_cones(self) -> list[tuple[Any, np.ndarray, int]]:
        """Second-order cones b - A x: of the acceleration, the glide slope, the speed and where it ends."""
        n = self.count
        descent = self.descent
        # (sigma or the largest size, u).
        order = sparse.csc_matrix(
            ([-1.0, -1.0, -1.0, -1.0], ([0, 1, 2, 3], [self.width - 1, 0, 1, 2])),
            shape=(4, self.width),
        )
        thrust = sparse.hstack(
            [sparse.csc_matrix((4 * n, self.knots)), sparse.kron(sparse.eye(n), order)]
        )
        cones = [(thrust.tocsc(), np.zeros(4 * n), 4)]
        # The glide slope at every knot but the first: (height over tan + margin, x, y).
        slope = np.zeros((3, 7))
        slope[0, 2] = -1.0 / math.tan(descent.glide_slope)
        slope[1, 0] = slope[2, 1] = -1.0
        later = sparse.hstack([sparse.csc_matrix((n, 1)), sparse.eye(n)])
        glide = sparse.hstack(
            [sparse.kron(later, slope), sparse.csc_matrix((3 * n, self.width * n))]
        )
        rim = np.tile([descent.margin / _LENGTH, 0.0, 0.0], n)
        cones.append((glide.tocsc(), rim, 3))
        if descent.speed is not None:
            fast = np.zeros((4, 7))
            fast[1:, 3:6] = -np.eye(3)
            speeds = sparse.hstack(
                [sparse.kron(later, fast), sparse.csc_matrix((4 * n, self.width * n))]
            )
            cones.append((speeds.tocsc(), np.tile([descent.speed / _SPEED, 0.0, 0.0, 0.0], n), 4))
        for tolerance, unit, offset in (
            (descent.position_tolerance, _LENGTH, 0),
            (descent.velocity_tolerance, _SPEED, 3),
        ):
            if tolerance > 0.0:
                ball = _selected(
                    -sparse.vstack([sparse.csc_matrix((1, 3)), sparse.eye(3)]),
                    7 * n + offset,
                    self.size,
                )
                cones.append((ball, np.array([tolerance / unit, 0.0, 0.0, 0.0]), 4))
        return cones


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
    """Lines of the least concave function that is nowhere below points (x, y)."""
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


def _slope(one: tuple[float, float], other: tuple[float, float]) -> float:
    return (other[1] - one[1]) / (other[0] - one[0])


def _selected(block: Any, first: int, size: int) -> Any:
    """A block of columns that begins at one of them, with zeros around it."""
    rows = block.shape[0]
    after = size - first - block.shape[1]
    return sparse.hstack(
        [sparse.csc_matrix((rows, first)), block, sparse.csc_matrix((rows, after))], format="csc"
    )
