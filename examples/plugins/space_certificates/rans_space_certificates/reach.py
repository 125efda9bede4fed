"""Lower bounds of fuel and time under on/off control in space, for craft with equal principal moments of inertia.

Such a craft has no gyroscopic torque: however it moves, its spin in B is w_0 + q n, with n a sum of the torques of
open thrusters, in quanta. The level m = |n|^2 is a whole number, and a period's torque t leads from m to
m' = m + 2 n . t + |t|^2: with the parity of m + |t|^2, and no farther from it than 2 |n| |t|.

The bound is a Lagrangian dual, minimised over levels by dynamic programming, in which the attitude is relaxed: it
may be any that a craft with these levels can have reached since the start by rotation about any axis and, in the
second half, any from which the goal can still be reached. docs/bounds/certificate.md has the proof.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from functools import cached_property
from types import ModuleType

import numpy as np
from rans_bounds.goal_set import GoalSet, pulse
from rans_bounds.problem import check_finite

from rans.extend import (
    ON_OFF,
    ConfigError,
    NonFiniteState,
    Quat,
    Spacecraft,
    SpatialState,
    Vec3,
    check_certifiable,
    check_period,
    inertia,
    rounded_up,
)

_LARGEST_PRODUCT = 64
"""Largest product of two thrusters' torques, in squared quanta."""
_RELATIVE_TOLERANCE = 1e-12
"""Difference of such products from whole numbers, and of moments from each other, that counts as rounding."""
_MOST_PATTERNS = 100_000
"""Patterns of open thrusters that differ, at most: more take minutes for each bound."""
_MOST_LEVEL = 25
"""Highest level that is resolved; a craft at a higher one is taken to have any attitude."""
_CELLS_PER_QUANTUM = 8
"""Cells of the angle of rotation by which one quantum of spin rotates in a period."""
_MOST_ROTATION = 1.3
"""Angle of rotation from which on any attitude is taken to be reached, rad."""
_ROUNDING = 1e-9
"""Margin for rounding, relative to the sum of all costs' sizes, of which double precision loses 1e-12."""
_OVERFLOW_MARGIN = 1e100
"""Margin from which on squares of costs might overflow, N s."""


