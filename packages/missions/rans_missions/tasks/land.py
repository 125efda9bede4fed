"""Land softly at a site under gravity, with engines that cannot be shut and limited propellant.

Observations are trained, and starts follow from the order of random numbers (`tests/tasks/test_land.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from rans.extend import (
    Dimension,
    Drift,
    Field,
    Information,
    InformationInW,
    ObservationTerm,
    Quat,
    Random,
    SingleTask,
    SpatialState,
    State,
    Timing,
    Transition,
    Vec3,
    VectorInW,
    cos,
    sin,
    where,
)
from rans.model.drift import UniformGravity
from rans.tasks.shapes import GlideSlope
from rans_missions.guidance.descent import DescentLaw

_EMPTY = 1e-3
"""Propellant below which the tank counts as empty, kg; single precision resolves 0.03 g at 400 kg."""


@dataclass(frozen=True)
class Land(SingleTask):
    """Powered descent: land softly at a site with little propellant, in space with z upwards.

    >>> rans.Land().tolerances()
    {'position': 1.0, 'velocity': 0.5}

    Start and gravity are those of a Mars landing: B. Acikmese and S. R. Ploen, "Convex programming approach to
    powered descent guidance for Mars landing", Journal of Guidance, Control, and Dynamics 30(5), 2007. Its start at
    (2000, 0, 1500) m with (80, 30, -75) m/s is one of those that `sample` draws, up to a rotation about the
    vertical. The craft starts upright and with a full tank.

    Success: within both tolerances of the landing site, which is the origin of W. Failure: below the ground or the
    glide slope, tilted too far, or without propellant.

    Observed task data: vector to the site, vertical, commanded acceleration and time to go of the guidance law of
    D'Souza (`rans_missions.guidance.descent.DescentLaw`), and the propellant left.
    """

    gravity: float = 3.7114
    """Gravity of Mars at the site, m/s^2 (Acikmese and Ploen)."""
    start_altitude: tuple[float, float] = (1450.0, 1650.0)
    """Range of the start's height, m."""
    start_distance: tuple[float, float] = (1900.0, 2100.0)
    """Range of the start's horizontal distance from the site, m."""
    start_away: tuple[float, float] = (50.0, 80.0)
    """Range of the start's horizontal speed away from the site, m/s."""
    start_across: tuple[float, float] = (0.0, 30.0)
    """Range of the start's horizontal speed across, to the left, m/s."""
    start_descent: tuple[float, float] = (65.0, 77.0)
    """Range of the start's vertical speed downwards, m/s."""
    glide_slope: float = math.radians(4.0)
    """Least elevation of the craft as seen from the edge of the site, rad (Acikmese and Ploen)."""
    tilt_limit: float = math.radians(40.0)
    """Largest angle between the craft's z axis and the vertical, rad (pointing limit of Acikmese and Ploen)."""
    position_tolerance: float = 1.0
    """Distance from the site within which the craft has landed, m; also the radius of the site."""
    velocity_tolerance: float = 0.5
    """Speed below which the craft has landed, m/s."""
    thrust_weight: float = 0.0
    """Reward lost per step and open thruster; zero because propellant has a price."""
    propellant_weight: ClassVar[float] = 1.0
    """Reward lost per kg of propellant used."""
    approach_weight: float = 0.9
    """Reward per m/s by which the velocity change of the guidance law decreases."""
    missed_weight: ClassVar[float] = 1.5
    """Reward lost at a failure, per m/s of velocity change that the guidance law would still need."""
    haste: ClassVar[float] = 2.0
    """Weight of time in the guidance law, m^2/s^4; a larger one lands sooner."""
    done_weight: float = 30.0
    """Reward for landing."""
    violation_weight: float = 30.0
    """Reward lost at a violation of the ground, the glide slope or the tilt limit."""

    symmetric: ClassVar[bool] = False
    dimensions: ClassVar[tuple[Dimension, ...]] = (3,)
    spacecraft: ClassVar[str | None] = "mars-lander-steered"
    optimal_problem = "landing"
    timing: ClassVar[Timing] = Timing(control_period=0.5, episode_steps=220, checks=2)

    @property
    def drift(self) -> Drift:
        """Uniform gravity along -z of W."""
        return UniformGravity((0.0, 0.0, -self.gravity))

    def sample(self, random: Random) -> tuple[State, State]:
        """Start above and beside the site (W, z up), moving away from it; seeds rely on the order of draws."""
        bearing = random.uniform(-math.pi, math.pi)
        altitude = random.within(self.start_altitude)
        distance = random.within(self.start_distance)
        away = random.within(self.start_away)
        across = random.within(self.start_across)
        descent = random.within(self.start_descent)
        start = upright(bearing, (distance, altitude), (away, across, -descent))
        return start, random.at_rest(random.origin(), random.no_rotation())

    def guidance(self, state: Any, goal: Any) -> DescentLaw:
        """Guidance law from a state to the goal."""
        return DescentLaw.of(state.p - goal.p, state.v - goal.v, self.gravity, self.haste)

    def scenery(self, goal: Any) -> tuple[GlideSlope]:
        """The glide slope, whose apex is so far below the site that all of the site is allowed."""
        up = Vec3(0.0, 0.0, 1.0)
        below = self.position_tolerance * (sin(self.glide_slope) / cos(self.glide_slope))
        return (GlideSlope(goal.p - up.scale(below), up, self.glide_slope),)

    def constraints(self, state: Any, goal: Any) -> dict[str, Field]:
        """Fields: height above the ground, m; margin of the glide slope, m.

        Cosine of the tilt less that of its limit.
        """
        up = Vec3(0.0, 0.0, 1.0)
        (slope,) = self.scenery(goal)
        return {
            "ground": state.p.z - goal.p.z,
            "glide slope": slope.gap(state.p),
            "tilt": state.attitude.rotate(up).z - cos(self.tilt_limit),
        }

    done = SingleTask.reached  # the craft has landed: within both tolerances of the site

    def observation_terms(self, state: State, goal: State) -> tuple[ObservationTerm, ...]:
        """Vector to the site, vertical, the law's acceleration and time to go, propellant left.

        SI units, W. Agents' files record the kinds and order of terms; `guidance` gives the law.
        """
        law = self.guidance(state, goal)
        zero = state.p.x * 0.0
        return (
            VectorInW("d", "m", goal.p - state.p),
            InformationInW(
                "up_", "-", Vec3(zero, zero, zero + 1.0), meaning="unit vector opposite to gravity"
            ),
            InformationInW(
                "a_",
                "m/s^2",
                law.thrust,
                meaning="acceleration by thrust that the guidance law of rans_missions.guidance.descent commands",
            ),
            Information("time to go", "s", law.time, meaning="time to go of the guidance law"),
            Information(
                "propellant", "kg", zero + _propellant(state), meaning="propellant that is left"
            ),
        )

    def reward(self, transition: Transition) -> dict[str, Field]:
        """Terms (fields).

        Propellant, progress of the guidance law, and a penalty for what it still needs at a failure.
        """
        state = transition.state
        goal = transition.goal
        before = transition.before or state
        needed = self.guidance(before, goal).speed
        left = where(self.reached(state, goal), 0.0, self.guidance(state, goal).speed)
        lost = self.failed(state, goal)
        for margin in self.constraints(state, goal).values():
            lost = lost | (margin < 0.0)
        used = _propellant(before) - _propellant(state)
        return {
            "propellant": used * -self.propellant_weight,
            "approach": (needed - left) * self.approach_weight,
            "missed": where(lost, left, 0.0) * -self.missed_weight,
            **self.prices(transition),
        }

    def failed(self, state: State, goal: State) -> Field:
        """Whether the tank is empty."""
        return _propellant(state) < _EMPTY


def _propellant(state: State) -> Field:
    """Propellant left in the tank, kg; 1 for a craft without propellant."""
    return state.stores[0] if state.stores else 1.0


def upright(
    bearing: Field, position: tuple[Field, Field], velocity: tuple[Field, Field, Field]
) -> SpatialState:
    """State of an upright craft without spin, at a bearing from the site.

    Args:
        bearing: horizontal direction from the site to the craft, as an angle from x of W, rad.
        position: horizontal distance and height, m.
        velocity: away from the site, across to the left, and upwards, m/s.
    """
    c, s = cos(bearing), sin(bearing)
    distance, altitude = position
    away, across, upwards = velocity
    zero = bearing * 0.0
    return SpatialState(
        Vec3(distance * c, distance * s, altitude),
        Quat(zero + 1.0, zero, zero, zero),
        Vec3(away * c - across * s, away * s + across * c, upwards),
        Vec3(zero, zero, zero),
    )
