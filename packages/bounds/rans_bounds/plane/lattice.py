"""The lattice on which heading and spin live when thrusters are on or off for whole control periods.

With constant inertia one pulse of a thruster changes the spin by a whole multiple of one quantum,
however the spacecraft moves. Spin and heading at the start of period k are then

    w_k = w_0 + q n_k,   heading_k = heading_0 + w_0 k h + q h (a_k + n_k / 2),

with whole numbers n_k, a_k that obey n_{k+1} = n_k + t_k and a_{k+1} = a_k + n_k, where t_k is the net
torque of the period in quanta. docs/bounds/certificate.md derives this and what follows from it.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rans.extend import (
    ON_OFF,
    ConfigError,
    PlanarState,
    Spacecraft,
    check_certifiable,
    check_period,
    rounded_up,
)
from rans_bounds.goal_set import GoalSet, pulse
from rans_bounds.problem import check_finite

_LARGEST_MULTIPLE = 64
"""Torque of a thruster in quanta, at most: finer lattices have too many points to enumerate."""
_ROUNDING = 1e-12
"""Difference of torques from whole multiples that is allowed, relative to the largest force times its distance from
the centre of mass: directions and positions have finitely many digits. It costs heading, see `Lattice.drift`."""
_MOST_PATTERNS = 10_000
"""Sets of open thrusters at most: 8 thrusters have 256, of which 81 differ."""
_NODES = 24
"""Nodes of the Gauss-Legendre rule over a period: error below 1e-16 of the force up to 6 rad turned in it."""


@dataclass(frozen=True)
class Patterns:
    """Sets of open thrusters that differ in force or torque, the cheapest of each, sorted by torque."""

    torque: np.ndarray
    """(P,) whole numbers, quanta."""
    force: np.ndarray
    """(P,) complex, F_x + i F_y on B, N."""
    thrust: np.ndarray
    """(P,) sum of the open thrusters' forces, N: fuel is its integral over time."""
    commands: np.ndarray
    """(P, thrusters) zeros and ones."""


