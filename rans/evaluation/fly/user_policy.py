"""Policies that other libraries trained, as controllers: an SB3 file, an ONNX file, or any Python function."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from rans.base.errors import ConfigError, RansError, brief, where_raised
from rans.base.registry import resolve_typed
from rans.effectors.commands import check_commands, clipped
from rans.evaluation.fly.policy_text import POLICIES, ForeignPolicy, forms, is_user_policy
from rans.model.spacecraft import Spacecraft
from rans.tasks import Task
from rans.tasks.derived import observation_width

_ALONE = 16
"""Observations of the first batch of a policy that are asked for alone."""


class UserPolicy:
    """A policy of another library as a controller; its commands are checked before they are flown.

    What the policy remembers is kept here from one control period to the next, and cleared by `reset`. Of the
    first batch it is asked twice, and once for single observations: one that answers otherwise then is refused.

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
        self.name = f"{kind}:{Path(file).name}" if file and kind != "python" else spec
        self._spec = spec
        self._policy = policy
        self._craft = craft
        self._task = task
        self._trust = trust
        self._memory: Any = None
        self._tried = 0
        """Rows of the largest batch that was asked for again, up to two."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Another process loads the policy anew, because not every policy can be pickled."""
        return user_policy, (self._spec, self._craft, self._task, self._trust)

    def reset(self, count: int) -> None:
        """See `rans.episode.flight.Controller`."""
        self._memory = None

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """See `rans.episode.flight.Controller` and `answered`; reads the observation only."""
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
        width = observation_width(self._task, self._craft.dimension)
        if observation.shape[1] != width:
            raise ConfigError(
                f"an observation of {type(self._task).__name__} has {width} numbers, got {observation.shape[1]}."
            )
        starts = np.full(len(observation), memory is None)
        if episode_start is not None:
            starts |= episode_start
        commands, after = self._asked(observation, memory, starts)
        if memory is None and self._tried < min(2, len(observation)):
            self._try_again(observation, starts, commands)
            self._tried = min(2, len(observation))
        return commands, after

    def _asked(
        self, observation: np.ndarray, memory: Any, starts: np.ndarray
    ) -> tuple[np.ndarray, Any]:
        after = None

        def ask() -> Any:
            nonlocal after
            commands, after = self._policy(observation, memory, starts)
            return commands

        return answered(self.name, ask, self._craft, len(observation)), after

    def _try_again(self, observation: np.ndarray, starts: np.ndarray, commands: np.ndarray) -> None:
        """Refuse (`ConfigError`) a policy that answers another command a second time, or to one row alone."""

        def off(rows: slice) -> bool:
            again = self._asked(observation[rows], None, starts[rows])[0]
            return not np.allclose(again, commands[rows], rtol=1e-3, atol=1e-3)

        if off(slice(None)):
            raise ConfigError(
                f"{self.name} answers the same observations differently a second time: the usual causes are a "
                "dropout, an action that is sampled, and a state that it keeps itself. Give the deterministic "
                "policy, in evaluation mode, as by eval(); one with a memory takes and gives it in predict."
            )
        # Sums in another order differ by rounding, which may turn a choice between 0 and 1 in one of several.
        if sum(off(slice(k, k + 1)) for k in range(min(_ALONE, len(observation)))) > 1:
            raise ConfigError(
                f"{self.name} answers an observation alone otherwise than among {len(observation)}: its flights "
                "would mix. The usual cause is a batch normalization in training mode."
            )


@contextmanager
def named(begin: str) -> Iterator[None]:
    """Context of somebody else's code: what it raises, also a `ConfigError`, becomes one that begins so.

    Sentences of RANS and its packages about that code name it themselves.
    """
    try:
        yield
    except (Exception, SystemExit) as error:
        place = where_raised(error)
        if isinstance(error, RansError) and not place:
            raise
        raise ConfigError(f"{begin}: {type(error).__name__}: {_whole(error)}{place}.") from error


def answered(who: str, ask: Callable[[], Any], craft: Spacecraft, count: int) -> np.ndarray:
    """Commands (N, commands) of a user's code for N observations.

    Raises:
        ConfigError: the code fails, or its commands are not those of the craft's actuators.
    """
    with named(f"{who} failed"):
        commands = np.asarray(ask(), dtype=np.float64)
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


def user_policy(spec: str, craft: Spacecraft, task: Task, trust: bool = False) -> UserPolicy:
    """Load the policy that a text of one of `rans.evaluation.fly.policy_text.forms` names.

    Loading a module runs its code. So does an SB3 file, because it is a pickle; it is opened only with ``trust``.

    Raises:
        ConfigError: the policy cannot be loaded, or has other observations or actions than task and craft.
    """
    kind, _, name = spec.partition(":")
    if not is_user_policy(spec) or not name:
        raise ConfigError(f"there is no policy {brief(spec)}; known are {forms()}.")
    given = name
    if kind == "python":
        kind, given = "object", _function(name)
    return UserPolicy(spec, POLICIES[kind](given, craft, task, trust), craft, task, trust)


def _function(name: str) -> Any:
    """The function MODULE:FUNCTION of observations; importing it runs its code."""
    module, _, function = name.rpartition(":")
    if not module or not function:
        raise ConfigError(
            f"python:{name} must name a module and a function, as python:my_policy:act."
        )
    try:
        policy = resolve_typed(name)
    except ConfigError as error:
        raise ConfigError(f"python:{name} cannot be imported: {error}") from error
    if not callable(policy):
        raise ConfigError(f"python:{name} is a {type(policy).__name__}, no function.")
    return policy
