"""Flights around the paper's circle by a velocity tracker with its look-ahead planner, and their tracking errors.

Errors are measured after the approach alone, (T, N) by step and flight; quantities are those of the paper.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rans.choices import EngineName
from rans.evaluation.fly.episodes import fly_episodes
from rans.extend import (
    MOST_STEPS,
    ConfigError,
    Controller,
    Drift,
    Flight,
    Random,
    Sample,
    Setup,
    Spacecraft,
    State,
    Table,
    Task,
    Timing,
    positive,
)

RADIUS = 1.5
"""m: radius of the circle, about the origin and counter-clockwise from (1.5, 0), as in the original system."""
START_SPREAD = 0.2
"""Largest distance of a start from the circle's first point, m."""
_LEAST_WAY = 0.75
"""Way of a flight, as a share of the way along the circle, below which it has cut across. A tracker without error
flies around a circle of radius R at sqrt(R^2 - L^2) for the look-ahead L: 0.99 R for the paper's, 0.75 R for
L = 0.66 R."""
_PATIENCE = 1.5
_GRACE = 10.0
"""Factor on the duration of a flight at full speed, and seconds added to it: the time that a flight has."""


@dataclass(frozen=True)
class LookAhead:
    """The paper's planner (section 4.2): fly towards the farthest point of the circle within a distance.

    Where no point is that near it is the closest one. Progress is the angle (rad) along the circle that a flight
    has come to: it moves on to the closest point within a window beyond it, and never goes back, so that a flight
    that is blown across the circle takes no short cut.

    Raises:
        ConfigError: the speed is not a finite number > 0, or the distance not one up to the circle's radius.
    """

    speed: float = 0.25
    """Length of the velocity command, m/s (paper: 0.25)."""
    distance: float = 0.25
    """Look-ahead distance, m (paper: 0.25)."""

    def __post_init__(self) -> None:
        positive("speed", self.speed)
        positive("look_ahead", self.distance)
        if self.distance > RADIUS:
            raise ConfigError(
                f"the look-ahead must be at most {RADIUS:g} m, the radius of the circle, got {self.distance:g}: "
                "the craft would cut across it."
            )

    @property
    def window(self) -> float:
        """Angle beyond the progress that is searched, rad: one and a half distances, at most half of the circle."""
        return min(1.5 * self.distance / RADIUS, math.pi)

    @property
    def approach(self) -> float:
        """Angle that is passed before errors count, rad: four distances, at most half of the circle.

        A perfect follower's distance from a straight path falls to 1/e over one distance, so that 2 % of the
        start's are left.
        """
        return min(4.0 * self.distance / RADIUS, math.pi)

    @property
    def end(self) -> float:
        """Progress at the end of a flight, rad: the approach and a lap."""
        return math.tau + self.approach

    def plan(self, position: np.ndarray, progress: np.ndarray) -> tuple[np.ndarray, ...]:
        """Plan a period: the new progress (N,) and the target's angle (N,), rad, and the command (N, d), m/s.

        Positions are (N, d), m, from progresses (N,). The command is zero at the end.
        """
        ahead = _ahead(position, progress, 0.5 * self.window)
        closest = progress + np.clip(ahead, 0.0, self.window)
        # Points at an angle up to ``reach`` from the craft are within the distance; nan: none is.
        aside = np.linalg.norm(position[:, :2], axis=1)
        squares = RADIUS**2 + (position * position).sum(axis=1) - self.distance**2
        with np.errstate(invalid="ignore", divide="ignore"):
            reach = np.arccos(np.maximum(squares / (2.0 * RADIUS * aside), -1.0))
        farthest = np.minimum(progress + ahead + reach, closest + self.window)
        first = progress + ahead - reach
        is_near = (farthest >= closest) & (first <= closest + self.window)
        target = np.where(is_near, farthest, closest)
        way = _points(target, position.shape[1]) - position
        # A target at the position itself has no direction.
        length = np.maximum(np.linalg.norm(way, axis=1), 1e-9)
        speed = np.where(closest < self.end, self.speed, 0.0)
        return closest, target, way * (speed / length)[:, None]

    def cross_track(self, position: np.ndarray, progress: np.ndarray) -> np.ndarray:
        """Distance (N,) m of positions (N, d) from the part of the circle within the look-ahead of progresses."""
        reach = self.distance / RADIUS
        nearest = progress + np.clip(_ahead(position, progress, 0.0), -reach, reach)
        return np.linalg.norm(position - _points(nearest, position.shape[1]), axis=1)


def _points(angle: np.ndarray, dimension: int) -> np.ndarray:
    """Points (N, d) of the circle at angles (N,), m; in space z is 0."""
    points = np.zeros((len(angle), dimension))
    points[:, 0] = RADIUS * np.cos(angle)
    points[:, 1] = RADIUS * np.sin(angle)
    return points


