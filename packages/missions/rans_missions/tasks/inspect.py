"""Inspect a target on a circular orbit: see nearly all points of its surface in sunlight from a safe distance.

Points, order of columns and random numbers are trained: `tests/tasks/test_inspect.py` has them by hand.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from operator import add
from typing import Any, ClassVar

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
    Quantity,
    Random,
    Scalar,
    Shape,
    SingleTask,
    State,
    Timing,
    Transition,
    Vec3,
    Vector,
    VectorInW,
    at_least,
    cos,
    declare,
    is_used,
    sin,
    sqrt,
    where,
)
from rans_missions.passive_safety import CoastZone

declare(
    Quantity(
        name="unseen",
        unit="-",
        display_unit="%",
        display_factor=100.0,
        time_within=("UT", (50, 20, 10, 5)),
        threshold=0.05,
        threshold_texts=("5 %", "2.5 %", "38 %"),
        held=(20, 10, 5),
    )
)

WORD = 20
"""Points per number of an episode's memory, one bit each; single precision represents 24 bits exactly."""


@dataclass(frozen=True)
class Inspected:
    """What a goal of `Inspect` notes."""

    sun: Field
    """Angle of the sun in the plane of the orbit, in W from x towards y, rad."""
    count: Field
    """Number of points inspected."""
    words: tuple[Field, ...]
    """One bit per point, 1 once it is inspected, packed in whole numbers of `WORD` bits."""


