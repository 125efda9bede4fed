"""Policies that are objects of the user's program, as controllers."""

from __future__ import annotations

from typing import Any

import cloudpickle

from rans.evaluation.fly.policy_text import POLICIES
from rans.evaluation.fly.user_policy import UserPolicy
from rans.model.spacecraft import Spacecraft
from rans.tasks import Task


class ObjectPolicy(UserPolicy):
    """A policy that is an object: a Stable-Baselines3 model, a torch module, or a function of observations.

    Args:
        policy: the object.
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
        decide = POLICIES["object"](policy, craft, task, False)
        super().__init__(name or own, decide, craft, task)

    def __reduce__(self) -> tuple[Any, ...]:
        """Another process gets a copy of the object, pickled by value if its class is defined in a script."""
        content = cloudpickle.dumps((self._given, self._craft, self._task, self.name))
        return _unpickled_policy, (content,)


def _unpickled_policy(content: bytes) -> ObjectPolicy:
    """Copy of an `ObjectPolicy` that another process of this session pickled."""
    policy, craft, task, name = cloudpickle.loads(content)
    return ObjectPolicy(policy, craft, task, name)
