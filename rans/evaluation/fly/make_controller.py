"""Controllers that need no training, made for a setup; those of others are checked as they are made and flown."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from rans.base.errors import ConfigError, brief
from rans.episode.flight import Controller, informed
from rans.episode.safety_filters import safety_filter
from rans.episode.step import Guard, Setup
from rans.evaluation.fly.controllers import CONTROLLERS, Maker
from rans.evaluation.fly.tuned import arguments, tuned
from rans.evaluation.fly.user_policy import answered, named
from rans.model.fields import Field
from rans.model.spacecraft import Spacecraft

if TYPE_CHECKING:
    from rans.fast.learn.config import TrainConfig


def checked(result: Any) -> Maker:
    """A maker, if it is a class or function of spacecraft, task and timing."""
    if not callable(result):
        raise ConfigError(
            "a controller must be a class or function of spacecraft, task and timing, got "
            f"{brief(result)}."
        )
    if isinstance(
        result, type
    ):  # A spacecraft or a task is a class too: it is refused before it is called.
        _check_methods(f"the class {result.__name__}", result)
    maker: Any = result
    return maker


def _check_methods(who: str, instance: object) -> None:
    missing = [need for need in ("reset", "act") if not callable(getattr(instance, need, None))]
    if missing:
        raise ConfigError(
            f"{who} is no controller: it has no {' and no '.join(missing)}; see "
            "rans.episode.flight.Controller."
        )


def controller(name: str, setup: Setup, trade_off: object = None) -> Controller:
    """Make a controller by name, with settings that were tuned for the setup, else with default settings.

    A built-in one that can expect errors of sensors and thrusters expects the setup's conditions. Only controllers
    with ``has_trade_off`` take a trade-off.

    Raises:
        ConfigError: there is no such controller, or none for this spacecraft.
    """
    maker = CONTROLLERS[name]
    result = tuned(name, setup)
    if result is not None:
        maker = partial(maker, **arguments(maker, result.settings))
    if trade_off is not None and getattr(CONTROLLERS[name], "has_trade_off", False):
        maker = partial(maker, trade_off=trade_off)
    if not CONTROLLERS.comes_with_rans(name):
        return CheckedController(name, setup, maker)
    return informed(maker(*setup[:3]), setup.conditions)


def guard_of(config: TrainConfig, craft: Spacecraft) -> Guard | None:
    """The safety filter of a training; None if it has none.

    Raises:
        ConfigError: the task has no constraints, or the craft has throttles with which no filter can brake.
    """
    return safety_filter(Setup(craft, config.settings, config.timing)) if config.guard else None


class CheckedController:
    """Controller of a plug-in or a user whose commands are checked; wrong ones raise a `ConfigError`."""

    def __init__(self, name: str, setup: Setup, maker: Maker) -> None:
        self._craft = setup.craft
        package = CONTROLLERS.package(name)
        self._who = f"the controller {brief(name)}" + (
            f" of the package {package}" if package else ""
        )
        with named(f"{self._who} cannot be made"):
            self._made: Any = maker(*setup[:3])
            self.name, self.slow = self._made.name, getattr(self._made, "slow", False)
            self.observes = getattr(self._made, "observes", True)
        _check_methods(self._who, self._made)
        if hasattr(self._made, "command"):  # a page computes it: `rans.show.pages.playground.Law`
            self.command = self._command

    def _command(self, state: Any, goal: Any) -> tuple[Field, ...]:
        """Commands as arithmetic on fields; what a class of the user raises becomes a `ConfigError`.

        Without the range checks of `act`, since fields have no values.
        """
        with named(
            f"`command` of {self._who}, which must be arithmetic on fields (docs/own_task.md), failed"
        ):
            return tuple(self._made.command(state, goal))

    @property
    def failures(self) -> int:
        """Number of times that its solver found no solution."""
        return getattr(self._made, "failures", 0)

    def reset(self, count: int) -> None:
        """See `rans.episode.flight.Controller`."""
        with named(f"{self._who} failed"):
            self._made.reset(count)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.episode.flight.Controller` and `answered`."""
        return answered(
            self._who,
            lambda: self._made.act(state, goal, observation),
            self._craft,
            len(observation),
        )
