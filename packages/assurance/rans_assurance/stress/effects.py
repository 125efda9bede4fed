"""Disturbances, faults and sensor errors by size, each alone and the same in every episode."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from math import radians
from typing import Any

import numpy as np

from rans.extend import Conditions, ConfigError, Spacecraft, Timing
from rans.files import distinct
from rans.randomization.conditions import (
    FaultConditions,
    SensorConditions,
    SensorsConditions,
    ThrusterConditions,
)


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


def applicable_effects(craft: Spacecraft, timing: Timing) -> list[Effect]:
    """Every effect that applies to this spacecraft, with the sizes that it can have.

    Sizes reach beyond the ranges of the conditions ``train-robust``. Disturbance forces and torques
    are fractions of those of the strongest thruster (without thrusters: wheel), and least on-times are whole
    control periods.
    """
    effects = [*_of_body(), *_disturbances(craft), *_readings()]
    if craft.thrusters:
        effects = [*_of_valves(craft, timing), *effects]
    for k, effect in enumerate(effects):
        sizes = tuple(size for size in effect.sizes if _is_possible(effect.make(size), craft))
        effects[k] = replace(effect, sizes=sizes)
    return effects


def _is_possible(conditions: Conditions, craft: Spacecraft) -> bool:
    """Whether a spacecraft can have the conditions."""
    try:
        conditions.check_craft(craft)
    except ConfigError:
        return False
    return True


def _only(part: str, name: str, unit: float = 1.0) -> Callable[[float], Conditions]:
    """Conditions of a size, in which one setting is the size times its unit and all else is nominal."""

    def conditions(size: float) -> Conditions:
        perfect = Conditions()
        return replace(perfect, **{part: replace(getattr(perfect, part), **{name: size * unit})})

    return conditions


def _of_valves(craft: Spacecraft, timing: Timing) -> Iterator[Effect]:
    """Effects on valves and thrusts: delays, least times and forces."""
    yield Effect("latency", "s", 0.0, (0.025, 0.05, 0.1, 0.2, 0.3), _only("thrusters", "latency"))
    yield Effect("rise", "s", 0.0, (0.05, 0.1, 0.2, 0.4), _only("thrusters", "rise"))
    # A throttle has no on-time.
    if not craft.actuators.is_continuous:
        period = timing.control_period
        periods = tuple(round(k * period, 6) for k in (2, 3, 4, 5))
        make = _only("thrusters", "least_on")
        yield Effect("least on-time", "s", period, periods, make)
    yield Effect("thrust of each off by", "%", 0.0, (10.0, 25.0, 50.0, 75.0), _uneven)
    yield Effect("one thruster weaker by", "%", 0.0, (25.0, 50.0, 75.0, 100.0), _weak)


def _uneven(percent: float) -> Conditions:
    return Conditions(
        thrusters=ThrusterConditions(thrust=(1.0 - percent / 100.0, 1.0 + percent / 100.0))
    )


def _weak(percent: float) -> Conditions:
    return Conditions(
        faults=FaultConditions(count=1.0, kinds=("weak",), share=1.0 - percent / 100.0)
    )


def _of_body() -> Iterator[Effect]:
    """Effects on mass and inertia (factors) and on the centre of mass (cm), from the nominal size upwards."""
    for quantity in ("mass", "inertia"):
        make = _only("body", quantity)
        yield Effect(f"more {quantity}", "times", 1.0, (1.25, 1.5, 2.0, 3.0), make)
        yield Effect(f"less {quantity}", "times", 1.0, (0.8, 0.65, 0.5, 0.35), make)
    centre = _only("body", "centre", 0.01)
    yield Effect("centre of mass", "cm", 0.0, (1.0, 2.0, 3.0, 5.0, 8.0), centre)


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
        yield Effect(name, unit, 0.0, sizes, _only("disturbances", name))


def _readings() -> Iterator[Effect]:
    """Effects on the readings: delay, noise, missed readings and outages."""
    late = _only("sensors", "delay")
    yield Effect("readings late by", "periods", 0.0, (1.0, 2.0, 3.0), late)
    # Noise of each quantity, in units that a datasheet has.
    for quantity, unit, factor in (
        ("position", "cm", 0.01),
        ("attitude", "degrees", radians(1.0)),
        ("velocity", "cm/s", 0.01),
        ("spin", "degrees/s", radians(1.0)),
    ):
        noisy = partial(_noisy, quantity, factor)
        yield Effect(f"noise of {quantity}", unit, 0.0, (1.0, 2.0, 3.0, 5.0), noisy)
    for quantity in ("position", "attitude", "velocity", "spin", "all"):
        missed = partial(_missed, quantity)
        name = f"missed readings of {quantity}"
        yield Effect(name, "%", 0.0, (3.0, 10.0, 30.0, 50.0), missed)
    outage = _only("sensors", "outage")
    yield Effect("outages every 5 s of", "s", 0.0, (0.4, 1.0, 2.0), outage)


def _noisy(quantity: str, factor: float, size: float) -> Conditions:
    noise: Any = SensorConditions(noise=factor * size)
    return Conditions(sensors=SensorsConditions(**{quantity: noise}))


def _missed(quantity: str, percent: float) -> Conditions:
    missed: Any = SensorConditions(dropout=percent / 100.0)
    which = ("position", "attitude", "velocity", "spin") if quantity == "all" else (quantity,)
    return Conditions(sensors=SensorsConditions(**dict.fromkeys(which, missed)))


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
