"""A task of your own in one file: keep one metre away from a point, and face it.

``python task.py`` trains an agent with `rans.train` and judges it. Every command takes the task by its name too,
in the folder of this file: ``rans list task:Face``, ``rans train task:Face --output runs/face``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import rans
from rans.extend import (
    Field,
    Heading,
    ObservationTerm,
    Random,
    RelativeRotation,
    SingleTask,
    State,
    Transition,
    VectorInW,
    absolute,
    at_least,
    atan2,
    nearness,
    speed,
)


@dataclass(frozen=True)
class Face(SingleTask):
    """Keep a distance from a point, and point the x axis of B at it."""

    distance: float = 1.0
    """To keep, m."""
    spawn_distance: tuple[float, float] = (2.5, 4.0)
    """Range of the start's distance from the goal, m."""
    position_tolerance: float = 0.1
    """Error of the distance that counts as reached, m."""
    attitude_tolerance: float = 0.1
    """Angle between nose and point that counts as reached, rad."""
    fail_distance: float = 8.0
    """An episode fails beyond this distance, m."""

    def sample(self, random: Random) -> tuple[State, State]:
        """Start at rest with a random heading; the goal is one of the poses that face the point."""
        goal = random.at_rest(random.origin(), random.attitude())
        return random.around(*self.spawn_distance), goal

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """The way to the nearest point at the distance, and the turn left: zero and the identity at the end."""
        way = self._way(state, goal)
        return (
            VectorInW("d", "m", way.scale(1.0 - self.distance / at_least(way.norm(), 0.01))),
            RelativeRotation("turn", "-", self._turn(state, goal)),
        )

    def errors(self, state: State, goal: State) -> dict[str, Field]:
        """How far the distance is off (m), and the angle between nose and point (rad)."""
        off = absolute(self._way(state, goal).norm() - self.distance)
        return {"position": off, "attitude": self._turn(state, goal).magnitude()}

    def reward(self, transition: Transition) -> dict[str, Field]:
        """exp(-error / scale) of each error; the nose counts more the nearer the distance is; and stillness."""
        state = transition.state
        off, aside = self.errors(state, transition.goal).values()
        near = nearness(off, 0.5)
        return {
            "distance": near,
            "nose": near * nearness(aside, 0.3),
            "stillness": near * nearness(speed(state.v.columns()) + speed(state.spin()), 0.25),
            **self.prices(transition),
        }

    def failed(self, state: State, goal: State) -> Field:
        """Too far away."""
        return self._way(state, goal).norm() > self.fail_distance

    def _way(self, state: State, goal: State) -> Any:
        """From the craft to the point, which the goal faces, in W (m)."""
        nose = Heading(goal.attitude.angle).rotate(type(goal.p)(self.distance, 0.0))
        return goal.p + nose - state.p

    def _turn(self, state: Any, goal: State) -> Heading:
        """Rotation from the nose to the point; a craft in space has no heading and is refused with a message."""
        way = self._way(state, goal)
        return Heading(state.attitude.angle).to(Heading(atan2(way.y, way.x)))


if __name__ == "__main__":
    agent = rans.train(Face(), output="runs/face", device="cpu", progress=False)
    metrics = agent.evaluate(episodes=256)
    print(
        ", ".join(
            f"{name} {metrics[name].value:.3g}" for name in ("solved", "settling time", "impulse")
        )
    )
