"""Conditions that can be flown but are hardly meant: percent, degrees, mm or ms, and pushes that no craft holds."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from operator import attrgetter

import numpy as np

from rans.base.errors import RansWarning
from rans.model.spacecraft import Spacecraft
from rans.randomization.conditions import Conditions, largest

_EDGES: tuple[tuple[str, float, str, str], ...] = (
    ("body.mass", 5.0, "times the designed one", "a factor in percent, or a mass in kg"),
    (
        "body.inertia",
        20.0,
        "times the designed one",
        "a factor in percent, or an inertia in kg m^2",
    ),
    ("body.centre", 1.0, "m", "a distance in mm or cm"),
    ("thrusters.thrust", 10.0, "times the designed one", "a factor in percent, or a force in N"),
    (
        "thrusters.pressure",
        10.0,
        "times the designed one",
        "a factor in percent, or a pressure in bar",
    ),
    ("thrusters.latency", 5.0, "s", "a time in ms"),
    ("thrusters.command_delay", 5.0, "s", "a time in ms"),
    ("thrusters.rise", 5.0, "s", "a time in ms"),
    ("thrusters.least_on", 10.0, "s", "a time in ms"),
    ("thrusters.noise", 0.5, "of the force", "a share in percent, or a force in N"),
    ("thrusters.misalignment", 0.35, "rad (20 degrees)", "an angle in degrees"),
    ("sensors.position.noise", 1.0, "m", "a distance in mm or cm"),
    ("sensors.position.bias", 2.0, "m", "a distance in mm or cm"),
    ("sensors.attitude.noise", 0.35, "rad (20 degrees)", "an angle in degrees"),
    ("sensors.attitude.bias", 1.0, "rad (57 degrees)", "an angle in degrees"),
    ("sensors.velocity.noise", 1.0, "m/s", "a velocity in mm/s or cm/s"),
    ("sensors.velocity.bias", 1.0, "m/s", "a velocity in mm/s or cm/s"),
    ("sensors.spin.noise", 1.0, "rad/s (57 degrees/s)", "a rate in degrees/s"),
    ("sensors.spin.bias", 1.0, "rad/s (57 degrees/s)", "a rate in degrees/s"),
    ("sensors.delay", 25.0, "control periods", "a time in ms"),
)
"""Setting, size beyond which it is hardly meant, unit, and the usual cause. All conditions that come with RANS, all
sizes of `rans stress` and the specifications of real valves, scales, and motion capture lie below."""
_FASTEST_KICK = 5.0
"""Change of velocity by one impulse beyond which it is hardly meant, m/s."""


def implausible(conditions: Conditions, craft: Spacecraft) -> list[str]:
    """Implausible values of conditions for a spacecraft, each as a sentence.

    >>> rans.randomization.plausible.implausible(rans.Conditions(), rans.load_spacecraft("free-flyer"))
    []
    """
    every = (conditions, *conditions.others)
    result = []
    for path, edge, unit, cause in _EDGES:
        size = max(largest(attrgetter(path)(part) or 0.0) for part in every)
        if size > edge:
            result.append(
                f"conditions have {path} up to {size:g} {unit}; above {edge:g} the usual cause is {cause}"
            )
    result.extend(_pushes(every, craft))
    return result


def _pushes(every: Sequence[Conditions], craft: Spacecraft) -> Iterator[str]:
    """Sentences of disturbances (N, N m) stronger than all effectors together, and of kicks that no craft takes."""
    wrenches = craft.wrenches
    force = float(np.linalg.norm(wrenches[:, : craft.dimension], axis=1).sum())
    torque = float(np.linalg.norm(wrenches[:, craft.dimension :], axis=1).sum())
    torque += sum(wheel.max_torque for wheel in craft.wheels)
    torque += sum(effector.largest_torque for effector in craft.further_effectors)
    pushes = [part.disturbances for part in every]
    for names, unit, limit, cause in (
        (("force", "slow_force"), "N", force, "a force in mN"),
        (("torque",), "N m", torque, "a torque in N mm, or a craft that cannot turn"),
    ):
        size = max(sum(largest(getattr(push, name)) for name in names) for push in pushes)
        if size > limit:
            yield (
                f"conditions have a disturbance {names[0]} up to {size:g} {unit}, and all effectors of "
                f"{craft.name!r} together give {limit:.3g}: no controller holds it; the usual cause is {cause}"
            )
    kick = max(largest(push.kick) for push in pushes)
    if kick > _FASTEST_KICK * craft.mass:
        yield (
            f"conditions have disturbances.kick up to {kick:g} N s, which moves {craft.name!r} at "
            f"{kick / craft.mass:.3g} m/s; the usual cause is an impulse in mN s"
        )


def warn_of_implausible(conditions: Conditions, craft: Spacecraft) -> None:
    """Warn of each of the `implausible`."""
    for doubt in implausible(conditions, craft):
        warnings.warn(f"{doubt}.", RansWarning, stacklevel=3)
