"""Controllers that need no training, by name: built in, of installed packages, or a user's own."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from rans.registry import Registry

if TYPE_CHECKING:
    from rans.flight import Controller
    from rans.tasks import Task

Maker = Callable[..., "Controller"]
"""Function or class that makes a controller from spacecraft, task and timing, and tuned settings by keyword."""

CONTROLLERS: Registry[Maker] = Registry(
    "controller",
    "rans.controllers",
    {
        "lqr": "rans.optimal.control.lqr:LQR",
        "switching": "rans.optimal.control.switching:Switching",
        "mpc": "rans.optimal.control.mpc:MPC",
        "mpc-observer": "rans.optimal.control.observer:ObserverMPC",
        "mppi": "rans.optimal.control.sampling:MPPI",
        "guidance": "rans.optimal.control.guidance:VelocityToGain",
        "convex": "rans.optimal.control.convex_guidance:ConvexGuidance",
        "landing": "rans.optimal.control.landing_guidance:LandingGuidance",
        "mission": "rans.optimal.control.mission_guidance:MissionGuidance",
        "circumnavigation": "rans.optimal.control.circumnavigation:Circumnavigation",
        "passive": "rans.optimal.control.passive_approach:PassiveApproach",
        "passive-entry": "rans.optimal.control.passive_entry:PassiveEntry",
        "visiting": "rans.optimal.control.visiting:Visiting",
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

BESIDE = ("lqr", "switching", "mpc", "optimal")
"""Default opponents of a comparison: controllers, and the best that is possible."""
_BESIDE_OTHERS = {
    "landing": ("landing", "optimal"),
    "inspection": ("circumnavigation", "visiting", "optimal"),
}
"""Default opponents of comparisons of missions that those controllers do not fly, by kind of optimal problem."""


def default_opponents(task: Task) -> tuple[str, ...]:
    """Names of controllers that fly a task beside the contestants of a comparison, and "optimal"."""
    return _BESIDE_OTHERS.get(task.optimal_problem, BESIDE)