class SpinLattice:
    """Lattice of the spins that on/off thrust can reach in space, and the forces that go with each torque.

    Args:
        craft: with equal principal moments of inertia and torques on a lattice.
        period: control period, s.

    Raises:
        ConfigError: this spacecraft has no such lattice, or the period is not a positive number.
    """

    def __init__(self, craft: Spacecraft, period: float) -> None:
        check_period(period)
        self.craft = craft
        self.period = period
        self.pulse = pulse(craft, period)
        self.moment = _moment(craft)
        wrenches = np.array(craft.wrench_map)
        self.torque, self.products = _quantum(craft, wrenches[:, 3:])
        self.spin = self.torque * period / self.moment
        """q: change of spin by one quantum of torque held for one period, rad/s."""
        self.force, self.squared_torques, self.thrust = _patterns(craft, wrenches, self.torque)

    @property
    def pulses_flip_parity(self) -> bool:
        """Whether every pulse changes the level m from even to odd or back."""
        return bool((np.diag(self.products) % 2 == 1).all())

    def final_levels(
        self, aims: Collection[str], start: SpatialState, goal_set: GoalSet
    ) -> range | None:
        """Levels m = |n|^2 with which a flight can end at rest; None where no rest is asked.

        |w_0 + q n| <= e needs q |n| to be within e of |w_0|.
        """
        if "spin" not in aims:
            return None
        initial_spin = float(np.linalg.norm(start.w.columns()))
        tolerance = goal_set.spin + 1e-9
        lowest = max(0.0, initial_spin - tolerance) / self.spin
        highest = (initial_spin + tolerance) / self.spin
        return range(math.ceil(lowest**2 - 1e-9), math.floor(highest**2 + 1e-9) + 1)

    def can_end_at_rest(
        self, aims: Collection[str], start: SpatialState, goal: SpatialState, goal_set: GoalSet
    ) -> bool:
        """Whether pulses can take the start's spin to the goal's rest; false too for goals that spin."""
        final_levels = self.final_levels(aims, start, goal_set)
        return not any(goal.w.columns()) and (final_levels is None or len(final_levels) > 0)

    def next_fuel(self, fuel: float, final_levels: range | None) -> float:
        """Smallest fuel, at least this, that a whole number of pulses can use, N s.

        Pulses of unequal thrusters have no such step: there it is the fuel itself. If every pulse changes the
        parity of the level, the number of pulses has the parity of the final level.

        Args:
            fuel: lower bound, N s.
            final_levels: levels with which a flight can end, see `final_levels`; None: any.
        """
        if self.pulse is None:
            return fuel
        count = round(rounded_up(fuel, self.pulse) / self.pulse)
        if self.pulses_flip_parity and final_levels is not None:
            parities = {m % 2 for m in final_levels}
            if len(parities) == 1:
                count += (count - final_levels[0]) % 2
        return count * self.pulse

    @cached_property
    def kinds(self) -> np.ndarray:
        """(kinds,) squared torques |t|^2 that patterns have, in squared quanta."""
        return np.unique(self.squared_torques)

    @cached_property
    def moves(self) -> np.ndarray:
        """(M, 3) possible moves in a period: from state, to state, kind of torque.

        States are the levels m = 0, 1, ..., `_MOST_LEVEL` and, last, all higher ones together.
        """
        results = []
        slow = range(_MOST_LEVEL + 1)
        for kind, p in enumerate(self.kinds.tolist()):
            # Between levels: the parity is that of m + p, and |m' - m - p| <= 2 |n| |t|.
            results += [
                (m, n, kind)
                for m in slow
                for n in slow
                if (n - m - p) % 2 == 0 and (n - m - p) ** 2 <= 4 * m * p
            ]
            # To and from higher levels, which is possible where |n| + |t| exceeds the highest.
            fastest = [
                m for m in slow if math.sqrt(m) + math.sqrt(p) > math.sqrt(_MOST_LEVEL) - 1e-9
            ]
            results += [(m, _MOST_LEVEL + 1, kind) for m in fastest] + [
                (_MOST_LEVEL + 1, m, kind) for m in fastest
            ]
            results.append((_MOST_LEVEL + 1, _MOST_LEVEL + 1, kind))
        return np.array(results)


