"""The inspection of a target by a team, whose deputies are neighbouring rows of one batch."""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial, reduce
from typing import Any

import numpy as np

from rans.extend import (
    ConfigError,
    Field,
    InformationInW,
    ObservationTerm,
    Random,
    State,
    map_leaves,
    where,
)
from rans_missions.tasks.inspect import Inspect


@dataclass(frozen=True)
class InspectTeam(Inspect):
    """See the points of a target's surface with up to three deputies, which share the points that they have seen.

    >>> from rans_missions.team.task import InspectTeam
    >>> rans.Engine("afrl-deputy", InspectTeam(deputies=2), num_envs=8).observe().shape
    torch.Size([8, 30])

    Rows k D to k D + D - 1 of a batch are the D deputies of team k: engines on NumPy and torch fly them, in batches
    of whole teams; programs that step one row cannot. A point counts for all of a team once one of them has seen
    it. A team succeeds together, and fails together if one of it comes too near to the target, leaves the zone, or
    comes nearer than `keep_apart` to another.

    Start: as that of `Inspect`, but every deputy has a part of the range of distances of its own, with a gap of
    `keep_apart` between the parts. The motion of its start is scaled to that part.

    Observed task data: also the vectors to the other deputies (W), the next row first.
    """

    deputies: int = 3
    """Number of deputies, 1 to 3."""
    keep_apart: float = 10.0
    """Least distance of two deputies from one another, m."""

    optimal_problem = "inspection by a team"

    def __post_init__(self) -> None:
        if type(self.deputies) is not int or not 1 <= self.deputies <= 3:
            raise ConfigError(
                f"deputies must be a whole number from 1 to 3, got {self.deputies!r}."
            )
        super().__post_init__()
        low, high = self.spawn_distance
        if self._part <= 0.0:
            raise ConfigError(
                f"{self.deputies} deputies cannot start {self.keep_apart:g} m apart at distances of {low:g} to "
                f"{high:g} m: lower keep_apart, or widen spawn_distance."
            )

    @property
    def rows(self) -> int:
        """See `rans.tasks.base.Task.rows`: the deputies."""
        return self.deputies

    @property
    def _part(self) -> float:
        """Width of the range of a deputy's distance at the start, m."""
        low, high = self.spawn_distance
        return (high - low - (self.deputies - 1) * self.keep_apart) / self.deputies

    def sample(self, random: Random) -> tuple[State, State]:
        """Starts around the target (W, m), each at distances of its own, and goals with one sun."""
        start, goal = super().sample(random)
        low, high = self.spawn_distance
        if self.deputies == 1:
            return start, goal
        distance = start.p.norm()
        number = self._grouped(distance * 0.0 + 1.0).cumsum(-1).reshape(distance.shape) - 1.0
        inner = low + number * (self._part + self.keep_apart)
        scale = (inner + (distance - low) * (self._part / (high - low))) / distance
        suns = self._grouped(goal.notes.sun)
        sun = (suns * 0.0 + suns[..., :1]).reshape(goal.notes.sun.shape)
        start = replace(start, p=start.p.scale(scale), v=start.v.scale(scale))
        return start, replace(goal, notes=replace(goal.notes, sun=sun))

    def visible(self, goal: State, state: State) -> list[Field]:
        """Whether each point is lit and within the view of any deputy, one field per point."""
        alone = super().visible(goal, state)
        # All points at once: an operation of torch takes as long for one of them.
        if isinstance(alone[0], np.ndarray):
            return list(self._together(operator.or_, np.stack(alone)))
        from torch import stack  # it takes seconds, which NumPy needs not

        return list(self._together(operator.or_, stack(alone)))

    def constraints(self, state: State, goal: State) -> dict[str, Field]:
        """Least distances of the team from the keep-out ball, from the end of the zone, and from one another, m."""

        def least(one: Field, other: Field) -> Field:
            return where(other < one, other, one)

        margins = super().constraints(state, goal)
        for k in range(1, self.deputies):
            apart = (self._mate(state, k).p - state.p).norm() - self.keep_apart
            margins["keep-apart"] = least(margins.get("keep-apart", apart), apart)
        return {name: self._together(least, margin) for name, margin in margins.items()}

    def failed(self, state: State, goal: State) -> Field:
        """Whether one of the team is too far away."""
        return self._together(operator.or_, super().failed(state, goal))

    def observation_terms(self, state: Any, goal: Any) -> tuple[ObservationTerm, ...]:
        """As those of `Inspect`, then the vectors to the other deputies (W)."""
        mates = (
            InformationInW(
                f"deputy {k} ",
                "m",
                self._mate(state, k).p - state.p,
                meaning=f"vector to the deputy {k} after this one in its team",
            )
            for k in range(1, self.deputies)
        )
        return (*super().observation_terms(state, goal), *mates)

    def _grouped(self, field: Any) -> Any:
        """A field (..., N) by teams, (..., N / D, D)."""
        rows = field.shape[-1]
        if rows % self.deputies:
            raise ConfigError(
                f"a batch must be of whole teams of {self.deputies} deputies, got {rows} rows."
            )
        return field.reshape(*field.shape[:-1], -1, self.deputies)

    def _of_mate(self, k: int, field: Any) -> Any:
        """A field with the value of the deputy k after each one in its team; a number is the same for all."""
        if isinstance(field, int | float | np.generic):
            return field
        teams = self._grouped(field)
        is_array = isinstance(teams, np.ndarray)
        rolled = np.roll(teams, -k, -1) if is_array else teams.roll(-k, -1)
        return rolled.reshape(field.shape)

    def _mate(self, state: Any, k: int) -> Any:
        """State of the deputy k after each one in its team."""
        return map_leaves(partial(self._of_mate, k), state)

    def _together(self, merge: Callable[[Field, Field], Field], field: Field) -> Field:
        """A field in which all of a team have what `merge` makes of their values, such as the least."""
        return reduce(merge, (self._of_mate(k, field) for k in range(self.deputies)))
