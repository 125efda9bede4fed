"""Disturbances, faults and sensor errors by size, each alone and the same in every episode."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from math import radians
from typing import Any

import numpy as np

from rans import Conditions, FaultConditions, ThrusterConditions, load_conditions
from rans.base.structure import is_range
from rans.extend import ConfigError, Spacecraft, Timing, bounds, distinct
from rans.randomization.plausible import implausible


@dataclass(frozen=True)
class Level:
    """Conditions in which contestants fly: an effect of one size, or named conditions."""

    effect: str
    """Name of the effect, or of the conditions."""
    size: float | None
    """Size in the unit of the effect; None for named conditions."""
    conditions: Conditions

    @property
    def name(self) -> str:
        """Name of the level, which is unique and can be a file name."""
        if self.effect.endswith(".toml"):
            return distinct(self.effect).strip("-")
        words = re.sub(r"[^\w.]+", "-", self.effect).strip("-")
        return words if self.size is None else f"{words}-{self.size:g}"


@dataclass(frozen=True)
class Effect:
    """Disturbance, fault or error whose size can vary."""

    name: str
    unit: str
    """Unit of the sizes."""
    nominal: float
    """Size that has no effect."""
    sizes: tuple[float, ...]
    """Sizes that are flown, in ascending order of the effect."""
    make: Callable[[float], Conditions]
    """Function that makes the conditions of a size."""

    def levels(self) -> Iterator[Level]:
        """Yield one level for each size."""
        for size in self.sizes:
            yield Level(self.name, size, self.make(size))


_QUANTITIES = {
    "position": ("cm", 0.01),
    "attitude": ("degrees", radians(1.0)),
    "velocity": ("cm/s", 0.01),
    "spin": ("degrees/s", radians(1.0)),
}
"""Units of noise that a datasheet has, by the quantity that is read, and what they are in SI units."""
_PERCENT = 0.01


def applicable_effects(craft: Spacecraft, timing: Timing) -> list[Effect]:
    """Every effect that applies to this spacecraft, with the sizes that it can have and hold.

    Sizes reach beyond the ranges of the conditions ``train-robust``. Disturbance forces and torques
    are fractions of those of the strongest thruster (without thrusters: wheel), and least on-times are whole
    control periods.
    """
    effects = [
        *(_of_valves(craft, timing.control_period) if craft.thrusters else ()),
        Effect("more mass", "times", 1.0, (1.25, 1.5, 2.0, 3.0), _only("body.mass")),
        Effect("less mass", "times", 1.0, (0.8, 0.65, 0.5, 0.35), _only("body.mass")),
        Effect("more inertia", "times", 1.0, (1.25, 1.5, 2.0, 3.0), _only("body.inertia")),
        Effect("less inertia", "times", 1.0, (0.8, 0.65, 0.5, 0.35), _only("body.inertia")),
        Effect("centre of mass", "cm", 0.0, (1.0, 2.0, 3.0, 5.0, 8.0), _only("body.centre", 0.01)),
        *_disturbances(craft),
        Effect("readings late by", "periods", 0.0, (1.0, 2.0, 3.0), _only("sensors.delay")),
    ]
    for quantity, (unit, factor) in _QUANTITIES.items():
        make = _only(f"sensors.{quantity}.noise", factor)
        effects.append(Effect(f"noise of {quantity}", unit, 0.0, (1.0, 2.0, 3.0, 5.0), make))
    missed = {quantity: f"sensors.{quantity}.dropout" for quantity in _QUANTITIES}
    for what, settings in (*missed.items(), ("all", " ".join(missed.values()))):
        make = _only(settings, _PERCENT)
        name = f"missed readings of {what}"
        effects.append(Effect(name, "%", 0.0, (3.0, 10.0, 30.0, 50.0), make))
    effects.append(
        Effect("outages every 5 s of", "s", 0.0, (0.4, 1.0, 2.0), _only("sensors.outage"))
    )
    lab = load_conditions("lab")
    times = (0.1, 0.2, 0.35, 0.5, 0.7, 1.0, 1.5)
    effects.append(Effect("all of lab", "times", 0.0, times, lambda size: _scaled(lab, size)))
    possible = []
    for effect in effects:
        sizes = tuple(x for x in effect.sizes if _is_possible(effect.make(x), craft))
        if sizes:
            possible.append(replace(effect, sizes=sizes))
    return possible


def _is_possible(conditions: Conditions, craft: Spacecraft) -> bool:
    """Whether a spacecraft can have the conditions, and some controller could hold them."""
    try:
        conditions.check_craft(craft)
    except ConfigError:
        return False
    return not implausible(conditions, craft)


def _only(settings: str, unit: float = 1.0) -> Callable[[float], Conditions]:
    """Conditions of a size: settings, by dotted names, are the size times its unit, and the rest is nominal."""

    def changed(part: Any, names: list[str], value: float) -> Any:
        first, *rest = names
        inner = changed(getattr(part, first), rest, value) if rest else value
        return replace(part, **{first: inner})

    def conditions(size: float) -> Conditions:
        result = Conditions()
        for name in settings.split():
            result = changed(result, name.split("."), size * unit)
        return result

    return conditions


def _scaled(part: Any, size: float) -> Any:
    """Settings whose ranges are so many times as far from the nominal values; 1 leaves them as they are."""
    nominal = type(part)()
    changed = {}
    for setting in fields(part):
        value = getattr(part, setting.name)
        usual = getattr(nominal, setting.name)
        if is_dataclass(value):
            changed[setting.name] = _scaled(value, size)
        elif is_range(setting) and value != usual:
            origin, _ = bounds(usual)
            changed[setting.name] = tuple(origin + size * (x - origin) for x in bounds(value))
    return replace(part, **changed)


def _of_valves(craft: Spacecraft, period: float) -> Iterator[Effect]:
    """Effects on valves and thrusts: delays, least times and forces."""
    yield Effect("latency", "s", 0.0, (0.025, 0.05, 0.1, 0.2, 0.3), _only("thrusters.latency"))
    yield Effect("rise", "s", 0.0, (0.05, 0.1, 0.2, 0.4), _only("thrusters.rise"))
    # A throttle has no on-time.
    if not craft.actuators.is_continuous:
        periods = tuple(round(k * period, 6) for k in (2, 3, 4, 5))
        yield Effect("least on-time", "s", period, periods, _only("thrusters.least_on"))
    yield Effect("thrust of each off by", "%", 0.0, (10.0, 25.0, 50.0, 75.0), _uneven)
    yield Effect("one thruster weaker by", "%", 0.0, (25.0, 50.0, 75.0, 100.0), _weak)


def _uneven(percent: float) -> Conditions:
    part = _PERCENT * percent
    return Conditions(thrusters=ThrusterConditions(thrust=(1.0 - part, 1.0 + part)))


def _weak(percent: float) -> Conditions:
    share = 1.0 - _PERCENT * percent
    return Conditions(faults=FaultConditions(count=1.0, kinds=("weak",), share=share))


def _disturbances(craft: Spacecraft) -> Iterator[Effect]:
    """Constant forces and torques, as parts of what the strongest effector gives."""
    wrenches = craft.wrenches
    size = craft.dimension
    force, torque = (
        float(np.linalg.norm(part, axis=1).max(initial=0.0))
        for part in (wrenches[:, :size], wrenches[:, size:])
    )
    if not craft.thrusters:
        torque = max((wheel.max_torque for wheel in craft.wheels), default=0.0)
    for name, unit, largest in (("force", "N", force), ("torque", "N m", torque)):
        sizes = tuple(
            float(f"{fraction * largest:.2g}")
            for fraction in (0.1, 0.2, 0.3, 0.5, 0.7)
            if largest > 0.0
        )
        yield Effect(name, unit, 0.0, sizes, _only(f"disturbances.{name}"))


def failure_levels(craft: Spacecraft) -> list[Level]:
    """Levels of failures, which have no size: one thruster, drawn at random, fails when the episode begins.

    A spacecraft without thrusters has none.
    """
    if not craft.thrusters:
        return []
    return [
        Level(
            f"one thruster {kind}",
            None,
            Conditions(faults=FaultConditions(count=1.0, kinds=(kind,))),
        )
        for kind in ("dead", "stuck-open")
    ]