class ReachRelaxation:
    """Dual problem of a flight from one start to one goal at rest in N periods, in floats.

    Args:
        lattice: spins of the craft.
        aims: what the goal asks, such as "position".
        start: of the flight.
        goal: of the flight, at rest.
        goal_set: tolerances of the goal.
        steps: N.
        fuel: cost of a newton second; 0 where only arrival in time matters.

    Raises:
        ConfigError: a number is not finite, the goal spins, no whole number of pulses ends at rest, or numba
            is missing.
    """

    def __init__(
        self,
        lattice: SpinLattice,
        aims: Collection[str],
        start: SpatialState,
        goal: SpatialState,
        goal_set: GoalSet,
        steps: int,
        fuel: float = 1.0,
    ) -> None:
        check_finite(start, goal)
        if not {"position", "attitude", "velocity"} <= set(aims):
            raise ConfigError("the on/off bound in space is for tasks that ask for a pose at rest.")
        if not lattice.can_end_at_rest(aims, start, goal, goal_set):
            raise ConfigError(
                "no whole number of pulses takes the start's spin to rest within the "
                "tolerance; the usual cause is a start or a goal that spins."
            )
        from rans_space_certificates import kernel  # compiles, with numba

        self._kernel: ModuleType = kernel
        self.lattice = lattice
        self.goal_set = goal_set
        self.steps = steps
        self.fuel = fuel
        self.final_levels = lattice.final_levels(aims, start, goal_set)
        self.time = steps * lattice.period
        self.velocity_change = np.array((goal.v - start.v).columns())
        self.displacement = np.array((goal.p - start.p - start.v.scale(self.time)).columns())
        self._forces = [lattice.force @ _matrix(x.attitude).T for x in (start, goal)]
        self._set_angles(float(np.linalg.norm(start.w.columns())))

    def _set_angles(self, spin: float) -> None:
        """Set the grid of the angle of rotation, and by how many of its cells every move rotates at most.

        Args:
            spin: magnitude of the start's spin, rad/s.
        """
        lattice = self.lattice
        h = self.lattice.period
        cell = h * lattice.spin / _CELLS_PER_QUANTUM * (1.0 + 1e-9)
        count = math.ceil(_MOST_ROTATION / cell) + 1
        angles = cell * np.arange(count)
        # Backwards from the goal, its tolerance counts as rotated already.
        self._angles = [angles, angles + self.goal_set.heading]
        speed = np.append(spin + lattice.spin * np.sqrt(np.arange(_MOST_LEVEL + 1)), np.inf)
        rotation = 0.5 * h * (speed[lattice.moves[:, 0]] + speed[lattice.moves[:, 1]]) / cell
        self._rotation_cells = np.ceil(np.minimum(rotation, count)).astype(np.int64)

    def bound(self, velocity: np.ndarray, position: np.ndarray) -> float:
        """Lower bound of the cost of all on/off flights that arrive, by any multipliers of the end conditions.

        Args:
            velocity: (3,) multiplier of the final velocity.
            position: (3,) multiplier of the final position.

        Raises:
            NonFiniteState: numbers are too large, so that infinity might mean an overflow.
        """
        lattice = self.lattice
        mass = self.lattice.craft.mass
        time_left = lattice.period * np.arange(self.steps, -1, -1)
        half = self.steps // 2
        with np.errstate(over="ignore", invalid="ignore"):  # refused below
            # Costates of velocity at the periods' ends; what the end conditions require, less their tolerances.
            pulls = velocity + time_left[:, None] * position
            required = mass * float(velocity @ self.velocity_change + position @ self.displacement)
            allowance = mass * float(
                self.goal_set.velocity * np.linalg.norm(velocity)
                + self.goal_set.position * np.linalg.norm(position)
            )
            pull = float(np.linalg.norm(pulls, axis=1).max())
            largest_costs = self.time * float(lattice.thrust.max()) * (self.fuel + pull)
            margin = _ROUNDING * (largest_costs + abs(required) + allowance)
        if not margin < _OVERFLOW_MARGIN:
            raise NonFiniteState(
                "a bound of fuel or time would overflow; the usual cause is a start, goal "
                "or spacecraft with far too large numbers."
            )
        # Least cost of both halves that meet in the same state.
        before = self._half(pulls[: half + 1], 0)
        after = self._half(pulls[half:][::-1], 1)
        return required - allowance + float((before + after).min()) - margin

    def _half(self, pulls: np.ndarray, end: int) -> np.ndarray:
        """Least cost (states,) of one half of the flight, by the state at its inner end.

        Time runs backwards from the goal, which is allowed since moves are symmetric.

        Args:
            pulls: (N/2 + 1, 3) costates of velocity, from the outer end on.
            end: 0 for the half from the start, 1 for that to the goal.
        """
        lattice = self.lattice
        angles = self._angles[end]
        # No attitude is farther than half a turn.
        cosine = np.where(angles < math.pi, np.cos(angles), -2.0)
        kinds = np.searchsorted(lattice.kinds, lattice.squared_torques)
        costs = self._kernel.period_costs(
            np.ascontiguousarray(pulls),
            self._forces[end],
            lattice.thrust,
            kinds,
            len(lattice.kinds),
            cosine,
            np.sin(angles),
            self.fuel,
            lattice.period,
        )
        first = [0] if end == 0 else self._last_states()
        return np.min(
            [
                self._kernel.least_costs(
                    costs, lattice.moves, self._rotation_cells, _MOST_LEVEL + 2, state
                )
                for state in first
            ],
            axis=0,
        )

    def _last_states(self) -> list[int]:
        """States in which a flight may end."""
        if self.final_levels is None:
            return list(range(_MOST_LEVEL + 2))
        slow = [m for m in self.final_levels if m <= _MOST_LEVEL]
        return slow + ([_MOST_LEVEL + 1] if self.final_levels[-1] > _MOST_LEVEL else [])


