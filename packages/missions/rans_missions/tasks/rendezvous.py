"""Rendezvous and dock in geostationary orbit, from 1 km, inside a line-of-sight cone near the target."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from rans.extend import Cone, Field, Random, Shape, State, Timing, where
from rans_missions.guidance.arrival import whole_periods
from rans_missions.guidance.cone_approach import ConeApproach
from rans_missions.passive_safety import CoastZone
from rans_missions.tasks.orbital import OrbitalMission

_SPEED_USE = 0.99
"""Part of the velocity tolerance that guidance does not brake: the rest is for rounding of the brake."""
_ANGLE_USE = 29.0 / 30.0
"""Part of the cone's half angle that guidance uses: a degree of 30 is for errors of burns."""


@dataclass(frozen=True)
class Rendezvous(OrbitalMission):
    """Rendezvous with a target in geostationary orbit, and dock inside its line-of-sight cone.

    >>> rans.load_task("rendezvous").cone_length
    100.0

    Goal: the origin of W, the Hill frame of the target. Success: within 1 m at 0.05 m/s or less, at any check.
    Constraint: within 100 m the craft is inside a cone of 30 degrees half angle that opens towards -x, at every
    check.

    Start: at rest in the Hill frame, 0.4 to 1 km away along the axis of the cone, within 25 degrees of it.

    Source: phases 2 and 3 of the benchmark of C. Jewison and R. S. Erwin, "A spacecraft benchmark problem for
    hybrid control and estimation", IEEE Conference on Decision and Control, 2016, as coded in ARPOD_Benchmark.m
    of EASEL-UCI: a = 42,164 km, chaser of 500 kg with 10 N per axis, phases that end at 1 km and 100 m, a line of
    sight of 60 degrees along -x, 5 cm/s. The cone of the benchmark is a pyramid; here it is the round cone within
    it. Contact at 1 m is our choice.
    """

    mean_motion: float = 7.2922e-5
    """Mean motion n of a geostationary orbit, rad/s."""
    deadline: tuple[float, float] = (4000.0, 10000.0)
    """Range of the deadline, s."""
    spawn_distance: tuple[float, float] = (400.0, 1000.0)
    """Range of the start's distance from the target along the cone's axis, m."""
    cone_length: float = 100.0
    """Distance from the target within which the cone applies, m."""
    cone_degrees: ClassVar[float] = 30.0
    """Half angle of the cone, degrees."""
    spawn_degrees: ClassVar[float] = 25.0
    """Angle from the cone's axis within which episodes start, degrees."""
    position_tolerance: float = 1.0
    """Distance from the target that counts as contact, m."""
    velocity_tolerance: float = 0.05
    """Largest speed of docking at contact, m/s."""
    shortest_aim: float = 50.0
    """Least coasting time of the velocity to gain, s: a control period."""
    fail_distance: float = 5000.0
    """Distance from the target beyond which an episode fails, m."""
    done_weight: float = 1.0
    violation_weight: float = 1.0
    impulse_weight: float = 0.002
    """Reward lost per newton-second of thruster impulse."""
    gain_weight: float = 1.0
    """Reward per m/s by which the velocity to gain decreases; by default the price of 1 m/s for 500 kg."""

    flag = 10
    brakes: ClassVar[bool] = True
    keeps: ClassVar[tuple[type[Shape], ...]] = (Cone,)
    spacecraft: ClassVar[str | None] = "arpod-chaser"
    timing: ClassVar[Timing] = Timing(control_period=50.0, episode_steps=200, checks=10)

    @property
    def coast_zone(self) -> CoastZone | None:
        """A ball of 20 m, until the craft is as near as the cone is long: our choice; see `Hold.coast_zone`."""
        return CoastZone(20.0, self.cone_length) if self.orbit.is_steady else None

    def limits(self, goal: State) -> dict[str, Shape]:
        """The line-of-sight cone, whose apex is behind the target so that it contains the ball of contact."""
        axis = replace(goal.p.scale(0.0), x=-1.0)
        apex = goal.p - axis.scale(self._depth())
        return {"cone": Cone(apex, axis, math.radians(self.cone_degrees), self.cone_length)}

    def recommended(self, state: Any, goal: Any, left: Field) -> Any:
        """Velocity in W, m/s, with which to go to the goal inside the cone.

        See `rans_missions.guidance.cone_approach`. It arrives at the end of the last whole control period before
        the deadline, whatever arrival is planned.
        """
        return state.v + self._approach(state, goal).burn()

    def _counted(self, state: Any, goal: Any, left: Field) -> Field:
        """See `OrbitalMission`: by the deadline, too."""
        price = self._approach(state, goal).price()
        return where(price < self.most_gain, price, self.most_gain)

    def _approach(self, state: Any, goal: Any) -> ConeApproach:
        """Transfers from a state (m, m/s) to the goal by the deadline, with the mission's reserves."""
        depth = self._depth()
        return ConeApproach(
            self.mean_motion,
            state.p,
            state.v,
            goal.p,
            whole_periods(goal.notes.deadline, self.timing.control_period),
            self.timing.control_period,
            self.velocity_tolerance * _SPEED_USE,
            math.tan(math.radians(self.cone_degrees * _ANGLE_USE)),
            self.cone_length - depth,
            depth,
        )

    def _depth(self) -> float:
        """Distance of the cone's apex behind the goal, m."""
        return self.position_tolerance / math.sin(math.radians(self.cone_degrees))

    def sample(self, random: Random) -> tuple[State, State]:
        """Start near the cone's axis, and the target at the origin, which notes a deadline and a plan.

        Target's frame, m and m/s. The order of draws is part of every recorded flight.
        """
        distance = random.uniform(*self.spawn_distance)
        rest = random.at_rest(random.origin(), random.no_rotation())
        # The distance across the axis is bounded by the angle.
        widest = math.tan(math.radians(self.spawn_degrees))
        across = random.direction().scale(distance * random.uniform(0.0, widest))
        position = replace(across, x=distance * -1.0)
        start = replace(rest, p=position)
        return start, self.planned(random, start, rest)
