"""Goal sets of certified bounds, and the unit of their impulses."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rans.extend import ON_OFF, ConfigError, PlanarState, Spacecraft, wrap


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
    """rad/s; a start that spins may need more, see `rans_bounds.plane.lattice.Lattice.net_spins`."""

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


def pulse(craft: Spacecraft, period: float) -> float | None:
    """Unit of impulse in on/off periods, shared or not, N s; None where there is none.

    Thrusters differ in strength there, or may be open for a part of a period.
    """
    forces = np.array([thruster.force for thruster in craft.thrusters])
    equal = craft.actuators == ON_OFF and np.ptp(forces) <= 1e-12 * forces.max()
    return float(forces[0]) * period if equal else None
