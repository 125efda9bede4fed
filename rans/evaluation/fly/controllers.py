"""Controllers that need no training: built in, of installed packages, or a user's own.

Policies that other libraries trained are controllers too: an SB3 file, an ONNX file, or any Python function.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cloudpickle
import numpy as np

from rans.effectors.commands import check_commands, clipped
from rans.episode import Guard, Setup
from rans.errors import ConfigError, RansError, brief, where_raised
from rans.evaluation.fly.foreign_policy import LOADERS, ForeignPolicy, policy_of
from rans.evaluation.fly.tuned import arguments, tuned
from rans.files import first_line
from rans.flight import Controller, informed
from rans.guard import safety_filter
from rans.model.spacecraft import Spacecraft
from rans.registry import Registry
from rans.tasks import Task

if TYPE_CHECKING:
    from rans.fast.learn.config import TrainConfig

Maker = Callable[..., Controller]
"""Function or class that makes a controller from spacecraft, task and timing, and tuned settings by keyword."""


def _checked(result: Any) -> Maker:
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
            "rans.flight.Controller."
        )


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
    _checked,
    elsewhere={
        "pid": "lqr",
        "pd": "lqr",
        "lqg": "lqr",
        "nmpc": "mpc",
        "bang-bang": "switching",
    },
)
"""Makers of controllers by name, with default settings; `controller` makes one with tuned settings."""

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


def controller(name: str, setup: Setup) -> Controller:
    """Make a controller by name, with settings that were tuned for the setup, else with default settings.

    A built-in one that can expect errors of sensors and thrusters expects the setup's conditions.

    Raises:
        ConfigError: there is no such controller, or none for this spacecraft.
    """
    maker = CONTROLLERS[name]
    result = tuned(name, setup)
    if result is not None:
        maker = partial(maker, **arguments(maker, result.settings))
    if name not in CONTROLLERS.built_in:
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
        try:
            self._made = maker(*setup[:3])
            self.name, self.slow = self._made.name, getattr(self._made, "slow", False)
            self.observes = getattr(self._made, "observes", True)
        except RansError:
            raise
        except Exception as error:  # somebody else's code raises anything
            raise ConfigError(
                f"{self._who} cannot be made: {type(error).__name__}: "
                f"{first_line(error)}{where_raised(error)}."
            ) from error
        _check_methods(self._who, self._made)

    @property
    def failures(self) -> int:
        """Number of times that its solver found no solution."""
        return getattr(self._made, "failures", 0)

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._made.reset(count)

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller` and `answered`."""
        return answered(
            self._who,
            lambda: self._made.act(state, goal, observation),
            self._craft,
            len(observation),
        )


USER_POLICIES = "sb3:FILE.zip, onnx:FILE or python:MODULE:FUNCTION"
"""Forms of names that `user_policy` accepts, for messages and help.

Each may end in :TASK-2d or -3d, with @SPACECRAFT, see `split_policy`.
"""


