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
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from scipy import sparse

from rans.extend import ConfigError, SolverFailed, Spacecraft
from rans.model.actuators import Throttle
from rans_missions.convex.cone_program import ConeProgram
from rans_missions.tasks.land import Land

_LENGTH = 1000.0
"""m."""
_TIME = 10.0
"""s."""
_SPEED = _LENGTH / _TIME
_ACCELERATION = _LENGTH / _TIME**2
_ROUNDS = 6
"""Linearisations of the upper bound at most; two or three suffice."""
_FLOORS = (15.0, 5.0, 2.0)
"""Periods of the programs that bound flight times before they are solved, s: some milliseconds each, and sharp
enough that few times remain."""
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
        along = full_thrust(craft)
        if np.linalg.norm(along[:2]) > 1e-6 * along[2]:
            raise ConfigError(
                f"the engines of {craft.name!r} push along {along.round(3).tolist()} N together, and a lander's "
                "along z of B."
            )
        # Mass flow at full thrust is the sum over engines of force by exhaust speed.
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
        # Corners of what engines throttled one by one can give: propellant, push along z, push
        # across it.
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
    count = craft.thruster_count
    if not all(0 <= k < count for k in dead) or len({*dead}) == count:
        raise ConfigError(
            f"dead engines are some, not all, of the numbers 0 to {count - 1}, got {[*dead]}."
        )
    live = [t for k, t in enumerate(craft.thrusters) if k not in dead]
    return np.array([np.multiply(t.direction, t.force) for t in live]).sum(axis=0)


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
    problem = _Problem(lander, descent, start, np.full(count, period))
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

    The propellant need not have one minimum over the flight time, and no time is left out. Programs with long
    periods, in which the thrust may vary in any way, bound the landings of each time (`_floor`), and then sharper
    ones. The time with the least bound is solved, until a solution is not above the bounds of all other times.

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
    waiting = [(0.0, 0, count) for count in range(first, last + 1)]
    solutions: dict[int, Landing] = {}
    while waiting:
        least, level, count = heapq.heappop(waiting)
        if level > len(_FLOORS):
            return solutions[count]
        if level == len(_FLOORS):
            result = landing(lander, descent, start, count * period, period, side)
            if result is None:
                continue
            solutions[count] = result
            floor = result.propellant
        else:
            merged = max(1, round(_FLOORS[level] / period))
            try:
                floor = _floor(lander, descent, start, count, period, merged)
            except SolverFailed:
                floor = least  # the next level asks again
        if math.isfinite(floor):
            heapq.heappush(waiting, (max(least, floor), level + 1, count))
    return None


def _floor(
    lander: Lander,
    descent: Descent,
    start: tuple[np.ndarray, np.ndarray],
    count: int,
    period: float,
    merged: int,
) -> float:
    """Lower bound of all landings whose flight has so many periods, kg; infinite: there is none.

    As many periods as `merged` become one, between whose ends the thrust may vary in any way, with the limits at
    its ends alone. The first is shorter where they do not divide the flight.

    Args:
        lander: what lands.
        descent: what is asked for.
        start: position, m, and velocity, m/s.
        count: flight time, in periods.
        period: s.
        merged: how many become one.

    Raises:
        SolverFailed: see `landing`.
    """
    whole, rest = divmod(count, merged)
    lengths = period * np.array([rest] * (rest > 0) + [merged] * whole)
    problem = _Problem(lander, descent, start, lengths, varies=True)
    answer = problem.answer(problem.heaviest, "bound")
    return math.inf if answer is None else problem.needed(answer)


