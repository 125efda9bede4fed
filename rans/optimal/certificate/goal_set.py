"""Goal sets of certified bounds, and what every bound checks of its numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rans.errors import ConfigError, is_finite
from rans.model.actuators import ON_OFF
from rans.model.dynamics import PlanarState, State
from rans.model.fields import leaves, wrap
from rans.model.spacecraft import Spacecraft, check_rigid


@dataclass(frozen=True)
class GoalSet:
    """Goal set: balls around the goal in which a controller must be at the end.

    Raises:
        ConfigError: a tolerance is negative or not finite.
    """

    position: float = 0.05
    """m."""
    velocity: float = 0.05
    """m/s."""
    heading: float = math.radians(5.0)
    """rad."""
    spin: float = 1e-9
    """rad/s; a start that spins may need more, see `rans.optimal.certificate.plane.lattice.Lattice.net_spins`."""

    def __post_init__(self) -> None:
        for key in ("position", "velocity", "heading", "spin"):
            value = getattr(self, key)
            if not (math.isfinite(value) and value >= 0):
                raise ConfigError(
                    f"goal set: {key} must be finite and not negative, got {value!r}."
                )

    def contains(self, state: PlanarState, goal: PlanarState) -> bool:
        """Whether a planar state of floats is in the set."""
        return bool(
            (goal.p - state.p).norm() <= self.position
            and (goal.v - state.v).norm() <= self.velocity
            and abs(wrap(state.attitude.angle - goal.attitude.angle)) <= self.heading
            and abs(state.w - goal.w) <= self.spin + 1e-9
        )


def check_finite(start: State, goal: State) -> None:
    """Refuse (`ConfigError`) states with NaN or infinity: nothing compares with them, so all seems proven."""
    for name, state in (("start", start), ("goal", goal)):
        if not np.isfinite(leaves(state)).all():
            raise ConfigError(f"a bound needs a finite {name}, got {state}; did a flight diverge?")


def check_period(period: float) -> None:
    """Refuse (`ConfigError`) a time for which no command can be held."""
    if not (is_finite(period) and period > 0):
        raise ConfigError(f"a bound needs a finite control period > 0 s, got {period!r}.")


def pulse(craft: Spacecraft, period: float) -> float | None:
    """Unit of impulse in on/off periods, shared or not, N s; None where there is none.

    Thrusters differ in strength there, or may be open for a part of a period.
    """
    forces = np.array([thruster.force for thruster in craft.thrusters])
    equal = craft.actuators == ON_OFF and np.ptp(forces) <= 1e-12 * forces.max()
    return float(forces[0]) * period if equal else None


def rounded_up(value: float, unit: float) -> float:
    """The least whole multiple of a unit that is not below a value by more than rounding."""
    return max(0, math.ceil(value / unit * (1.0 - 1e-12))) * unit if math.isfinite(value) else value


def check_certifiable(craft: Spacecraft, wheels: bool = False) -> None:
    """Refuse a craft that a bound does not cover.

    Args:
        craft: spacecraft.
        wheels: whether the bound covers reaction wheels.

    Raises:
        ConfigError: it has no thrusters, effectors of other kinds or reaction wheels, or uses propellant.
    """
    if not craft.thrusters:
        raise ConfigError(
            f"spacecraft {craft.name!r}: certified bounds are those of thrusters, and it has none."
        )
    if craft.acting_effectors:
        raise ConfigError(
            f"spacecraft {craft.name!r}: certified bounds are those of thrusters, and it has effectors of other "
            "kinds."
        )
    check_rigid(craft, "certified bounds")
    if craft.propellant is not None or (craft.wheels and not wheels):
        covered = "thrusters, wheels" if wheels else "thrusters"
        raise ConfigError(
            f"spacecraft {craft.name!r}: certified bounds are those of {covered} and a constant mass; it has "
            f"{'reaction wheels' if craft.wheels and not wheels else 'propellant'}."
        )
