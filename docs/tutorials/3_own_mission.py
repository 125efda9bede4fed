"""
Your own mission
================

Write a mission in one class: dock with a target that drifts by, softly, and without entering a keep-out zone.
"""

# %%
# A mission has a start and a goal, an observation, a reward, constraints, and an end. All functions are written
# over *fields*: the same source steps thousands of spacecraft, is compiled, moves in Drake, and is optimized.
# Two rules follow: multiply a vector with ``v.scale(s)``, and use ``where`` in place of ``if`` on a field.
import tempfile
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import rans
from rans.model.drift import step_goal
from rans.tasks import SingleTask
from rans.tasks.observation_terms import VectorInW
from rans.tasks.rewards import nearness
from rans.tasks.shapes import Ball


@dataclass(frozen=True)
class SoftDock(SingleTask):
    """Touch a point that drifts by, softly, and stay out of a ball around the origin."""

    spawn_distance: tuple[float, float] = (1.5, 2.5)
    goal_speed: float = 0.03
    position_tolerance: float = 0.05
    velocity_tolerance: float = 0.05
    fail_distance: float = 8.0
    zone: float = 0.3
    done_weight: float = 150.0
    violation_weight: float = 10.0
    timing = rans.Timing(control_period=0.2, episode_steps=200, checks=4)

    def sample(self, random):
        """A goal 1 m from the origin that drifts, and a start at rest around it."""
        goal = random.moving(
            random.direction().scale(self.goal_speed), random.no_rotation()
        )
        return random.around(*self.spawn_distance), goal

    def later(self, goal, time):
        """The goal after a time."""
        return step_goal(goal, self.drift, time)

    def observation_terms(self, state, goal):
        """Way to the goal and velocity to gain, in the world frame."""
        return VectorInW("d", "m", goal.p - state.p), VectorInW(
            "dv_", "m/s", goal.v - state.v
        )

    def reward(self, transition):
        """Near, then near and slow, less the price of thrust."""
        distance, speed = self.errors(
            transition.state, transition.goal
        ).values()
        soft = nearness(speed, 0.1) * nearness(distance, 0.2)
        return {
            "near": nearness(distance, 1.0),
            "soft": soft,
            **self.prices(transition),
        }

    def failed(self, state, goal):
        """Too far away."""
        return self.errors(state, goal)["position"] > self.fail_distance

    def done(self, state, goal):
        """Touched softly: the mission is over and won."""
        distance, speed = self.errors(state, goal).values()
        return (distance < self.position_tolerance) & (
            speed < self.velocity_tolerance
        )


# %%
# Train it
# --------
# Everything else follows from the class: the observation space, the Gymnasium environment, formulas, plots.
#
# ``done_weight`` is paid once, when the mission is won. It must exceed what an agent earns by waiting beside
# the goal: here up to 2 a step, which the discount of 0.98 sums to 2 / (1 - 0.98) = 100. With less the agent
# waits.
mission = SoftDock()
mission

# %%
folder = Path(tempfile.mkdtemp())
agent = rans.train(
    mission, total_timesteps=700_000, output=folder / "soft-dock"
)
flight = agent.fly(64)
print(
    f"{100 * np.mean(flight.done):.0f} % of 64 docked, in the median after "
    f"{np.median(flight.lengths) * 0.2:.1f} s"
)

# %%
# Plot approaches
# ---------------
figure, (paths, speeds) = plt.subplots(
    1, 2, figsize=(9, 4), layout="constrained"
)
way = flight.goals.p - flight.states.p
for k in range(12):
    end = flight.lengths[k] + 1
    paths.plot(-way.x[:end, k], -way.y[:end, k], linewidth=1)
    speeds.semilogy(
        flight.times[:end],
        np.asarray(flight.errors()["velocity"])[:end, k],
        linewidth=1,
    )
paths.plot(0, 0, "k+")
paths.set(
    xlabel="x from the target, m", ylabel="y from the target, m", aspect="equal"
)
speeds.axhline(0.05, color="black", linestyle="--")
speeds.set(xlabel="time, s", ylabel="relative speed, m/s")
plt.show()

# %%
# Add a constraint
# ----------------
# A subclass adds a keep-out zone. One object is the margin of the constraint, what the policy observes, and
# what replays draw. A negative margin ends the episode.


@dataclass(frozen=True)
class SoftDockBehind(SoftDock):
    """A soft docking with a keep-out zone at the origin."""

    def scenery(self, goal):
        """A ball that stands still."""
        return (Ball(goal.p.scale(0.0), goal.v.scale(0.0), self.zone),)

    def constraints(self, state, goal):
        """Distance from the rim, m."""
        return {"zone": self.scenery(goal)[0].gap(state.p)}

    def observation_terms(self, state, goal):
        """What the policy observes of the zone too."""
        (ball,) = self.scenery(goal)
        return (
            *super().observation_terms(state, goal),
            *ball.entries("zone", state),
        )


engine = rans.Engine("floating-platform", SoftDockBehind(), num_envs=1024)
print(engine.reset(seed=0).shape)

# %%
# Next
# ----
# In a file ``mission.py`` the class is ``mission:SoftDock`` for every command: ``rans train mission:SoftDock``.
# How agents that come with RANS avoid zones and dock at ports is in the pages of missions.
