"""Base class of missions near a target on an orbit, with a deadline and a planned arrival.

Trained agents and guidance rest on its observation and plans: every mission is compared with flights in Drake and
in two-body gravity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

from rans.base.display import Settings
from rans.extend import (
    Ball,
    ClohessyWiltshire,
    ConfigError,
    Dimension,
    Drift,
    Field,
    Information,
    InformationInW,
    ObservationTerm,
    Random,
    Shape,
    SingleTask,
    SpeedLimit,
    State,
    Transition,
    VectorInW,
    at_least,
    cos,
    is_finite,
    is_used,
    positive,
    sin,
    where,
)
from rans_missions.control.afterwards import Afterwards
from rans_missions.guidance.arrival import TIME_ROUNDING
from rans_missions.guidance.orbital import FewBurns, OrbitalGuidance, SingleImpulse
from rans_missions.guidance.staying import staying_velocity
from rans_missions.orbits.earth import EARTH, EARTH_RADIUS
from rans_missions.orbits.elliptic import MOST_ECCENTRIC, EllipticOrbit, mean_anomaly
from rans_missions.orbits.perturbed import PerturbedOrbit
from rans_missions.orbits.reach import velocity_to_reach
from rans_missions.orbits.uneven import UnevenOrbit

if TYPE_CHECKING:
    from rans.extend import Spacecraft, Timing

_EARTH_RADIUS = 1e-3 * EARTH_RADIUS
"""Equatorial radius of the Earth, km."""
_LARGEST_DRAG = 0.01
"""Largest acceleration by drag, m/s^2: a satellite has about 1e-3 at 150 km (2e-9 kg/m^3, 7,800 m/s, 50 kg/m^2),
where an orbit ends within a day."""


def last_check(deadline: float, interval: float) -> int:
    """Number of the last check, every interval (s) from the start, at which `OrbitalMission.done` counts a success.

    >>> from rans_missions.tasks.orbital import last_check
    >>> last_check(99.9995, 10.0), last_check(99.9, 10.0)
    (10, 9)
    """
    return math.floor((deadline + TIME_ROUNDING) / interval + 1e-9)


@dataclass(frozen=True)
class TargetOrbit(Settings):
    """Orbit of a mission's target around the Earth; by default a circle with the mission's mean motion.

    >>> orbit = rans.TargetOrbit(eccentricity=0.3, semi_major_axis_km=9683.0)
    >>> rans.Dock(orbit=orbit).drift.name
    'elliptic-orbit'
    >>> low = rans.TargetOrbit(oblate=True, inclination_degrees=51.6, target_drag=4e-7, ballistic_ratio=0.5)
    >>> rans.Dock(orbit=low).drift.name
    'perturbed-orbit'

    Raises:
        ConfigError: the eccentricity is not from 0 to 0.9, the semi-major axis is negative or not finite, the
            perigee is within the Earth, angles are no range, the inclination is not from 0 to 180 degrees, a drag
            is negative or has a ballistic ratio of 1, a ratio is not above 0, or an ellipse or a gradient of
            gravity has an oblate Earth or drag.
    """

    eccentricity: float = 0.0
    """Eccentricity, from 0 (circle) to 0.9."""
    semi_major_axis_km: float = 0.0
    """Semi-major axis, km, which replaces the mission's mean motion; 0: the mean motion counts."""
    true_anomaly_degrees: tuple[float, float] = (0.0, 360.0)
    """Range of the target's true anomaly at the start of an ellipse, degrees from the perigee; equal numbers fix
    it."""
    oblate: bool = False
    """Whether the Earth is oblate (J2); otherwise it is a sphere."""
    inclination_degrees: float = 0.0
    """Inclination of the orbit around the oblate Earth, from 0 to 180 degrees."""
    argument_of_latitude_degrees: tuple[float, float] = (0.0, 360.0)
    """Range of the target's angle from the ascending node at the start, degrees; only with an oblate Earth."""
    target_drag: float = 0.0
    """Acceleration by which the air slows the target down, m/s^2: half of density times speed squared, over its
    ballistic coefficient."""
    ballistic_ratio: float = 1.0
    """Ballistic coefficient (mass over drag coefficient and area) of the craft, divided by that of the target.
    Below 1 the air slows the craft down more than the target."""
    gravity_gradient: bool = False
    """Whether the gradient of gravity turns the craft: with its largest axis of inertia across the orbit, and its
    smallest along the radius."""

    def __post_init__(self) -> None:
        e, size, angles = self.eccentricity, self.semi_major_axis_km, self.true_anomaly_degrees
        if not is_finite(e) or not 0.0 <= e <= MOST_ECCENTRIC:
            raise ConfigError(
                f"the eccentricity of a target's orbit must be from 0 to {MOST_ECCENTRIC}, got {e!r}."
            )
        if not is_finite(size) or size < 0.0:
            raise ConfigError(
                f"semi_major_axis_km must be a finite number > 0 km, or 0 for none, got {size!r}."
            )
        if size:
            self._check_perigee(
                size, "the usual cause is an altitude in place of the semi-major axis"
            )
        for name in ("true_anomaly_degrees", "argument_of_latitude_degrees"):
            angles = getattr(self, name)
            if (
                not (isinstance(angles, tuple) and len(angles) == 2 and all(map(is_finite, angles)))
                or angles[0] > angles[1]
            ):
                raise ConfigError(
                    f"{name} must be a range (low, high) of finite numbers, got {angles!r}."
                )
        self._check_perturbations()

    def _check_perturbations(self) -> None:
        """Refuse impossible inclinations and drags, and ellipses and gradients of gravity with either."""
        tilt, drag, ratio = self.inclination_degrees, self.target_drag, self.ballistic_ratio
        if not is_finite(tilt) or not 0.0 <= tilt <= 180.0:
            raise ConfigError(f"inclination_degrees must be from 0 to 180 degrees, got {tilt!r}.")
        if not is_finite(drag) or drag < 0.0:
            raise ConfigError(
                f"target_drag must be a finite number >= 0 m/s^2, got {drag!r}; it is the size of an acceleration."
            )
        if drag > _LARGEST_DRAG:
            raise ConfigError(
                f"target_drag must be at most {_LARGEST_DRAG:g} m/s^2, got {drag:g}: about 4e-7 is usual at "
                "500 km, and a target with more than the bound falls out of its orbit. The usual cause is an "
                "exponent that was left out."
            )
        positive("ballistic_ratio", ratio)
        if drag and ratio == 1.0:
            raise ConfigError(
                f"target_drag is {drag:g} m/s^2, but with a ballistic_ratio of 1 air slows craft and target down "
                "alike, and nothing changes: set ballistic_ratio too, or leave target_drag out."
            )
        if tilt and not self.oblate:
            raise ConfigError(
                f"inclination_degrees is {tilt:g} degrees, but only an oblate Earth has an axis: set oblate = true."
            )
        if self.eccentricity and self.is_perturbed:
            raise ConfigError(
                f"an oblate Earth and drag are computed near circular orbits, and the eccentricity is "
                f"{self.eccentricity:g}: leave out one of them."
            )
        if self.gravity_gradient and self.is_perturbed:
            raise ConfigError(
                "gravity_gradient is that of a sphere without drag, and the orbit has an oblate Earth or drag: "
                "leave out one of them."
            )

    @property
    def drag(self) -> float:
        """Acceleration by which the air slows the craft down more than the target, m/s^2."""
        return self.target_drag * (1.0 / self.ballistic_ratio - 1.0)

    @property
    def is_perturbed(self) -> bool:
        """Whether the Earth is oblate, or drag differs."""
        return self.oblate or self.drag != 0.0

    @property
    def is_steady(self) -> bool:
        """Whether relative motion does not depend on where the target is on its orbit."""
        return not (self.eccentricity or self.is_perturbed)

    def motion(self, mean_motion: float, angle: Field) -> Drift:
        """Relative motion near the target.

        Args:
            mean_motion: mean motion, rad/s.
            angle: where the target is, rad: its mean anomaly on an ellipse, its argument of latitude elsewhere.
        """
        if self.eccentricity:
            return EllipticOrbit(mean_motion, self.eccentricity, angle, self.gravity_gradient)
        if not self.is_perturbed:
            return ClohessyWiltshire(mean_motion, self.gravity_gradient)
        tilt = math.radians(self.inclination_degrees)
        orbit = PerturbedOrbit.around_earth(mean_motion, tilt, self.drag, angle)
        return orbit if self.oblate else replace(orbit, oblateness=0.0)

    def mean_motion(self, otherwise: float) -> float:
        """Mean motion, rad/s, of the semi-major axis; without one, the other number.

        Raises:
            ConfigError: with the other number the perigee of the ellipse is within the Earth.
        """
        if not self.semi_major_axis_km:
            if self.eccentricity and is_finite(otherwise) and otherwise > 0.0:
                size = 1e-3 * math.cbrt(EARTH / otherwise**2)
                self._check_perigee(size, "that is the mission's own size: set semi_major_axis_km")
            return otherwise
        return math.sqrt(EARTH / (1e3 * self.semi_major_axis_km) ** 3)

    def _check_perigee(self, size: float, advice: str) -> None:
        """Refuse a semi-major axis, km, whose perigee is within the Earth."""
        perigee = size * (1.0 - self.eccentricity)
        if perigee < _EARTH_RADIUS:
            raise ConfigError(
                f"an orbit with a semi-major axis of {size:g} km and an eccentricity of {self.eccentricity:g} has "
                f"its perigee at {perigee:.0f} km from the Earth's centre, inside the Earth ({_EARTH_RADIUS:g} "
                f"km); {advice}."
            )

    @property
    def first_angle(self) -> float:
        """Lowest angle of the range at the start, rad; see `motion`."""
        if self.eccentricity:
            return mean_anomaly(math.radians(self.true_anomaly_degrees[0]), self.eccentricity)
        return math.radians(self.argument_of_latitude_degrees[0])

    def angle(self, random: Random) -> Field:
        """Where a start finds the target, rad: mean anomaly on an ellipse, argument of latitude on a circle."""
        if self.eccentricity:
            return mean_anomaly(
                random.uniform(*map(math.radians, self.true_anomaly_degrees)), self.eccentricity
            )
        return random.uniform(*map(math.radians, self.argument_of_latitude_degrees))


