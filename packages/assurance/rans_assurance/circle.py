"""Flights around the paper's circle by a velocity tracker with its look-ahead planner: their tracking errors."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rans.evaluation.fly.episodes import fly_episodes
from rans.evaluation.measure.aggregate import measure
from rans.extend import (
    ConfigError,
    Drift,
    Flight,
    LoadedRun,
    Metrics,
    Random,
    Sample,
    Setup,
    State,
    Task,
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
    """

    speed: float = 0.25
    """Length of the velocity command, m/s (paper: 0.25)."""
    distance: float = 0.25
    """Look-ahead distance, m (paper: 0.25)."""

    @property
    def window(self) -> float:
        """Angle beyond the progress that is searched, rad: one and a half distances."""
        return 1.5 * self.distance / RADIUS

    @property
    def approach(self) -> float:
        """Angle that is passed before errors count, rad: four distances.

        A perfect follower's distance from a straight path falls to 1/e over one distance, so that 2 % of the
        start's are left.
        """
        return 4.0 * self.distance / RADIUS

    @property
    def end(self) -> float:
        """Progress at the end of a flight, rad: the approach and a lap."""
        return math.tau + self.approach

    def plan(self, position: np.ndarray, progress: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Plan a period: the new progress (N,), rad, and the command (N, d), m/s, which is zero at the end.

        Positions are (N, d), m, from progresses (N,).
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
        way = _points(np.where(is_near, farthest, closest), position.shape[1]) - position
        # A target at the position itself has no direction.
        length = np.maximum(np.linalg.norm(way, axis=1), 1e-9)
        speed = np.where(closest < self.end, self.speed, 0.0)
        return closest, way * (speed / length)[:, None]

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
        progress, command = self.planner.plan(position, goal.notes.angle)
        return replace(goal, v=type(goal.v)(*command.T), notes=Progress(progress))


def fly_circle(run: LoadedRun, planner: LookAhead, seed: int, count: int) -> Flight:
    """Flights around the circle, of motion computed in float64, for the time that all of them need.

    They start at rest with any attitude, up to `START_SPREAD` from the circle's first point.

    Raises:
        ConfigError: the run does not track velocities, or not such fast ones.
    """
    task = run.task
    name = run.controller.name
    speeds: Any = getattr(task, "target_speed", None)
    if "track-velocity" in task.parts():
        raise ConfigError(f"{name} has several tasks: pick one, as in {name}#track-velocity.")
    if speeds is None or task.tolerances().keys() != {"velocity"}:
        raise ConfigError(
            "only an agent trained for track-velocity can follow a path, but "
            f"{name} was trained for another task."
        )
    if planner.speed > speeds[1]:
        raise ConfigError(
            f"{name} was trained for at most {speeds[1]:g} m/s, and the command is of {planner.speed:g} m/s."
        )
    seconds = _PATIENCE * planner.end * RADIUS / planner.speed + _GRACE
    timing = replace(run.timing, episode_steps=math.ceil(seconds / run.timing.control_period))
    setup = Setup(run.craft, Guided(task, planner), timing)
    return fly_episodes(run.controller, setup, seed, count)


def tracked(flight: Flight, planner: LookAhead) -> Metrics:
    """Tracking errors of N flights around the circle, whose goals are the planner's commands.

    Errors count from the end of the approach (`LookAhead.approach`) to the end of the lap. A flight that never
    leaves the approach is judged on its last instant.
    """
    return measure(flight, _errors(flight, planner))


def _errors(flight: Flight, planner: LookAhead) -> Iterator[Sample]:
    progress = flight.goals.notes.angle[:-1]
    commands = np.stack(flight.goals.v.columns(), axis=2)[:-1]
    positions = np.stack(flight.states.p.columns(), axis=2)
    reached = np.stack(flight.states.v.columns(), axis=2)[1:]
    counts = (progress >= planner.approach) & (progress < planner.end)
    counts[-1] |= ~counts.any(axis=0)

    def mean(values: np.ndarray) -> np.ndarray:
        return (values * counts).sum(axis=0) / counts.sum(axis=0)

    # A flight that has cut across the circle, so that its own way is much shorter, has not followed it.
    waited = (progress < planner.end).sum(axis=0)
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=2)
    flown = (steps * (np.arange(len(steps))[:, None] < waited)).sum(axis=0)
    arrives = waited < len(progress)
    arrives &= flown >= _LEAST_WAY * planner.end * RADIUS - START_SPREAD
    seconds = np.where(arrives, waited * flight.timing.control_period, np.inf)
    instants = zip(positions, progress, strict=False)
    distance = 100.0 * np.stack([planner.cross_track(*instant) for instant in instants])
    late = 100.0 * mean(np.linalg.norm(reached - commands, axis=2))
    off = 100.0 * mean(np.abs(np.linalg.norm(reached, axis=2) - planner.speed))
    duty = 100.0 * mean(flight.openings.mean(axis=2))
    root = np.sqrt(mean(distance**2))
    farthest = (distance * counts).max(axis=0)
    aim = f"mean difference from {planner.speed:g} m/s"
    along = "root mean square distance from the circle"
    group = f"circle of {RADIUS:g} m"
    yield Sample(group, "solved", "flies the approach and a lap", "%", arrives)
    yield Sample(group, "cross-track RMS", along, "cm", root)
    yield Sample(
        group, "cross-track maximum", "largest distance of any flight", "cm", farthest, np.max
    )
    yield Sample(group, "velocity error", "mean from the command a period later", "cm/s", late)
    yield Sample(group, "speed error", aim, "cm/s", off)
    yield Sample(group, "duration", "time for the approach and one lap", "s", seconds)
    yield Sample(group, "duty", "mean duty cycle of the thrusters", "%", duty)
