"""Controllers that need no training: built in, of packages that are installed, or your own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from rans.errors import ConfigError, RansError
from rans.evaluation.fly.protocols import Setup
from rans.evaluation.fly.user_policies import answered
from rans.files import first_line
from rans.flight import Controller
from rans.model.spacecraft import Spacecraft
from rans.model.timing import Timing
from rans.registry import Registry
from rans.tasks import Task

Maker = Callable[[Spacecraft, Task, Timing], Controller]


def _checked(found: Any) -> Maker:
    maker: Maker = found
    if not callable(found):
        raise ConfigError("a controller must be a class or function of spacecraft, task and timing, got "
                          f"{found!r}.")
    return maker


CONTROLLERS: Registry[Maker] = Registry("controller", "rans.controllers", {
    "lqr": "rans.optimal.control.lqr:LQR",
    "mpc": "rans.optimal.control.mpc:MPC",
}, _checked)
"""What makes the controller of a name, with its default settings."""

BESIDE = (*CONTROLLERS.built_in, "optimal")
"""Who joins a comparison unless somebody else is named: controllers, and the best that is possible."""


def controller(name: str, setup: Setup) -> Controller:
    """The controller of this name for a setup.

    Raises:
        ConfigError: there is none, or it cannot fly this spacecraft.
    """
    maker = CONTROLLERS[name]
    return maker(*setup) if name in CONTROLLERS.built_in else Guarded(name, setup)


class Guarded:
    """A controller made elsewhere, each of whose answers is checked before it flies.

    Args:
        name: as `CONTROLLERS` knows it.
        setup: what it is for.

    Raises:
        ConfigError: it cannot be made, or is no controller.
    """

    def __init__(self, name: str, setup: Setup) -> None:
        self._craft, package = setup.craft, CONTROLLERS.package(name)
        self._who = f"the controller {name!r}" + (f" of the package {package}" if package else "")
        try:
            self._made = CONTROLLERS[name](*setup)
            self.name, self.slow = self._made.name, getattr(self._made, "slow", False)
        except RansError:
            raise
        except Exception as error:  # somebody else's code raises anything
            raise ConfigError(f"{self._who} cannot be made: {type(error).__name__}: {first_line(error)}."
                              ) from error
        missing = [need for need in ("reset", "act") if not callable(getattr(self._made, need, None))]
        if missing:
            raise ConfigError(f"{self._who} is no controller: it has no {' and no '.join(missing)}; see "
                              "rans.flight.Controller.")

    @property
    def failures(self) -> int:
        """Times that its solver found nothing."""
        return getattr(self._made, "failures", 0)

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._made.reset(count)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`.

        Raises:
            ConfigError: it fails, or answers what the craft's actuators cannot follow.
        """
        return answered(self._who, lambda: self._made.act(state, goal, observation), self._craft,
                        len(observation))