class Lattice:
    """Spins and headings that on/off thrust can reach, and the force that each pattern gives.

    The spacecraft is planar and shares no thrust; a command is held for the period, s. Dead thrusters are
    never open, those stuck open always: bounds then hold for faults from the start on.

    Raises:
        ConfigError: this spacecraft has no such lattice, or the period is not a positive number.
    """

    def __init__(
        self,
        craft: Spacecraft,
        period: float,
        dead: Collection[int] = (),
        stuck: Collection[int] = (),
    ) -> None:
        check_period(period)
        _check(craft)
        self.craft = craft
        self.period = period
        self.pulse = pulse(craft, period)
        self.forces = np.array([thruster.force for thruster in craft.thrusters])
        self.grain = float(self.forces.min()) * period
        """Fuel by which amounts of it are told apart: one pulse, or the weakest thruster's, N s."""
        torques = np.array([column[2] for column in craft.wrench_map])
        # The spin of a craft that nothing turns has one level; 1 rad/s is as good a quantum as any other.
        self.torque, self.multiples = _quantum(craft, torques) or (
            craft.inertia[2][2] / period,
            np.zeros(len(torques), dtype=np.int64),
        )
        self.spin = self.torque * period / craft.inertia[2][2]
        """q: change of spin by one quantum of torque held for one period, rad/s."""
        self.patterns = _patterns(craft, self.multiples, dead, stuck)
        error = np.abs(torques - self.torque * self.multiples).sum()
        self._angular_error = float(error) / craft.inertia[2][2]

    def net_spins(self, goal_set: GoalSet, start: PlanarState, goal: PlanarState) -> set[int]:
        """Changes of spin, in quanta, that end within the goal set's tolerance of the goal's spin.

        Raises:
            ConfigError: there is none, or start or goal are not finite.
        """
        check_finite(start, goal)
        exact = (goal.w - start.w) / self.spin
        reach = goal_set.spin / self.spin + 1e-9
        result = set(range(math.ceil(exact - reach), math.floor(exact + reach) + 1))
        if not result:
            nearest = abs(round(exact) - exact) * self.spin
            raise ConfigError(
                f"no whole number of pulses takes the spin from {start.w:.6g} to {goal.w:.6g} rad/s: "
                f"the nearest misses by {nearest:.3g} rad/s, so the goal set's spin tolerance, "
                f"{goal_set.spin:.3g} rad/s, must be at least that; the usual cause is a start that spins."
            )
        return result

    def drift(self, steps: int) -> float:
        """Heading by which torques that are not exact multiples may leave the lattice, rad."""
        return 0.5 * self._angular_error * (steps * self.period) ** 2

    def most_fuel(self, steps: int) -> float:
        """Fuel of all thrusters open all the time, and its rounding error, N s."""
        return steps * self.period * float(sum(self.forces)) * (1.0 + 1e-12)

    def next_fuel(self, fuel: float, net: set[int]) -> float:
        """Least fuel that pulses can add up to and that is not below this, N s.

        It is this where thrusters differ in strength. Net changes of spin are in quanta.
        """
        if self.pulse is None:
            return fuel
        count = round(rounded_up(fuel, self.pulse) / self.pulse)
        if (self.multiples % 2 == 1).all() and len({n % 2 for n in net}) == 1:
            count += (count - next(iter(net))) % 2  # as even or odd as the change of spin in quanta
        return count * self.pulse

    def fuel_above(self, fuel: float, net: set[int]) -> float:
        """Greatest lower bound of the fuels that pulses can add up to and that exceed this, N s."""
        return fuel if self.pulse is None else self.next_fuel(fuel + 0.5 * self.pulse, net)

    @cached_property
    def quanta_per_fuel(self) -> float:
        """Most torque that a newton second of fuel buys, in quanta: bounds the spin, 1/(N s)."""
        return float((np.abs(self.multiples) / self.forces).max()) / self.period

    def responses(self, spins: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Integrals of exp(i (w s + t q s^2 / (2 h))) and of s times that, over one period.

        Of spins (W,) at its start, rad/s: two complex arrays (W, torques), s and s^2, for the `torque_range`.
        """
        nodes, weights = np.polynomial.legendre.leggauss(_NODES)
        s = 0.5 * self.period * (nodes + 1.0)
        weights = 0.5 * self.period * weights
        rate = self.spin / self.period * self.torque_range
        angle = spins[:, None, None] * s + 0.5 * rate[:, None] * s * s
        rotated = np.exp(1j * angle) * weights
        return rotated.sum(axis=2), (rotated * s).sum(axis=2)

    @cached_property
    def torque_range(self) -> np.ndarray:
        """(torques,) every net torque of a pattern, in quanta, rising by one."""
        torque = self.patterns.torque
        return np.arange(torque.min(), torque.max() + 1)


def _check(craft: Spacecraft) -> None:
    """Reject (`ConfigError`) craft whose motion has no lattice: space, shared thrust, other valves than on/off."""
    if craft.dimension != 2:
        raise ConfigError(
            f"spacecraft {craft.name!r}: the on/off certificate exists for planar motion only, "
            "because attitudes in space do not lie on a lattice."
        )
    if craft.thrust_sharing != "none":
        raise ConfigError(
            f"spacecraft {craft.name!r}: the on/off certificate does not cover "
            f'thrust_sharing = "{craft.thrust_sharing}", where a pulse\'s torque '
            "depends on how many thrusters are open."
        )
    check_certifiable(craft)
    if craft.actuators != ON_OFF:
        raise ConfigError(
            f"spacecraft {craft.name!r}: the on/off certificate does not cover its "
            f"{craft.actuators.kind} actuators, which can do more than open for whole periods."
        )


def _quantum(craft: Spacecraft, torques: np.ndarray) -> tuple[float, np.ndarray] | None:
    """The largest torque of which all thrusters' are whole multiples, N m, and the multiples; None: none turns it.

    Thrusters through the centre of mass leave torques of rounding only, which are no quanta.
    """
    levers = (t.force * math.dist(t.position, craft.centre_of_mass) for t in craft.thrusters)
    rounding = _ROUNDING * max(*levers, float(np.abs(torques).max()))
    turning = np.abs(torques[np.abs(torques) > rounding])
    if not len(turning):
        return None
    for parts in range(1, _LARGEST_MULTIPLE + 1):
        quantum = float(turning.min()) / parts
        multiples = np.round(torques / quantum)
        exact = np.abs(torques - multiples * quantum).max() <= rounding
        if exact and np.abs(multiples).max() <= _LARGEST_MULTIPLE:
            return quantum, multiples.astype(np.int64)
    raise ConfigError(
        f"spacecraft {craft.name!r}: the on/off certificate needs thrusters whose torques are "
        f"whole multiples, at most {_LARGEST_MULTIPLE}, of one quantum, got "
        f"{', '.join(f'{torque:.4g}' for torque in torques)} N m; the usual cause is a centre "
        "of mass off the thrusters' centre."
    )


def _patterns(
    craft: Spacecraft, multiples: np.ndarray, dead: Collection[int], stuck: Collection[int]
) -> Patterns:
    """All sums of thrusters, one after the other, of equal ones the cheapest.

    They are in the order of their torque: kernels look up those of a torque by the first of them.
    """
    # Equal forces may differ by rounding of sums.
    tiny = 1e-12 * max(thruster.force for thruster in craft.thrusters)
    count = craft.thruster_count
    result = {(0, 0, 0): (0, 0j, 0.0, (0.0,) * count)}
    for index, (thruster, (x, y, _)) in enumerate(
        zip(craft.thrusters, craft.wrench_map, strict=True)
    ):
        # With this thruster shut, unless it is stuck open; and with it open, unless it is dead.
        shut = [] if index in dead else list(result.values())
        if index in stuck:
            result = {}
        for torque, force, thrust, open_ in shut:
            torque = torque + int(multiples[index])
            force = force + complex(x, y)
            thrust = thrust + thruster.force
            key = (torque, round(force.real / tiny), round(force.imag / tiny))
            if key not in result or thrust < result[key][2] - tiny:
                result[key] = (torque, force, thrust, (*open_[:index], 1.0, *open_[index + 1 :]))
        if len(result) > _MOST_PATTERNS:
            raise ConfigError(
                f"spacecraft {craft.name!r}: its {count} thrusters have more than "
                f"{_MOST_PATTERNS} different on/off patterns, too many to search."
            )
    ordered = sorted(result.values(), key=lambda pattern: (pattern[0], pattern[2]))
    torque, force, thrust, commands = zip(*ordered, strict=True)
    return Patterns(np.array(torque), np.array(force), np.array(thrust), np.array(commands))