class _Problem:
    """The second-order cone program of one flight time, in the solver's units.

    Variables, by knots k = 0 to N: p_k (3), v_k (3), z_k = ln(m_k / m_full), then by periods u_k (3), sigma_k.
    With engines that are throttled one by one, sigma_k is the mass flow times the exhaust speed over the mass, and
    one more variable a period is not below the size of u_k.

    Where the thrust varies in a period of length h, at times s in it, there are two of these groups: means of
    (1 - s / h) u and of (s / h) u. Their sum changes the velocity, the first alone the position. Means of cones
    are in these cones, and the mass is between those of both ends, so that nothing that can be flown is left out.
    """

    def __init__(
        self,
        lander: Lander,
        descent: Descent,
        start: tuple[np.ndarray, np.ndarray],
        lengths: np.ndarray,
        varies: bool = False,
    ) -> None:
        count = len(lengths)
        self.lander = lander
        self.descent = descent
        self.count = count
        self.lengths = lengths
        self.groups = 2 if varies else 1
        self.start = start
        self.knots = 7 * (count + 1)
        self.width = 5 if lander.corners else 4
        self.controls = self.groups * count
        self.size = self.knots + self.width * self.controls
        dry = lander.mass - lander.propellant
        self.times = np.concatenate([[0.0], np.cumsum(lengths)])
        full = lander.mass
        lightest = full - lander.largest_thrust / lander.exhaust_speed * self.times
        # ln m of craft that burn as much, and as little, as they can.
        self.lightest = np.log(np.maximum(lightest, dry))
        heaviest = full - lander.least_thrust / lander.exhaust_speed * self.times
        self.heaviest = np.log(np.maximum(heaviest, dry))
        self.middle = 0.5 * (self.lightest + self.heaviest)
        self.equations = self._dynamics()
        self.fixed = self._fixed_cones()

    def solved(self, log_mass: np.ndarray, side: Side) -> Landing | None:
        """Optimum with the bounds of thrust linearised about masses (N + 1,), ln kg; None: proved infeasible."""
        answer = self.answer(log_mass, side)
        return None if answer is None else self._read(answer)

    def answer(self, log_mass: np.ndarray, side: Side) -> Any:
        """Answer in the variables of the solver, about masses whose logarithms (count + 1,) are given.

        Rows come in the order that `ConeProgram` asks for: equations, inequalities, cones.
        """
        linear = self._linear(log_mass, side)
        blocks = [self.equations, linear, *self.fixed]
        cost = np.zeros(self.size)
        cost[self._z(self.count)] = -1.0
        farthest = self._farthest(side)
        program = ConeProgram(
            cost,
            sparse.vstack([block for block, _, _ in blocks], format="csc"),
            np.concatenate([values for _, values, _ in blocks]),
            self.equations[0].shape[0],
            linear[0].shape[0],
            tuple(width for block, _, width in self.fixed for _ in range(block.shape[0] // width)),
            -farthest,
            farthest,
        )
        return program.solve(f"a landing in {self.times[-1]:g} s")

    def needed(self, answer: Any) -> float:
        """Propellant that the dual solution proves to be needed, kg."""
        full = self.lander.mass
        return float(full - full * math.exp(-float(answer.obj_val_dual)))

    def _farthest(self, side: Side) -> np.ndarray:
        """(n,) sizes that no variable exceeds: the largest acceleration all the way, in any direction.

        Dual bounds are made true by these sizes: a variable that may be larger makes a bound that may be wrong.
        """
        lander = self.lander
        emptying = math.log(1.0 - lander.propellant / lander.mass)
        lines = [line for pair in self._inverse_masses(self.heaviest, side) for line in pair]
        inverse = max(abs(a + b * z) for a, b, _ in lines for z in (emptying, 0.0))
        sigma = push = lander.largest_thrust / _ACCELERATION * inverse
        for tilt in {*self._tilts().tolist()} if lander.corners else ():
            sizes, _ = thrusts(lander.corners, tilt)
            push = max(
                push, *(abs(a) * sigma + abs(force) / _ACCELERATION * inverse for a, force in sizes)
            )
        time = self.times[-1] / _TIME
        faster = self.groups * push + self.descent.gravity / _ACCELERATION
        v = float(np.linalg.norm(self.start[1])) / _SPEED + time * faster
        p = float(np.linalg.norm(self.start[0])) / _LENGTH + 2.0 * time * v
        knot = [*[p] * 3, *[v] * 3, -emptying]
        control = [push, push, push, sigma, push][: self.width]
        return np.array(knot * (self.count + 1) + control * self.controls)

    def _read(self, answer: Any) -> Landing:
        """The solver's answer in SI units, from scaled knots (7 each) and controls.

        Columns are those of `_dynamics`: seven for a knot, then `width` for a control.
        """
        x = np.array(answer.x)
        knots = x[: self.knots].reshape(-1, 7)
        controls = x[self.knots :].reshape(-1, self.width) * _ACCELERATION
        mass = self.lander.mass * np.exp(knots[:, 6])
        return Landing(
            float(self.lengths[0]),
            knots[:, :3] * _LENGTH,
            knots[:, 3:6] * _SPEED,
            mass,
            controls[:, :3],
            controls[:, 3],
            float(mass[0] - mass[-1]),
            self.needed(answer),
        )

    def _z(self, knot: int) -> int:
        return 7 * knot + 6

    def _sigma(self, period: int, group: int) -> int:
        return self.knots + self.width * (self.groups * period + group) + 3

    def _dynamics(self) -> tuple[Any, np.ndarray, int]:
        """Equations of motion, the start and, where it is exact, the end.

        Matrix, right sides and 1, in scaled units.

        `_read` takes the unknowns in its order: seven of every knot, then `width` of every control.
        """
        n = self.count
        steps = self.lengths / _TIME
        g = np.array([0.0, 0.0, -self.descent.gravity / _ACCELERATION])
        rate = _ACCELERATION * _TIME / self.lander.exhaust_speed
        identity = sparse.eye(3)
        # x_{k+1} - A x_k - B (u_k, sigma_k) = constant.
        drift = np.zeros((7, 7))
        drift[:3, 3:6] = np.eye(3)
        nearer = np.zeros((7, self.width))
        nearer[:3, :3] = np.eye(3)
        faster = np.zeros((7, self.width))
        faster[3:6, :3] = np.eye(3)
        faster[6, 3] = -rate
        blocks = [0.5 * nearer] if self.groups == 1 else [nearer, 0.0 * nearer]
        at_begin = sparse.hstack([sparse.eye(n), sparse.csc_matrix((n, 1))])
        at_end = sparse.hstack([sparse.csc_matrix((n, 1)), sparse.eye(n)])
        long = sparse.diags(steps)
        carry = sparse.kron(at_begin, sparse.eye(7)) + sparse.kron(long @ at_begin, drift)
        push = sparse.kron(long, np.hstack([faster] * self.groups))
        push += sparse.kron(long @ long, np.hstack(blocks))
        motion = sparse.hstack([sparse.kron(at_end, sparse.eye(7)) - carry, -push])
        fallen = np.concatenate([0.5 * g, np.zeros(4)]), np.concatenate([np.zeros(3), g, [0.0]])
        falling = np.outer(steps**2, fallen[0]) + np.outer(steps, fallen[1])
        p, v = self.start
        rows = [motion, _selected(sparse.eye(7), 0, self.size)]
        values = [falling.ravel(), np.concatenate([p / _LENGTH, v / _SPEED, [0.0]])]
        for tolerance, offset in (
            (self.descent.position_tolerance, 0),
            (self.descent.velocity_tolerance, 3),
        ):
            if tolerance == 0.0:
                rows.append(_selected(identity, 7 * n + offset, self.size))
                values.append(np.zeros(3))
        return sparse.vstack(rows, format="csc"), np.concatenate(values), 1

    def _linear(self, log_mass: np.ndarray, side: Side) -> tuple[Any, np.ndarray, int]:
        """Bounds of sigma, the thrust's cone about the vertical, and the propellant, as rows with A x <= b.

        On side "bound" every row must hold for all landings that can be flown, on the other side for none that
        cannot.
        """
        # Rows, as (row, column, value), and their right sides.
        n = self.count
        rows: list[tuple[int, int, float]] = []
        right: list[float] = []

        def add(bound: float, *entries: tuple[int, float]) -> None:
            rows.extend((len(right), column, value) for column, value in entries)
            right.append(bound)

        # Means over the halves of a period's weight, in units of the acceleration.
        weight = 1.0 / (self.groups * _ACCELERATION)

        def bounded(force: float, line: Line, *entries: tuple[int, float]) -> None:
            """The entries and a force (N) over the mass sum to at most 0."""
            constant, slope, knots = line
            scale = weight * force
            about = [(self._z(knot), slope * scale / len(knots)) for knot in knots]
            add(-constant * scale, *entries, *about)

        tilts = self._tilts()
        for k, (under, over) in enumerate(self._inverse_masses(log_mass, side)):
            for group in range(self.groups):
                # The flow is between those of the least and of the largest thrust.
                sigma = self._sigma(k, group)
                bounded(self.lander.least_thrust, under, (sigma, -1.0))
                bounded(-self.lander.largest_thrust, over, (sigma, 1.0))
                # The thrust is tilted by a bounded angle: with engines throttled together its vertical part is not
                # below sigma times the cosine; else lines bound its size and its vertical part by the flow.
                vertical = sigma - 1
                if not self.lander.corners:
                    add(0.0, (sigma, math.cos(tilts[k])), (vertical, -1.0))
                    continue
                # The flow is not negative, even where the tangent is.
                add(0.0, (sigma, -1.0))
                sizes, heights = thrusts(self.lander.corners, float(tilts[k]))
                for variable, sign, lines in ((sigma + 1, 1.0, sizes), (vertical, -1.0, heights)):
                    for slope, force in lines:
                        line = over if force > 0.0 else under
                        bounded(-force, line, (variable, sign), (sigma, -slope))
        # No more propellant than there is.
        dry = math.log((self.lander.mass - self.lander.propellant) / self.lander.mass)
        add(-dry, (self._z(n), -1.0))
        row, column, value = zip(*rows, strict=True)
        matrix = sparse.csc_matrix((value, (row, column)), shape=(len(right), self.size))
        return matrix, np.array(right), 1

    def _inverse_masses(self, log_mass: np.ndarray, side: Side) -> Iterator[tuple[Line, Line]]:
        """Two lines for 1 / m in each period, over the mean of z at some knots.

        The first is a tangent, which is nowhere above 1 / m. The second is the same tangent if the plan is to be
        flown, and a chord, which is above 1 / m, if it is to be a bound. Thrust that is held for a period acts on
        the mass in its middle, ln of which is the mean of both ends. Where the thrust varies, 1 / m is not below
        that at the begin, nor above that at the end.
        """
        full = math.log(self.lander.mass)
        for k in range(self.count):
            first, last = ((k,), (k + 1,)) if self.groups == 2 else ((k, k + 1),) * 2
            middle = float(np.mean(log_mass[[*first]]))
            inverse = math.exp(-middle)
            tangent = inverse * (1.0 + middle - full), -inverse, first
            if side == "flyable":
                yield tangent, tangent
                continue
            # The chord between the masses that can be reached. Both are the dry mass in flights that are too long.
            light = float(np.mean(self.lightest[[*last]]))
            heavy = float(np.mean(self.heaviest[[*last]]))
            above = math.exp(-light)
            slope = (math.exp(-heavy) - above) / max(heavy - light, 1e-9)
            yield tangent, (above + slope * (full - light), slope, last)

    def _tilts(self) -> np.ndarray:
        """(N,) largest tilt of thrust in each period, rad: what a craft can have turned by at its end.

        By then a craft's inertia is that of the lightest that it can be.
        """
        limit = np.full(self.count, self.descent.tilt)
        if self.descent.turning is None:
            return limit
        full = math.log(self.lander.mass)
        growth = np.exp(full - self.lightest[1:])
        return np.minimum(limit, 0.5 * self.descent.turning * growth * self.times[1:] ** 2)

    def _fixed_cones(self) -> list[tuple[Any, np.ndarray, int]]:
        """Second-order cones b - A x: of the acceleration, the glide slope and where it ends.

        With widths.
        """
        n = self.count
        descent = self.descent
        # (sigma or the largest size, u).
        order = sparse.csc_matrix(
            ([-1.0, -1.0, -1.0, -1.0], ([0, 1, 2, 3], [self.width - 1, 0, 1, 2])),
            shape=(4, self.width),
        )
        thrust = sparse.hstack(
            [
                sparse.csc_matrix((4 * self.controls, self.knots)),
                sparse.kron(sparse.eye(self.controls), order),
            ]
        )
        cones = [(thrust.tocsc(), np.zeros(4 * self.controls), 4)]
        # The glide slope at every knot but the first: (height over tan + margin, x, y).
        slope = np.zeros((3, 7))
        slope[0, 2] = -1.0 / math.tan(descent.glide_slope)
        slope[1, 0] = slope[2, 1] = -1.0
        later = sparse.hstack([sparse.csc_matrix((n, 1)), sparse.eye(n)])
        glide = sparse.hstack(
            [sparse.kron(later, slope), sparse.csc_matrix((3 * n, self.width * self.controls))]
        )
        rim = np.tile([descent.margin / _LENGTH, 0.0, 0.0], n)
        cones.append((glide.tocsc(), rim, 3))
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


Line = tuple[float, float, tuple[int, ...]]
"""Constant and slope, 1/kg, over the mean of z at these knots."""
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


def _selected(block: Any, first: int, size: int) -> Any:
    """A block of columns that begins at one of them, with zeros around it."""
    rows = block.shape[0]
    after = size - first - block.shape[1]
    return sparse.hstack(
        [sparse.csc_matrix((rows, first)), block, sparse.csc_matrix((rows, after))], format="csc"
    )
