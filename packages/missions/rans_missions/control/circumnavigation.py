"""Guidance of inspections: the cheapest flight that linear programs find from ellipses around the target.

Times are since the start of the episode, s, positions in the Hill frame, m.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rans.extend import ConfigError, Spacecraft, Task, Timing, Vec3, map_leaves
from rans_missions.control.afterwards import Afterwards
from rans_missions.control.velocity_guidance import TRIM, PlannedBurns, VelocityGuidance
from rans_missions.convex.inspecting import BESIDE, Burns, InspectionSearch
from rans_missions.orbits.linear import carried
from rans_missions.tasks.hold import Hold, HoldPlan
from rans_missions.tasks.inspect import Inspect
from rans_missions.team.coasts import coasts_apart
from rans_missions.vectors import components, motion_of

_HALF_WIDTH = 30.0
"""Half width of the ellipses from which a search begins, m; with more of them prices do not fall."""
_PHASES = (-0.5, 0.0, 0.5)
"""Phases of the craft on them ahead of the sun, rad: from there half of what it sees is in light."""
_BLEND = 0.3
"""Part of an orbit in which such a beginning goes over from the coast to the ellipse."""
_LATER = (0, 20, 40, 80, 120, 160, 200, 260, 320, 400, 500, 640, 800, 1200, 1600, 2400)
"""Times after enough has been in light by which a team tries to end, s: later, all must be kept in the zone."""
_BEST = 2
"""Number of these from which the search begins in all ways: most often the price has one valley."""
_BEHIND = 40.0
"""Distance behind the target at which a craft stays that has seen enough, m."""
_AWAY = 1500.0
"""Time in which it goes there, s: a quarter of the orbit at 500 km."""


class Circumnavigation(VelocityGuidance[Inspect]):
    """Inspects a target for little impulse, alone or as a team, and then stays behind it.

    >>> rans.Circumnavigation("afrl-deputy", "inspect")
    <circumnavigation: Inspect for afrl-deputy>

    An ellipse around the target in the orbit's plane, twice as long as wide, is a natural motion: it needs no
    thrust, and turns in the Hill frame once an orbit, as the sun does. A craft that is near the sun's direction on
    it sees the lit side of the target all the time. From some of these ellipses, and from the coast without a burn,
    a search for the cheapest flight begins, by linear programs over burns in any direction
    (`rans_missions.convex.inspecting`), about a second of a core.

    Deputies of an `rans_missions.team.task.InspectTeam` are searched together, in about three seconds: points are
    divided by who sees each best, and the end is the one of several that is cheapest. Of the flights found, the
    cheapest is flown whose deputies stay apart also if all thrusters shut after any of its burns.

    Errors of more than 1 mm/s are corrected on the way. If a flight has ended and too little was seen, the next one
    is searched. Once enough has been seen, or while no flight is found, the craft goes to a point behind the target
    on its orbit and stays there, outside of the ball (`rans_missions.tasks.hold.Hold`). It knows
    the state exactly, and expects no errors of sensors and thrusters.

    Source of the motion: W. H. Clohessy and R. S. Wiltshire, "Terminal guidance system for satellite rendezvous",
    Journal of the Aerospace Sciences 27(9), 1960.

    Args:
        craft: by name, TOML file or as such.
        task: an `rans_missions.tasks.inspect.Inspect`, or its name.
        timing: control period, and length of the episode; None: the task's.
        within: time within which the inspection should end, s, None: the length of the episode. Shorter times need
            more impulse; where no flight is found in time, one of the length of the episode is searched.

    Raises:
        ConfigError: the task is no inspection, or its points are not visible down to their horizons.
    """

    name = "circumnavigation"
    slow: ClassVar[bool] = True
    mission = Inspect
    purpose = "circumnavigation flies inspections"

    def __init__(
        self,
        craft: str | Path | Spacecraft,
        task: str | Task,
        timing: Timing | None = None,
        within: float | None = None,
    ) -> None:
        super().__init__(craft, task, timing)
        if self.task.view_degrees != 90.0:
            raise ConfigError(
                "circumnavigation searches flights that see points down to their horizons: view_degrees must be "
                f"90, got {self.task.view_degrees:g}."
            )
        # Of an `rans_missions.team.task.InspectTeam`; a craft alone is a team of one.
        self._deputies: int = getattr(self.task, "deputies", 1)
        self._apart: float = getattr(self.task, "keep_apart", 0.0)
        self._length = self._period * self._timing.episode_steps
        self._within = self._length if within is None else within
        self._plans: PlannedBurns | None = None
        self._flying = np.zeros(0, bool)
        """Whether each craft flies what a search has found, (N,)."""
        self._finish = np.zeros(0)
        """When its next search is due if too little has been seen by then, (N,) s."""
        self._hold = Hold(
            mean_motion=self.task.mean_motion,
            hold_distance=_BEHIND,
            keep_out=self.task.keep_out,
            deadline=(_AWAY, _AWAY),
        )
        self._afterwards = Afterwards(self.craft, self._hold, self._timing)

    def reset(self, count: int) -> None:
        """See `rans.episode.flight.Controller`; forgets flights and estimates."""
        super().reset(count)
        self._afterwards.reset(count)
        self._plans = None

    def velocity_change(self, state: Any, goal: Any, now: float) -> tuple[np.ndarray, np.ndarray]:
        """Changes of velocity (N, 3), m/s, and which rows burn; see the base.

        Searches when it first sees a start, and again where a flight is over and too little is inspected;
        `_plans` remembers.
        """
        size = len(state.p.x)
        if self._plans is None:
            self._plans = PlannedBurns(
                self.task.drift, self._period, size, self._timing.episode_steps + 1
            )
            self._flying = np.zeros(size, bool)
            self._finish = np.full(size, -1.0)

        # Search where no flight has been found, and where one has ended too soon; leave where enough has been seen.
        enough = np.broadcast_to(self.task.unseen(goal) < self.task.unseen_tolerance, size)
        self._flying &= ~enough
        for row in np.flatnonzero((now > self._finish) & ~enough)[:: self._deputies]:
            self._search(int(row), state, goal, now, self._plans)

        change = self._plans.change(motion_of(state))
        if not self._flying.all():
            away = self._change_to_leave(state)
            away = np.where(np.linalg.norm(away, axis=1, keepdims=True) > TRIM, away, 0.0)
            change = np.where(self._flying[:, None], change, away)
        burns: Any = change.any(axis=1)
        return change, burns

    def _change_to_leave(self, state: Any) -> np.ndarray:
        """(N, 3) change of velocity in W, m/s, with which craft go behind the target and stay there.

        The law of `hold` is flown with a goal behind the target, whose deadline has passed: a new plan is made.
        """
        zero = np.zeros(np.shape(state.p.x))
        still = Vec3(zero, zero, zero)
        behind = replace(still, y=zero - _BEHIND * (1 + np.arange(len(zero)) % self._deputies))
        goal = replace(state, p=behind, v=still, notes=HoldPlan(zero, zero, zero, held=zero - 1.0))
        goal = self._afterwards.goal(state, goal)
        velocity = self._hold.recommended(state, goal, self._hold.arrival(goal))
        stays = self._hold.staying(state, goal)
        velocity = map_leaves(lambda a, b: np.where(self._afterwards.stays, a, b), stays, velocity)
        return components(velocity - state.v, len(zero))

    def _search(self, row: int, state: Any, goal: Any, now: float, plans: PlannedBurns) -> None:
        """Set the cheapest flight that a search finds in the rows of a team; none is found: it waits."""
        team = slice(row, row + self._deputies)
        starts = np.atleast_2d(motion_of(map_leaves(lambda x: x[team], state)))
        target = map_leaves(lambda x: float(x[row]), goal)
        sun = target.notes.sun
        inspected = np.array([bool(x) for word in self.task._known(target) for x in word])
        self._flying[team] = False
        self._finish[team] = now + _AWAY
        for within in dict.fromkeys((self._within - now, self._length - now, self._length)):
            if within <= self._period:
                continue
            burns = self._cheapest(starts, sun, inspected, within)
            if burns is not None:
                self._flying[team] = True
                self._finish[team] = now + burns.finish
                plans.begin(team, starts, burns.periods, burns.changes)
                return

    def _cheapest(
        self, starts: np.ndarray, sun: float, inspected: np.ndarray, within: float
    ) -> Burns | None:
        """The cheapest flight found from starts (D, 6) within a time, s; for a team, of several times up to it."""

        def search(within: float) -> InspectionSearch:
            return InspectionSearch(
                self.task, self._timing, starts, sun, inspected, within, self._most
            )

        whole = search(within)
        searches = [whole]
        if len(starts) > 1:
            ends = [self._period * math.ceil((whole.earliest + x) / self._period) for x in _LATER]
            searches = [search(end) for end in ends if end < within] + searches
            scanned = [(one.best([one.coast]), k) for k, one in enumerate(searches)]
            cheap = sorted(((burns.price, k) for burns, k in scanned if burns is not None))
            searches = [searches[k] for _, k in cheap[:_BEST]] or [whole]

        def is_safe(burns: Burns) -> bool:
            return self._coasts_apart(starts, burns) >= self._apart + BESIDE

        found = [one.best(self._beginnings(one, sun), is_safe) for one in searches]
        return min(
            filter(None, found), key=lambda burns: (not is_safe(burns), burns.price), default=None
        )

    def _coasts_apart(self, starts: np.ndarray, burns: Burns) -> float:
        """Least distance of two deputies on coasts after each burn of a flight from starts (D, 6), m."""
        states, last = starts, 0.0
        after = []
        for period, changes in zip(burns.periods, np.moveaxis(burns.changes, 1, 0), strict=True):
            middle = self._period * (period + 0.5)
            states = carried(self.task.drift, states, middle - last)
            states = states + np.pad(changes, ((0, 0), (3, 0)))
            after.append(states)
            last = middle
        return coasts_apart(self.task.mean_motion, np.reshape(after, (-1, *starts.shape)))

    def _beginnings(self, search: InspectionSearch, sun: float) -> list[np.ndarray]:
        """Paths (D, T, 3), m, from which a search begins: the coast, and ways of a craft to ellipses."""
        times, coast = search.times, search.coast
        turned = self.task.mean_motion * times
        blend = np.minimum(turned / (2.0 * math.pi * _BLEND), 1.0)[:, None]
        paths = [coast]
        for craft in range(len(coast)):
            for phase in _PHASES:
                angle = sun - turned + phase
                ellipse = _HALF_WIDTH * np.stack(
                    [np.cos(angle), 2.0 * np.sin(angle), 0.0 * angle], axis=1
                )
                path = coast.copy()
                path[craft] += blend * (ellipse - path[craft])
                paths.append(path)
        return paths
