"""A mission with success, constraints, goals that move and memory."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from rans import GoToPose
from rans.model.dynamics import State
from rans.model.fields import Field, Vec2, where


@dataclass(frozen=True)
class Way:
    """What a goal of `Pass` notes."""

    seconds: Any
    """Since the start, s."""
    farthest: Any
    """x of the farthest position ever, m."""


@dataclass(frozen=True)
class Pass(GoToPose):
    """Fly from x = -1 m along x: won within 0.1 m of the origin; a wall stands at ``wall``."""

    speed: float = 0.8
    wall: float = 0.3
    lead: float = 0.0
    goal_notes = Way
    done_weight: float = 5.0  # pyrefly: ignore[bad-override]
    violation_weight: float = 3.0  # pyrefly: ignore[bad-override]
    violation_ends: bool = True  # pyrefly: ignore[bad-override]

    def __post_init__(self) -> None:
        """Walls may be anywhere."""

    def sample(self, random: Any) -> tuple[State, State]:
        start, goal = super().sample(random)
        zero = start.w * 0.0
        start = replace(
            start, p=Vec2(zero - 1.0 + self.lead, zero), v=Vec2(zero + self.speed, zero)
        )
        return replace(start, w=zero), replace(goal, notes=Way(zero, zero))

    def later(self, goal: Any, time: Field) -> Any:
        return replace(goal, notes=replace(goal.notes, seconds=goal.notes.seconds + time))

    def remember(self, goal: Any, state: State) -> Any:
        farthest = where(state.p.x > goal.notes.farthest, state.p.x, goal.notes.farthest)
        return replace(goal, notes=replace(goal.notes, farthest=farthest))

    def constraints(self, state: State, goal: State) -> dict[str, Field]:
        return {"wall": self.wall - state.p.x}

    def done(self, state: State, goal: State) -> Field:
        return state.p.norm() < 0.1
