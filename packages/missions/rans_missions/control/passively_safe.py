"""Base of guidance whose coasts keep out of a zone around the target, whenever the thrusters shut."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from rans.extend import Vec3
from rans_missions.control.velocity_guidance import Mission, VelocityGuidance
from rans_missions.orbits.reach import velocity_to_reach
from rans_missions.passive_safety import (
    carried,
    coast_zone,
    joined,
    least_distances,
    pieces_of_periods,
    pushed,
    single_coasts,
)

_PREDICTED = 8
"""Number of plans of each batch, safe if burns were impulses, whose flight is predicted."""
_CLEAR = 0.1
"""Least distance of the coasts of a predicted flight from the zone, m: for rounding to pulses."""


class SafePlan(NamedTuple):
    """The plan that a search for safe coasts has chosen."""

    row: int
    """Number of the plan."""
    distance: float
    """Distance from the target that its coasts keep, m."""


class PassivelySafeGuidance(VelocityGuidance[Mission]):
    """Base of guidance whose coasts of an orbit keep out of a zone around the target, whenever the thrusters shut.

    Plans have prices. In the order of these their coasts are computed, first of impulses and then of burns as they
    are flown (`rans_missions.passive_safety`).
    """

    @property
    def _radius(self) -> float:
        """Radius of the zone, m."""
        zone = coast_zone(self.task)
        assert zone is not None
        return zone.radius

    @property
    def _orbit(self) -> float:
        """Length of an orbit, s."""
        return 2.0 * math.pi / self.task.mean_motion

    def _coast_distance(self, start: np.ndarray) -> float:
        """Distance that the coast of an orbit from a state (6,) keeps, m."""
        coast = single_coasts(start[None], np.array([self._orbit]), np.array([0]))
        return float(least_distances(self.task.mean_motion, coast, 1)[0])

    def _change_to_coast(
        self, states: np.ndarray, points: np.ndarray, ends: np.ndarray, now: float
    ) -> np.ndarray:
        """Change of velocity in W, (N, 3) m/s, with which coasts lead from states (N, 6) to points (N, 3) in time.

        A burn over this control period acts as an impulse in its middle.

        Args:
            states: states at the beginning of the period.
            points: where the coasts end, m.
            ends: when they end, (N,) s.
            now: beginning of the period, s.
        """
        half = 0.5 * self._period
        middle = carried(self.task.mean_motion, states, np.full(len(states), half))
        left = np.maximum(ends - now - half, self._period)
        return self._coast_velocity(middle[:, :3], points, left) - middle[:, 3:]

    def _coast_velocity(self, p: np.ndarray, target: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Velocities (K, 3) with which coasts lead from positions (K, 3) to others in times (K,)."""
        v = velocity_to_reach(self.task.drift, Vec3(*p.T), Vec3(*target.T), time)
        return np.stack(v.columns(), axis=1)

    def _is_safe(self, distance: Any) -> Any:
        """Whether a predicted flight whose coasts keep this distance, m, is safe."""
        return distance > self._radius + _CLEAR

    def _cheapest_safe(
        self,
        order: np.ndarray,
        batch: int,
        of_impulses: Callable[[np.ndarray], np.ndarray],
        of_flights: Callable[[np.ndarray], np.ndarray],
    ) -> SafePlan | None:
        """The cheapest plan whose predicted flight is safe; else that whose coasts keep the largest distance.

        Args:
            order: numbers of the plans, the cheapest first.
            batch: number of plans whose coasts are computed at once.
            of_impulses: whether the coasts of plans (K,) keep out of the zone if burns are impulses, (K,).
            of_flights: distances (K,) that the coasts of plans (K,) keep, of burns as they are flown.

        Returns:
            The plan; None if no plan would be safe with impulses.
        """
        best: SafePlan | None = None
        for begin in range(0, len(order), batch):
            rows = order[begin : begin + batch]
            rows = rows[of_impulses(rows)][:_PREDICTED]
            if not len(rows):
                continue
            distances = of_flights(rows)
            safe = self._is_safe(distances)
            if safe.any():
                first = int(np.argmax(safe))
                return SafePlan(int(rows[first]), float(distances[first]))
            farthest = int(np.argmax(distances))
            if best is None or distances[farthest] > best.distance:
                best = SafePlan(int(rows[farthest]), float(distances[farthest]))
        return best

    def _predicted_distance(
        self,
        starts: np.ndarray,
        law: Callable[[np.ndarray, float], np.ndarray],
        steps: int,
        end: Any,
        is_unsafe_start: bool,
    ) -> np.ndarray:
        """Distance (K,), m, that coasts of K flights keep, with constant thrust in every control period.

        Args:
            starts: states (K, 6) from which they begin.
            law: change of velocity in W, (K, 3) m/s, that states (K, 6) get at a time, s.
            steps: number of control periods of the prediction.
            end: time, s, or times (K,), at which the last coasts end.
            is_unsafe_start: whether the coast from the start itself enters the zone. Of flights that burn in the
                first control period it then does not count, nor do coasts from within it. Of others it does.
        """
        n, period = self.task.mean_motion, self._period
        count = len(starts)
        states = starts
        # Coasts since the last burn of each flight, and the instant at which they began.
        coasts = states
        since = np.zeros(count)
        pieces = []
        for step in range(steps):
            now = step * period
            change = law(states, now)
            after = pushed(n, states, change / period, period)
            burn = np.flatnonzero(change.any(axis=1))
            if len(burn):
                if step or not is_unsafe_start:
                    # Thrusters may shut on the coast before this burn, and in the midst of it.
                    lasting = self._orbit + now - since[burn]
                    pieces.append(single_coasts(coasts[burn], lasting, burn))
                    family = pieces_of_periods(
                        n, states[burn], after[burn], period, self._orbit, self._radius, burn
                    )
                    pieces.append(family)
                since[burn] = now + period
                coasts = coasts.copy()
                coasts[burn] = after[burn]
            states = after
        pieces.append(single_coasts(coasts, end - since, np.arange(count)))
        return least_distances(n, joined(pieces), count)
