"""Bounds of on/off control in space, for craft that turn alike about every axis.

With equal principal moments nothing is gyroscopic: however such a craft moves, its spin in B is w_0 + q n,
with n a sum of the torques of open thrusters, in quanta. Squared lengths of n are whole numbers m, and a
period's torque takes m to m' = m + 2 n . t + |t|^2 only: as even or odd as m + |t|^2, and no farther from it
than 2 |n| |t|. What is relaxed is the attitude. It is anything that a craft with these m can have turned to
since the start, about any axis, and, in the second half, can still turn to the goal from. docs/certificate.md
proves it.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from functools import cached_property
from types import ModuleType

import numpy as np

from rans.errors import ConfigError, NonFiniteState
from rans.model.actuators import ON_OFF
from rans.model.dynamics import SpatialState
from rans.model.fields import Quat, Vec3
from rans.model.spacecraft import Spacecraft
from rans.optimal.certificate.goal_set import (
    GoalSet,
    check_certifiable,
    check_finite,
    check_period,
    pulse,
    rounded_up,
)
from rans.optimal.trajectory.allocation import inertia

_LARGEST_PRODUCT = 64
"""Largest product of two thrusters' torques, in squared quanta."""
_EXACT = 1e-12
"""Difference of such products from whole numbers that is allowed, relative to the largest."""
_MOST_PATTERNS = 100_000
_SLOW = 25
"""Squared spin, in quanta, up to which craft are followed; a faster one is taken to have any attitude."""
_CELLS = 8
"""Cells of angle that one quantum of spin turns in a period."""
_TURNED = 1.3
"""Angle turned from which on any attitude is taken for reached, rad."""
_ROUNDING = 1e-9
"""Relative to the sum of all costs' sizes; double precision loses 1e-12 of it in some hundred periods."""
_HUGE = 1e100
"""A margin from which on squares of costs might overflow, N s."""


class SpinLattice:
    """Spins that on/off thrust can reach in space, and the forces that go with each torque.

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
        self.force, self.square, self.thrust = _patterns(craft, wrenches, self.torque)

    @property
    def odd(self) -> bool:
        """Whether every pulse changes m from even to odd or back."""
        return bool((np.diag(self.products) % 2 == 1).all())

    def final(self, aims: Collection[str], start: SpatialState, goal_set: GoalSet) -> range | None:
        """Squared lengths of n that end at rest, and None where no rest is asked.

        |w_0 + q n| <= e needs q |n| to be within e of |w_0|.
        """
        if "spin" not in aims:
            return None
        first = float(np.linalg.norm(start.w.columns()))
        e = goal_set.spin + 1e-9
        least = max(0.0, first - e) / self.spin
        most = (first + e) / self.spin
        return range(math.ceil(least**2 - 1e-9), math.floor(most**2 + 1e-9) + 1)

    def ends(
        self, aims: Collection[str], start: SpatialState, goal: SpatialState, goal_set: GoalSet
    ) -> bool:
        """Whether pulses can take the start's spin to the goal's rest; False too for goals that spin."""
        last = self.final(aims, start, goal_set)
        return not any(goal.w.columns()) and (last is None or len(last) > 0)

    def next_fuel(self, fuel: float, last: range | None) -> float:
        """Least fuel that pulses can add up to and that is not below this, N s; where not equal, this.

        If every pulse changes the parity of m, their number is even or odd as the last m is.
        """
        if self.pulse is None:
            return fuel
        count = round(rounded_up(fuel, self.pulse) / self.pulse)
        if last is not None and self.settled(last):
            count += (count - last[0]) % 2
        return count * self.pulse

    def settled(self, last: range | None) -> bool:
        """Whether these squared lengths at the end settle if the number of pulses is even or odd."""
        return self.odd and last is not None and len({m % 2 for m in last}) == 1

    @cached_property
    def kinds(self) -> np.ndarray:
        """(kinds,) squared torques that patterns have, in squared quanta."""
        return np.unique(self.square)

    @cached_property
    def moves(self) -> np.ndarray:
        """(M, 3) from state, to state, kind: states are m = 0, 1 .. and, last, all that are faster."""
        results = []
        slow = range(_SLOW + 1)
        for kind, p in enumerate(self.kinds.tolist()):
            results += [
                (m, n, kind)
                for m in slow
                for n in slow
                if (n - m - p) % 2 == 0 and (n - m - p) ** 2 <= 4 * m * p
            ]
            near = [m for m in slow if math.sqrt(m) + math.sqrt(p) > math.sqrt(_SLOW) - 1e-9]
            results += [(m, _SLOW + 1, kind) for m in near] + [(_SLOW + 1, m, kind) for m in near]
            results.append((_SLOW + 1, _SLOW + 1, kind))
        return np.array(results)


class ReachRelaxation:
    """The dual problem from one start to one goal at rest, of floats, in N periods.

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
        if not lattice.ends(aims, start, goal, goal_set):
            raise ConfigError(
                "no whole number of pulses takes the start's spin to rest within the "
                "tolerance; the usual cause is a start or a goal that spins."
            )
        from rans.optimal.certificate.space import kernel  # compiles, with numba

        self._kernel: ModuleType = kernel
        self.lattice = lattice
        self.goal_set = goal_set
        self.steps = steps
        self.fuel = fuel
        self.last = lattice.final(aims, start, goal_set)
        self.time = steps * lattice.period
        self.gain = np.array((goal.v - start.v).columns())
        self.way = np.array((goal.p - start.p - start.v.scale(self.time)).columns())
        self._forces = [lattice.force @ _matrix(x.attitude).T for x in (start, goal)]
        self._cells(float(np.linalg.norm(start.w.columns())))

    def _cells(self, spin: float) -> None:
        """Angles, and how many cells of them every move turns at most."""
        lattice = self.lattice
        h = self.lattice.period
        cell = h * lattice.spin / _CELLS * (1.0 + 1e-9)
        count = math.ceil(_TURNED / cell) + 1
        angles = cell * np.arange(count)
        # the goal's tolerance is turned already, seen from the end
        self._angles = [angles, angles + self.goal_set.heading]
        speed = np.append(spin + lattice.spin * np.sqrt(np.arange(_SLOW + 1)), np.inf)
        turned = 0.5 * h * (speed[lattice.moves[:, 0]] + speed[lattice.moves[:, 1]]) / cell
        self._turned = np.ceil(np.minimum(turned, count)).astype(np.int64)

    def bound(self, velocity: np.ndarray, position: np.ndarray) -> float:
        """Cost of every on/off controller that arrives at least, by any multipliers (3,) of v and p.

        Raises:
            NonFiniteState: numbers are too large, so that infinity might mean an overflow.
        """
        lattice = self.lattice
        mass = self.lattice.craft.mass
        left = lattice.period * np.arange(self.steps, -1, -1)
        half = self.steps // 2
        with np.errstate(over="ignore", invalid="ignore"):  # what that leaves is refused below
            pulls = velocity + left[:, None] * position
            wanted = mass * float(velocity @ self.gain + position @ self.way)
            spared = mass * float(
                self.goal_set.velocity * np.linalg.norm(velocity)
                + self.goal_set.position * np.linalg.norm(position)
            )
            pull = float(np.linalg.norm(pulls, axis=1).max())
            most = self.time * float(lattice.thrust.max()) * (self.fuel + pull)
            margin = _ROUNDING * (most + abs(wanted) + spared)
        if not margin < _HUGE:
            raise NonFiniteState(
                "a bound of fuel or time would overflow; the usual cause is a start, goal "
                "or spacecraft with far too large numbers."
            )
        before = self._half(pulls[: half + 1], 0)
        after = self._half(pulls[half:][::-1], 1)
        return wanted - spared + float((before + after).min()) - margin

    def _half(self, pulls: np.ndarray, end: int) -> np.ndarray:
        """(states,) least cost of one half by the state at its inner end; 0: from the start, 1: to the goal.

        Time runs backwards from the goal: moves may be taken either way.
        """
        lattice = self.lattice
        angles = self._angles[end]
        cosine = np.where(
            angles < math.pi, np.cos(angles), -2.0
        )  # no angle is farther than half a turn
        kinds = np.searchsorted(lattice.kinds, lattice.square)
        costs = self._kernel.stages(
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
                self._kernel.sweep(costs, lattice.moves, self._turned, _SLOW + 2, state)
                for state in first
            ],
            axis=0,
        )

    def _last_states(self) -> list[int]:
        if self.last is None:
            return list(range(_SLOW + 2))
        slow = [m for m in self.last if m <= _SLOW]
        return slow + ([_SLOW + 1] if self.last[-1] > _SLOW else [])


