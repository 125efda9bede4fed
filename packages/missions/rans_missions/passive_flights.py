"""Passive safety of flights near a target on an orbit: what if all thrusters shut, and stay shut?"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rans.extend import ClohessyWiltshire, ConfigError, Flight, Sample
from rans_missions.vectors import motion_of

if TYPE_CHECKING:
    from rans_missions.passive_safety import CoastZone


@dataclass(frozen=True)
class PassiveSafety:
    """Distances that coasts of N flights keep from the target, certified lower bounds."""

    zone: CoastZone
    """What coasts are asked to keep out of."""
    seconds: float
    """Time for which coasts last, s."""
    distance: np.ndarray
    """(N,) least distance of the coasts from every instant of the flight on, m; from the end of the first control
    period on where the coast from the start enters the zone."""
    start: np.ndarray
    """(N,) least distance of the coast from the start, m."""

    @property
    def unsafe(self) -> np.ndarray:
        """(N,) bool: whether a coast of the flight enters the zone."""
        return self.distance < self.zone.radius

    @property
    def unsafe_start(self) -> np.ndarray:
        """(N,) bool: whether the coast from the start enters it, whatever controller flies."""
        return self.start < self.zone.radius


def passive_safety(
    flight: Flight, seconds: float | None = None, zone: CoastZone | None = None
) -> PassiveSafety:
    """How near the target flights would coast if all thrusters shut at any instant, also in the midst of a burn.

    >>> starts = rans.scenarios(rans.Hold(), rans.load_spacecraft("vbar-chaser"), 7, 2)
    >>> controller = rans.MissionGuidance("vbar-chaser", "hold")
    >>> timing = rans.Timing(control_period=10.0, episode_steps=5)
    >>> flight = rans.fly("vbar-chaser", "hold", controller, starts, timing)
    >>> rans.passive_safety(flight).unsafe.shape
    (2,)

    Instants are those of the flight until its success, and until the end of the first control period within
    `CoastZone.approach` of the target. The distances are certified for all these instants and all instants of the
    coasts (`rans_missions.passive_safety`): thrust is constant in a control period, or has one direction.

    Args:
        flight: flights of a mission in a Clohessy-Wiltshire frame, in space.
        seconds: time for which coasts last, s; None: one orbit.
        zone: what coasts keep out of; None: the mission's.

    Raises:
        ConfigError: the mission has no circular orbit, or no zone.
    """
    from rans_missions.passive_safety import coasts_of_flights, least_distances, single_coasts

    drift = flight.task.drift
    zone = getattr(flight.task, "coast_zone", None) if zone is None else zone
    if not isinstance(drift, ClohessyWiltshire) or flight.craft.dimension != 3:
        raise ConfigError(
            f"passive safety is that of missions in space on a circular orbit, such as hold, and "
            f"{type(flight.task).__name__} is not one."
        )
    if zone is None:
        raise ConfigError(
            f"{type(flight.task).__name__} has no zone that coasts keep out of: give one."
        )
    n = drift.mean_motion
    seconds = 2.0 * math.pi / n if seconds is None else seconds
    period = flight.timing.control_period
    states = motion_of(flight.states)
    periods, count = flight.commands.shape[:2]
    # Periods that count: before success, before the approach, and with finite states.
    lengths = np.full(count, periods) if flight.lengths is None else np.asarray(flight.lengths)
    counted = np.arange(periods)[:, None] < lengths
    away = np.linalg.norm(states[..., :3], axis=-1) >= zone.approach
    finite: Any = np.isfinite(states).all(axis=-1)
    counted &= np.logical_and.accumulate(away[:-1], axis=0) & finite[1:] & finite[:-1]
    everyone = np.arange(count)
    start = least_distances(n, single_coasts(states[0], np.full(count, seconds), everyone), count)
    coasts = coasts_of_flights(
        n,
        states,
        counted & (flight.commands != 0.0).any(axis=2),
        counted.sum(axis=0),
        period,
        seconds,
        zone.radius,
        start >= zone.radius,
    )
    return PassiveSafety(zone, seconds, least_distances(n, coasts, count), start)


def samples(flight: Flight) -> Iterator[Sample]:
    """Metrics of passive safety of a flight whose task has a zone that coasts keep out of."""
    # Every flight of every task comes here: what computes coasts is imported for those that have a zone.
    zone: CoastZone | None = getattr(flight.task, "coast_zone", None)
    if zone is None:
        return
    safety = passive_safety(flight)
    until = f" before {zone.approach:g} m" if zone.approach else ""
    group = "passive safety"
    coasts = f"flights from which, thrusters shut{until}, an orbit's coast enters {zone.radius:g} m"
    yield Sample(group, "unsafe coasts", coasts, "%", safety.unsafe, key=True)
    starts = "starts from which a coast without any thrust enters it"
    yield Sample(group, "unsafe starts", starts, "%", safety.unsafe_start)
    least = "least distance of all coasts of all flights from the target, certified"
    yield Sample(group, "coast distance", least, "m", safety.distance, np.min, key=True)
