"""Least impulse of an arrival in closed form: which thrusters to fire when, for very many states at once.

Where only the position of an arrival counts, its least impulse is a linear program with as many equations as the
position has components. What a unit of impulse of each thruster in each control period does to that position is
a point. The convex hull of all these points is what a unit of impulse can do at all, and the least impulse that
makes up for a miss is by how much the hull must be scaled for the miss to lie on it (its gauge: R. T. Rockafellar,
"Convex analysis", 1970, section 15). The corners of the facet that is met there are the firings.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from rans_missions.convex.rendezvous import Meeting


@dataclass(frozen=True)
class Firings:
    """Firings that each of N states needs: at most as many as positions have components d."""

    impulse: np.ndarray
    """(N,) of all together, N s."""
    period: np.ndarray
    """(N, d) control period of each firing, from now on."""
    thruster: np.ndarray
    """(N, d)"""
    command: np.ndarray
    """(N, d) command of that thruster in that period, 0 to 1 where the thruster is strong enough."""

    def now(self, thrusters: int) -> np.ndarray:
        """(N, thrusters) commands of the period that begins now."""
        commands = np.zeros((len(self.command), thrusters))
        row, column = np.nonzero(self.period == 0)
        np.add.at(commands, (row, self.thruster[row, column]), self.command[row, column])
        return commands


class Impulses:
    """Least impulses to the place of a meeting after a whole number of control periods.

    Speeds of arrival and limits on the way are not asked; commands may exceed full thrust where it is too little.

    Args:
        meeting: what is to be done.
        aim: share of the position's tolerance within which a transfer ends; a state whose coast ends within the
            tolerance needs none.
    """

    def __init__(self, meeting: Meeting, aim: float = 0.6) -> None:
        self._meeting = meeting
        self._aim = aim
        self._hulls: dict[int, _Hull] = {}

    def firings(self, states: np.ndarray, periods: int) -> Firings:
        """Least impulses from states (N, 2 d) for an arrival after so many control periods, at least one.

        The miss of a coast must be made up for by a sum of the hull's points, each times an impulse. The facet that
        the miss points at has the points of the least sum. It remembers the hull of each number of periods.
        """
        # By how much coasts miss the point of the meeting.
        meeting = self._meeting
        size = len(meeting.point)
        checks = np.array([periods * meeting.timing.checks])
        coasted = (
            meeting.free(np.zeros(2 * size), checks)[0] + states @ meeting.transition(checks[0]).T
        )
        missed = meeting.point - coasted[:, :size]
        if periods not in self._hulls:
            self._hulls[periods] = _Hull.of(meeting, periods)
        hull = self._hulls[periods]
        # Any position within the tolerance will do: stop short of the point, in the direction that saves most.
        direction = hull.normals[hull.facet(missed)]
        inside = self._aim * meeting.position_tolerance
        aimed = missed - inside * direction / np.linalg.norm(direction, axis=1, keepdims=True)
        coasts = np.linalg.norm(missed, axis=1) <= meeting.position_tolerance
        aimed[coasts] = 0.0
        # Impulses, N s, at the corners of the facet, whose points times these sum to the miss.
        corners = hull.corners[hull.facet(aimed)]
        points = hull.points[corners]
        impulses = np.linalg.solve(np.swapaxes(points, 1, 2), aimed[:, :, None])[:, :, 0]
        impulses = np.maximum(impulses, 0.0)
        # Points are numbered by period, then by thruster.
        period, thruster = np.divmod(corners, meeting.forces.shape[1])
        return Firings(impulses.sum(axis=1), period, thruster, impulses / meeting.price[thruster])

    def flown(self, states: np.ndarray, firings: Firings, checks: np.ndarray) -> np.ndarray:
        """States (N, L, 2 d) at checks (L,) from now on, of states (N, 2 d) that fire so.

        Firings whose period has not begun at a check do nothing there.
        """
        meeting = self._meeting
        _, offset, effect = meeting._tables
        result = np.einsum("lij,nj->nli", meeting.transition(checks), states) + offset[checks]
        for k in range(firings.command.shape[1]):
            age = checks[None, :] - meeting.timing.checks * firings.period[:, k, None]
            done = effect[np.maximum(age, 0), :, firings.thruster[:, k, None]]
            result += np.where(age > 0, firings.command[:, k, None], 0.0)[:, :, None] * done
        return result


@dataclass(frozen=True)
class _Hull:
    """Convex hull of the changes of an arrival's position by a unit of impulse."""

    points: np.ndarray
    """(periods m, d) by each thruster in each period, m per N s."""
    corners: np.ndarray
    """(F, d) numbers of the points at the corners of each facet."""
    normals: np.ndarray
    """(F, d) whose product with the facet's points is 1: prices of missing the position, N s per m."""

    @classmethod
    def of(cls, meeting: Meeting, periods: int) -> _Hull:
        size = len(meeting.point)
        effect = meeting.effect(periods * meeting.timing.checks, periods)[:size]
        points = (effect / np.tile(meeting.price, periods)).T
        hull = ConvexHull(points)
        # A facet is where normal . x + offset = 0, and the origin is inside: offset < 0.
        return cls(points, hull.simplices, hull.equations[:, :size] / -hull.equations[:, size:])

    def facet(self, missed: np.ndarray) -> np.ndarray:
        """(N,) facets that the rays from the origin along misses (N, d) pass through."""
        return np.argmax(missed @ self.normals.T, axis=1)
