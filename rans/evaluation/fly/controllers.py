"""Controllers that need no training, by name: built in, of installed packages, or a user's own."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from rans.base.registry import Registry

if TYPE_CHECKING:
    from rans.episode.flight import Controller
    from rans.tasks import Task

Maker = Callable[..., "Controller"]
"""Function or class that makes a controller from spacecraft, task and timing, and tuned settings by keyword."""

CONTROLLERS: Registry[Maker] = Registry(
    "controller",
    "rans.controllers",
    {
        "lqr": "rans.control.lqr:LQR",
        "switching": "rans.control.switching:Switching",
    },
    "rans.evaluation.fly.make_controller:checked",
    elsewhere={
        "pid": "lqr",
        "pd": "lqr",
        "lqg": "lqr",
        "nmpc": "mpc",
        "bang-bang": "switching",
    },
)
"""Makers of controllers by name, with default settings; `controller` of the module `make_controller` makes one with
tuned settings."""

MODULES = {
    "mpc": ("casadi",),
    "optimal": ("casadi", "numba"),
}
"""Modules of `rans.base.errors.EXTRAS` that opponents of a comparison need."""

BESIDE = ("lqr", "switching", "mpc", "optimal")
"""Default opponents of a comparison: controllers, and the best that is possible."""


def default_opponents(task: Task) -> tuple[str, ...]:
    """Names of controllers that fly a task beside the contestants of a comparison, and "optimal"."""
    from rans.evaluation.problems import Problem

    problem = Problem.of(task)
    return BESIDE if problem is None else problem.opponents or BESIDE
