"""Flights along a path by a velocity tracker with the look-ahead planner, and their tracking errors.

Errors are measured after the approach alone, (T, N) by step and flight; quantities are those of the paper.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rans.evaluation.fly.episodes import fly_episodes
from rans.extend import (
    MOST_STEPS,
    ConfigError,
    Controller,
    Drift,
    EngineName,
    Flight,
    Random,
    Sample,
    Setup,
    Spacecraft,
    State,
    Table,
    Task,
    Timing,
)
from rans_assurance.follow.paths import SPACING, LookAhead

START_SPREAD = 0.2
"""Largest distance of a start from the path's first point, m."""
_LEAST_WAY = 0.75
"""Way of a flight, as a share of the way along the path, below which it has cut across. A tracker without error
flies around a circle of radius R at sqrt(R^2 - L^2) for the look-ahead L: 0.99 R for the paper's, 0.75 R for
L = 0.66 R."""
_PATIENCE = 1.5
_GRACE = 10.0
"""Factor on the duration of a flight at full speed, and seconds added to it: the time that a flight has."""


def _tracker(method: str) -> Any:
    """A method of `Guided` that calls the same method of the tracker's task."""
    return lambda self, *arguments: getattr(self.task, method)(*arguments)


@dataclass(frozen=True)
class Progress:
    """What a goal of `Guided` notes."""

    point: Any
    """(N,) number of the path's point that each flight has come to."""


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
        """Start at rest near the path's first point, and the first command."""
        first: Any = type(random.origin())(*self.planner.path.points[0])
        offset = random.direction().scale(random.uniform(0.0, START_SPREAD))
        start: Any = random.at_rest(first + offset, random.attitude())
        goal: Any = random.at_rest(random.origin(), random.no_rotation())
        begun = replace(goal, notes=Progress(np.zeros(len(start.p.x), dtype=int)))
        return start, self.remember(begun, start)

    def remember(self, goal: Any, state: State) -> Any:
        """The planner's command at the position of the spacecraft."""
        position = np.stack(state.p.columns(), axis=1)
        progress, _, command = self.planner.plan(position, goal.notes.point.astype(int))
        return replace(goal, v=type(goal.v)(*command.T), notes=Progress(progress))


@dataclass(frozen=True)
class Following:
    """N flights along a path.

    Errors count from the end of the approach (`LookAhead.approach`) to the end of the path. A flight
    that never leaves the approach is judged on its last instant.
    """

    planner: LookAhead
    flight: Flight
    """Motion of all flights for the full time, even after their arrival."""

    @property
    def progress(self) -> np.ndarray:
        """(T, N) progress of each flight, an index of the path's points, at each command."""
        return self.flight.goals.notes.point[:-1].astype(int)

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
        """(T, N) distance from the path at each command, m."""
        path = self.planner.path
        reach = self.planner.radius
        instants = zip(self.positions, self.progress, strict=False)
        return np.stack(
            [path.cross_track(position, progress, reach) for position, progress in instants]
        )

    @property
    def measured(self) -> np.ndarray:
        """(T, N) whether errors of the period count."""
        inside = (self.progress >= self.planner.approach) & (self.progress < self.planner.end)
        inside[-1] |= ~inside.any(axis=0)
        return inside

    @property
    def durations(self) -> np.ndarray:
        """(N,) time from the start to the end of the path, approach included, s; infinite if never.

        A flight that has cut across the path, so that its own way is much shorter, has not followed it to its end.
        """
        waited = (self.progress < self.planner.end).sum(axis=0)
        arrives = waited < len(self.progress)
        steps = np.linalg.norm(np.diff(self.positions, axis=0), axis=2)
        flown = np.cumsum(np.concatenate([0.0 * steps[:1], steps]), axis=0)
        arrival_times = flown[np.where(arrives, waited, 0), np.arange(len(waited))]
        arrives &= arrival_times >= _LEAST_WAY * self.planner.end * SPACING - START_SPREAD
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
        lap = "the approach and one lap" if self.planner.path.closed else "the path"
        # Root mean squares and means are over the measured part of each flight alone.
        root = np.sqrt(mean(distance**2))
        farthest = (distance * counts).max(axis=0)
        off = mean(np.abs(speed - aim))
        duty = 100.0 * mean(self.flight.openings.mean(axis=2))
        return tuple(
            Sample("path", name, meaning, unit, values)
            for name, meaning, unit, values in (
                ("cross-track RMS", "root mean square distance from the path", "cm", 100.0 * root),
                ("cross-track maximum", "largest distance from the path", "cm", 100.0 * farthest),
                ("velocity error", "mean distance from the command one period later", "cm/s", late),
                ("speed error", f"mean difference from {aim:g} m/s", "cm/s", 100.0 * off),
                ("duration", f"time for {lap}", "s", self.durations),
                ("duty", "mean duty cycle of the thrusters", "%", duty),
            )
        )

    def title(self) -> str:
        """Title in one line: tracker, path and speed."""
        arrived = int(np.isfinite(self.durations).sum())
        path = self.planner.path
        return (
            f"{self.flight.controller} along {path.name} ({path.length:.1f} m): {arrived} of "
            f"{len(self.durations)} flights arrive"
        )

    def table(self) -> Table:
        """A row for each quantity: mean and worst of the flights.

        "never" where a flight does not reach the path.
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
        path = self.planner.path
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
            "path": path.name,
            "length": path.length,
            "closed": path.closed,
            "speed": self.planner.speed,
            "look_ahead": self.planner.radius,
            "spacecraft": flight.craft.name,
            "control_period": flight.timing.control_period,
            "quantities": rows,
        }


def fly_path(
    craft: Spacecraft,
    task: Task,
    tracker: Controller,
    planner: LookAhead,
    timing: Timing,
    seed: int,
    count: int,
    engine: EngineName = "fast",
) -> Following:
    """Fly along a path, in float64.

    Flights start at rest with any attitude, up to `START_SPREAD` from the path's first point.

    Args:
        craft: spacecraft.
        task: task for which the tracker was made.
        tracker: controller that tracks velocities.
        planner: path, speed and look-ahead; a planar path also serves in space.
        timing: timing with the control period; its length is replaced by the time that all flights need.
        seed: seed of the starts.
        count: number of flights.
        engine: engine that computes the motion.

    Raises:
        ConfigError: the tracker does not track velocities or not such fast ones, or the path leaves the plane of a
            planar craft.
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
    if planner.path.dimension > craft.dimension:
        raise ConfigError(
            f"the path {planner.path.name} is spatial, but {craft.name} moves in a plane; "
            "give a path of x and y only, such as the circle."
        )
    if planner.path.dimension < craft.dimension:
        planner = replace(planner, path=planner.path.in_space())
    # A time in which every flight reaches the end of the path.
    seconds = _PATIENCE * planner.end * SPACING / planner.speed + _GRACE
    if (steps := math.ceil(seconds / timing.control_period)) > MOST_STEPS:
        raise ConfigError(
            f"at {planner.speed:g} m/s the path {planner.path.name} takes {steps:,} control "
            f"periods, of which a flight has at most {MOST_STEPS:,}: fly faster."
        )
    long_enough = replace(timing, episode_steps=steps)
    setup = Setup(craft, Guided(task, planner), long_enough)
    return Following(planner, fly_episodes(tracker, setup, seed, count, engine))
