"""Least impulse of a team's inspection: a proven lower bound from who sees what, by when, and who must stay."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import linprog

from rans.extend import Spacecraft, SpatialState, Timing
from rans_missions.convex.inspection import between_checks, farthest, point_prices, responses
from rans_missions.team.task import InspectTeam
from rans_missions.vectors import components

_EVERY = 4
"""Checks of which one may be the end of an interval, or has a constraint of the zone."""
_CUTS = 8
"""Programs of one stay, each with the constraints that the flight of the last one breaks, at most."""


def team_bound(
    craft: Spacecraft,
    task: InspectTeam,
    starts: Sequence[SpatialState],
    goal: SpatialState,
    within: float,
    timing: Timing,
) -> float:
    """Lower bound of the impulse of all deputies together in any inspection that succeeds, N s.

    A success is at some check, in one interval of time. Deputy d has then spent at least its price c of each point
    that it has seen (`inspection_bound`), by the end of the interval, and at least the impulse s that keeps it in
    the zone until its beginning. If it has spent I, it has seen no point dearer than I. So the team spends at least
    the smallest sum of numbers I_d >= s_d for which enough points have c_dk <= I_d for some d, and at least the
    smallest of these sums over all intervals after enough points have been in light.

    It holds for every control law. It leaves out the keep-out ball, the distances between deputies, limits of the
    thrust, and that a deputy sees several points in one flight.

    Args:
        craft: as in `inspection_bound`.
        task: the inspection.
        starts: states of the deputies, of numbers.
        goal: goal of the same episode, with the angle of the sun at the start in its notes.
        within: time within which it must succeed, s.
        timing: control period and checks.

    Raises:
        ConfigError: see `inspection_bound`.
    """
    prices = np.stack([point_prices(craft, task, start, goal, within, timing) for start in starts])
    asked = task.points - max(math.ceil(task.unseen_tolerance * task.points - 1e-9) - 1, 0)
    enough = np.isfinite(prices[0]).sum(axis=1) >= asked
    if not enough.any():
        return math.inf
    stays = [_Stay(craft, task, start, within, timing) for start in starts]
    best = math.inf
    # A success after the check `begin`, at the check `end` at the latest.
    last = len(enough) - 1
    for begin in range(max(int(enough.argmax()) - 1, 0), last, _EVERY):
        least = [stay.price(begin) for stay in stays]
        # Later, stays cost no less and points no less than at the end.
        if best < math.inf and _divided(prices[:, last], least, asked, best) >= best:
            break
        best = min(best, _divided(prices[:, min(begin + _EVERY, last)], least, asked, best))
    return best


def _divided(prices: np.ndarray, least: Sequence[float], asked: int, best: float) -> float:
    """Smallest sum of budgets, each at least its own, that pay for enough points; at most ``best``.

    The last deputy pays for what the others leave, so that only their budgets are tried: `least` and prices of
    points.

    Args:
        prices: (D, points) N s.
        least: least budget of each deputy, N s.
        asked: number of points to be paid for.
        best: sum beyond which nothing is of interest, N s.
    """
    spare = prices.shape[1] - asked
    tried = [np.union1d(row[row > x], x) for row, x in zip(prices[:-1], least[:-1], strict=True)]
    for budgets in itertools.product(*tried):
        others = float(sum(budgets))
        if others + least[-1] >= best:
            continue
        left = (prices[:-1] > np.reshape(budgets, (-1, 1))).all(axis=0)
        dear = np.sort(prices[-1, left])[::-1]
        needed = dear[spare] if len(dear) > spare else 0.0
        best = min(best, others + max(float(needed), least[-1]))
    return best


class _Stay:
    """Least impulse with which a deputy is in the zone at the checks until a time.

    Linear programs over burns and tangents of the zone find multipliers l_j of constraints d_j . p(t_j) <= far.
    Their proof needs no program: an impulse of 1 N s at a time s lowers the sum of l_j d_j . p(t_j) by at most
    e(s), so that the flight costs at least (sum of l_j (d_j . p_free(t_j) - far)) / max e.
    """

    def __init__(
        self,
        craft: Spacecraft,
        task: InspectTeam,
        start: SpatialState,
        within: float,
        timing: Timing,
    ) -> None:
        self._craft, self._start = craft, start
        self._far = task.fail_distance
        step = timing.control_period / timing.checks
        times = step * np.arange(math.floor(within / step + 1e-9) + 1)
        p, _ = task.drift.carry(start.p, start.v, times)
        self._free = components(p, len(times))
        self._response = responses(task, times)
        self._between = between_checks(task, step)

    def price(self, last: int) -> float:
        """Certified lower bound, N s, until the check number ``last``."""
        free = self._free[: last + 1]
        checks = np.arange(last % _EVERY, last + 1, _EVERY)
        since = checks[:, None] - np.arange(0, last + 1, 2 * _EVERY)
        effect = self._response[np.maximum(since, 0)] * (since > 0)[..., None, None]
        effect = effect.transpose(0, 2, 1, 3).reshape(len(checks), 3, -1)
        burns = np.zeros(effect.shape[2])
        directions, when = np.zeros((0, 3)), np.zeros(0, int)
        best = 0.0
        for _ in range(_CUTS):
            p = free[checks] + effect @ burns
            distance = np.linalg.norm(p, axis=1)
            out = distance > self._far + 0.5
            if not out.any():
                break
            directions = np.concatenate([directions, p[out] / distance[out, None]])
            when = np.concatenate([when, np.flatnonzero(out)])
            rows = np.einsum("ci,cik->ck", directions, effect[when])
            missing = np.einsum("ci,ci->c", directions, free[checks[when]]) - self._far
            program = linprog(
                np.ones(2 * len(burns)), np.hstack([rows, -rows]), -missing, method="highs"
            )
            if program.status != 0:
                break
            burns = program.x[: len(burns)] - program.x[len(burns) :]
            multipliers = np.maximum(-program.ineqlin.marginals, 0.0)
            best = max(best, self._proven(multipliers, directions, checks[when], missing))
        return best

    def _proven(
        self,
        multipliers: np.ndarray,
        directions: np.ndarray,
        checks: np.ndarray,
        missing: np.ndarray,
    ) -> float:
        """Bound of the class from multipliers (M,) of constraints, any that are not negative, N s."""
        if not multipliers.any():
            return 0.0
        pull = np.zeros((checks.max() + 1, 3))
        for weight, direction, check in zip(multipliers, directions, checks, strict=True):
            if weight:
                pull[: check + 1] += weight * (direction @ self._response[check::-1])
        between = self._between * multipliers.sum() / self._craft.mass
        # Burns bring it nearer.
        most = farthest(self._craft, self._start, -pull).max() + between
        return float(multipliers @ missing / most)