def _moment(craft: Spacecraft) -> float:
    """The one moment of inertia of a craft that has a lattice of spins, kg m^2."""
    check_certifiable(craft)
    if craft.dimension != 3 or craft.thrust_sharing != "none" or craft.actuators != ON_OFF:
        raise ConfigError(
            f"spacecraft {craft.name!r}: the on/off bound in space is for thrusters that are "
            "on or off for whole periods and share no supply."
        )
    tensor = inertia(craft)
    moment = float(np.trace(tensor)) / 3.0
    if np.abs(tensor - moment * np.eye(3)).max() > _EXACT * moment:
        raise ConfigError(
            f"spacecraft {craft.name!r}: the on/off bound in space needs equal principal "
            "moments of inertia; with others gyroscopic torques take the spin off its lattice."
        )
    return moment


def _quantum(craft: Spacecraft, torques: np.ndarray) -> tuple[float, np.ndarray]:
    """The largest torque whose square divides all inner products of torques, N m, and these quotients."""
    gram = torques @ torques.T
    largest = float(gram.max())
    levers = [t.force * math.dist(t.position, craft.centre_of_mass) for t in craft.thrusters]
    turning = np.abs(gram[np.abs(gram) > _EXACT * max(largest, *(x * x for x in levers))])
    for parts in range(1, _LARGEST_PRODUCT + 1) if len(turning) else ():
        unit = float(turning.min()) / parts
        products = np.round(gram / unit).astype(np.int64)
        if (
            np.abs(gram - products * unit).max() <= _EXACT * largest
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
    """Forces (P, 3), squared torques (P,) in squared quanta and thrust (P,), of equal ones the cheapest."""
    forces = np.array([t.force for t in craft.thrusters])
    tiny = 1e-12 * np.repeat([forces.max(), quantum], 3)
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
    square = np.round(np.sum(sums[:, 3:] ** 2, axis=1) / quantum**2).astype(np.int64)
    order = np.argsort(thrust, kind="stable")
    _, first = np.unique(
        np.column_stack([np.round(sums[order, :3] / tiny[:3] / 1e3), square[order]]),
        axis=0,
        return_index=True,
    )
    kept = order[first]
    return sums[kept, :3], square[kept], thrust[kept]


def _matrix(attitude: Quat) -> np.ndarray:
    """R of a quaternion of floats, normalised."""
    unit = attitude.normalised()
    return np.array([unit.rotate(Vec3(*axis)).columns() for axis in np.eye(3).tolist()]).T