def _ahead(position: np.ndarray, progress: np.ndarray, middle: float) -> np.ndarray:
    """Angles (N,) from progresses (N,) to positions (N, d), within half a turn of a middle one, rad."""
    angle = np.arctan2(position[:, 1], position[:, 0]) - progress
    return np.mod(angle - middle + math.pi, math.tau) - math.pi + middle


def _tracker(method: str) -> Any:
    """A method of `Guided` that calls the same method of the tracker's task."""
    return lambda self, *arguments: getattr(self.task, method)(*arguments)


@dataclass(frozen=True)
class Progress:
    """What a goal of `Guided` notes."""

    angle: Any
    """(N,) angle along the circle that each flight has come to, rad."""


@dataclass(frozen=True)
class Guided(Task):
    """A velocity tracker's task whose goal is the planner's velocity command."""

    task: Task
    """Task of the tracker."""
    planner: LookAhead

    goal_notes = Progress
    flag_of = _tracker("flag_of")
    observation_terms = _tracker("observation_terms")
    errors = _tracker("errors")
    tolerances = _tracker("tolerances")
    reward = _tracker("reward")
    failed = _tracker("failed")

    @property
    def drift(self) -> Drift:
        """Drift of the tracker's task."""
        return self.task.drift

    def sample(self, random: Random) -> tuple[State, State]:
        """Start at rest near the circle's first point, and the first command."""
        origin: Any = random.origin()
        first = replace(origin, x=origin.x + RADIUS)
        offset = random.direction().scale(random.uniform(0.0, START_SPREAD))
        start: Any = random.at_rest(first + offset, random.attitude())
        goal: Any = random.at_rest(random.origin(), random.no_rotation())
        begun = replace(goal, notes=Progress(np.zeros(len(start.p.x))))
        return start, self.remember(begun, start)

    def remember(self, goal: Any, state: State) -> Any:
        """The planner's command at the position of the spacecraft."""
        position = np.stack(state.p.columns(), axis=1)
        progress, _, command = self.planner.plan(position, goal.notes.angle)
        return replace(goal, v=type(goal.v)(*command.T), notes=Progress(progress))


