"""What all safety filters do: predict from where a command acts, and replace the commands that do not pass."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

from rans.extend import Command, Field, World
from rans_missions.guard.ahead import Ahead
from rans_missions.guard.expected import Reserve
from rans_missions.guard.rows import (
    batched,
    copied,
    count,
    is_array,
    like,
    taken,
    truths,
    where_true,
)


class Replacing(ABC):
    """Base of filters, a `rans.episode.Guard`: commands that pass are kept, and others replaced."""

    by_values: ClassVar[bool] = True

    @abstractmethod
    def safe(self, world: World, state: Any, goal: Any) -> Field:
        """Whether states (N,) of arrays or tensors are safe: the filter can keep them so from there, (N,)."""

    @abstractmethod
    def passes(self, world: World, state: Any, goal: Any, command: Command) -> Field:
        """Whether commands (N,) of arrays or tensors that act in these states pass unchanged, (N,)."""

    @abstractmethod
    def _instead(self, world: World, state: Any, goal: Any, command: Command) -> Command:
        """Replacements of commands (N,) that do not pass."""

    @abstractmethod
    def _expected(self) -> tuple[Reserve, float]:
        """Margins that are held in reserve, and time from a reading until the command acts, s."""

    def admitted(
        self,
        world: World,
        state: Any,
        goal: Any,
        command: Command,
        before: tuple[Command, ...] = (),
    ) -> tuple[Command, Field]:
        """Safe command in place of the desired one, and whether it differs; see `rans.episode.Guard.admitted`."""
        (state, goal, command), single = batched((state, goal, tuple(command)))
        size = count((state, command))
        command = tuple(x if is_array(x) else like(state, size, x) for x in command)
        reserve, delay = self._expected()
        state, goal = Ahead(world, reserve).delayed(state, goal, before, delay)
        refused = where_true(~self.passes(world, state, goal, command))
        changed = truths(state, size)
        admitted = tuple(copied(x) for x in command)
        if len(refused):
            instead = self._instead(world, *taken((state, goal, command), refused))
            for x, new in zip(admitted, instead, strict=True):
                changed[refused] |= x[refused] != new
                x[refused] = new
        if single:
            return tuple(float(x[0]) for x in admitted), bool(changed[0])
        return admitted, changed