@dataclass(frozen=True)
class Inspect(SingleTask):
    """See the points of a target's surface in sunlight from a safe distance.

    >>> rans.load_task("inspect").tolerances()
    {'unseen': 0.05}

    W is the Hill frame of the target: x radially outwards, y along the track, z across it. The target is at its
    origin and does not rotate in it. Points lie on a sphere around the target, on a Fibonacci lattice. The camera
    of the craft always points at the target. A point counts as seen after the first check at which the craft is
    within the view cone of the point and the sun within its light cone. Both are cones around the normal of the
    point; with the default angles both craft and sun must be above its horizon.

    The sun lies in the plane of the orbit and rotates at -n in W; episodes draw its initial angle. Success: all
    but 5 % of the points have been seen. Constraint: the centre of the craft is at least `keep_out` from the
    target.

    Start: 50 to 100 m away in a uniform direction, without rotation, with a velocity in a uniform direction of up
    to 0.8 of 2 n r at the distance r. An episode lasts two orbits, in periods of 20 s with a check every 10 s.

    The goal is the centre of the target. It notes the sun and the points seen (`Inspected`).

    Observed task data: vector to the target and direction of the sun (W), share of unseen points, mean normal of
    the unseen points and of the lit ones among them (W), and margin of the keep-out ball.

    Source: Inspection-v0 of the benchmark of the Air Force Research Laboratory (safe-autonomy-sims 6d71f7e):
    100 points on a sphere of 10 m, sun at -n, starts, speeds, and 800 m. The crash radius of 15 m is that of its
    code (its page has 10 m). Success there is 95 % of the weight of the points, and the control period is 10 s.
    """

    mean_motion: float = 0.001027
    """Mean motion n of the target's orbit, rad/s."""
    points: int = 100
    """Number of points."""
    surface_distance: ClassVar[float] = 10.0
    """Radius of the sphere of points, m."""
    view_degrees: float = 90.0
    """Largest angle at a point between its normal and the craft, degrees."""
    light_degrees: float = 90.0
    """Largest angle at a point between its normal and the sun, degrees."""
    keep_out: float = 15.0
    """Least distance from the target's centre, m."""
    spawn_distance: tuple[float, float] = (50.0, 100.0)
    """Range of the start's distance from the target, m."""
    start_speed: tuple[float, float] = (0.0, 0.8)
    """Range of the start's speed as a share of 2 n times the distance."""
    unseen_tolerance: float = 0.05
    """Share of unseen points below which the mission succeeds."""
    unseen_weight: float = 1.0
    """Reward lost per control period times the share of unseen points."""
    impulse_weight: float = 0.05
    """Reward lost per newton-second of thruster impulse."""
    done_weight: float = 5.0
    violation_weight: float = 50.0
    fail_distance: float = 800.0
    """Distance from the target beyond which an episode fails, m."""
    thrust_weight: float = 0.0
    """Reward lost per step and open thruster; zero because impulse has a price."""

    goal_notes = Inspected
    optimal_problem = "inspection"
    symmetric = False
    flag = 11
    dimensions: ClassVar[tuple[Dimension, ...]] = (3,)
    spacecraft: ClassVar[str | None] = "afrl-deputy"
    timing: ClassVar[Timing] = Timing(control_period=20.0, episode_steps=612, checks=2)

    def __post_init__(self) -> None:
        if type(self.points) is not int or not 1 <= self.points <= 200:
            raise ConfigError(f"points must be a whole number from 1 to 200, got {self.points!r}.")
        super().__post_init__()
        for name in ("view_degrees", "light_degrees"):
            angle = getattr(self, name)
            if isinstance(angle, int | float) and angle > 90.0:
                raise ConfigError(
                    f"{name} must be at most 90 degrees, got {angle:g}: a point is not visible below its horizon."
                )
        if isinstance(self.keep_out, int | float) and self.keep_out <= self.surface_distance:
            raise ConfigError(
                f"keep_out must exceed surface_distance, {self.surface_distance:g} m, got {self.keep_out:g} m: "
                "the craft would be inside the target."
            )

    @property
    def drift(self) -> Drift:
        """Clohessy-Wiltshire equations of the target's orbit."""
        return ClohessyWiltshire(self.mean_motion)

    @cached_property
    def normals(self) -> tuple[tuple[float, float, float], ...]:
        """Unit normals of the points in W: a Fibonacci lattice with even steps in z and the golden angle."""
        golden = math.pi * (3.0 - math.sqrt(5.0))
        normals = []
        for k in range(self.points):
            height = 1.0 - (2 * k + 1) / self.points
            across = math.sqrt(1.0 - height * height)
            normals.append((across * math.cos(golden * k), across * math.sin(golden * k), height))
        return tuple(normals)

    @property
    def coast_zone(self) -> CoastZone:
        """The keep-out ball, always."""
        return CoastZone(self.keep_out)

    def sample(self, random: Random) -> tuple[State, State]:
        """Start around the target (W, m), and a goal that notes the sun's angle and that no point is seen.

        Starts of published comparisons depend on the order of these draws.
        """
        distance = random.uniform(*self.spawn_distance)
        speed = distance * random.uniform(*self.start_speed) * (2.0 * self.mean_motion)
        position = random.direction().scale(distance)
        velocity = random.direction().scale(speed)
        start = replace(random.moving(velocity, random.no_rotation()), p=position)
        goal = random.at_rest(random.origin(), random.no_rotation())
        sun = random.uniform(-math.pi, math.pi)
        words = -(-self.points // WORD)
        return start, replace(goal, notes=Inspected(sun, sun * 0.0, (sun * 0.0,) * words))

    def later(self, goal: State, time: Field) -> State:
        """Goal after a time (s), in which the sun rotates."""
        sun = goal.notes.sun - time * self.mean_motion
        return replace(goal, notes=replace(goal.notes, sun=sun))

    def remember(self, goal: State, state: State) -> State:
        """Goal with the points that are visible now added to those seen; words of bits, see `_known`."""
        now = self.visible(goal, state)
        counted: Field = 0.0
        remembered = []
        for word, bits in zip(goal.notes.words, self._known(goal), strict=True):
            packed = word * 0.0
            for bit, before in enumerate(bits):
                is_inspected = before | now[len(remembered) * WORD + bit]
                packed = where(is_inspected, packed + float(2**bit), packed)
                counted = counted + where(is_inspected, packed * 0.0 + 1.0, packed * 0.0)
            remembered.append(packed)
        return replace(goal, notes=Inspected(goal.notes.sun, counted, tuple(remembered)))

    def visible(self, goal: State, state: State) -> list[Field]:
        """Whether each point is lit and within the view of the craft, one field per point."""
        radius = self.surface_distance
        p = state.p
        square = p.dot(p) + radius * radius
        sun = self.sun(goal)
        view = math.cos(math.radians(self.view_degrees))
        light = math.cos(math.radians(self.light_degrees))
        visible = []
        for normal in self.normals:
            along = p.dot(Vec3(*normal))
            distance_along = sqrt(at_least(square - along * (2.0 * radius), 0.0))
            visible.append(
                (along - radius > distance_along * view) & (sun.dot(Vec3(*normal)) > light)
            )
        return visible

    def sun(self, goal: State) -> Vec3:
        """Unit vector towards the sun in W."""
        angle = goal.notes.sun
        return Vec3(cos(angle), sin(angle), angle * 0.0)

    def unseen(self, goal: State) -> Field:
        """Share of the points that have not been seen."""
        return (float(self.points) - goal.notes.count) * (1.0 / self.points)

    def _known(self, goal: State) -> list[list[Field]]:
        """Whether each point was seen, 0 or 1 by word and bit, the inverse of what `remember` packs."""
        words: list[list[Field]] = []
        for k, word in enumerate(goal.notes.words):
            bits = min(WORD, self.points - k * WORD)
            rest = word
            seen_in_word: list[Field] = []
            for bit in reversed(range(bits)):
                is_set = rest > 2.0**bit - 0.5
                rest = where(is_set, rest - 2.0**bit, rest)
                seen_in_word.append(is_set)
            words.append(seen_in_word[::-1])
        return words

    def limits(self, goal: State) -> dict[str, Shape]:
        """The keep-out ball around the target."""
        return {"keep-out": Ball(goal.p, goal.v, self.keep_out)}

    def markers(self, goal: State) -> tuple[tuple[Vector, Field], ...]:
        """Points of the target's surface, each with whether it has been seen."""
        seen = reduce(add, self._known(goal))
        return tuple(
            (goal.p + Vec3(*(self.surface_distance * x for x in normal)), is_inspected)
            for normal, is_inspected in zip(self.normals, seen, strict=True)
        )

    def constraints(self, state: State, goal: State) -> dict[str, Field]:
        """Distance from the keep-out ball, and from the end of the zone, m."""
        return {
            **super().constraints(state, goal),
            "zone": self.fail_distance - (state.p - goal.p).norm(),
        }

    done = SingleTask.reached  # whether enough points have been seen

    def observation_terms(self, state: Any, goal: Any) -> tuple[ObservationTerm, ...]:
        """Vector to the target, direction of the sun (W), and the unseen points; agents rely on the order."""
        sun = self.sun(goal)
        unlit, lit = self.directions(goal)
        return (
            VectorInW("d", "m", goal.p - state.p),
            InformationInW("sun ", "-", sun, meaning="unit vector towards the sun"),
            Scalar(
                "unseen",
                "-",
                self.unseen(goal),
                meaning="share of the points that have not been seen",
            ),
            InformationInW(
                "unseen ",
                "-",
                unlit,
                meaning="sum of the outward normals of unseen points, over the number of points",
            ),
            InformationInW(
                "unseen lit ",
                "-",
                lit,
                meaning="sum of the outward normals of unseen points in sunlight, over the number of points",
            ),
            *(
                Information(
                    "keep-out gap",
                    "m",
                    shape.gap(state.p),
                    meaning="distance from the surface of the keep-out zone, negative inside",
                )
                for shape in self.scenery(goal)
            ),
        )

    def directions(self, goal: State) -> tuple[Vec3, Vec3]:
        """Sums of the normals (W) of unseen points and of unseen lit points, over the number of all; observed."""
        inspected = reduce(add, self._known(goal))
        sun = self.sun(goal)
        light = math.cos(math.radians(self.light_degrees))
        zero = goal.notes.count * 0.0
        sums = [[zero, zero, zero], [zero, zero, zero]]
        for normal, is_inspected in zip(self.normals, inspected, strict=True):
            weight_of_point = where(is_inspected, zero, zero + 1.0 / self.points)
            lit = where(sun.dot(Vec3(*normal)) > light, weight_of_point, zero)
            for total, weight in zip(sums, (weight_of_point, lit), strict=True):
                for axis in range(3):
                    total[axis] = total[axis] + weight * normal[axis]
        return Vec3(*sums[0]), Vec3(*sums[1])

    def errors(self, state: State, goal: State) -> dict[str, Field]:
        """Share of the points that have not been seen."""
        return {"unseen": self.unseen(goal)}

    def reward(self, transition: Transition) -> dict[str, Field]:
        """Penalties of unseen points and of impulse in every control period."""
        terms = {"unseen": self.unseen(transition.goal) * -self.unseen_weight}
        if is_used(self.impulse_weight):
            terms["impulse"] = transition.impulse * -self.impulse_weight
        return terms | self.prices(transition)

    def failed(self, state: State, goal: State) -> Field:
        """Whether the craft is too far away."""
        return (state.p - goal.p).norm() > self.fail_distance