@dataclass(frozen=True)
class Following:
    """N flights around the circle.

    Errors count from the end of the approach (`LookAhead.approach`) to the end of the lap. A flight
    that never leaves the approach is judged on its last instant.
    """

    planner: LookAhead
    flight: Flight
    """Motion of all flights for the full time, even after their arrival."""

    @property
    def progress(self) -> np.ndarray:
        """(T, N) progress of each flight at each command, rad."""
        return self.flight.goals.notes.angle[:-1]

    @property
    def commands(self) -> np.ndarray:
        """(T, N, d) velocity commands, m/s."""
        return np.stack(self.flight.goals.v.columns(), axis=2)[:-1]

    @property
    def positions(self) -> np.ndarray:
        """(T + 1, N, d) m."""
        return np.stack(self.flight.states.p.columns(), axis=2)

    @property
    def velocities(self) -> np.ndarray:
        """(T + 1, N, d) m/s."""
        return np.stack(self.flight.states.v.columns(), axis=2)

    @property
    def cross_track(self) -> np.ndarray:
        """(T, N) distance from the circle at each command, m."""
        instants = zip(self.positions, self.progress, strict=False)
        return np.stack([self.planner.cross_track(*instant) for instant in instants])

    @property
    def measured(self) -> np.ndarray:
        """(T, N) whether errors of the period count."""
        inside = (self.progress >= self.planner.approach) & (self.progress < self.planner.end)
        inside[-1] |= ~inside.any(axis=0)
        return inside

    @property
    def durations(self) -> np.ndarray:
        """(N,) time from the start to the end of the lap, approach included, s; infinite if never.

        A flight that has cut across the circle, so that its own way is much shorter, has not followed it.
        """
        waited = (self.progress < self.planner.end).sum(axis=0)
        arrives = waited < len(self.progress)
        steps = np.linalg.norm(np.diff(self.positions, axis=0), axis=2)
        flown = np.cumsum(np.concatenate([0.0 * steps[:1], steps]), axis=0)
        arrival_times = flown[np.where(arrives, waited, 0), np.arange(len(waited))]
        arrives &= arrival_times >= _LEAST_WAY * self.planner.end * RADIUS - START_SPREAD
        period = self.flight.timing.control_period
        return np.where(arrives, waited * period, np.inf)

    def quantities(self) -> tuple[Sample, ...]:
        """Samples (N,) of the tracking errors in cm, cm/s and %: the approach to the path does not count."""
        counts = self.measured
        reached = self.velocities[1:]
        aim = self.planner.speed

        def mean(values: np.ndarray) -> np.ndarray:
            return (values * counts).sum(axis=0) / counts.sum(axis=0)

        distance = self.cross_track
        speed = np.linalg.norm(reached, axis=2)
        late = 100.0 * mean(np.linalg.norm(reached - self.commands, axis=2))
        # Root mean squares and means are over the measured part of each flight alone.
        root = np.sqrt(mean(distance**2))
        farthest = (distance * counts).max(axis=0)
        off = mean(np.abs(speed - aim))
        duty = 100.0 * mean(self.flight.openings.mean(axis=2))
        return tuple(
            Sample("path", name, meaning, unit, values)
            for name, meaning, unit, values in (
                (
                    "cross-track RMS",
                    "root mean square distance from the circle",
                    "cm",
                    100.0 * root,
                ),
                ("cross-track maximum", "largest distance from the circle", "cm", 100.0 * farthest),
                ("velocity error", "mean distance from the command one period later", "cm/s", late),
                ("speed error", f"mean difference from {aim:g} m/s", "cm/s", 100.0 * off),
                ("duration", "time for the approach and one lap", "s", self.durations),
                ("duty", "mean duty cycle of the thrusters", "%", duty),
            )
        )

    def title(self) -> str:
        """Title in one line: tracker, path and arrivals."""
        arrived = int(np.isfinite(self.durations).sum())
        return (
            f"{self.flight.controller} along circle ({math.tau * RADIUS:.1f} m): {arrived} of "
            f"{len(self.durations)} flights arrive"
        )

    def table(self) -> Table:
        """A row for each quantity: mean and worst of the flights.

        "never" where a flight does not reach the end.
        """
        rows = [
            (
                sample.name,
                *(f"{x:.3g} {sample.unit}" if math.isfinite(x) else "never" for x in ends),
                sample.meaning,
            )
            for sample in self.quantities()
            for ends in [(sample.values.mean(), sample.values.max())]
        ]
        return Table(("quantity", "mean", "worst flight", "meaning"), rows, self.title())

    def to_json(self) -> dict[str, Any]:
        """Data for `rans.files.write_json` (SI); the duration of a flight that never arrived is infinite."""
        flight = self.flight
        rows = [
            {
                "name": sample.name,
                "meaning": sample.meaning,
                "unit": sample.unit,
                "mean": float(sample.values.mean()),
                "worst": float(sample.values.max()),
                "flights": sample.values.tolist(),
            }
            for sample in self.quantities()
        ]
        return {
            "title": self.title(),
            "path": "circle",
            "length": math.tau * RADIUS,
            "closed": True,
            "speed": self.planner.speed,
            "look_ahead": self.planner.distance,
            "spacecraft": flight.craft.name,
            "control_period": flight.timing.control_period,
            "quantities": rows,
        }


def fly_circle(
    craft: Spacecraft,
    task: Task,
    tracker: Controller,
    planner: LookAhead,
    timing: Timing,
    seed: int,
    count: int,
    engine: EngineName = "fast",
) -> Following:
    """Fly around the circle, in float64.

    Flights start at rest with any attitude, up to `START_SPREAD` from the circle's first point.

    Args:
        craft: spacecraft.
        task: task for which the tracker was made.
        tracker: controller that tracks velocities.
        planner: speed and look-ahead.
        timing: timing with the control period; its length is replaced by the time that all flights need.
        seed: seed of the starts.
        count: number of flights.
        engine: engine that computes the motion.

    Raises:
        ConfigError: the tracker does not track velocities or not such fast ones.
    """
    # What the tracker must be, and be able to do.
    speeds: Any = getattr(task, "target_speed", None)
    if "track-velocity" in task.parts():
        raise ConfigError(
            f"{tracker.name} has several tasks: pick one, as in {tracker.name}#track-velocity."
        )
    if speeds is None or task.tolerances().keys() != {"velocity"}:
        raise ConfigError(
            "only an agent trained for track-velocity can follow a path, but "
            f"{tracker.name} was trained for another task."
        )
    if planner.speed > speeds[1]:
        raise ConfigError(
            f"the speed must be at most the {speeds[1]:g} m/s that {tracker.name} was trained "
            f"for, got {planner.speed:g}."
        )
    # A time in which every flight reaches the end of the lap.
    seconds = _PATIENCE * planner.end * RADIUS / planner.speed + _GRACE
    if (steps := math.ceil(seconds / timing.control_period)) > MOST_STEPS:
        raise ConfigError(
            f"at {planner.speed:g} m/s the circle takes {steps:,} control "
            f"periods, of which a flight has at most {MOST_STEPS:,}: fly faster."
        )
    long_enough = replace(timing, episode_steps=steps)
    setup = Setup(craft, Guided(task, planner), long_enough)
    return Following(planner, fly_episodes(tracker, setup, seed, count, engine))
