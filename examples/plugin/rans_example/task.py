"""Stay at a distance from a point, anywhere around it."""

from dataclasses import dataclass
from typing import Any, ClassVar

from rans.extend import (
    Drift,
    Field,
    ObservationTerm,
    Random,
    SingleTask,
    State,
    Transition,
    VectorInW,
    absolute,
    at_least,
    nearness,
    speed,
)
from rans_example.motion import Bowl


@dataclass(frozen=True)
class KeepDistance(SingleTask):
    """Stay at a distance from a point, with any attitude.

    Observed task data: the way to the nearest point at that distance, in W (2 or 3 columns, m).
    """

    distance: float = 1.0
    """To keep, m."""
    spawn_distance: tuple[float, float] = (2.5, 4.0)
    """Range of the start's distance from the goal, m."""
    position_scale: float = 0.5
    """Error at which the reward has fallen to 1/e, m."""
    position_tolerance: float = 0.1
    """Error that counts as reached, m."""
    fail_distance: float = 8.0
    """An episode fails beyond this distance, m."""
    sag: float = 0.02
    """Frequency at which a free craft swings about the origin of a table that sags by 0.3 mm at 4 m, rad/s."""
    optimal_problem: ClassVar[str] = "keep-distance"
    """Its bounds (entry point of the group rans.problems)."""

    @property
    def drift(self) -> Drift:
        """Motion of a free point on the table."""
        return Bowl(self.sag)

    def sample(self, random: Random) -> tuple[State, State]:
        """Start at rest around the goal, from which the point is at the distance along the x axis of W."""
        return random.around(*self.spawn_distance), random.at_rest(
            random.origin(), random.no_rotation()
        )

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """The way to the nearest point at the distance."""
        way = self._way(state, goal)
        return (VectorInW("d", "m", way.scale(1.0 - self.distance / at_least(way.norm(), 0.01))),)

    def errors(self, state: State, goal: State) -> dict[str, Field]:
        """How far the distance is off, and angular speed."""
        off = absolute(self._way(state, goal).norm() - self.distance)
        return {"position": off, "spin": speed(state.spin())}

    def reward(self, transition: Transition) -> dict[str, Field]:
        """exp(-error / scale), and as much for stillness."""
        off, spin = self.errors(transition.state, transition.goal).values()
        return {
            "position": nearness(off, self.position_scale),
            "stillness": nearness(spin, 0.25),
            **self.prices(transition),
        }

    def failed(self, state: State, goal: State) -> Field:
        """Too far away."""
        return self._way(state, goal).norm() > self.fail_distance

    def _way(self, state: State, goal: State) -> Any:
        """From the craft to the point, in W (m)."""
        axes = (self.distance, 0.0, 0.0)[: len(goal.p.columns())]
        return goal.p + type(goal.p)(*axes) - state.p