_CIRCLE = TargetOrbit()


@dataclass(frozen=True)
class AdvisedVelocityChange(InformationInW):
    """A change of velocity in W that guidance recommends for the control period that begins now."""


@dataclass(frozen=True)
class Plan:
    """What a goal of `OrbitalMission` notes: its times, and where the target is on its orbit."""

    deadline: Field
    """Time left until the deadline, s."""
    arrival: Field
    """Time left until the planned arrival, s."""
    won: Field
    """1 after success, else 0."""
    angle: Field | None = None
    """Mean anomaly of the target on an ellipse, its argument of latitude on another orbit along which motion
    changes, rad (`TargetOrbit.motion`); None: motion does not depend on it."""


@dataclass(frozen=True)
class OrbitalMission(SingleTask):
    """Base class of missions to a position near a target on an orbit by a deadline.

    W is the Hill frame of the target: x radially outwards, y along the track, z across it. The craft follows the
    Clohessy-Wiltshire equations; where `orbit` is another one, the goal notes the angle of the target on it
    (`Plan`). Every episode draws a deadline and fails if the mission has not
    succeeded by it.

    Every episode has a plan, which is the arrival time with the least velocity change
    (`rans_missions.guidance.arrival`). Plans that violate a limit on the way have a penalty. The velocity to gain
    is the velocity change now with which the craft coasts to the goal by the planned arrival. `guidance` says how
    a craft flies there: its velocities are observed, and its prices are those of rewards.

    Observed task data: vector to the goal, velocity to gain, velocity at the arrival after gaining it, miss
    distance of a coast to the planned arrival (saturated at ten tolerances), both times, and the entries of every
    shape in `scenery`.

    Rewards measure wasted velocity change: impulse has a price, and a decrease of the velocity to gain is
    rewarded by the same price. An impulse to the goal at the start of an episode therefore earns zero.

    Raises:
        ConfigError: the deadline is so late that the velocity to gain has no solution.
    """

    mean_motion: float = 0.001027
    """Mean motion n of the target's orbit, rad/s."""
    deadline: tuple[float, float] = (600.0, 2000.0)
    """Range of the deadline, s."""
    orbit: TargetOrbit = _CIRCLE
    """Orbit of the target; by default a circle around a sphere, without drag."""
    position_tolerance: float = 0.5
    """Distance from the goal at which the mission succeeds, m."""
    velocity_tolerance: float = 0.2
    """Speed at which the mission succeeds, m/s."""
    shortest_aim: float = 1.0
    """Least coasting time of the velocity to gain, s."""
    impulse_weight: float = 0.1
    """Reward lost per newton-second of thruster impulse."""
    gain_weight: float = 1.2
    """Reward per m/s by which the velocity to gain decreases, summed over the axes; by default the price of 1 m/s
    for 12 kg."""
    most_gain: ClassVar[float] = 1.0
    """Upper bound of the velocity to gain in rewards and observations, m/s."""
    fail_distance: float = 1000.0
    """Distance from the goal beyond which an episode fails, m."""
    thrust_weight: float = 0.0
    """Reward lost per step and open thruster; zero because impulse has a price."""

    goal_notes = Plan
    symmetric = False
    dimensions: ClassVar[tuple[Dimension, ...]] = (3,)
    optimal_problem = "rendezvous"
    braking_time: float = 20.0
    """Time between the latest planned arrival and the deadline, s; only of missions that brake."""
    braking: ClassVar[float] = 0.02
    """Acceleration along each axis with which the craft brakes, m/s^2; only of missions that brake."""
    speed_reserve: float = 0.03
    """Share of a speed limit that recommended velocities stay below it: the limit may fall within a period."""
    keep_out_reserve: ClassVar[float] = 4.0
    """Distance that recommended velocities keep from keep-out balls, m: coasts are checked at a few points."""
    brakes: ClassVar[bool] = False
    """Whether plans and rewards include the velocity change of braking at the arrival, and guidance brakes."""
    keeps: ClassVar[tuple[type[Shape], ...]] = (Ball, SpeedLimit)
    """Classes of the limits that recommended velocities keep."""
    stays: ClassVar[bool] = False
    """Whether success asks for staying within the tolerances after the arrival."""
    few_burns: ClassVar[bool] = False
    """Whether `guidance` flies transfers of few burns (`rans_missions.guidance.few_burns`); only of missions that
    brake."""
    ellipses: ClassVar[bool] = False
    """Whether the target may be on an ellipse."""

    def __post_init__(self) -> None:
        if self.orbit.eccentricity and not self.ellipses:
            raise ConfigError(
                f"{type(self).__name__} flies near circular orbits, and the eccentricity is "
                f"{self.orbit.eccentricity:g}; dock flies on ellipses."
            )
        object.__setattr__(self, "mean_motion", self.orbit.mean_motion(self.mean_motion))
        super().__post_init__()
        latest = self.deadline[1]
        bound = 0.95 * self.half_turn / self.mean_motion
        if isinstance(latest, int | float) and latest >= bound:
            raise ConfigError(
                f"deadline must be < {bound:.0f} s, got {self.deadline!r}: 0.95 of the least time in which the "
                "target makes half a turn, after which the velocity to gain has no solution."
            )

    @property
    def stay_seconds(self) -> float:
        """Time for which success asks the craft to stay within the tolerances after its arrival, s."""
        return 0.0

    @property
    def half_turn(self) -> float:
        """Least change of the mean anomaly, rad, in which the target makes half a turn."""
        return math.pi

    @property
    def drift(self) -> Drift:
        """Equations of relative motion on the target's orbit, from the first angle of its range on."""
        return self.orbit.motion(self.mean_motion, self.orbit.first_angle)

    def drift_at(self, goal: State) -> Drift:
        """Equations of relative motion on the target's orbit from now on."""
        if self.orbit.is_steady:
            return self.drift
        return self.orbit.motion(self.mean_motion, goal.notes.angle)

    def planned(self, random: Random, start: State, goal: State) -> State:
        """Goal with a drawn deadline and the plan for a start in its notes."""
        if not self.orbit.is_steady:
            goal = replace(goal, notes=self.goal_notes(0.0, 0.0, 0.0, self.orbit.angle(random)))
        return self.plan(start, goal, random.uniform(*self.deadline))

    def plan(self, start: State, goal: State, deadline: Field) -> State:
        """Goal with a deadline (s, a field), and the plan for a start in its notes, of which the angle stays."""
        angle = None if self.orbit.is_steady else goal.notes.angle
        unplanned = self.goal_notes(deadline, deadline, deadline * 0.0, angle)
        goal = replace(goal, notes=unplanned)
        guidance = self.guidance_at(goal)
        drift = guidance.drift
        if isinstance(drift, PerturbedOrbit):
            # Arrival times are compared without oblateness: it changes all prices alike, and each comparison
            # would integrate it some thirty times, in nine of ten lines of a generated kernel.
            guidance = replace(guidance, drift=replace(drift, oblateness=0.0))
        arrival = guidance.arrival(start, goal, deadline)
        return replace(goal, notes=replace(unplanned, arrival=arrival, won=deadline * 0.0))

    def guidance_at(self, goal: State) -> OrbitalGuidance:
        """Guidance that flies the mission from now on, from its settings.

        Plans of goals and the velocity that networks observe come of it, so that recorded flights rely on its
        settings.
        """
        kind = FewBurns if self.few_burns else SingleImpulse
        return kind(self, self.drift_at(goal), self.scenery(goal))

    def arrival(self, goal: State) -> Field:
        """Time until the planned arrival, s."""
        return goal.notes.arrival

    def later(self, goal: State, time: Field) -> State:
        """Goal after a time (s, a field), with less time left, and the target farther on its orbit.

        It does not move.
        """
        notes: Plan = goal.notes
        angle = notes.angle
        drift = self.drift_at(goal).later(time)
        if isinstance(drift, UnevenOrbit):
            angle = drift.angle
        deadline, arrival = notes.deadline - time, notes.arrival - time
        return replace(goal, notes=replace(notes, deadline=deadline, arrival=arrival, angle=angle))

    def remember(self, goal: State, state: State) -> State:
        """Goal whose notes record whether the mission has succeeded."""
        won = where(self.done(state, goal), 1.0, goal.notes.won)
        return replace(goal, notes=replace(goal.notes, won=won))

    def afterwards(self, craft: Spacecraft, timing: Timing) -> Afterwards:
        """Stays from the arrival on, and plans again after a deadline that was missed."""
        return Afterwards(craft, self, timing)

    def velocity_to_gain(self, state: Any, goal: Any, left: Field) -> Any:
        """Velocity change in W, m/s, with which the craft coasts to the goal in the time left (s)."""
        time = at_least(left, self.shortest_aim)
        return velocity_to_reach(self.drift_at(goal), state.p, goal.p, time) - state.v

    def recommended(self, state: Any, goal: Any, left: Field) -> Any:
        """Velocity in W, m/s, with which `guidance` goes to the goal in the time left, s, within the limits."""
        return self.guidance_at(goal).velocity(state, goal, left, goal.notes.deadline)

    def staying(self, state: Any, goal: Any, acceleration: Any = None) -> Any:
        """Velocity in W, m/s, with which a craft that has arrived stays at the goal, however long.

        Thrust balances a drag that is part of the drift.

        Args:
            state: state.
            goal: goal.
            acceleration: constant acceleration in W beside the drift, m/s^2; None: none.
        """
        drift = self.drift_at(goal)
        period = self.timing.control_period
        tolerances = self.position_tolerance, self.velocity_tolerance
        if isinstance(drift, PerturbedOrbit) and drift.drag:
            zero = 0.0 * state.p.x
            dragged = type(state.p)(zero, zero - drift.drag, *(zero for _ in state.p.columns()[2:]))
            acceleration = dragged if acceleration is None else acceleration + dragged
            drift = replace(drift, drag=0.0)
        return staying_velocity(drift, state, goal, period, *tolerances, acceleration)

    def observation_terms(self, state: Any, goal: Any) -> tuple[ObservationTerm, ...]:
        """Vector to the goal, velocities to gain and of arrival, miss distance, times left, limits' entries.

        In SI units and the target's frame. Agents' files record the kinds and order of terms.
        """
        deadline, arrival = goal.notes.deadline, goal.notes.arrival
        gain = self.velocity_to_gain(state, goal, arrival)
        time = at_least(arrival, self.shortest_aim)
        drift = self.drift_at(goal)
        _, at_goal = drift.carry(state.p, state.v + gain, time)
        missed = goal.p - drift.carry(state.p, state.v, time)[0]
        advised = self.recommended(state, goal, arrival) - state.v
        # The velocity to gain is unbounded just before an arrival that misses the goal.
        nearby = 0.1 / self.position_tolerance
        # Whatever grows without bound is scaled, so that a network sees numbers of one size.
        scale = 1.0 / at_least(gain.norm() * (1.0 / self.most_gain), 1.0)
        return (
            VectorInW("d", "m", goal.p - state.p),
            VectorInW(
                "gain_",
                "m/s",
                gain.scale(scale),
                meaning="velocity with which the craft coasts to the goal in the time to arrival, minus own, "
                f"divided by 1 or, if more, its length over {self.most_gain:g} m/s",
            ),
            InformationInW(
                "arrival_v_",
                "m/s",
                at_goal.scale(scale),
                meaning="velocity with which that coast arrives, divided by the same number",
            ),
            InformationInW(
                "miss_",
                "m",
                missed.scale(1.0 / (1.0 + missed.norm() * nearby)),
                meaning="position of the goal minus that of the craft after a coast of the time to arrival, "
                f"divided by 1 plus its length times {nearby:g} 1/m",
            ),
            Information("time left", "s", deadline, meaning="time until the mission must be over"),
            Information(
                "time to arrival",
                "s",
                arrival,
                meaning="time until the arrival that guidance plans",
            ),
            AdvisedVelocityChange(
                "advised_dv_",
                "m/s",
                advised,
                meaning="velocity that guidance recommends, minus own",
            ),
            *(
                entry
                for name, shape in self.limits(goal).items()
                for entry in shape.entries(name, state)
            ),
            *self._angle_terms(goal),
        )

    def _angle_terms(self, goal: Any) -> tuple[ObservationTerm, ...]:
        """Cosine and sine of the target's angle, or () where the orbit is steady: fixed for each setting.

        Files of agents have the observation's columns in this order, with these names.
        """
        if self.orbit.is_steady:
            return ()
        angle, what = (
            "anomaly",
            "the target's mean anomaly, which grows evenly from 0 at the perigee",
        )
        if not self.orbit.eccentricity:
            angle = "argument of latitude"
            what = "the target's argument of latitude, its angle from the ascending node"
        return tuple(
            Information(
                f"{name} of the {angle}", "", f(goal.notes.angle), meaning=f"{name} of {what}"
            )
            for name, f in (("cosine", cos), ("sine", sin))
        )

    def reward(self, transition: Transition) -> dict[str, Field]:
        """Terms (fields): decrease of the velocity to gain, m/s, less the price of impulse."""
        goal = transition.goal
        arrival, won = goal.notes.arrival, goal.notes.won
        terms = {}
        if is_used(self.impulse_weight):
            terms["impulse"] = transition.impulse * -self.impulse_weight
        if is_used(self.gain_weight):
            before = transition.state if transition.before is None else transition.before
            past = self._counted(before, goal, arrival + transition.period)
            now = self._counted(transition.state, goal, arrival)
            # After success nothing is left to gain, whatever happens in the rest of the period.
            terms["gain"] = (past - where(won > 0.5, 0.0, now)) * self.gain_weight
        return {**terms, **self.prices(transition)}

    def _counted(self, state: Any, goal: Any, left: Field) -> Field:
        """Velocity to gain as rewards count it, m/s: the price of `guidance`, at most `most_gain`."""
        price = self.guidance_at(goal).price(state, goal, left)
        return where(price < self.most_gain, price, self.most_gain)

    def done(self, state: State, goal: State) -> Field:
        """Whether the state is within all tolerances before the deadline."""
        return self.reached(state, goal) & (goal.notes.deadline > -TIME_ROUNDING)

    def failed(self, state: State, goal: State) -> Field:
        """Whether the craft is too far away, or the deadline has passed."""
        distance = self.errors(state, goal)["position"]
        return (distance > self.fail_distance) | (goal.notes.deadline < TIME_ROUNDING)