class UserPolicy:
    """A policy of another library as a controller; its commands are checked before they are flown.

    What the policy remembers is kept here from one control period to the next, and cleared by `reset`.

    Args:
        spec: text that `user_policy` opens.
        policy: the policy.
        craft: spacecraft that it flies.
        task: task that it observes.
        trust: see `user_policy`.
    """

    def __init__(
        self, spec: str, policy: ForeignPolicy, craft: Spacecraft, task: Task, trust: bool = False
    ) -> None:
        kind, _, file = spec.partition(":")
        self.name = f"{kind}:{Path(file).name}" if kind in ("sb3", "onnx") else spec
        self._spec = spec
        self._policy = policy
        self._craft = craft
        self._task = task
        self._trust = trust
        self._memory: Any = None

    def __reduce__(self) -> tuple[Any, ...]:
        """Another process loads the policy anew, because not every policy can be pickled."""
        return user_policy, (self._spec, self._craft, self._task, self._trust)

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`."""
        self._memory = None

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller` and `answered`; reads the observation only."""
        commands, self._memory = self.decide(observation, self._memory)
        return commands

    def decide(
        self, observation: np.ndarray, memory: Any, episode_start: np.ndarray | None = None
    ) -> tuple[np.ndarray, Any]:
        """Checked commands (N, commands) for observations (N, width), and the memory after them.

        Args:
            observation: (N, width), float32.
            memory: that after the step before; None: all episodes begin.
            episode_start: (N,) bool, where an episode begins; None: nowhere, unless all begin.
        """
        starts = np.full(len(observation), memory is None)
        if episode_start is not None:
            starts |= np.asarray(episode_start, dtype=bool)
        after = None

        def ask() -> Any:
            nonlocal after
            commands, after = self._policy(observation, memory, starts)
            return commands

        return answered(self.name, ask, self._craft, len(observation)), after


class ObjectPolicy(UserPolicy):
    """A policy that is an object: a Stable-Baselines3 model, a torch module, or a function of observations.

    Args:
        policy: the object; see `policy_of`.
        craft: spacecraft that it flies.
        task: task that it was trained for.
        name: name in tables; None: the name of its class or function.

    Raises:
        ConfigError: the object is no policy, or one for other observations or actions.
    """

    def __init__(
        self, policy: object, craft: Spacecraft, task: Task, name: str | None = None
    ) -> None:
        self._given = policy
        own = getattr(policy, "__name__", type(policy).__name__)
        super().__init__(name or own, policy_of(policy, craft, task), craft, task)

    def __reduce__(self) -> tuple[Any, ...]:
        """Another process gets a copy of the object, pickled by value if its class is defined in a script."""
        content = cloudpickle.dumps((self._given, self._craft, self._task, self.name))
        return _unpickled_policy, (content,)


def _unpickled_policy(content: bytes) -> ObjectPolicy:
    """Copy of an `ObjectPolicy` that another process of this session pickled."""
    policy, craft, task, name = cloudpickle.loads(content)
    return ObjectPolicy(policy, craft, task, name)


def answered(who: str, ask: Callable[[], Any], craft: Spacecraft, count: int) -> np.ndarray:
    """Commands (N, commands) of a user's code for N observations.

    Raises:
        ConfigError: the code fails, or its commands are not those of the craft's actuators.
    """
    try:
        commands = np.asarray(ask(), dtype=np.float64)
    except (Exception, SystemExit) as error:  # somebody else's code raises anything
        raise ConfigError(
            f"{who} failed: {type(error).__name__}: {_whole(error)}{where_raised(error)}."
        ) from error
    shape = count, craft.command_count
    if commands.shape != shape:
        raise ConfigError(
            f"{who} must answer {count} observations with commands of shape "
            f"{shape}, got {commands.shape}."
        )
    try:
        check_commands(craft, commands, count)
    except ConfigError as error:
        raise ConfigError(
            f"{who} answers with commands that {craft.name} does not take: {error} Probabilities have to be "
            "rounded, and densities clipped, by the policy."
        ) from None
    return clipped(craft, commands)


_LONGEST_REASON = 400
"""Largest number of characters of an exception's text in a message."""


def _whole(error: BaseException) -> str:
    """The text of another library's exception in one line, because its first line may not hold the cause."""
    text = " ".join(str(error).split()).rstrip(".")
    return text if len(text) <= _LONGEST_REASON else f"{text[:_LONGEST_REASON]} ..."


def is_user_policy(spec: str) -> bool:
    """Whether a text names a policy of `USER_POLICIES`."""
    return spec.partition(":")[0] in LOADERS and ":" in spec


def split_policy(spec: str) -> tuple[str, str]:
    """Split the text of a policy into what `user_policy` opens and its TASK-2d@SPACECRAFT, "" if it has none.

    >>> split_policy("sb3:policy.zip:go-to-pose-2d@atmos")
    ('sb3:policy.zip', 'go-to-pose-2d@atmos')
    >>> split_policy("python:mine:act")
    ('python:mine:act', '')
    """
    kind, _, rest = spec.partition(":")
    if kind == "python":
        module, _, rest = rest.partition(":")
        function, _, setup = rest.partition(":")
        return f"python:{module}:{function}", setup
    if Path(rest).is_file():
        return spec, ""
    drive, rest = os.path.splitdrive(rest)  # on Windows it has a colon, too
    file, _, setup = rest.partition(":")
    return f"{kind}:{drive}{file}", setup


def user_policy(spec: str, craft: Spacecraft, task: Task, trust: bool = False) -> UserPolicy:
    """Load the policy that ``sb3:FILE.zip``, ``onnx:FILE`` or ``python:MODULE:FUNCTION`` names.

    Loading a module runs its code. So does an SB3 file that RANS did not write, because it is a pickle; it is
    opened only with ``trust``.

    Raises:
        ConfigError: the policy cannot be loaded, or has other observations or actions than task and craft.
    """
    kind, _, name = spec.partition(":")
    if not is_user_policy(spec) or not name:
        raise ConfigError(f"there is no policy {brief(spec)}; known are {USER_POLICIES}.")
    return UserPolicy(spec, LOADERS[kind](name, craft, task, trust), craft, task, trust)
