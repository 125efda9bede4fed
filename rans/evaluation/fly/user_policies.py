"""Policies made elsewhere, as controllers: an SB3 file, an ONNX file, or any Python function."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from rans.errors import ConfigError
from rans.files import first_line
from rans.model.actuators import ON_OFF
from rans.model.spacecraft import Spacecraft
from rans.registry import from_here, resolve
from rans.tasks import Task, observation_width

FORMS = "sb3:FILE.zip, onnx:FILE or python:MODULE:FUNCTION"
"""What `user_policy` understands, for messages and help."""

Policy = Callable[[np.ndarray], Any]
"""(N, width) float32 observations, as `rans.tasks.observation` orders them, to (N, thrusters) what the
craft's actuators take: zeros and ones, or numbers between."""


class UserPolicy:
    """A function of the observation, each of whose answers is checked before it flies.

    Args:
        name: as `user_policy` knows it.
        policy: called with all episodes at once.
        craft: whose thrusters it must command.
        task: whose observations it must understand.
    """

    def __init__(self, name: str, policy: Policy, craft: Spacecraft, task: Task) -> None:
        self.name = name
        self._policy, self._craft, self._task = policy, craft, task

    def __reduce__(self) -> tuple[Any, ...]:
        """Another process loads it anew: not every policy can be pickled."""
        return user_policy, (self.name, self._craft, self._task)

    def reset(self, count: int) -> None:
        """See `rans.flight.Controller`; a function has no memory."""

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.flight.Controller`; looks at the observation only.

        Raises:
            ConfigError: the function fails, or answers what the craft's actuators cannot follow.
        """
        return answered(self.name, lambda: self._policy(observation), self._craft, len(observation))


def answered(who: str, ask: Callable[[], Any], craft: Spacecraft, count: int) -> np.ndarray:
    """The commands that somebody answers with, (N, thrusters).

    Args:
        who: is asked, for messages.
        ask: somebody else's code.
        craft: whose thrusters they are for.
        count: N.

    Raises:
        ConfigError: it fails, or answers what the craft's actuators cannot follow.
    """
    try:
        commands = np.asarray(ask(), dtype=np.float64)
    except Exception as error:  # somebody else's code raises anything
        raise ConfigError(f"{who} failed: {type(error).__name__}: {first_line(error)}.") from error
    wanted = count, len(craft.thrusters)
    if commands.shape != wanted:
        raise ConfigError(f"{who} must answer {count} observations with commands of shape "
                          f"{wanted}, got {commands.shape}.")
    try:
        craft.actuators.check(commands, *wanted)
    except ConfigError as error:
        raise ConfigError(f"{who} answers what {craft.name} cannot do: {error} Probabilities have to be "
                          "rounded, and densities clipped, by the policy.") from None
    return commands


def is_user_policy(spec: str) -> bool:
    """Whether a text names a policy of `FORMS`."""
    return spec.partition(":")[0] in _LOADERS and ":" in spec


def user_policy(spec: str, craft: Spacecraft, task: Task) -> UserPolicy:
    """The policy behind ``sb3:FILE.zip``, ``onnx:FILE`` or ``python:MODULE:FUNCTION``.

    Args:
        spec: see above. An SB3 file is a pickle and a module is code: open only what you trust.
        craft: whose thrusters it commands.
        task: whose observations it understands.

    Raises:
        ConfigError: it cannot be loaded, or is for another observation or other actions.
    """
    kind, _, name = spec.partition(":")
    if not is_user_policy(spec) or not name:
        raise ConfigError(f"there is no policy {spec!r}; known are {FORMS}.")
    return UserPolicy(spec, _LOADERS[kind](name, craft, task), craft, task)


def _sb3(name: str, craft: Spacecraft, task: Task) -> Policy:
    """The policy of any SB3 algorithm: the file names its class, so the algorithm need not be known."""
    from stable_baselines3.common.save_util import load_from_zip_file

    _check_file(name)
    try:
        data, parameters, _ = load_from_zip_file(name, device="cpu")
        assert data is not None  # every SB3 file has them
        spaces = data["observation_space"], data["action_space"]
        policy = data["policy_class"](*spaces, lambda _: 0.0, **data["policy_kwargs"])
        policy.load_state_dict(parameters["policy"])
    except Exception as error:  # a damaged pickle raises anything
        raise ConfigError(f"{name} is no policy that Stable-Baselines3 saved: "
                          f"{first_line(error)}.") from error
    policy.set_training_mode(False)
    _check_spaces(name, *spaces, craft, task)
    return lambda observation: policy.predict(observation, deterministic=True)[0]


def _check_spaces(name: str, seen: Any, action: Any, craft: Spacecraft, task: Task) -> None:
    from gymnasium.spaces import MultiBinary

    width, count = observation_width(task, craft.dimension), len(craft.thrusters)
    if seen.shape != (width,):
        raise ConfigError(f"{name} observes {seen.shape}, but {craft.name} shows ({width},).")
    known = ON_OFF.action_space(count), MultiBinary(count), craft.actuators.action_space(count)
    if action not in known:
        raise ConfigError(f"{name} acts by {action}, but {craft.name} has {count} thrusters, which take "
                          f"{craft.actuators.allowed}: {', '.join(dict.fromkeys(map(str, known)))}.")


def _onnx(name: str, _craft: Spacecraft, _task: Task) -> Policy:
    """A network with one input of observations, whose first output is the commands."""
    try:
        from onnxruntime import InferenceSession  # pyright: ignore[reportMissingImports]: is optional
    except ImportError as error:
        raise ConfigError(f"onnx:{name} needs the package onnxruntime: pip install 'rans[onnx]'.") from error
    _check_file(name)
    try:
        session = InferenceSession(name, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's errors have no common class
        raise ConfigError(f"{name} is no ONNX network: {first_line(error)}.") from error
    inputs = [node.name for node in session.get_inputs()]
    if len(inputs) != 1:
        raise ConfigError(f"{name} must have one input, the observation, got {', '.join(inputs)}.")
    return lambda observation: session.run(None, {inputs[0]: observation})[0]


def _python(name: str, _craft: Spacecraft, _task: Task) -> Policy:
    module, _, function = name.rpartition(":")
    if not module or not function:
        raise ConfigError(f"python:{name} must name a module and a function, as python:my_policy:act.")
    try:
        policy = resolve(from_here(name))
    except ConfigError as error:
        raise ConfigError(f"python:{name} cannot be imported: {error}") from error
    if not callable(policy):
        raise ConfigError(f"python:{name} is a {type(policy).__name__}, no function.")
    return policy


def _check_file(name: str) -> None:
    if not Path(name).is_file():
        raise ConfigError(f"there is no file {name}.")


_LOADERS: dict[str, Callable[[str, Spacecraft, Task], Policy]] = {
    "sb3": _sb3, "onnx": _onnx, "python": _python}
