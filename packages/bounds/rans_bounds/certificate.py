"""Certified bounds of the fuel and time of any on/off controller, and controls that reach them.

A `Bounder` does the work for one kind of craft. `rans_bounds.plane` has that of the plane, by
branch and bound; that of space is a package of the repository, examples/plugins/space_certificates. The proofs
are in docs/bounds/certificate.md and in that package.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, cast

import numpy as np

from rans.base.errors import installing_folder
from rans.base.registry import Registry
from rans.extend import ConfigError, Spacecraft, brief
from rans_bounds.flight import fuel
from rans_bounds.problem import Found, Problem, SearchEffort

_DEFAULT_EFFORT = SearchEffort()


@dataclass(frozen=True)
class Certificate:
    """Certified bound and best control found; equal bounds prove the control optimal."""

    lower: float
    """No on/off controller at this rate does with less: N s of fuel, or s of time."""
    upper: float
    """Fuel (N s) or time (s) that ``commands`` need; infinite where none were found."""
    commands: np.ndarray | None
    """(T, thrusters) zeros and ones, replayed into the goal set; None too where none are needed."""
    seconds: float
    """Wall time."""


class Bounder(Protocol):
    """Proves what no on/off controller of one craft can beat.

    Commands are held for a control period each.
    """

    @property
    def craft(self) -> Spacecraft:
        """Spacecraft that the bounds are of."""
        ...

    @property
    def period(self) -> float:
        """Control period, s."""
        ...

    def contains(self, problem: Problem) -> bool:
        """Whether the start is in the goal set already."""
        ...

    def can_stop(self, problem: Problem) -> bool:
        """Whether any number of pulses takes the start's spin to the goal's."""
        ...

    def least_fuel(self, problem: Problem, steps: int, effort: SearchEffort) -> Found:
        """Bounds the impulse, N s, of controllers that are in the goal set after so many periods.

        Raises:
            Unreachable: none is.
            ConfigError: the problem has no bound, see `can_stop`.
        """
        ...

    def least_time(self, problem: Problem, most_steps: int, effort: SearchEffort) -> Found:
        """Bounds the time, s, until controllers are in the goal set, which the start is not.

        More than so many periods are not tried. Raises `ConfigError` as `certified_least_fuel`.
        """
        ...


def certified_least_fuel(
    bounder: Bounder, problem: Problem, steps: int, effort: SearchEffort = _DEFAULT_EFFORT
) -> Certificate:
    """Least impulse of any on/off controller that is in the goal set after so many control periods.

    Raises:
        Unreachable: no on/off controller can be in the goal set at that time.
        ConfigError: see `Bounder.least_fuel`; or the number of periods is none.
    """
    return _certified(
        lambda: bounder.least_fuel(problem, steps, effort),
        steps,
        lambda commands: fuel(bounder.craft, commands, bounder.period),
    )


def certified_least_time(
    bounder: Bounder, problem: Problem, most_steps: int, effort: SearchEffort = _DEFAULT_EFFORT
) -> Certificate:
    """Least time in which any on/off controller can be in the goal set, up to so many control periods.

    Raises:
        ConfigError: see `Bounder.least_time`; or the number of periods is none.
    """

    def search() -> Found:
        if bounder.contains(problem):
            return Found(0.0, np.zeros((0, bounder.craft.thruster_count)))
        return bounder.least_time(problem, most_steps, effort)

    return _certified(search, most_steps, lambda commands: len(commands) * bounder.period)


MakeBounder = Callable[[Spacecraft, float], Bounder]
"""Makes a bounder of a spacecraft and its control period (s); `ConfigError` where there is no certificate."""


def _checked(loaded: Any) -> MakeBounder:
    """The function, checked to be callable."""
    if not callable(loaded):
        raise ConfigError(
            f"a bounder is a function of a spacecraft and its control period, got {brief(loaded)}."
        )
    return cast("MakeBounder", loaded)


BOUNDERS: Registry[MakeBounder] = Registry(
    "bounder",
    "rans.bounds",
    {},
    _checked,
)
"""Functions that make bounders, by what their craft move in: "plane", and "space" where a package offers it."""
_SPACE = (
    "on/off certificates in space, for craft with equal principal moments of inertia, are a plug-in: "
    f"{installing_folder('examples/plugins/space_certificates')}."
)


def bounder(craft: Spacecraft, period: float) -> Bounder:
    """Bounder for a spacecraft whose commands are held for a period, s.

    Raises:
        ConfigError: no on/off certificate exists for this craft; or the package for certificates in space is not
            installed.
    """
    if craft.dimension == 2:
        return BOUNDERS["plane"](craft, period)
    if "space" not in BOUNDERS:
        tensor = np.array(craft.inertia)
        if not np.allclose(tensor, tensor[0, 0] * np.eye(3)):
            raise ConfigError(
                f"on/off certificates in space are for craft with equal principal moments of inertia, and "
                f"{craft.name} has others."
            )
        raise ConfigError(_SPACE)
    return BOUNDERS["space"](craft, period)


def _certified(
    search: Callable[[], Found], steps: int, amount: Callable[[np.ndarray], float]
) -> Certificate:
    """Certificate of what a search finds, whose commands need an amount of fuel or time.

    A start in the goal set needs no pulse, and its certificate has no commands.

    Raises:
        ConfigError: the number of control periods is none.
    """
    if not isinstance(steps, int) or steps < 1:
        raise ConfigError(
            f"the certificate needs at least one control period, a whole number, got {steps}."
        )
    began = time.monotonic()
    lower, commands = search()
    upper = math.inf if commands is None else amount(commands)
    needed = commands if upper > 0.0 else None
    return Certificate(lower, upper, needed, time.monotonic() - began)