def _moment(craft: Spacecraft) -> float:
    """Moment of inertia about every axis of a craft that has a lattice of spins, kg m^2; else ConfigError."""
    check_certifiable(craft)
    if craft.dimension != 3 or craft.thrust_sharing != "none" or craft.actuators != ON_OFF:
        raise ConfigError(
            f"spacecraft {craft.name!r}: the on/off bound in space is for thrusters that are "
            "on or off for whole periods and share no supply."
        )
    tensor = inertia(craft)
    moment = float(np.trace(tensor)) / 3.0
    if np.abs(tensor - moment * np.eye(3)).max() > _RELATIVE_TOLERANCE * moment:
        raise ConfigError(
            f"spacecraft {craft.name!r}: the on/off bound in space needs equal principal "
            "moments of inertia; with others gyroscopic torques take the spin off its lattice."
        )
    return moment


def _quantum(craft: Spacecraft, torques: np.ndarray) -> tuple[float, np.ndarray]:
    """Quantum of torque, N m, and inner products (thrusters, thrusters) of torques in squared quanta.

    The quantum is the largest torque whose square divides all these products.
    """
    gram = torques @ torques.T
    largest = float(gram.max())
    levers = [t.force * math.dist(t.position, craft.centre_of_mass) for t in craft.thrusters]
    turning = np.abs(
        gram[np.abs(gram) > _RELATIVE_TOLERANCE * max(largest, *(x * x for x in levers))]
    )
    for parts in range(1, _LARGEST_PRODUCT + 1) if len(turning) else ():
        unit = float(turning.min()) / parts
        products = np.round(gram / unit).astype(np.int64)
        if (
            np.abs(gram - products * unit).max() <= _RELATIVE_TOLERANCE * largest
            and products.max() <= _LARGEST_PRODUCT
        ):
            return math.sqrt(unit), products
    raise ConfigError(
        f"spacecraft {craft.name!r}: the on/off bound in space needs torques whose inner "
        f"products are whole multiples, at most {_LARGEST_PRODUCT}, of one number; the usual "
        "cause is a centre of mass off the thrusters' centre."
    )


def _patterns(
    craft: Spacecraft, wrenches: np.ndarray, quantum: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Forces (P, 3), squared torques (P,) in squared quanta and thrust (P,) of patterns of open thrusters.

    Of patterns with equal force and squared torque only the cheapest is listed.
    """
    forces = np.array([t.force for t in craft.thrusters])
    tiny = 1e-12 * np.repeat([forces.max(), quantum], 3)
    # Add thruster by thruster, and drop patterns whose wrench another has for less thrust.
    sums = np.zeros((1, 6))
    thrust = np.zeros(1)
    for wrench, force in zip(wrenches, forces, strict=True):
        sums = np.vstack([sums, sums + wrench])
        thrust = np.append(thrust, thrust + force)
        order = np.argsort(thrust, kind="stable")
        _, first = np.unique(np.round(sums[order] / tiny / 1e3), axis=0, return_index=True)
        sums = sums[order[first]]
        thrust = thrust[order[first]]
        if len(sums) > _MOST_PATTERNS:
            raise ConfigError(
                f"spacecraft {craft.name!r}: its thrusters have more than {_MOST_PATTERNS} "
                "different on/off patterns, too many to search."
            )
    # Of a torque only its square matters.
    squared_torques = np.round(np.sum(sums[:, 3:] ** 2, axis=1) / quantum**2).astype(np.int64)
    order = np.argsort(thrust, kind="stable")
    _, first = np.unique(
        np.column_stack([np.round(sums[order, :3] / tiny[:3] / 1e3), squared_torques[order]]),
        axis=0,
        return_index=True,
    )
    cheapest = order[first]
    return sums[cheapest, :3], squared_torques[cheapest], thrust[cheapest]


def _matrix(attitude: Quat) -> np.ndarray:
    """Rotation matrix (3, 3) of a quaternion of floats, which is normalised first."""
    unit = attitude.normalised()
    return np.array([unit.rotate(Vec3(*axis)).columns() for axis in np.eye(3).tolist()]).T
