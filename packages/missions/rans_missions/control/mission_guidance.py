"""Guidance in closed form for missions on an orbit: the change of velocity that the mission recommends.

Drake, pages and kernels fly the same law; it only reads the state and the notes of the goal.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import replace
from functools import reduce
from operator import add
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rans import Conditions
from rans.extend import (
    ConfigError,
    Field,
    Heading,
    ModelBased,
    Quat,
    Spacecraft,
    Task,
    Timing,
    bounds,
    floor,
    largest,
    map_leaves,
    per_velocity,
    scenario,
    within,
)
from rans_missions.control.afterwards import Afterwards
from rans_missions.control.navigation_filter import NavigationFilter
from rans_missions.tasks.orbital import OrbitalMission
from rans_missions.vectors import components

_DOUBT = 2.0
"""Standard deviations of a correction below which it is not given: it would mostly correct errors of navigation."""
_SPEED_DOUBT = 3.0
"""Standard deviations of a measured velocity that recommendations stay farther below speed limits."""
_MOST_RESERVE = 0.5
"""Largest share of a speed limit that recommendations stay below it."""
_EARLY = 4.0
"""Control periods by which a craft that expects errors and brakes arrives sooner: a brake that was too weak or too
late is repeated before the deadline. Of 64 flights to hold with all errors 2 are lost then, 4 with two periods, and
5 without. It costs up to 3 % of the impulse where one error acts alone."""
_PUSHES = 3.0
"""Largest force, of uniform size and direction, over the standard deviation of one component."""
_UNIFORM = math.sqrt(12.0)
"""Width of a uniform distribution over its standard deviation."""
_PULSES = 1.25
"""Shortest pulses of a thruster that they stay farther below: burns are rounded down along every axis."""


class MissionGuidance(ModelBased):
    """Gives the change of velocity that a mission on an orbit recommends, in every control period.

    >>> rans.MissionGuidance("afrl-deputy", "dock")
    <mission: Dock for afrl-deputy>

    The recommendation (`rans_missions.tasks.orbital.OrbitalMission.recommended`) keeps below speed limits, goes
    around keep-out balls, stays inside the cone of rendezvous, and burns across the orbit's plane later where that
    is cheaper. Agents observe it.

    After the arrival it stays at the goal, and after a deadline that was missed it plans again
    (`rans_missions.control.afterwards`): in a simulator that does not end it flies on for ever.

    With known errors it estimates position, velocity and a constant force by a Kalman filter, gives no correction
    below two standard deviations, expects the mean command delay, and stays farther below speed limits. A mission
    without a brake it plans again with that speed in its first control period; at a hold point it arrives four
    control periods sooner. Once it stays it balances the force. Burns of pulsed thrusters are rounded down to whole
    pulses, except by missions that brake at the arrival. What is missing is given once it has grown to a pulse.

    Args:
        craft: by name, TOML file or as such; it has one throttled or pulsed thruster either way along each axis.
        task: a mission on an orbit, by name or as such.
        timing: control period, and length of the episode.
        conditions: what it knows about errors: noise of position and velocity, the ranges of thrust and command
            delay, and the largest constant force. The default is a perfect world.

    Raises:
        ConfigError: the task is no mission on an orbit or has limits that its recommendation does not keep, or the
            craft has other thrusters.
    """

    name = "mission"
    follows_orbits: ClassVar[bool] = True
    heeds_constraints: ClassVar[bool] = True

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        timing: Timing | None = None,
        conditions: Conditions | None = None,
    ) -> None:
        super().__init__(craft, task, timing)
        self._given = OrbitalMission.expected(
            self._task, "mission guidance flies missions on an orbit, such as dock and hold"
        )
        self._mission = self._given
        if not self.keeps_limits(self._given):
            raise ConfigError(
                f"mission guidance does not keep all limits of {type(self._given).__name__}; fly it with convex."
            )
        self._identity = Heading(0.0) if self._craft.dimension == 2 else Quat(1.0, 0.0, 0.0, 0.0)
        self._period = self._timing.control_period
        self._levers = np.array(per_velocity(self._craft, self._period))
        """Command that gives 1 m/s along each axis of B, 1/(m/s), (thrusters, d)."""
        self._changes = self._levers / (self._levers**2).sum(axis=1, keepdims=True)
        """Change of velocity in B that each full command gives, m/s, (thrusters, d)."""
        self._counts: int | None = None
        """Counts to which burns are rounded down; brakes at an arrival must not be too small."""
        if not self._mission.brakes:
            # Throttles have none.
            self._counts = getattr(self._craft.actuators, "counts", None)
        self._afterwards = Afterwards(self._craft, self._given, self._timing)
        self._expect(Conditions() if conditions is None else conditions)
        self._past: np.ndarray | None = None
        """Burn of the last period in W, m/s, (N, d)."""
        self._sooner: Field | None = None
        """Time by which its own plan arrives before that of the mission, s; None: it has not planned yet."""

    def _expect(self, conditions: Conditions) -> None:
        """Set the filter and the reserve below speed limits for known errors."""
        sensors = conditions.sensors
        noise = largest(sensors.velocity.noise)
        weakest, strongest = bounds(conditions.thrusters.thrust)
        soonest, latest = bounds(conditions.thrusters.command_delay)
        self._late = 0.5 * (soonest + latest) / self._period
        """Mean share of a burn that comes in the next period."""
        self._lateness = (latest - soonest) / (_UNIFORM * self._period)
        """Standard deviation of this share."""
        inexact = math.hypot(
            (strongest - weakest) / _UNIFORM, self._lateness, largest(conditions.thrusters.noise)
        )
        pushed = largest(conditions.disturbances.force) / (_PUSHES * self._craft.mass)
        position = largest(sensors.position.noise)
        self._early = 0.0
        """Time by which a craft that brakes arrives before the planned arrival, s."""
        self._filter: NavigationFilter | None = None
        uncertain = max(position, noise, inexact, self._late) > 0.0
        if uncertain and self._given.brakes:
            self._early = _EARLY * self._period
        if uncertain or (pushed > 0.0 and self._given.drift.steady):
            self._filter = NavigationFilter(
                self._mission.drift,
                self._craft.dimension,
                self._period,
                position,
                noise,
                inexact,
                acceleration=pushed,
            )
        pulse = 0.0 if self._counts is None else float(self._changes.max()) / self._counts
        # Independent errors of the speed, as shares of the lowest limit.
        mission = self._given
        base = mission.velocity_tolerance
        slower = math.hypot(_SPEED_DOUBT * noise / base, _PULSES * pulse / base, inexact)
        reserve = min(mission.speed_reserve + slower, _MOST_RESERVE)
        self._mission = replace(mission, speed_reserve=reserve)

    def expecting(self, conditions: Conditions | None) -> MissionGuidance:
        """Copy of this guidance that expects the errors of these conditions; None: a perfect world."""
        result = copy(self)
        result._afterwards = Afterwards(self._craft, self._given, self._timing)
        result._expect(Conditions() if conditions is None else conditions)
        result.reset(0)
        return result

    def command(self, state: Any, goal: Any) -> tuple[Field, ...]:
        """Commands of a perfect world from a state until the arrival, as arithmetic on fields; see `act`.

        Args:
            state: exact state.
            goal: goal with the times in its notes.
        """
        change = self._mission.recommended(state, goal, self._mission.arrival(goal)) - state.v
        return self._commands(state, change)

    def _commands(self, state: Any, change: Any) -> tuple[Field, ...]:
        """Commands that give a change of velocity in W, m/s, as far as a period can."""
        along = state.attitude.to(self._identity).rotate(change).columns()
        commands = []
        for lever in self._levers.tolist():
            parts = [x * component for x, component in zip(lever, along, strict=True) if x]
            command = within(reduce(add, parts), 0.0, 1.0)
            if self._counts is not None:
                command = floor(command * self._counts) * (1.0 / self._counts)
            commands.append(command)
        return tuple(commands)

    @staticmethod
    def keeps_limits(task: OrbitalMission) -> bool:
        """Whether all limits of a mission are of the kinds that its recommendation keeps."""
        goal = scenario(task, task.dimensions[0], seed=0, episode=0).goal
        return all(isinstance(limit, task.keeps) for limit in task.limits(goal).values())

    def reset(self, count: int) -> None:
        """See `rans.episode.flight.Controller`; forgets estimates."""
        self._past = None
        self._sooner = None
        self._afterwards.reset(count)
        if self._filter is not None:
            self._filter.reset()

    def act(self, state: Any, goal: Any, observation: np.ndarray) -> np.ndarray:
        """Commands (N, n) from the state and the times in the goal's notes; the observation is not read.

        Remembers its filter, its rounding, and who has arrived (`Afterwards`).
        """
        small: Any = 0.0
        if self._filter is not None:
            state, small = self._estimated(self._filter, state, self._mission.arrival(goal))
            if not self._mission.brakes:
                goal = self._planned(state, goal)
        goal = self._afterwards.goal(state, goal, exact=self._filter is None)
        left = self._mission.arrival(goal) - self._early
        change = self._mission.recommended(state, goal, left) - state.v
        burns = change.norm() > small
        change = map_leaves(lambda x: np.where(burns, x, 0.0), change)
        shape = np.shape(state.p.x)
        command = np.stack(self._commands(state, change), axis=-1)
        acceleration = None
        if self._filter is not None:
            acceleration = type(state.p)(*self._filter.acceleration().T)
        command = self._afterwards.commands(state, goal, command, acceleration)
        if self._filter is not None:
            burn_in_body = type(state.p)(*(command @ self._changes).T)
            burn = components(self._identity.to(state.attitude).rotate(burn_in_body), shape)
            past = 0.0 if self._past is None else self._past
            self._filter.burn((1.0 - self._late) * burn + self._late * past)
            self._past = burn
        return command

    def _planned(self, state: Any, goal: Any) -> Any:
        """Goal with the time of the cheapest arrival that keeps this guidance's reserve below speed limits.

        The mission planned the goal's own time with a smaller reserve. Whoever flies to that with the larger one is
        up to 3 s late, which can be after the deadline. The difference is computed once an episode.
        """
        arrival = self._mission.arrival(goal)
        if self._sooner is None:
            own = self._mission.plan(state, goal, goal.notes.deadline)
            self._sooner = arrival - self._mission.arrival(own)
        return replace(goal, notes=replace(goal.notes, arrival=arrival - self._sooner))

    def _estimated(
        self, navigation: NavigationFilter, state: Any, left: Any
    ) -> tuple[Any, np.ndarray]:
        """Estimated state after a reading, and the size of corrections (N,) that are not given, m/s.

        What is still to come of the last burn is part of the estimated velocity.
        """
        d = self._craft.dimension
        shape = np.shape(state.p.x)
        reading = np.concatenate(
            [components(vector, shape) for vector in (state.p, state.v)], axis=1
        )
        mean, covariance = navigation.read(reading)
        past = np.zeros((len(mean), d)) if self._past is None else self._past
        vector = type(state.p)
        p = vector(*mean[:, :d].T)
        v = vector(*(mean[:, d:] + self._late * past).T)
        # A correction is the miss of a coast over its time.
        time = np.broadcast_to(np.maximum(left, self._period), len(mean))
        of_p = np.trace(covariance[:, :d, :d], axis1=1, axis2=2)
        of_v = np.trace(covariance[:, d:, d:], axis1=1, axis2=2)
        mixed = np.trace(covariance[:, :d, d:], axis1=1, axis2=2)
        coming = ((self._lateness * past) ** 2).sum(axis=1)
        variance = of_p / time**2 + 2.0 * mixed / time + of_v + coming
        return replace(state, p=p, v=v), _DOUBT * np.sqrt(variance)
